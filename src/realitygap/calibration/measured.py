"""Proximity sensors as measured: optics by rays, electronics by a curve for each sensor.

Only the optics is searched (directions, offset, width, aperture, lobe): at each of its values the curves
that suit it best follow by linear least squares (variable projection: Golub and Pereyra 1973).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.constants import SIGMAS, Constant
from realitygap.calibration.curves import STEPS, Curves, Seen, smoothness
from realitygap.calibration.forms import (
    Tick,
    free_directions,
    free_reflectances,
    free_turns,
    scan,
    with_columns,
)
from realitygap.calibration.optics import SHARES, Optics, shift_of
from realitygap.calibration.rows import FOLDS, Rows, dead_zone, means, repeated_noise
from realitygap.calibration.solve import Fit, Free, Values, solve
from realitygap.calibration.solve import Measured as Readings
from realitygap.world.profile import Profile

__all__ = ["MEASURED", "PLAIN", "Measured", "fit_measured"]

Array = NDArray[np.float64]
Use = NDArray[np.bool_]

MEASURED = "measured"
ONE_BEAM = {"aperture_deg": 60.0, "share_1": 0.28, "share_2": 0.22, "share_3": 0.14, "share_4": 0.06}
TWO_BEAMS = {"share_4": 0.67}
"""What a search begins at, and what of the lobe is free: one beam; or two beside the middle ray, less what
they see of a flat surface before it, as in simulators that subtract."""
APERTURES_DEG = (10.0, 15.0, 22.0)
"""Of two beams."""
WIDTHS_CM = (0.5, 3.0, 9.0)
PROMISING = 3
PLAIN = 1.02
"""Another start than the first has to be so much better: where readings do not tell, there is one beam."""
COARSE = {0.05: 10.0, 0.03: 4.0, 0.02: 2.0, 0.01: 1.0, 0.003: 0.4}
"""Shares of the full scale that readings are first taken to be good to: far from the truth details mislead.
And how far a sensor's direction is looked for then, degrees."""
FIRST = max(COARSE)
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
    """The form "measured" of the proximity sensors, fitted."""

    def __init__(self, rows: Rows, base: Profile, noise: float) -> None:
        self._rows, self._noise = rows, noise
        self._straight = all(r.from_sensor is not None for r in rows.recordings)
        law = base.infrared
        flat = tuple(np.linspace(0.0, law.top, 2))
        sensors = tuple(replace(s, a=1.0, b=0.0, curve=flat, noise=()) for s in law.sensors)
        law = replace(
            law, sensors=sensors, lobe=(1.0, 0.0, 0.0, 0.0, 0.0), aperture_deg=45.0, curve_cm=3.0,
            dead=dead_zone(rows), exponent=1.0,
        )  # fmt: skip
        self._all = Seen(counts=rows.counts, use=rows.use, top=rows.top, noise=noise, dead=law.dead)
        self._first_of = np.unique(rows.place, return_index=True)[1]
        seen = replace(self._all, counts=means(rows), use=self._at_places(rows.use), noise=FIRST * rows.top)
        self._first = Optics(
            base=replace(base, infrared=law), scenes=rows.scenes, seen=seen, place=np.arange(len(seen.counts))
        )

    def fit(self) -> tuple[Profile, Fit]:
        """The profile and its constants, from the start that promises most."""
        use = self._first.seen.use
        optics, values = self._begun()
        folds = self._rows.folds()[self._first_of]
        for _ in range(2):  # how smooth curves are shows only where the optics is right
            smooth = smoothness(optics.seen, optics.share(optics.profile(values), values), folds)
            optics = replace(optics, seen=replace(optics.seen, noise=self._noise, smooth=smooth))
            values = self._solved(optics, values, use, self._noise, intervals=False).values
            values = self._ended(optics, values, use)
        self._places = optics
        self.optics = replace(optics, seen=replace(self._all, smooth=smooth), place=self._rows.place)
        fit = self._solved(self._places, values, use, self._noise, intervals=True)
        values, use = self._ended(self._places, fit.values, use), self._rows.use
        fit = replace(fit, values=values, constants=(*fit.constants, *self._points(values, use)))
        return self.profile(values, use), replace(fit, model=self.optics.shown(values, use))

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

    def _begun(self) -> tuple[Optics, dict[str, Array]]:
        """Nearly there: of all starts the most promising are followed a stage, and the best to the end."""
        use = self._first.seen.use
        begun: list[tuple[float, int, Optics, dict[str, Array]]] = []
        lobes = [ONE_BEAM, *({**TWO_BEAMS, "aperture_deg": wide} for wide in APERTURES_DEG)]
        lobes = lobes[: 1 if self._straight else None]
        for lobe, width, matt in product(lobes, WIDTHS_CM, (1.0,) if self._straight else (1.0, 0.0)):
            values = self._start(lobe, width)
            law = replace(self._first.base.infrared, matt=matt)
            optics = replace(self._first, base=replace(self._first.base, infrared=law), lobe=tuple(lobe))
            optics = optics.centred(values)
            values = self._turned(optics, values, use, FIRST * self._rows.top, COARSE[FIRST])
            values = self._ended(optics, values, use, ENDS_CM)
            plain = 1.0 if lobe is ONE_BEAM else PLAIN
            begun.append((self._left(optics, values, use) * plain, len(begun), optics, values))
        for share, reach in COARSE.items():
            staged = []
            for _, number, optics, values in sorted(begun, key=lambda one: one[:2])[:PROMISING]:
                nearer = self._stage(optics, values, share * self._rows.top, reach)
                staged.append((self._left(*nearer, use), number, *nearer))
            begun = [min(staged, key=lambda one: one[:2])]
        return begun[0][2:]

    def _stage(
        self, optics: Optics, values: Values, noise: float, reach: float
    ) -> tuple[Optics, dict[str, Array]]:
        """Directions, then where rays end, then all else: nearer, as if readings were good to `noise`."""
        use = optics.seen.use
        values = self._turned(optics, values, use, noise, reach)
        optics = optics.centred(values)
        values = self._ended(optics, values, use, ENDS_CM)
        return optics, self._solved(optics, values, use, noise, intervals=False).values

    def held_out(self, fit: Fit, use: Use) -> Array:
        """[n, S] readings by a fit to those in `use` alone."""
        there = self._at_places(use)
        values = self._ended(self._places, fit.values, there)
        values = self._solved(self._places, values, there, self._noise, intervals=False).values
        return self.optics.shown(self._ended(self._places, values, there), use)

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
        seen = Readings(counts=optics.seen.counts, noise=noise, use=use, clusters=self._first_of)
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
            Free(key=key, start=0.2 * one, low=lowest, high=4.0, prior=1.0, step=5e-3)
            for key in lobe if key in SHARES
        ]  # fmt: skip
        size = [
            Free(key="offset_cm", start=0.3 * one, low=-1.0, high=6.0, prior=2.0, step=5e-3),
            Free(key="width_cm", start=3.0 * one, low=0.0, high=20.0, prior=10.0, step=1e-2),
        ]
        if self._straight:
            shifts = [Free(key=shift_of(name), start=0 * one, low=-1.0, high=1.0, prior=SHIFT_CM, step=1e-3)
                      for name, _ in scenes]  # fmt: skip
            return [*size, *shifts]
        return [
            free_directions(self._first.base.infrared.sensors, tie=None),
            *size,
            Free(key="aperture_deg", start=45.0 * one, low=5.0, high=85.0, prior=30.0, step=0.1),
            *shares,
            *free_reflectances(scenes),
            *free_turns([name for (name, _), r in zip(scenes, recordings, strict=True) if r.pose is None]),
        ]

    def _left(self, optics: Optics, values: Values, use: Use) -> float:
        return float(np.abs((optics.readings(values, use) - optics.seen.counts)[use]).mean())

    def _solved(self, optics: Optics, start: Values, use: Use, noise: float, *, intervals: bool) -> Fit:
        measured = Readings(
            counts=optics.seen.counts, noise=noise, use=use & ~self._at_end(optics, start, use, noise),
            clusters=self._rows.block[self._first_of],
        )  # fmt: skip
        fit = solve(
            self._frees(optics.lobe), lambda values: optics.readings({**start, **values}, use), measured,
            start=start, intervals=intervals,
        )  # fmt: skip
        return replace(fit, values={**start, **fit.values})

    def _at_end(self, optics: Optics, values: Values, use: Use, noise: float) -> Use:
        """[n, S] the readings in which a ray comes to its end or not by a hair."""
        end = values["range_cm"]
        near, far = (
            optics.readings({**values, "range_cm": end * share}, use) for share in (1 - AT_END, 1 + AT_END)
        )
        return np.asarray(np.abs(near - far) > noise)


def fit_measured(rows: Rows, base: Profile, tick: Tick) -> tuple[Profile, Fit, Array]:
    """The profile, its constants, and what it reads [n, S] on places held out."""
    tick()
    form = Measured(rows, base, max(repeated_noise(rows), FINEST * rows.top))
    profile, fit = form.fit()
    folds, held_out = rows.folds(), fit.model.copy()
    for fold in range(FOLDS):
        tick()
        out = folds == fold
        if out.any() and not out.all():
            held_out[out] = form.held_out(fit, rows.use & ~out[:, None])[out]
    return profile, fit, held_out
