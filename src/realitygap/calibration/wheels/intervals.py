"""Intervals of the wheels' constants, and which of them the counters cannot separate."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.fit import SIGMAS, blind_pairs, bounded, filling
from realitygap.calibration.wheels.odometry import Odometry
from realitygap.values import Floats
from realitygap.world.robot import Constant

__all__ = ["ASSUMED", "at_bound", "intervals", "with_lengths"]

ASSUMED = 0.02
"""Relative uncertainty of pulses per mm where they were not measured: sources say 12 or 12.5."""
LENGTHS = {"speed_left": (0,), "speed_right": (1,), "play_cm": (0, 1)}
"""Constants in cm, and the wheels whose cm per pulse they depend on."""
STEP = 1e-4
"""Step of the derivatives: this share of a value, or of a hundredth of its range."""
FEWEST_TRIALS, ROWS = 10, 20
"""With fewer trials the rows are grouped by this many (2 s)."""


def intervals(
    names: Sequence[str],
    theta: Floats,
    bounds: tuple[Floats, Floats],
    residuals: Callable[[Floats], Floats],
    trial: NDArray[np.int64],
    *,
    robust_at: float,
) -> tuple[tuple[Constant, ...], tuple[tuple[str, str, float], ...]]:
    """Constants with 95 % intervals, and pairs that the residuals cannot separate.

    Steps of one trial have correlated errors: the covariance is the sandwich clustered by trials (Liang and
        Zeger 1986), at least that of independent steps. A constant without effect gets its whole range; one
        whose interval ends at a bound is not identifiable (not `told`).

    Args:
        names: of the constants.
        theta: [p] where the fit ended.
        bounds: [p] lowest and highest values.
        residuals: [n] of theta.
        trial: [n] number of each residual's trial.
        robust_at: residual from which soft L1 reduces the weight.
    """
    low, high = bounds
    off = residuals(theta)
    z = (off / robust_at) ** 2
    columns = _columns(theta, bounds, residuals, off) * (high - low)
    curvature = columns.T @ (columns * (1.0 + z)[:, None] ** -1.5)  # soft L1's second derivative
    variance = max(float((off**2 / np.sqrt(1.0 + z)).sum()) / max(len(off) - len(theta), 1), 1e-300)
    # Without information all values within the bounds are equally likely: no division by zero.
    bread = np.linalg.inv(curvature / variance + np.eye(len(theta)))
    scores = columns * (off / np.sqrt(1.0 + z) / variance)[:, None]
    inner = filling(scores, _groups(trial)) + np.eye(len(theta))
    spread = np.maximum(np.diag(bread @ inner @ bread), np.diag(bread))
    deviation = np.sqrt(spread) * (high - low)
    told = (low < theta - SIGMAS * deviation) & (theta + SIGMAS * deviation < high)
    return bounded(names, theta, deviation, low, high, told), blind_pairs(names, curvature)


def with_lengths(constants: Sequence[Constant], odometry: Odometry | None) -> tuple[Constant, ...]:
    """Constants in cm with the uncertainty of the pulses' length added; not identifiable where that length is
    assumed."""
    shares = (ASSUMED, ASSUMED)
    if odometry is not None:
        lengths = {c.key: (c.high - c.low) / 2 / SIGMAS / c.value for c in odometry.constants}
        shares = (lengths.get("cm_per_pulse_left", 0.0), lengths.get("cm_per_pulse_right", 0.0))
    out = []
    for c in constants:
        share = max((shares[w] for w in LENGTHS.get(c.key, ())), default=0.0)
        below, above = (np.hypot(end - c.value, SIGMAS * share * c.value) for end in (c.low, c.high))
        wide = replace(
            c, low=max(float(c.value - below), 0.0), high=float(c.value + above),
            told=c.told and (odometry is not None or c.key not in LENGTHS),
        )  # fmt: skip
        out.append(wide)
    return tuple(out)


def at_bound(value: float, low: float, high: float) -> bool:
    """Whether a fitted value is at one of its bounds."""
    span = 1e-4 * (high - low)
    return not low + span < value < high - span


def _groups(trial: NDArray[np.int64]) -> NDArray[np.int64]:
    """[n] numbers of rows with correlated errors: a trial's, or a piece's where trials are few."""
    numbers = np.unique(trial, return_inverse=True)[1]
    if int(numbers.max(initial=0)) + 1 < FEWEST_TRIALS:
        numbers = np.unique(numbers * len(trial) + np.arange(len(trial)) // ROWS, return_inverse=True)[1]
    return np.asarray(numbers)


def _columns(
    theta: Floats, bounds: tuple[Floats, Floats], residuals: Callable[[Floats], Floats], off: Floats
) -> Floats:
    """[n, p] derivatives within the bounds; of both directions the smaller one, since unstable gains may be
    near."""
    low, high = bounds
    out = np.empty((len(off), len(theta)))
    for i, value in enumerate(theta):
        step = STEP * max(abs(value), 0.01 * (high[i] - low[i]))
        ways = []
        for to in (value + step, value - step):
            if low[i] <= to <= high[i]:
                moved = theta.copy()
                moved[i] = to
                ways.append((residuals(moved) - off) / (to - value))
        out[:, i] = min(ways, key=np.linalg.norm)
    return out
