"""Proximity sensors as measured: optics by rays, electronics by a curve for each sensor.

Only the optics is searched (directions, offset, width, aperture, lobe): at each of its values the curves
that suit it best follow by linear least squares (variable projection: Golub and Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.curves import Curves, Seen, on_curves, smoothness
from realitygap.calibration.forms import (
    Tick,
    columns_of,
    free_directions,
    free_reflectances,
    free_turns,
    with_columns,
)
from realitygap.calibration.forward import received
from realitygap.calibration.infrared import PROXIMITY_COUNTS
from realitygap.calibration.rows import FOLDS, Rows
from realitygap.calibration.solve import Fit, Free, Values, solve
from realitygap.world.profile import Profile

__all__ = ["MEASURED", "fit_measured"]

Array = NDArray[np.float64]
Use = NDArray[np.bool_]

MEASURED = "measured"
LOBES = {
    "one-sided": (60.0, (0.30, 0.28, 0.22, 0.14, 0.06)),
    "two-sided": (30.0, (-0.6, 0.0, 1.6, 0.0, 0.0)),
}
"""Aperture (degrees) and shares that a search begins at: one beam; two beams, and what both see counts once,
as in simulators that subtract."""
WIDTHS_CM = (0.5, 3.0, 9.0)
PROMISING = 2
PLAIN = 1.02
"""Another start than the first has to be so much better: where readings do not tell, there is one beam."""
COARSE = 0.05
"""Share of the full scale that readings are first taken to be good to: far from the truth details mislead."""
FINEST = 0.004
"""Share of the full scale that no model is expected to be better than."""
MEDIAN = 0.455
"""Of the square of a normal number."""
SHARES = ("share_1", "share_2", "share_3", "share_4")
GAP = 0.05
"""Share of the full scale from which on a gap above 0 is a dead zone."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Optics:
    """A fit under way: the profile that its constants stand in, its curves' middle, its readings."""

    base: Profile
    rows: Rows
    seen: Seen

    def profile(self, values: Values) -> Profile:
        """The base with the optics in place, and curves that only hold their places."""
        law = self.base.infrared
        shares = [float(values[key][0]) for key in SHARES]
        columns = columns_of(values, ("direction_deg",), law.sensors)
        columns["offset_cm"] = [float(values["offset_cm"][0])] * len(law.sensors)
        return replace(
            self.base,
            infrared=replace(
                law, sensors=with_columns(law.sensors, columns), lobe=(1.0 - sum(shares), *shares),
                aperture_deg=float(values["aperture_deg"][0]), width_cm=float(values["width_cm"][0]),
            ),
        )  # fmt: skip

    def share(self, profile: Profile, values: Values) -> Array:
        """[n, S] how far up its curve each reading lies."""
        parts = [
            received(profile, scene.tried(values), float(values[name][0]) if name in values else 0.0)
            for name, scene in self.rows.scenes
        ]  # fmt: skip
        root = np.sqrt(np.maximum(np.concatenate(parts), 0.0))
        return np.asarray(root / (root + 1.0 / profile.infrared.curve_cm))

    def curves(self, values: Values, use: Use) -> tuple[Array, Array]:
        """The curves [S, n] that suit the optics, and each reading's share."""
        u = self.share(self.profile(values), values)
        return Curves(replace(self.seen, use=use), u).fitted(), u

    def readings(self, values: Values, use: Use) -> Array:
        """Noise-free readings [n, S] by curves fitted to those in `use`; in the dead zone what exceeds it."""
        model, dead = on_curves(*self.curves(values, use)), self.seen.dead
        return np.where((self.seen.counts <= 0) & (dead > 0), np.maximum(model - dead, 0.0), model)

    def shown(self, values: Values, use: Use) -> Array:
        """Noise-free readings [n, S] as the robot shows them."""
        model = on_curves(*self.curves(values, use))
        return np.where(model < self.seen.dead, 0.0, model)

    def centred(self, values: Values) -> Optics:
        """The same with the curves' middle where readings are neither dark nor saturated."""
        seen = self.seen
        u = self.share(self.profile(values), values)
        lit = seen.use & (seen.counts > 0.1 * seen.top) & (seen.counts < 0.9 * seen.top) & (u > 0) & (u < 1)
        if not lit.any():
            return self
        root = float(np.median(u[lit] / (1.0 - u[lit]))) / self.base.infrared.curve_cm
        law = replace(self.base.infrared, curve_cm=1.0 / root)
        return replace(self, base=replace(self.base, infrared=law))


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
        seen = Seen(counts=rows.counts, use=rows.use, top=rows.top, noise=COARSE * rows.top, dead=law.dead)
        self._first = Optics(base=replace(base, infrared=law), rows=rows, seen=seen)

    def fit(self) -> tuple[Profile, Fit]:
        """The profile and its constants, from the start that promises most."""
        use = self._rows.use
        starts: list[tuple[float, int, Optics, dict[str, Array]]] = []
        lobes = list(LOBES.values())[: 1 if self._straight else None]
        for (wide, shares), width, matt in product(
            lobes, WIDTHS_CM, (1.0,) if self._straight else (1.0, 0.0)
        ):
            values = self._start(wide, shares, width)
            law = replace(self._first.base.infrared, matt=matt)
            optics = replace(self._first, base=replace(self._first.base, infrared=law)).centred(values)
            plain = 1.0 if (wide, shares) == lobes[0] else PLAIN
            starts.append((self._left(optics, values, use) * plain, len(starts), optics, values))
        tried = []
        for _, number, optics, values in sorted(starts, key=lambda one: one[:2])[:PROMISING]:
            values = self._solved(optics, values, use, COARSE * self._rows.top, intervals=False).values
            optics = optics.centred(values)
            tried.append((self._left(optics, values, use), number, optics, values))
        _, _, optics, values = min(tried, key=lambda one: one[:2])
        smooth = smoothness(optics.seen, optics.share(optics.profile(values), values), self._rows.folds())
        seen = replace(optics.seen, noise=self._noise, smooth=smooth)
        self.optics = replace(optics, seen=seen)
        fit = self._solved(self.optics, values, use, self._noise, intervals=True)
        return self.profile(fit.values, use), replace(fit, model=self.optics.shown(fit.values, use))

    def held_out(self, fit: Fit, use: Use) -> Array:
        """[n, S] readings by a fit to those in `use` alone."""
        values = self._solved(self.optics, fit.values, use, self._noise, intervals=False).values
        return self.optics.shown(values, use)

    def profile(self, values: Values, use: Use) -> Profile:
        """The profile of fitted optics, with the curves that suit it."""
        made = self.optics.profile(values)
        curves, _ = self.optics.curves(values, use)
        law = made.infrared
        sensors = with_columns(law.sensors, {"curve": [tuple(row) for row in curves.round(3).tolist()]})
        return replace(made, infrared=replace(law, sensors=sensors))

    def _start(self, wide: float, shares: Sequence[float], width: float) -> dict[str, Array]:
        start = {free.key: free.start for free in self._frees()}
        start["direction_deg"] = np.array([s.direction_deg for s in self._first.base.infrared.sensors])
        start |= {key: np.array([share]) for key, share in zip(SHARES, shares[1:], strict=True)}
        return start | {"aperture_deg": np.array([wide]), "width_cm": np.array([width])}

    def _frees(self) -> list[Free]:
        one, scenes, recordings = np.ones(1), self._rows.scenes, self._rows.recordings
        shares = [Free(key=key, start=0.2 * one, low=-4.0, high=4.0, prior=1.0, step=5e-3) for key in SHARES]
        size = [
            Free(key="offset_cm", start=0.3 * one, low=0.0, high=6.0, prior=2.0, step=5e-3),
            Free(key="width_cm", start=3.0 * one, low=0.0, high=20.0, prior=10.0, step=1e-2),
        ]
        if self._straight:
            return size
        return [
            free_directions(self._first.base.infrared.sensors),
            *size,
            Free(key="aperture_deg", start=45.0 * one, low=5.0, high=85.0, prior=30.0, step=0.1),
            *shares,
            *free_reflectances(scenes),
            *free_turns([name for (name, _), r in zip(scenes, recordings, strict=True) if r.pose is None]),
        ]

    def _left(self, optics: Optics, values: Values, use: Use) -> float:
        return float(np.abs((optics.readings(values, use) - self._rows.counts)[use]).mean())

    def _solved(self, optics: Optics, start: Values, use: Use, noise: float, *, intervals: bool) -> Fit:
        measured = replace(self._rows.measured(noise), use=use)
        fit = solve(
            self._frees(), lambda values: optics.readings({**start, **values}, use), measured, start=start,
            intervals=intervals,
        )  # fmt: skip
        return replace(fit, values={**start, **fit.values})


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


def repeated_noise(rows: Rows) -> float:
    """The deviation of readings that were repeated at their places, counts; else as of the paper's robot."""
    lit = rows.use & (rows.counts > COARSE * rows.top) & (rows.counts < (1.0 - COARSE) * rows.top)
    many = np.maximum(np.bincount(rows.place), 1)
    mean = np.stack([np.bincount(rows.place, column) for column in rows.counts.T], 1) / many[:, None]
    off = ((rows.counts - mean[rows.place]) ** 2)[lit & (many > 1)[rows.place][:, None]]
    spread = 1.0 - 1.0 / np.median(many) if np.median(many) > 1 else 1.0
    return float(np.sqrt(np.median(off) / MEDIAN / spread)) if len(off) else PROXIMITY_COUNTS * rows.unit


def dead_zone(rows: Rows) -> float:
    """The least reading above 0 if there is a gap below it; else 0."""
    lit = rows.counts[rows.use & (rows.counts > 0)]
    dark = (rows.counts[rows.use] == 0).mean()
    least = float(lit.min()) if len(lit) else 0.0
    return least if dark > 0.02 and least > GAP * rows.top else 0.0
