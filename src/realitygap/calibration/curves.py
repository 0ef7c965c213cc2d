"""A monotone curve for each sensor: a table of counts at equal steps, fitted to its readings.

Penalised least squares: a penalty on bends over the share, or over the light itself (Whittaker 1923); falling
steps are penalised until there are none (Eilers 2005); a sensor with few readings follows the curve that all
sensors share. Matrices are kept as bands [3, S, STEPS + 1], diagonal last. Readings at an end of the
converter are censored (Tobin 1958).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.values import Floats

Use = NDArray[np.bool_]

STEPS = 80
"""Of a curve."""
BRIGHT = 0.9
"""Beyond this share all steps count as equally much light. Towards a share of 1 the light goes to infinity,
and a curve penalised for bends over the light would depend on its far end, and so on rounding errors."""
ROUNDS, STEEP = 12, 1e6
"""Rounds of one fit, and the weight that keeps a curve from falling."""
SETTLED = 1e-3
"""A curve has converged when a round moves it by less than this share of the full scale."""
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


class Ends(NamedTuple):
    """Readings at an end of the converter: their cell, position in it, and weights on either side.

    `counts` are the readings; unused for those at 0."""

    cell: NDArray[np.int64]
    share: Floats
    here: Floats
    there: Floats
    counts: Floats

    def on(self, curves: Floats) -> Floats:
        """Values of curves [S, STEPS + 1] there."""
        values = curves.ravel()
        below = values[self.cell]
        return np.asarray(below + self.share * (values[1:][self.cell] - below))


class Curves:
    """The fit at shares u [n, S]: the normal equations are gathered once, their right side as often as
    readings at the ends are taken anew. Dark readings that no ray reaches count as one of each sensor."""

    def __init__(self, seen: Seen, u: Floats) -> None:
        self._seen, self._u = seen, u
        at = np.minimum(np.maximum(u, 0.0), 1.0) * STEPS
        j = np.minimum(at.astype(np.int64), STEPS - 1)
        self._share, sensors = at - j, u.shape[1]
        self._cell = j + np.arange(sensors) * (STEPS + 1)
        weight, self._size = np.where(seen.use, 1.0, 0.0) / seen.noise**2, sensors * (STEPS + 1)
        self._here, self._there = (1 - self._share) * weight, self._share * weight
        diagonal = self._sum(self._here * (1 - self._share), self._there * self._share)
        beside = self._sum(self._here * self._share, np.zeros(u.shape))
        self._most = np.broadcast_to(np.asarray(seen.most), (sensors,))
        low, high = seen.use & (seen.counts <= 0), seen.use & (seen.counts >= seen.most)
        self._inside, unlit = seen.use & ~low & ~high, low & (u <= 0)
        inside = np.where(self._inside, seen.counts, 0.0)
        self._right = self._sum(inside * self._here, inside * self._there)
        dark, first = self._at(low & ~unlit), np.arange(sensors) * (STEPS + 1)
        none, weight = np.zeros(sensors), (self._here * unlit).sum(axis=0)
        self._low = Ends(
            np.append(dark.cell, first), np.append(dark.share, none), np.append(dark.here, weight),
            np.append(dark.there, none), np.append(dark.counts, none),
        )  # fmt: skip
        self._high = self._at(high)
        self._dark = 0.0 if seen.dead else seen.dark()
        self._bread = np.zeros((3, sensors, STEPS + 1))
        self._bread[2], self._bread[1, :, 1:] = diagonal, beside[:, :-1]

    def _sum(self, here: Floats, there: Floats) -> Floats:
        """[S, STEPS + 1] sums over the readings of each cell."""
        return self._gathered(self._cell.ravel(), here.ravel(), there.ravel())

    def _gathered(self, cell: NDArray[np.int64], here: Floats, there: Floats) -> Floats:
        total = np.bincount(cell, here, self._size + 1)
        total[1:] += np.bincount(cell, there, self._size)
        return np.asarray(total[: self._size].reshape(-1, STEPS + 1))

    def fitted(self, *, beyond: bool = False) -> Floats:
        """The curves [S, STEPS + 1], never falling, from 0 to where each saturates; `beyond` leaves out that
        upper limit, because a curve cut off within a step is no straight line there."""
        common = self._solved(self._bread.sum(axis=1, keepdims=True), np.zeros((1, STEPS + 1)), pooled=True)
        curves = self._solved(self._bread, np.repeat(common, self._bread.shape[1], 0), pooled=False)
        most = np.inf if beyond else self._most[:, None]
        curves = np.clip(np.maximum.accumulate(curves, axis=1), 0.0, most)
        # Below half a count there is nothing: so that a sensor's reach ends.
        return np.where(curves < curves[:, :1] + 0.5, curves[:, :1], curves)

    def _solved(self, bread: Floats, towards: Floats, *, pooled: bool) -> Floats:
        seen, held = self._seen, self._held(bread, None if pooled else towards)
        size, matrix, pulled = bread[2].mean(), bread + held, _times(held, towards)
        curves, falls = towards, np.zeros((len(towards), STEPS), bool)
        solve, enough = _solver(matrix), SETTLED * seen.top
        for _ in range(ROUNDS):
            right = self._right_side(np.repeat(curves, self._bread.shape[1], 0) if pooled else curves)
            right = right.sum(axis=0, keepdims=True) if pooled else right
            new = solve(right + pulled)
            moved, curves = np.abs(new - curves).max(), new
            more = (curves[:, 1:] < curves[:, :-1]) & ~falls
            if more.any():
                falls |= more
                weight, steep = STEEP * size * falls, matrix.copy()
                steep[2, :, :-1] += weight
                steep[2, :, 1:] += weight
                steep[1, :, 1:] -= weight
                solve = _solver(steep)
            elif moved < enough:
                break
        return curves

    def _held(self, bread: Floats, common: Floats | None) -> Floats:
        """The penalties: small bends, and closeness to the common curve, if there is one."""
        seen = self._seen
        bends = OVER_LIGHT if seen.linear else OVER_SHARE
        held = np.repeat(bends[:, None] * (seen.smooth * STEPS**3 * bread[2].mean()), bread.shape[1], 1)
        held[2] += 1e-12 if common is None else (seen.alike * np.maximum(common, seen.top)) ** -2.0
        return held

    def deviations(self, curves: Floats) -> Floats:
        """[S, STEPS + 1] standard errors of fitted curves' values, counts; infinite where no reading is near.

        The light is taken as exact; residuals count as noise.
        """
        inside = self._inside
        off = np.where(inside, on_curves(curves, self._u) - self._seen.counts, 0.0) / self._seen.noise
        left = np.sqrt(np.maximum(1.0, (off**2).sum(axis=0) / np.maximum(inside.sum(axis=0), 1)))
        bands = self._bread + self._held(self._bread, curves)
        sides = [np.stack([np.diag(row[k:], k) for row in bands[2 - k]]) for k in (1, 2)]
        dense = np.stack([np.diag(row) for row in bands[2]]) + sum(
            side + side.swapaxes(1, 2) for side in sides
        )
        size = np.sqrt(np.diagonal(np.linalg.inv(dense), axis1=1, axis2=2))
        return np.where(self._bread[2] > 0, size * left[:, None], np.inf)

    def _right_side(self, curves: Floats) -> Floats:
        """[S, STEPS + 1] sums of readings, with what is expected beyond where one ends at 0, in the dead zone
        or at the top."""
        from scipy.special import ndtr

        model = self._low.on(curves)
        if self._dark > 0:
            a = np.minimum(np.maximum(-model / self._dark, -6.0), 6.0)
            model = model - self._dark * np.exp(-a * a / 2) / np.sqrt(2 * np.pi) / ndtr(a)
        right = self._right + self._ended(self._low, np.minimum(model, self._seen.dead))
        if not len(self._high.cell):
            return right
        return right + self._ended(self._high, np.maximum(self._high.on(curves), self._high.counts))

    def _ended(self, ends: Ends, full: Floats) -> Floats:
        return self._gathered(ends.cell, full * ends.here, full * ends.there)

    def _at(self, where: Use) -> Ends:
        share, here, there = self._share[where], self._here[where], self._there[where]
        return Ends(self._cell[where], share, here, there, self._seen.counts[where])


def _solver(bands: Floats) -> Callable[[Floats], Floats]:
    """What solves symmetric banded systems for right sides [S, n]: all as one long matrix, factored once."""
    from scipy.linalg.lapack import dpbtrf, dpbtrs

    factors, failed = dpbtrf(bands.reshape(3, -1))
    if failed:
        raise np.linalg.LinAlgError("curves: a matrix that is not positive definite")
    return lambda right: np.asarray(dpbtrs(factors, right.ravel())[0].reshape(right.shape))


def _times(bands: Floats, vectors: Floats) -> Floats:
    """[S, n] symmetric matrices of these bands times vectors."""
    out = bands[2] * vectors
    for k in (1, 2):
        out[:, k:] += bands[2 - k, :, k:] * vectors[:, :-k]
        out[:, :-k] += bands[2 - k, :, k:] * vectors[:, k:]
    return np.asarray(out)


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
