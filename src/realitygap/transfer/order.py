"""Whether two measures order controllers alike, with a bootstrap over units."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.statistics import correlation
from realitygap.values import Floats

__all__ = ["SUBSTITUTE", "Order", "mean", "means", "order_of"]

SUBSTITUTE = 0.8
"""Spearman's rho above which one measure may replace another (`docs/noise-level-2.md`)."""
RESAMPLES = 1000
LEAST = 3
"""Smallest number of controllers whose order is meaningful."""


@dataclass(frozen=True, kw_only=True)
class Order:
    """Agreement of measures on the order of one task's controllers on one kind of robot.

    All correlations except `fitness` are Spearman's rho, with 1 for the same order: a smaller distance ranks
    with a higher score. NaN with too few controllers, or nothing to compare.

    Attributes:
        task, individual, kind: of the controllers.
        controllers, units: their numbers.
        rho: of the distance without a camera with the camera's score; low, high: its 95 % interval.
        verdict: "a substitute" (low above 0.8), "no substitute" (high below it), or "open".
        readings, commands, speeds, replay: as rho, of each part alone and of the replayed commands' error.
        fitness: Pearson's r of simulated and situated fitness (Kadian et al. 2020); fitness_low,
            fitness_high: its 95 % interval over controllers.
        simulated, pseudo: rho of situated fitness with fitness in simulation and in pseudo-realities.
    """

    task: str
    individual: str
    kind: str
    controllers: int
    units: int
    rho: float
    low: float
    high: float
    verdict: str
    readings: float
    commands: float
    speeds: float
    replay: float
    fitness: float
    fitness_low: float
    fitness_high: float
    simulated: float
    pseudo: float


def order_of(
    names: tuple[str, str, str], distance: Floats, score: Floats, columns: Mapping[str, Floats],
    home: NDArray[np.int64] | None = None,
) -> Order:  # fmt: skip
    """Compare all measures of a group of controllers.

    Args:
        names: task, individual, kind of robot.
        distance: [controllers, units] without a camera, NaN without a drive.
        score: [controllers, units] by the camera, NaN without a camera.
        columns: [controllers] of each other measure, by name.
        home: [controllers] calibration units, if each has controllers of its own; None if all controllers
            drove the same units.
    """
    low, high = _interval(distance, score) if home is None else _interval_by_home(distance, score, home)
    verdict = "a substitute" if low > SUBSTITUTE else "no substitute" if high < SUBSTITUTE else "open"
    task, individual, kind = names
    seen, situated = columns["correspondence"], columns["fitness_situated"]
    both = np.isfinite(columns["fitness_simulated"]) & np.isfinite(situated)
    fitness, fitness_low, fitness_high = math.nan, math.nan, math.nan
    if both.sum() >= LEAST:
        pearson = correlation(columns["fitness_simulated"][both], situated[both])
        fitness, (fitness_low, fitness_high) = pearson.r, pearson.interval
    return Order(
        task=task, individual=individual, kind=kind, controllers=distance.shape[0], units=distance.shape[1],
        rho=_rho(-means(distance), means(score)), low=low, high=high, verdict=verdict,
        readings=_rho(-columns["readings"], seen), commands=_rho(-columns["commands"], seen),
        speeds=_rho(-columns["speeds"], seen), replay=_rho(-columns["replay_cm"], seen),
        fitness=fitness, fitness_low=fitness_low, fitness_high=fitness_high,
        simulated=_rho(columns["fitness_simulated"], situated),
        pseudo=_rho(columns["fitness_pseudo"], situated),
    )  # fmt: skip


def _rho(first: Floats, second: Floats) -> float:
    """Spearman's rho of the controllers known to both; NaN for too few."""
    both = np.isfinite(first) & np.isfinite(second)
    if both.sum() < LEAST:
        return math.nan
    return correlation(first[both], second[both], resamples=0).rho


def mean(values: Sequence[float]) -> float:
    """Mean of the known values; NaN for none."""
    known = [value for value in values if math.isfinite(value)]
    return math.fsum(known) / len(known) if known else math.nan


def means(values: Floats, weights: Floats | None = None) -> Floats:
    """[controllers] means over the units that each drove, NaN for none."""
    weighed = np.isfinite(values) * (np.ones(values.shape[1]) if weights is None else weights)
    total = weighed.sum(axis=1)
    sums = (np.where(np.isfinite(values), values, 0.0) * weighed).sum(axis=1)
    found: Floats = np.divide(sums, total, out=np.full(len(values), np.nan), where=total > 0)
    return found


def _interval(distance: Floats, score: Floats) -> tuple[float, float]:
    """95 % interval of rho: units, which all controllers drove, and controllers are resampled."""
    draw, made = np.random.default_rng(0), []
    controllers, units = distance.shape
    for _ in range(RESAMPLES):
        times = np.bincount(draw.integers(0, units, units), minlength=units).astype(float)
        rows = draw.integers(0, controllers, controllers)
        made.append(_rho(-means(distance, times)[rows], means(score, times)[rows]))
    return _middle(made)


def _interval_by_home(distance: Floats, score: Floats, home: NDArray[np.int64]) -> tuple[float, float]:
    """95 % interval of rho: calibration units are drawn with replacement, each with its controllers.

    These keep all units that they drove: resampling a controller's few would add noise to its measures and to
        rho.
    """
    draw, own = np.random.default_rng(0), [np.flatnonzero(home == unit) for unit in np.unique(home)]
    far, near = -means(distance), means(score)
    drawn = (draw.integers(0, len(own), len(own)) for _ in range(RESAMPLES))
    rows = (np.concatenate([own[k] for k in units]) for units in drawn)
    return _middle([_rho(far[some], near[some]) for some in rows])


def _middle(made: list[float]) -> tuple[float, float]:
    """The middle 95 % of the known values."""
    known = np.array(made)[np.isfinite(made)]
    low, high = np.quantile(known, [0.025, 0.975]) if len(known) else (np.nan, np.nan)
    return float(low), float(high)
