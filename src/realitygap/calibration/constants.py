"""Fitted constants: their intervals, and which of them the data cannot separate."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from realitygap.values import Floats
from realitygap.world.robot import Constant

__all__ = ["SIGMAS", "blind_pairs", "bounded", "filling", "moved"]

SIGMAS = 1.96
"""Intervals hold 95 %."""
ALIKE, BLIND = 0.95, 1e-5
"""Correlation from which two constants count as inseparable."""


def moved(constant: Constant, values: Mapping[str, Floats]) -> Constant:
    """A constant with its final value, and its interval shifted with it."""
    key, _, number = constant.key.rstrip("]").partition("[")
    value = float(values[key][int(number or 0)])
    by = value - constant.value
    return replace(constant, value=value, low=constant.low + by, high=constant.high + by)


def bounded(
    names: Sequence[str], values: Floats, size: Floats, low: Floats, high: Floats, told: NDArray[np.bool_]
) -> tuple[Constant, ...]:
    """Constants with 95 % intervals, cut off at their bounds.

    Args:
        names: p of them.
        values: the fitted values [p].
        size: their standard errors [p].
        low, high: their bounds [p].
        told: whether each is identifiable [p].
    """
    least, most = np.fmax(low, values - SIGMAS * size), np.fmin(high, values + SIGMAS * size)
    columns = (column.tolist() for column in (values, least, most, told))
    return tuple(
        Constant(key=name, value=value, low=a, high=b, told=sure)
        for name, value, a, b, sure in zip(names, *columns, strict=True)
    )


def filling(scores: Floats, clusters: NDArray[np.int64]) -> Floats:
    """[p, p] the middle ("meat") of a sandwich covariance from scores [n, p]; rows of one cluster [n] have
    correlated errors.

    Liang and Zeger, "Longitudinal data analysis using generalized linear models" (Biometrika 73, 1986).
    """
    groups = np.unique(clusters, return_inverse=True)[1]
    sums = np.zeros((int(groups.max()) + 1, scores.shape[1]))
    np.add.at(sums, groups, scores)
    return np.asarray(sums.T @ sums * (len(sums) / max(len(sums) - 1, 1)))


def blind_pairs(names: Sequence[str], curvature: Floats) -> tuple[tuple[str, str, float], ...]:
    """Pairs of constants whose estimates correlate with `|ρ| ≥ 0.95`; of two kinds of constant only the
    closest pair."""
    size = np.sqrt(np.diag(curvature))
    moves = np.flatnonzero(size > 1e-9 * size.max(initial=1e-300))
    names, size = [names[int(i)] for i in moves], size[moves]
    values, vectors = np.linalg.eigh(curvature[np.ix_(moves, moves)] / np.outer(size, size))
    inverse = (vectors / np.maximum(values, BLIND)) @ vectors.T
    scale = np.sqrt(np.maximum(np.diag(inverse), 1e-12))
    rho = np.clip(inverse / np.outer(scale, scale), -1.0, 1.0)
    closest: dict[tuple[str, str], tuple[str, str, float]] = {}
    for i, j in np.argwhere(np.tril(np.abs(rho) >= ALIKE, -1)).tolist():
        first, second = sorted(names[k].partition("[")[0] for k in (i, j))
        kinds = (first, second)
        # A shift's mean is fixed at 0 by definition.
        shifted = kinds[1] == f"{kinds[0]}_shift" or (kinds[0] == kinds[1] and kinds[0].endswith("_shift"))
        pair = (names[i], names[j], float(rho[i, j]))
        if not shifted and abs(pair[2]) > abs(closest.get(kinds, ("", "", 0.0))[2]):
            closest[kinds] = pair
    return tuple(sorted(closest.values(), key=lambda pair: -abs(pair[2])))
