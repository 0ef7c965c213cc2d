"""Uncertainty of a comparison, and further statistics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.trials import RADIUS_CM, STEP_S, Trial
from realitygap.errors import UsageError
from realitygap.values import Floats

if TYPE_CHECKING:
    from realitygap.correspondence.score import Distances

__all__ = ["parting_s", "resampled_weights", "transferability", "two_sample_p"]

NEIGHBOURS = 3


def resampled_weights(distances: Distances, draw: np.random.Generator, count: int) -> tuple[Floats, Floats]:
    """Weights [count, n] of both sides in so many resamples: starts drawn with replacement, and units
    likewise.

    Matched starts are drawn together for both sides.
    """
    starts, size = distances.starts, int(distances.starts.max()) + 1
    sides = []
    for side, trials in zip(distances.sides, (distances.a, distances.b), strict=True):
        names = sorted({t.unit for t in trials})
        sides.append((side, np.unique(starts[side > 0]), [names.index(t.unit) for t in trials]))
    made = np.empty((2, count, len(starts)))
    for k in range(count):
        drawn = np.bincount(draw.integers(0, size, size), minlength=size)
        for weights, (side, own, unit) in zip(made[:, k], sides, strict=True):
            if not distances.matched:
                drawn = np.bincount(draw.choice(own, len(own)), minlength=size)
            weights[:] = side * drawn[starts]
            if (units := max(unit) + 1) > 1:
                times = np.bincount(draw.integers(0, units, units), minlength=units)
                weights[side > 0] *= times[unit]
    return made[0], made[1]


def two_sample_p(distances: Distances, *, permutations: int = 199, seed: int = 0) -> float:
    """Permutation p of a classifier two-sample test: do nearest neighbours reveal a trial's set?

    A test only, not a scale, since it saturates. Matched starts are swapped within their pair, others change
    sides with all their trials, and a trial's neighbours never have its own start. (Lopez-Paz and Oquab, ICLR
    2017.)
    """
    far = np.where(distances.counts, distances._between, np.inf)
    order = np.argsort(far, axis=1)[:, :NEIGHBOURS]
    truth = distances.sides[0] > 0
    draw = np.random.default_rng(seed)

    def right(labels: NDArray[np.bool_]) -> Floats:
        """Share of correct guesses under each row of labels."""
        return np.asarray((labels[:, order] == labels[:, :, None]).mean(axis=(1, 2)))

    starts = distances.starts
    if distances.matched:
        swapped = draw.random((permutations, starts.max() + 1)) < 0.5
        labels = truth ^ swapped[:, starts]
    else:
        side = np.zeros(starts.max() + 1, dtype=bool)
        side[starts] = truth  # trials of one start are correlated: they change sides together
        labels = draw.permuted(np.tile(side, (permutations, 1)), axis=1)[:, starts]
    at_least = int((right(labels) >= right(truth[None]) - 1e-12).sum())
    return (1 + at_least) / (1 + permutations)


def parting_s(a: Sequence[Trial], b: Sequence[Trial]) -> list[float | None]:
    """The time at which each pair of trials of one start was a body's radius apart, s; None: never while both
    lasted."""
    found: list[float | None] = []
    for one, other in _pairs(a, b):
        n = min(len(one), len(other))
        apart = np.hypot(one.x[:n] - other.x[:n], one.y[:n] - other.y[:n]) > RADIUS_CM
        found.append(float(apart.argmax()) * STEP_S if apart.any() else None)
    return found


def transferability(simulated: Sequence[Trial], situated: Sequence[Trial]) -> float:
    """Minus the disparity of paired trajectories: 0 is perfect (Koos, Mouret and Doncieux 2013).

    The disparity is the mean squared distance between robots with a common start, over the mean squared
    distance of both from it. −1: as far from each other as from the start.

    Raises:
        UsageError: no start in common.
    """
    apart, gone = 0.0, 0.0
    for one, other in _pairs(simulated, situated):
        n = min(len(one), len(other))
        apart += float(((one.x[:n] - other.x[:n]) ** 2 + (one.y[:n] - other.y[:n]) ** 2).mean())
        for t in (one, other):
            gone += float(((t.x[:n] - t.x[0]) ** 2 + (t.y[:n] - t.y[0]) ** 2).mean()) / 2
    if not _pairs(simulated, situated):
        raise UsageError("transferability: expected trials of both sets with one start in common, got none.")
    return -apart / max(gone, 1e-9)


def _pairs(a: Sequence[Trial], b: Sequence[Trial]) -> list[tuple[Trial, Trial]]:
    return [(one, other) for one in a for other in b if one.start == other.start]
