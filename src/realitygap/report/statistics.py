"""Statistics for figures and tables: means and their uncertainty."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import t

__all__ = ["Mean", "difference", "mean_of", "running_best", "student"]


def student(freedom: float) -> float:
    """97.5 % point of Student's t: what a standard error is multiplied by for a 95 % interval."""
    return float(t.ppf(0.975, freedom)) if freedom > 0 else math.nan


@dataclass(frozen=True, kw_only=True)
class Mean:
    """A mean, the half width of its 95 % interval (nan for a single value), and the number of values."""

    value: float
    half: float
    count: int
    deviation: float = math.nan


def mean_of(values: ArrayLike) -> Mean | None:
    """The mean of some values, None without any."""
    array = np.asarray(values, dtype=float)
    if not array.size:
        return None
    if array.size == 1:
        return Mean(value=float(array[0]), half=math.nan, count=1)
    deviation = float(array.std(ddof=1))
    half = student(array.size - 1) * deviation / math.sqrt(array.size)
    return Mean(value=float(array.mean()), half=half, count=array.size, deviation=deviation)


def difference(first: ArrayLike, second: ArrayLike) -> Mean | None:
    """Excess of the first mean over the second, with Welch's 95 % interval; None below two values each."""
    a, b = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    if a.size < 2 or b.size < 2:
        return None
    va, vb = a.var(ddof=1) / a.size, b.var(ddof=1) / b.size
    gap = float(a.mean() - b.mean())
    if va + vb == 0:
        return Mean(value=gap, half=0.0, count=a.size + b.size)
    freedom = (va + vb) ** 2 / (va**2 / (a.size - 1) + vb**2 / (b.size - 1))
    return Mean(value=gap, half=student(freedom) * math.sqrt(va + vb), count=a.size + b.size)


def running_best(fitness: ArrayLike) -> np.ndarray:
    """The highest fitness so far at each evaluation."""
    return np.maximum.accumulate(np.asarray(fitness, dtype=float))
