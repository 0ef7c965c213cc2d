"""Tests, effect sizes and intervals for comparisons of two levels, and the peak of a curve.

Both are normal approximations of rank tests, corrected for ties and continuity.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from realitygap.correspondence.statistics import ranks
from realitygap.values import Floats

__all__ = ["Effect", "crossing", "holm", "interval", "paired", "peak", "unpaired"]

Interval = tuple[float, float]


class Effect(NamedTuple):
    """Excess of the first values over the second.

    `delta` is Cliff's: the share of pairs in which the first is higher, minus that in which it is lower;
    `difference` is that of the means; `p` is two-sided.
    """

    delta: float
    difference: float
    p: float
    delta_interval: Interval | None = None
    difference_interval: Interval | None = None


def paired(first: ArrayLike, second: ArrayLike, weights: Floats | None = None) -> Effect:
    """Effect between two values of the same controllers [n]: Wilcoxon's signed-rank test with Pratt's zeros.

    `weights` are resamples [B, n]: how often each is drawn.
    """
    gap = np.asarray(first, np.float64) - np.asarray(second, np.float64)
    sign = np.sign(gap)
    rank = (ranks(np.abs(gap)) + 1) * np.abs(sign)
    p = _two_sided(float((sign * rank).sum()), float((rank**2).sum()), step=1.0)
    effect = Effect(delta=float(sign.mean()), difference=float(gap.mean()), p=p)
    if weights is None:
        return effect
    drawn = weights.sum(axis=1)
    return effect._replace(
        delta_interval=interval(weights @ sign / drawn), difference_interval=interval(weights @ gap / drawn)
    )


def unpaired(
    first: ArrayLike, second: ArrayLike, *, strata: tuple[Sequence[object], Sequence[object]] | None = None,
    weights: tuple[Floats, Floats] | None = None,
) -> Effect:  # fmt: skip
    """Effect between two groups [n], [m]: Mann and Whitney's test, within strata.

    Args:
        first, second: values [n] and [m].
        strata: of either group; pairs of different strata do not count. None: one stratum.
        weights: resamples [B, n] and [B, m].
    """
    x, y = np.asarray(first, np.float64), np.asarray(second, np.float64)
    mine, theirs = strata or ([0] * len(x), [0] * len(y))
    number = {key: i for i, key in enumerate(dict.fromkeys([*mine, *theirs]))}
    a, b = np.array([number[k] for k in mine]), np.array([number[k] for k in theirs])
    fair = (a[:, None] == b[None, :]).astype(np.float64)
    sign = np.sign(x[:, None] - y[None, :]) * fair
    spread = sum(_spread(x[a == k], y[b == k]) for k in number.values())
    p = _two_sided(float(sign.sum()) / 2, spread, step=0.5)
    pairs = float(fair.sum())
    delta = float(sign.sum()) / pairs if pairs else math.nan
    effect = Effect(delta=delta, difference=float(x.mean() - y.mean()), p=p)
    if weights is None or not pairs:
        return effect
    u, v = weights
    with np.errstate(invalid="ignore"):
        deltas = ((u @ sign) * v).sum(axis=1) / ((u @ fair) * v).sum(axis=1)
    gaps = u @ x / u.sum(axis=1) - v @ y / v.sum(axis=1)
    return effect._replace(delta_interval=interval(deltas), difference_interval=interval(gaps))


def _spread(x: Floats, y: Floats) -> float:
    """Variance of U under the null hypothesis, corrected for ties."""
    n, m = len(x), len(y)
    total = n + m
    if not n or not m:
        return 0.0
    _, ties = np.unique(np.concatenate([x, y]), return_counts=True)
    tied = float((ties.astype(np.float64) ** 3 - ties).sum())
    return n * m / 12 * (total + 1 - tied / (total * (total - 1)))


def _two_sided(excess: float, variance: float, *, step: float) -> float:
    """p of a statistic's excess over its mean; `step` is half of its smallest change."""
    if variance <= 0:
        return 1.0
    z = max(abs(excess) - step, 0.0) / math.sqrt(variance)
    return math.erfc(z / math.sqrt(2))


def holm(p: Sequence[float]) -> list[float]:
    """p-values with Holm's correction (1979)."""
    order = sorted(range(len(p)), key=lambda i: p[i])
    corrected, running = [1.0] * len(p), 0.0
    for place, i in enumerate(order):
        running = max(running, min(1.0, (len(p) - place) * p[i]))
        corrected[i] = running
    return corrected


def interval(values: ArrayLike, share: float = 0.95) -> Interval:
    """The middle 95 % of resampled values; nan are left out."""
    known = np.asarray(values, np.float64)
    known = known[np.isfinite(known)]
    if not known.size:
        return (math.nan, math.nan)
    low, high = np.quantile(known, [(1 - share) / 2, (1 + share) / 2])
    return float(low), float(high)


def peak(levels: ArrayLike, curves: ArrayLike) -> Floats:
    """Levels [B] at which curves [B, L] are highest: the top of a parabola over the level's root.

    The parabola passes through the highest value and its neighbours; if an end is highest, it is the peak.
    """
    root, rows = np.sqrt(np.asarray(levels, np.float64)), np.atleast_2d(np.asarray(curves, np.float64))
    tops = np.empty(len(rows))
    for b, row in enumerate(rows):
        i = int(row.argmax())
        tops[b] = root[i]
        if 0 < i < len(root) - 1:
            x, y = root[i - 1 : i + 2] - root[i], row[i - 1 : i + 2] - row[i]
            curve = (y[2] / x[2] - y[0] / x[0]) / (x[2] - x[0])
            if curve < 0:
                tops[b] += -(y[0] / x[0] - curve * x[0]) / (2 * curve)
    result: Floats = tops**2
    return result


def crossing(levels: ArrayLike, curves: ArrayLike) -> Floats:
    """Levels [B] at which falling curves [B, L] first pass zero, linear in the level's root; else nan."""
    root, rows = np.sqrt(np.asarray(levels, np.float64)), np.atleast_2d(np.asarray(curves, np.float64))
    found = np.full(len(rows), np.nan)
    for b, row in enumerate(rows):
        below = np.flatnonzero((row[:-1] > 0) & (row[1:] <= 0))
        if below.size:
            i = int(below[0])
            share = row[i] / (row[i] - row[i + 1])
            found[b] = (root[i] + share * (root[i + 1] - root[i])) ** 2
    return found
