"""A monotone curve for each sensor through what it read: a table of counts at equal steps.

Penalised least squares: second differences are small (Whittaker 1923), falling steps are penalised until
there are none (Eilers 2005), and a sensor with few readings follows the curve that all sensors share.
Readings at an end of the converter only say that a curve passes it there (Tobin 1958).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

__all__ = ["STEPS", "Curves", "Seen", "on_curves", "smoothness"]

Array = NDArray[np.float64]
Use = NDArray[np.bool_]

STEPS = 40
"""Of a curve."""
ROUNDS, STEEP = 12, 1e6
"""Rounds of one fit, and the weight that keeps a curve from falling."""
SETTLED = 1e-3
"""Share of the full scale by which a round moves a curve that has come to rest."""
ALIKE = 0.3
"""Share of the full scale by which a sensor's curve may easily differ from that of all."""
SMOOTH = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
"""Weights of second differences that are tried on places held out."""
BEND = np.diff(np.eye(STEPS + 1), 2, axis=0)
BENDS = BEND.T @ BEND


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What curves are fitted to: counts [n, S] up to `top`, of which `use` [n, S] count, and their noise.

    Readings below `dead` are 0; `smooth` weighs second differences.
    """

    counts: Array
    use: Use
    top: float
    noise: float
    dead: float = 0.0
    smooth: float = SMOOTH[1]

    def dark(self) -> float:
        """Noise of the dark: the size of readings that are nearly 0."""
        low = self.counts[self.use & (self.counts < max(3.0 * self.noise, self.dead))]
        return float(np.sqrt(np.mean(low**2))) if len(low) else 0.0


def on_curves(curves: Array, u: Array) -> Array:
    """Counts [n, S] of sensors on their curves [S, STEPS + 1] at shares u [n, S]."""
    at = np.clip(u, 0.0, 1.0) * STEPS
    j = np.minimum(at.astype(np.int64), STEPS - 1)
    k = np.arange(curves.shape[0])
    return np.asarray(curves[k, j] + (at - j) * (curves[k, j + 1] - curves[k, j]))


class Curves:
    """The fit at shares u [n, S]: the normal equations are gathered once, their right side as often as
    readings at the ends are taken anew."""

    def __init__(self, seen: Seen, u: Array) -> None:
        self._seen, self._u = seen, u
        at = np.clip(u, 0.0, 1.0) * STEPS
        j = np.minimum(at.astype(np.int64), STEPS - 1)
        self._share, sensors = at - j, u.shape[1]
        self._cell = j + np.arange(sensors) * (STEPS + 1)
        weight = np.where(seen.use, 1.0, 0.0) / seen.noise**2
        self._weight, self._size = weight, sensors * (STEPS + 1)
        here, there = (1 - self._share) * weight, self._share * weight
        diagonal = self._sum(here * (1 - self._share), there * self._share)
        beside = self._sum(here * self._share, None)
        self._ends = seen.counts <= 0, seen.counts >= seen.top
        self._dark = 0.0 if seen.dead else seen.dark()
        self._bread = np.zeros((sensors, STEPS + 1, STEPS + 1))
        k = np.arange(STEPS + 1)
        self._bread[:, k, k] = diagonal
        self._bread[:, k[:-1], k[1:]] = self._bread[:, k[1:], k[:-1]] = beside[:, :-1]

    def _sum(self, here: Array, there: Array | None) -> Array:
        """[S, STEPS + 1] sums over the readings of each cell."""
        total = np.bincount(self._cell.ravel(), here.ravel(), self._size + 1)
        if there is not None:
            total += np.bincount(self._cell.ravel() + 1, there.ravel(), self._size + 1)
        return np.asarray(total[: self._size].reshape(-1, STEPS + 1))

    def fitted(self) -> Array:
        """The curves [S, STEPS + 1], from 0 to the full scale, never falling."""
        common = self._solved(self._bread.sum(axis=0, keepdims=True), np.zeros((1, STEPS + 1)), pooled=True)
        curves = self._solved(self._bread, np.repeat(common, self._bread.shape[0], 0), pooled=False)
        curves = np.clip(np.maximum.accumulate(curves, axis=1), 0.0, self._seen.top)
        # Below half a count there is nothing: so that a sensor's reach ends.
        return np.where(curves < curves[:, :1] + 0.5, curves[:, :1], curves)

    def _solved(self, bread: Array, towards: Array, *, pooled: bool) -> Array:
        seen = self._seen
        bends, alike = self._held(bread, pooled=pooled)
        curves, falls = towards.copy(), np.zeros((len(bread), STEPS))
        for _ in range(ROUNDS):
            full = self._full(np.repeat(curves, self._bread.shape[0], 0) if pooled else curves)
            right = self._sum(full * self._weight * (1 - self._share), full * self._weight * self._share)
            right = right.sum(axis=0, keepdims=True) if pooled else right
            steep = self._no_fall(falls, bread)
            new = np.linalg.solve(
                bread + bends + alike + steep, (right + towards @ (bends + alike))[..., None]
            )
            moved, curves = np.abs(new[..., 0] - curves).max(), new[..., 0]
            fell = np.diff(curves, axis=1) < 0
            if moved < SETTLED * seen.top and not (fell & (falls == 0)).any():
                break
            falls = np.maximum(falls, fell)
        return np.asarray(curves)

    def _held(self, bread: Array, *, pooled: bool) -> tuple[Array, Array]:
        """What holds curves where readings do not: small second differences, and the curve of all."""
        bends = BENDS * (self._seen.smooth * STEPS**3 * bread.trace(axis1=1, axis2=2).mean() / (STEPS + 1))
        return bends, np.eye(STEPS + 1) * (1.0 / (ALIKE * self._seen.top) ** 2 if not pooled else 1e-12)

    def deviations(self, curves: Array) -> Array:
        """[S, STEPS + 1] standard errors of fitted curves' values, counts; infinite where no reading is near.

        The light is taken as it is; what the curves leave over counts as noise.
        """
        inside = self._seen.use & ~self._ends[0] & ~self._ends[1]
        off = np.where(inside, on_curves(curves, self._u) - self._seen.counts, 0.0) / self._seen.noise
        left = np.sqrt(np.maximum(1.0, (off**2).sum(axis=0) / np.maximum(inside.sum(axis=0), 1)))
        held = sum(self._held(self._bread, pooled=False))
        near = np.diagonal(self._bread, axis1=1, axis2=2)
        size = np.sqrt(np.diagonal(np.linalg.inv(self._bread + held), axis1=1, axis2=2))
        return np.where(near > 0, size * left[:, None], np.inf)

    def _no_fall(self, falls: Array, bread: Array) -> Array:
        """The penalty on steps that fell."""
        step = np.diff(np.eye(STEPS + 1), axis=0)
        weight = STEEP * bread.trace(axis1=1, axis2=2).mean() / (STEPS + 1)
        return np.asarray(np.einsum("ki,sk,kj->sij", step, falls * weight, step, optimize=True))

    def _full(self, curves: Array) -> Array:
        """Readings, with what is expected beyond where one ends at 0, in the dead zone or at the top."""
        from scipy.special import ndtr

        out, ends = self._seen.counts.copy(), self._ends
        model = on_curves(curves, self._u)
        out[ends[1]] = np.maximum(model, out)[ends[1]]
        low = model[ends[0]]
        if self._dark > 0:
            a = np.clip(-low / self._dark, -6.0, 6.0)
            low = low - self._dark * np.exp(-a * a / 2) / np.sqrt(2 * np.pi) / ndtr(a)
        out[ends[0]] = np.minimum(low, self._seen.dead)
        return out


def smoothness(seen: Seen, u: Array, folds: NDArray[np.int64], *, weights: Sequence[float] = SMOOTH) -> float:
    """The weight of second differences with which curves err least on places held out.

    Args:
        seen: what the curves are fitted to.
        u: [n, S] where on its curve a sensor reads.
        folds: [n] with which others a row is held out.
        weights: those to choose from.
    """
    errors = []
    for weight in weights:
        off = np.zeros(u.shape)
        for fold in np.unique(folds):
            out = (folds == fold)[:, None]
            some = replace(seen, use=seen.use & ~out, smooth=weight)
            model = np.minimum(on_curves(Curves(some, u).fitted(), u), seen.top)
            off = np.where(out & seen.use, model - seen.counts, off)
        errors.append(float((off**2).sum()))
    return weights[int(np.argmin(errors))]
