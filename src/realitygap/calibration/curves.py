"""A monotone curve for each sensor: a table of counts at equal steps, fitted to its readings.

Penalised least squares: a penalty on bends over the share, or over the light itself (Whittaker 1923); falling
steps are penalised until there are none (Eilers 2005); a sensor with few readings follows the curve that all
sensors share. Matrices are kept as bands [3, S, STEPS + 1], diagonal last. Readings at an end of the
converter are censored (Tobin 1958).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from realitygap.kernels.curves import STEPS, normal, solved
from realitygap.values import Floats

Use = NDArray[np.bool_]

BRIGHT = 0.9
"""Beyond this share all steps count as equally much light. Towards a share of 1 the light goes to infinity,
and a curve penalised for bends over the light would depend on its far end, and so on rounding errors."""
ALIKE, ALIKES = 0.3, (0.3, 0.1, 0.03, 0.01)
"""How alike sensors' curves usually are; and for sensors with gains of their own, the values tried on
held-out places."""
SMOOTH = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""Weights of bends that are tried on held-out places."""


def _light() -> Floats:
    """[STEPS + 1] light at each step of a curve, in arbitrary units."""
    share = np.arange(STEPS) / STEPS
    gap = np.diff((share / (1.0 - share)) ** 2)
    return np.cumsum([0.0, *np.minimum(gap, gap[int(BRIGHT * STEPS)]), gap[int(BRIGHT * STEPS)]])


def _bends(at: Floats) -> Floats:
    """[3, STEPS + 1] bands of the sum of squared second differences of a curve over `at`; with equal steps
    these are the ordinary ones."""
    gap = np.diff(at)
    wide = (gap[1:] + gap[:-1]) / 2.0
    row = np.stack([wide / gap[:-1], -wide / gap[:-1] - wide / gap[1:], wide / gap[1:]])
    bands = np.zeros((3, STEPS + 1))
    for k in range(3):
        for j in range(k, 3):
            bands[2 - j + k, j : STEPS - 1 + j] += row[k] * row[j]
    return bands


OVER_SHARE = _bends(np.arange(STEPS + 1.0))
OVER_LIGHT = _bends(_light())


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """The data of a curve fit: counts [n, S] up to `top`, of which `use` [n, S] count, and their noise; a
    sensor saturates at `most`, [S] or one for all.

    Readings below `dead` are 0; `smooth` weighs bends over the share, or over the light if `linear`; `alike`
    is the expected deviation of a sensor's curve from the common one, as a share of the full scale.
    """

    counts: Floats
    use: Use
    top: float
    most: Floats | float
    noise: float
    dead: float = 0.0
    smooth: float = SMOOTH[1]
    linear: bool = False
    alike: float = ALIKE

    def dark(self) -> float:
        """Noise in the dark: the size of readings near 0."""
        low = self.counts[self.use & (self.counts < max(3.0 * self.noise, self.dead))]
        return float(np.sqrt(np.mean(low**2))) if len(low) else 0.0


def on_curves(curves: Floats, u: Floats) -> Floats:
    """Counts [n, S] of sensors on their curves [S, STEPS + 1] at shares u [n, S]."""
    at = np.clip(u, 0.0, 1.0) * STEPS
    j = np.minimum(at.astype(np.int64), STEPS - 1)
    k = np.arange(curves.shape[0])
    return np.asarray(curves[k, j] + (at - j) * (curves[k, j + 1] - curves[k, j]))


class Curves:
    """The fit at shares u [n, S] of light: the common curve of all sensors, then each sensor's."""

    def __init__(self, seen: Seen, u: Floats) -> None:
        self._seen, self._u = seen, u
        self._most = np.broadcast_to(np.asarray(seen.most, float), u.shape[1:])
        self._bends = OVER_LIGHT if seen.linear else OVER_SHARE
        self._bread = normal(u, seen.use, seen.noise)

    def fitted(self, *, beyond: bool = False) -> Floats:
        """The curves [S, STEPS + 1], never falling, from 0 to where each saturates; `beyond` leaves out that
        upper limit, because a curve cut off within a step is no straight line there."""
        seen = self._seen
        dark = 0.0 if seen.dead else seen.dark()
        told = (self._u, seen.counts, seen.use, self._most, seen.top, seen.dead, dark, seen.noise)
        held = self._bends * (seen.smooth * STEPS**3)
        common, done = solved(self._bread.sum(axis=1)[:, None], held, np.zeros((1, STEPS + 1)), 0.0, *told)
        towards = np.repeat(common, len(self._most), 0)
        curves, all_done = solved(self._bread, held, towards, seen.alike, *told)
        if not (done and all_done):
            raise np.linalg.LinAlgError("curves: a matrix that is not positive definite")
        most = np.inf if beyond else self._most[:, None]
        curves = np.clip(np.maximum.accumulate(curves, axis=1), 0.0, most)
        # Below half a count there is nothing: so that a sensor's reach ends.
        return np.where(curves < curves[:, :1] + 0.5, curves[:, :1], curves)

    def deviations(self, curves: Floats) -> Floats:
        """[S, STEPS + 1] standard errors of fitted curves' values, counts; infinite where no reading is near.

        The light is taken as exact; residuals count as noise.
        """
        seen = self._seen
        inside = seen.use & (seen.counts > 0) & (seen.counts < self._most)
        off = np.where(inside, on_curves(curves, self._u) - seen.counts, 0.0) / seen.noise
        left = np.sqrt(np.maximum(1.0, (off**2).sum(axis=0) / np.maximum(inside.sum(axis=0), 1)))
        bands = self._bread + self._bends[:, None] * (seen.smooth * STEPS**3 * self._bread[2].mean())
        bands[2] += (seen.alike * np.maximum(curves, seen.top)) ** -2.0
        sides = [np.stack([np.diag(row[k:], k) for row in bands[2 - k]]) for k in (1, 2)]
        dense = np.stack([np.diag(row) for row in bands[2]]) + sum(
            side + side.swapaxes(1, 2) for side in sides
        )
        size = np.sqrt(np.diagonal(np.linalg.inv(dense), axis1=1, axis2=2))
        return np.where(self._bread[2] > 0, size * left[:, None], np.inf)


def smoothness(
    seen: Seen, u: Floats, folds: NDArray[np.int64], alikes: Sequence[float] = (ALIKE,)
) -> tuple[float, Seen]:
    """The sum of squares on places held out, and `seen` with the bends (and likeness, of `alikes`) that make
    it least, for shares u [n, S] and the fold [n] of each row."""
    tried = [
        replace(seen, smooth=weight, linear=linear, alike=alike)
        for linear, weight, alike in product((False, True), SMOOTH, alikes)
    ]
    silent = (seen.counts <= 0) & (seen.dead > 0)
    errors = []
    for one in tried:
        off = np.zeros(u.shape)
        for fold in np.unique(folds):
            out = (folds == fold)[:, None]
            model = on_curves(Curves(replace(one, use=seen.use & ~out), u).fitted(beyond=True), u)
            error = np.minimum(model, seen.most) - np.where(silent, seen.dead, seen.counts)
            error = np.where(silent, np.maximum(error, 0.0), error)
            off = np.where(out & seen.use, error, off)
        errors.append(float((off**2).sum()))
    best = int(np.argmin(errors))
    return errors[best], tried[best]
