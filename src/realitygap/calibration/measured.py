"""Proximity sensors as measured: optics by rays, electronics by a curve for each sensor.

Only the optics is searched (directions, offset, width, aperture, lobe): at each of its values the curves
that suit it best follow by linear least squares (variable projection: Golub and Pereyra 1973).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.constants import SIGMAS, Constant, moved
from realitygap.calibration.curves import STEPS, Curves, Seen, smoothness
from realitygap.calibration.forms import (
    FINE_DEG,
    Tick,
    free_directions,
    free_reflectances,
    free_turns,
    scan,
    with_columns,
)
from realitygap.calibration.optics import SHARES, Optics, about_rig, shift_of
from realitygap.calibration.rows import Rows, dead_zone, means, repeated_noise, saturation
from realitygap.calibration.search import search
from realitygap.calibration.solve import Fit, Free, Values, solve
from realitygap.calibration.solve import Measured as Readings
from realitygap.world.profile import Profile

__all__ = ["PLAIN", "Measured", "fit_measured"]

Array = NDArray[np.float64]
Use = NDArray[np.bool_]
Begun = tuple[float, int, Optics, dict[str, Array]]
"""A start: what it leaves over, its number, and where it got to."""

ONE_BEAM = {"aperture_deg": 60.0, "share_1": 0.28, "share_2": 0.22, "share_3": 0.14, "share_4": 0.06}
TWO_BEAMS = {"share_4": 0.67}
"""What a search begins at, and what of the lobe is free: one beam; or two beside the middle ray, less what
they see of a flat surface before it, as in simulators that subtract."""
TWO_BEAMS_DEG = (10.0, 15.0, 22.0)
LOBES = (ONE_BEAM, *({**TWO_BEAMS, "aperture_deg": wide} for wide in TWO_BEAMS_DEG))
WIDTHS_CM = (0.5, 3.0, 9.0)
PROMISING = 2
PLAIN = 1.02
"""Another start than the first has to be so much better: where readings do not tell, there is one beam."""
COARSE = {0.05: 10.0, 0.03: 4.0, 0.02: 2.0, 0.01: 1.0, 0.003: 0.4}
"""Shares of the full scale that readings are first taken to be good to: far from the truth details mislead.
And how far a sensor's direction is looked for then, degrees."""
FIRST = max(COARSE)
DRAWS, DRAWS_HELD_OUT = 600, 300
"""Looks at all places in one search; and where some are held out, four times over: what fewer miss errs to
the careful side."""
FINEST = 0.004
"""Share of the full scale that no model is expected to be better than."""
ENDS_CM = tuple(np.geomspace(5.0, 40.0, 18))
"""Where rays may end; then nearer and nearer about the best, by these shares of it."""
NEARER, LIKE = (0.08, 0.015, 0.002), 1.0 + 1e-6
AT_END = 0.015
"""By this share of their range rays are doubtful: readings that hang on it are left out of a descent."""
POINTS = (STEPS // 4, STEPS // 2, 3 * STEPS // 4)
"""Of a curve: those whose intervals are told."""
SHIFT_CM = 0.2
"""How far off a straight series may have been set down: its distances all are by as much."""


class Measured:
    """The form "measured" of the proximity sensors, fitted to rows in so many draws."""

    def __init__(self, rows: Rows, base: Profile, noise: float, *, draws: int = DRAWS) -> None:
        self._rows, self._noise, self._draws = rows, noise, draws
        self._straight = all(r.from_sensor is not None for r in rows.recordings)
        law = base.infrared
        flat = tuple(np.linspace(0.0, law.top, 2))
        sensors = tuple(replace(s, a=1.0, b=0.0, curve=flat, noise=()) for s in law.sensors)
        law = replace(
            law, sensors=sensors, lobe=(1.0, 0.0, 0.0, 0.0, 0.0), aperture_deg=45.0, curve_cm=3.0,
            dead=dead_zone(rows), exponent=1.0,
        )  # fmt: skip
        self._all = Seen(
            counts=rows.counts, use=rows.use, top=rows.top, most=saturation(rows), noise=noise, dead=law.dead
        )
        self._first_of = np.unique(rows.place, return_index=True)[1]
        seen = replace(self._all, counts=means(rows), use=self._at_places(rows.use), noise=FIRST * rows.top)
        self._first = Optics(
            base=replace(base, infrared=law), scenes=rows.scenes, seen=seen, place=np.arange(len(seen.counts))
        )

    def fit(self) -> tuple[Profile, Fit]:
        """The profile and its constants, from the start that promises most."""
        places, values = self._promising()
        fit = self._solved(places, values, places.seen.use, self._noise, intervals=True)
        values, use = self._mended(places, values, fit.values, places.seen.use), self._rows.use
        constants = [moved(c, values) for c in fit.constants]
        fit = replace(fit, values=values, constants=(*constants, *self._points(values, use)))
        return self.profile(values, use), replace(fit, model=self.optics.shown(values, use))

    def read(self) -> Array:
        """[n, S] readings at all places, those of no use to the fit too, by the search alone."""
        _, values = self._promising()
        return self.optics.shown(values, self._rows.use)

    def _promising(self) -> tuple[Optics, dict[str, Array]]:
        """Where the start ends that promises most; `optics` has it with curves fitted to all readings."""
        found = [self._start_at(i, *self._nearer(*one[2:])) for i, one in enumerate(self._begun())]
        places, values = self._nearer(*min(found, key=itemgetter(0, 1))[2:])
        seen = replace(self._all, smooth=places.seen.smooth, linear=places.seen.linear)
        self.optics = replace(places, seen=seen, place=self._rows.place)
        return places, values

    def _points(self, values: Values, use: Use) -> list[Constant]:
        """Three points of each sensor's curve with their intervals, the optics as fitted."""
        curves, u = self.optics.curves(values, use)
        size = SIGMAS * Curves(replace(self.optics.seen, use=use), u).deviations(curves)
        return [
            Constant(
                key=f"curve_{j}[{k}]", value=value, low=max(0.0, value - size[k, j]),
                high=min(self._rows.top, value + size[k, j]), told=bool(np.isfinite(size[k, j])),
            )
            for j in POINTS for k, value in enumerate(curves[:, j].tolist()) if k not in self._rows.dead
        ]  # fmt: skip

    def _nearer(self, optics: Optics, values: Values) -> tuple[Optics, dict[str, Array]]:
        """The curves as smooth as suits the optics, which shows only where that is right; then that."""
        folds, seen = self._rows.folds()[self._first_of], replace(optics.seen, noise=self._noise)
        seen = smoothness(seen, optics.share(optics.profile(values), values), folds)
        optics = replace(optics, seen=seen)
        return optics, self._searched(optics, values, seen.use)

    def _begun(self) -> list[Begun]:
        """Nearly there: of all starts the most promising are followed a stage, and then the best with one
        beam and with two."""
        use = self._first.seen.use
        begun: list[Begun] = []
        lobes = LOBES[: 1 if self._straight else None]
        for lobe, width, matt in product(lobes, WIDTHS_CM, (1.0,) if self._straight else (1.0, 0.0)):
            values = self._start(lobe, width)
            law = replace(self._first.base.infrared, matt=matt)
            optics = replace(self._first, base=replace(self._first.base, infrared=law), lobe=tuple(lobe))
            optics = optics.centred(values)
            values = self._turned(optics, values, use, FIRST * self._rows.top, COARSE[FIRST])
            values = self._ended(optics, values, use, ENDS_CM)
            begun.append(self._start_at(len(begun), optics, values))
        many = PROMISING
        for share, reach in COARSE.items():
            staged = []
            for _, number, optics, values in _best_of_each(begun, many):
                nearer = self._stage(optics, values, share * self._rows.top, reach)
                staged.append(self._start_at(number, *nearer))
            begun, many = staged, 1
        return _best_of_each(begun, many)

    def _start_at(self, number: int, optics: Optics, values: dict[str, Array]) -> Begun:
        """A start that got there."""
        plain = 1.0 if optics.lobe == tuple(ONE_BEAM) else PLAIN
        return self._left(optics, values, optics.seen.use) * plain, number, optics, values

    def _stage(
        self, optics: Optics, values: Values, noise: float, reach: float
    ) -> tuple[Optics, dict[str, Array]]:
        """Directions, then where rays end, then all else: nearer, as if readings were good to `noise`."""
        use = optics.seen.use
        values = self._turned(optics, values, use, noise, reach)
        optics = optics.centred(values)
        values = self._ended(optics, values, use, ENDS_CM)
        return optics, self._solved(optics, values, use, noise, intervals=False).values

    def _searched(self, optics: Optics, values: Values, use: Use) -> dict[str, Array]:
        """Better values: at random, where readings jump (a ray that just meets a thing, or just not), and by
        least squares where they do not."""
        if not self._straight:
            end = Free(key="range_cm", start=values["range_cm"], low=1.0, high=100.0, jump=0.1)
            frees = [*self._frees(optics.lobe), *([end] if values["range_cm"] > 0 else [])]
            seen = self._seen(optics, use, self._noise)
            begin = about_rig(values, 1.0)
            found = search(
                frees, lambda v: optics.readings(about_rig(v, -1.0), use), seen, begin, draws=self._draws
            )
            values = about_rig(found, -1.0)
            for reach in FINE_DEG:
                values = self._turned(optics, values, use, self._noise, reach)
        solved = self._solved(optics, values, use, self._noise, intervals=False).values
        return self._mended(optics, values, solved, use)

    def _mended(self, optics: Optics, values: Values, solved: Values, use: Use) -> dict[str, Array]:
        """The values that least squares led to, with rays that end where they should; or those before."""
        found = self._turned(optics, solved, use, self._noise, FINE_DEG[-1])
        tried: tuple[Values, ...] = (values, self._ended(optics, found, use))
        best = min(tried, key=lambda v: self._left(optics, v, use))
        return dict(best)

    def _at_places(self, use: Use) -> Use:
        """[m, S] the places of which any reading is in `use` [n, S]."""
        return np.stack([np.bincount(self._rows.place, column) > 0 for column in use.T], 1)

    def profile(self, values: Values, use: Use) -> Profile:
        """The profile of fitted optics, with the curves that suit it."""
        made = self.optics.profile(values)
        curves, _ = self.optics.curves(values, use)
        law = made.infrared
        sensors = with_columns(law.sensors, {"curve": [tuple(row) for row in curves.round(3).tolist()]})
        return replace(made, infrared=replace(law, sensors=sensors))

    def _start(self, lobe: dict[str, float], width: float) -> dict[str, Array]:
        start = {free.key: free.start for free in self._frees(())}
        start["direction_deg"] = np.array([s.direction_deg for s in self._first.base.infrared.sensors])
        none = dict.fromkeys((*SHARES, "range_cm"), 0.0)
        return start | {key: np.array([value]) for key, value in (none | lobe | {"width_cm": width}).items()}

    def _turned(
        self, optics: Optics, values: Values, use: Use, noise: float, reach: float
    ) -> dict[str, Array]:
        """The values with each sensor looking where that leaves least over."""
        if self._straight:
            return dict(values)
        seen = self._seen(optics, use, noise)
        return scan(lambda tried: optics.readings(tried, use), values, seen, reach)

    def _ended(
        self, optics: Optics, values: Values, use: Use, ends: Sequence[float] = ()
    ) -> dict[str, Array]:
        """The values with rays that end where that leaves least over: nowhere, unless it is much better."""
        if self._straight:  # a dead zone says as much
            return dict(values)

        def left(end: float) -> float:
            return self._left(optics, {**values, "range_cm": np.array([end])}, use)

        best = min([float(values["range_cm"][0]), *ends], key=left)
        for near in NEARER if best else ():
            tried = best * (1.0 + near * np.linspace(-1.0, 1.0, 11))
            found = np.array([left(end) for end in tried])
            best = float(tried[found <= found.min() * LIKE].mean())  # amid those between two readings
        return {**values, "range_cm": np.array([best if left(best) * PLAIN < left(0.0) else 0.0])}

    def _frees(self, lobe: Sequence[str]) -> list[Free]:
        one, scenes, recordings = np.ones(1), self._rows.scenes, self._rows.recordings
        lowest = -4.0 if "share_1" in lobe else 0.0
        shares = [
            Free(key=key, start=0.2 * one, low=lowest, high=4.0, prior=1.0, step=5e-3, jump=0.02)
            for key in lobe if key in SHARES
        ]  # fmt: skip
        size = [
            Free(key="offset_cm", start=0.3 * one, low=-1.0, high=6.0, prior=2.0, step=5e-3, jump=0.1),
            Free(key="width_cm", start=3.0 * one, low=0.0, high=20.0, prior=10.0, step=1e-2, jump=0.1),
        ]
        if self._straight:
            shifts = [Free(key=shift_of(name), start=0 * one, low=-1.0, high=1.0, prior=SHIFT_CM, step=1e-3)
                      for name, _ in scenes]  # fmt: skip
            return [*size, *shifts]
        return [
            free_directions(self._first.base.infrared.sensors, tie=None, jump=0.5),
            *size,
            Free(key="aperture_deg", start=45.0 * one, low=5.0, high=85.0, prior=30.0, step=0.1, jump=0.5),
            *shares,
            *free_reflectances(scenes),
            *free_turns([name for (name, _), r in zip(scenes, recordings, strict=True) if r.pose is None]),
        ]

    def _left(self, optics: Optics, values: Values, use: Use) -> float:
        return float(np.abs((optics.readings(values, use) - optics.seen.counts)[use]).mean())

    def _solved(self, optics: Optics, start: Values, use: Use, noise: float, *, intervals: bool) -> Fit:
        measured = self._seen(optics, use & ~self._at_end(optics, start, use, noise), noise)
        fit = solve(
            self._frees(optics.lobe), lambda values: optics.readings({**start, **values}, use), measured,
            start=start, intervals=intervals,
        )  # fmt: skip
        return replace(fit, values={**start, **fit.values})

    def _seen(self, optics: Optics, use: Use, noise: float) -> Readings:
        blocks = self._rows.block[self._first_of]
        return Readings(counts=optics.seen.counts, noise=noise, use=use, clusters=blocks)

    def _at_end(self, optics: Optics, values: Values, use: Use, noise: float) -> Use:
        """[n, S] the readings in which a ray comes to its end or not by a hair."""
        end = values["range_cm"]
        near, far = (
            optics.readings({**values, "range_cm": end * share}, use) for share in (1 - AT_END, 1 + AT_END)
        )
        return np.asarray(np.abs(near - far) > noise)


def _best_of_each(begun: Sequence[Begun], many: int) -> list[Begun]:
    """The best starts with one beam and with two, so `many` of each, the best of all first."""
    ranked = sorted(begun, key=itemgetter(0, 1))
    kinds = [[one for one in ranked if one[2].lobe == tuple(lobe)] for lobe in (ONE_BEAM, LOBES[-1])]
    return sorted((one for kind in kinds for one in kind[:many]), key=itemgetter(0, 1))


def fit_measured(rows: Rows, base: Profile, tick: Tick) -> tuple[Profile, Fit, Array]:
    """The profile, its constants, and what it reads [n, S] on places held out."""

    def form(rows: Rows, draws: int) -> Measured:
        return Measured(rows, base, max(repeated_noise(rows), FINEST * rows.top), draws=draws)

    tick()
    profile, fit = form(rows, DRAWS).fit()
    held_out = fit.model.copy()
    for out in rows.held_out(tick):
        held_out[out] = form(rows.without(out), DRAWS_HELD_OUT).read()[out]
    return profile, fit, held_out
