"""Random search for constants in which readings jump, so that derivatives do not help (§3.3).

At the edge of the robot's own shadow a tenth of a millimetre switches a ray on or off, and least squares stop
at the first such edge. So constants are drawn at random about the best. One draw evaluates all places for all
sensors at once, since a sensor's constants change only its own readings.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.solve import ROBUST_AT, Free, Measured, Model, Values
from realitygap.values import Floats

__all__ = ["DRAWS", "search"]

DRAWS = 2000
"""Evaluations of all places. With 3000 the error on fresh places of three twin units was the same."""
COMMON_EVERY = 3
"""Every third draw changes the constants that all sensors share."""
AFAR = 0.5
"""This share of draws uses the initial step size, to leave the neighbourhood of the best."""
WIDER, NARROWER, NARROWEST, WIDEST = 1.8, 0.94, 0.01, 4.0
"""Steps grow when a draw is better and shrink when it is not; the limits of their factor."""
GAIN, LITTLE = "log_gain", 1e-3


@dataclass(frozen=True, kw_only=True)
class _Best:
    """The best values so far, and each sensor's misfit and priors there, [S]."""

    values: dict[str, Floats]
    cost: Floats


def search(
    frees: Sequence[Free], model: Model, measured: Measured, values: Values, *, draws: int = DRAWS
) -> dict[str, Floats]:
    """Better values of the constants with a `jump`, and of gains, if any; never worse ones.

    Args:
        frees: all constants.
        model: their noise-free readings.
        measured: readings, and which of them count.
        values: where to begin.
        draws: evaluations.
    """
    draw = np.random.default_rng(0)
    sensors = measured.counts.shape[1]
    own = [f for f in frees if f.jump and len(f.start) == sensors]
    common = [f for f in frees if f.jump and len(f.start) == 1]
    cost = _Cost(own, model, measured)
    best = cost.of({key: np.array(value) for key, value in values.items()})
    step, common_step = np.ones(sensors), np.ones(1)
    for k in range(draws):
        if k % COMMON_EVERY == 0:
            tried = cost.of(best.values | {f.key: _near(f, best, common_step, draw) for f in common})
            better = bool(tried.cost.sum() < best.cost.sum())
            best = tried if better else best
            common_step = _stepped(common_step, np.array([better]))
            continue
        afar = draw.random() < AFAR
        moved = {f.key: _near(f, best, np.ones(sensors) if afar else step, draw) for f in own}
        tried = cost.of(best.values | moved)
        won = tried.cost < best.cost
        keys = [*moved, *({GAIN} & values.keys())]
        best = _Best(
            values=best.values | {key: np.where(won, tried.values[key], best.values[key]) for key in keys},
            cost=np.where(won, tried.cost, best.cost),
        )
        step = step if afar else _stepped(step, won)
    return best.values


class _Cost:
    """The cost of values, with the best gains for them."""

    def __init__(self, own: Sequence[Free], model: Model, measured: Measured) -> None:
        self._own, self._model = own, model
        self._counts, self._noise, self._use = measured.counts, measured.noise, measured.use

    def of(self, values: dict[str, Floats]) -> _Best:
        """Cost [S] as in least squares (soft L1, priors), after one step towards the best gains."""
        if GAIN in values:
            values = values | {GAIN: self._gains(values)}
        off = self._off(values)
        cost = 2.0 * ROBUST_AT**2 * (np.sqrt(1.0 + (off / ROBUST_AT) ** 2) - 1.0).sum(axis=0)
        for free in self._own:
            if free.prior:
                cost = cost + ((values[free.key] - free.start) / free.prior) ** 2
        return _Best(values=values, cost=cost)

    def _gains(self, values: dict[str, Floats]) -> Floats:
        """One step towards the best gains [S]."""
        gain = np.broadcast_to(values[GAIN], self._counts.shape[1:])
        off = self._off(values | {GAIN: gain})
        slope = (self._off(values | {GAIN: gain + LITTLE}) - off) / LITTLE
        weight = 1.0 / np.sqrt(1.0 + (off / ROBUST_AT) ** 2)
        curvature = (weight * slope * slope).sum(axis=0)
        return np.asarray(gain - (weight * slope * off).sum(axis=0) / np.maximum(curvature, 1e-12))

    def _off(self, values: dict[str, Floats]) -> Floats:
        return np.where(self._use, (self._model(values) - self._counts) / self._noise, 0.0)


def _near(free: Free, best: _Best, step: Floats, draw: np.random.Generator) -> Floats:
    moved = best.values[free.key] + draw.standard_normal(len(free.start)) * free.jump * step
    return np.clip(moved, free.low, free.high)


def _stepped(step: Floats, better: NDArray[np.bool_]) -> Floats:
    return np.asarray(np.clip(np.where(better, step * WIDER, step * NARROWER), NARROWEST, WIDEST))
