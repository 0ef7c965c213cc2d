"""Distances between two sets of trials: of behaviour, and of layout (where the robot was).

They are computed once for all pairs of trials, so that a bootstrap only changes weights. Both are unbiased:
two sets of one robot's trials have distance 0 on average, with any number of trials. Two trials of one start
are never compared, within a set or across: a common start would make any two robots similar.

Sources: Székely and Rizzo, "Energy statistics" (J. Stat. Plan. Inference 143, 2013); Lin, "Divergence
measures based on the Shannon entropy" (IEEE Trans. Inf. Theory 37, 1991).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.descriptors import chosen, describe_all, in_units
from realitygap.correspondence.trials import Trial
from realitygap.values import Floats
from realitygap.world.arena import Arena

__all__ = ["Distances", "matched_starts"]

BLUR_CM = 4.0
"""Standard deviation of the blur of an occupancy map: a little more than a body's radius."""
ANYWHERE_PER_CM2 = 1e-6
"""Occupancy added everywhere: limits the weight of places that no robot visits."""
EVERY = 5
"""Every fifth row, two a second, represents a trial in its map."""
ROUNDING = 1e-12
"""A squared distance below this is 0: a set compared with itself gives only rounding errors."""
NEIGHBOURS = 3
"""Of a trial in the two-sample test."""
SAME_CM, SAME_RAD = 1.5, np.radians(15)
"""Two robots set down by hand within these have the same start."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Distances:
    """Precomputed distances of two sets of trials, `a` and `b`, for any weights.

    Attributes:
        a, b: the trials, two at least in each.
        arena: where they were; None: only the tracks' own motion is compared.
        matched: whether starts of one name are the same start in both sets.
        jitter: whether the descriptor "jitter" is included.
    """

    a: Sequence[Trial]
    b: Sequence[Trial]
    arena: Arena | None = None
    matched: bool = False
    jitter: bool = True

    @cached_property
    def described(self) -> tuple[dict[str, Floats], dict[str, Floats]]:
        """Descriptors by name of a's and of b's trials, in their own units."""
        return describe_all(self.a, self.arena), describe_all(self.b, self.arena)

    @cached_property
    def rows(self) -> Floats:
        """Descriptors of both sets' trials, [n, d]: a's, then b's."""
        kept = [d for d in chosen(self.arena) if self.jitter or d.name != "jitter"]
        return np.vstack([in_units(one, kept) for one in self.described])

    @cached_property
    def starts(self) -> NDArray[np.int64]:
        """[n] number of each trial's start."""
        names = [("" if self.matched else "a", t.start) for t in self.a]
        names += [("" if self.matched else "b", t.start) for t in self.b]
        number = {name: i for i, name in enumerate(dict.fromkeys(names))}
        return np.array([number[name] for name in names])

    @cached_property
    def counts(self) -> NDArray[np.bool_]:
        """[n, n] which pairs of trials are compared: those of different starts."""
        starts, n = self.starts, len(self.a)
        few = len(set(starts[:n])) < 2 or len(set(starts[n:])) < 2
        names = np.arange(len(starts)) if few else starts
        return np.asarray(names[:, None] != names[None, :])

    @cached_property
    def sides(self) -> tuple[Floats, Floats]:
        """Weights [n] that count each trial of `a`, or each of `b`, once."""
        ours = (np.arange(len(self.a) + len(self.b)) < len(self.a)).astype(np.float64)
        return ours, 1.0 - ours

    def behaviour(self, wa: Floats | None = None, wb: Floats | None = None) -> Floats:
        """√ of the energy distance of the descriptors, in just-noticeable amounts; 0 or more."""
        return _root(self.energy(wa, wb))

    def energy(self, wa: Floats | None = None, wb: Floats | None = None) -> Floats:
        """The energy distance of the descriptors: `2 E|X − Y| − E|X − X'| − E|Y − Y'|`; may be below 0.

        Weights [..., n] of the trials on either side, by default a and b; a distance [...] for each row.
        """
        wa, wb = self._weights(wa, wb)
        counts, far = self.counts, self._between * self.counts

        def mean(one: Floats, other: Floats) -> Floats:
            total = np.vecdot(one @ counts, other)
            # row by row: a product of two matrices has other last bits than that of one row
            summed = np.vecdot((one[..., np.newaxis, :] @ far)[..., 0, :], other)
            return np.asarray(summed / np.where(total > 0, total, np.nan))

        return 2 * mean(wa, wb) - mean(wa, wa) - mean(wb, wb)

    def layout(self, wa: Floats | None = None, wb: Floats | None = None) -> Floats:
        """Jensen-Shannon distance (√, base 2) of the occupancy maps; 0 to 1. Weights as of `energy`."""
        wa, wb = self._weights(wa, wb)
        density = []
        for weights in (wa, wb):
            # which trials form the map that another is compared with
            makers = weights[..., np.newaxis] * self.counts
            made = np.einsum("...ij,ijp->...jp", makers, self._occupancy)
            mass = np.maximum(makers.sum(axis=-2), 1e-12)
            density.append(made / mass[..., np.newaxis] + ANYWHERE_PER_CM2)
        both = density[0] + density[1]
        gain = [np.log2(2 * own / both).mean(axis=-1) for own in density]
        gained = np.vecdot(wa, gain[0]) / wa.sum(axis=-1) + np.vecdot(wb, gain[1]) / wb.sum(axis=-1)
        return np.minimum(1.0, _root(gained / 2))

    def resampled(self, draw: np.random.Generator, count: int) -> tuple[Floats, Floats]:
        """Weights [count, n] of both sides in so many resamples: starts and units are drawn with replacement.

        Matched starts are drawn together for both sides.
        """
        starts, size = self.starts, int(self.starts.max()) + 1
        sides = []
        for side, trials in zip(self.sides, (self.a, self.b), strict=True):
            names = sorted({t.unit for t in trials})
            sides.append((side, np.unique(starts[side > 0]), [names.index(t.unit) for t in trials]))
        made = np.empty((2, count, len(starts)))
        for k in range(count):
            drawn = np.bincount(draw.integers(0, size, size), minlength=size)
            for weights, (side, own, unit) in zip(made[:, k], sides, strict=True):
                if not self.matched:
                    drawn = np.bincount(draw.choice(own, len(own)), minlength=size)
                weights[:] = side * drawn[starts]
                if (units := max(unit) + 1) > 1:
                    times = np.bincount(draw.integers(0, units, units), minlength=units)
                    weights[side > 0] *= times[unit]
        return made[0], made[1]

    def two_sample_p(self, *, permutations: int = 199, seed: int = 0) -> float:
        """Permutation p of a classifier two-sample test: do nearest neighbours reveal a trial's set?

        A test only, not a scale, since it saturates. Matched starts are swapped within their pair, others
        change sides with all their trials, and a trial's neighbours never have its own start. (Lopez-Paz and
        Oquab, ICLR 2017.)
        """
        order = np.argsort(np.where(self.counts, self._between, np.inf), axis=1)[:, :NEIGHBOURS]
        truth, draw, starts = self.sides[0] > 0, np.random.default_rng(seed), self.starts
        if self.matched:
            labels = truth ^ (draw.random((permutations, starts.max() + 1)) < 0.5)[:, starts]
        else:
            side = np.zeros(starts.max() + 1, dtype=bool)
            side[starts] = truth  # trials of one start are correlated: they change sides together
            labels = draw.permuted(np.tile(side, (permutations, 1)), axis=1)[:, starts]
        labels = np.vstack([truth, labels])
        right = (labels[:, order] == labels[:, :, None]).mean(axis=(1, 2))  # share of correct guesses
        return float((right >= right[0] - 1e-12).sum() / (1 + permutations))

    def _weights(self, wa: Floats | None, wb: Floats | None) -> tuple[Floats, Floats]:
        return self.sides[0] if wa is None else wa, self.sides[1] if wb is None else wb

    @cached_property
    def _between(self) -> Floats:
        rows = self.rows
        return np.asarray(np.sqrt(((rows[:, None] - rows[None, :]) ** 2).sum(axis=2)))

    @cached_property
    def _occupancy(self) -> Floats:
        """[i, j, p]: occupancy of trial i at the p-th place of trial j, a share per cm²."""
        trials = [*self.a, *self.b]
        count = min(len(t) for t in trials) // EVERY
        places = np.array([np.column_stack([t.x, t.y])[: count * EVERY : EVERY] for t in trials])
        places /= np.sqrt(2) * BLUR_CM
        n = len(trials)
        made = np.empty((n, n, count))
        for i, own in enumerate(places):  # one table of distances serves both directions
            later = places[i:].reshape(-1, 2)
            near = np.subtract.outer(own[:, 0], later[:, 0]) ** 2
            near += np.subtract.outer(own[:, 1], later[:, 1]) ** 2
            np.negative(near, out=near)
            np.exp(near, out=near)
            near = near.reshape(count, n - i, count)
            made[i, i:] = near.mean(axis=0)
            made[i:, i] = near.mean(axis=2).T
        return made / (2 * np.pi * BLUR_CM**2)


def matched_starts(a: Sequence[Trial], b: Sequence[Trial]) -> frozenset[str]:
    """The starts that are pairs: in both sets, of one name and one pose.

    All common starts are, or none: none if a name has two poses, or fewer than half have a partner.
    """
    first = {t.start: t for t in a}
    others = {t.start for t in b}
    common = frozenset(first) & others
    near = all(_near(first[t.start], t) for t in [*a, *b] if t.start in common)
    return common if near and 2 * len(common) >= len(others | set(first)) else frozenset()


def _near(one: Trial, other: Trial) -> bool:
    away = np.hypot(one.x[0] - other.x[0], one.y[0] - other.y[0])
    turned = (one.heading[0] - other.heading[0] + np.pi) % (2 * np.pi) - np.pi
    return bool(away < SAME_CM and abs(turned) < SAME_RAD)


def _root(square: Floats) -> Floats:
    """√, with rounding errors as 0; NaN stays NaN, where there was nothing to compare."""
    return np.sqrt(np.where(square <= ROUNDING, 0.0, square))
