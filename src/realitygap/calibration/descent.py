"""Improves measured optics: by scans and random draws where readings jump (a ray just hits or just misses an
object), and by least squares where they do not."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from realitygap.calibration.forms import FINE_DEG, free_directions, free_reflectances, free_turns, scan
from realitygap.calibration.optics import SHARES, Optics, about_rig, background_of, gain_of, shift_of
from realitygap.calibration.rows import Rows
from realitygap.calibration.search import search
from realitygap.calibration.solve import Fit, Free, Measured, Values, solve
from realitygap.values import Floats
from realitygap.world.sensors import ProximitySensor

__all__ = ["ENDS_CM", "PLAIN", "Descent"]

PLAIN = 1.02
"""A more complex model must be this factor better; otherwise one beam without a range limit is kept."""
ENDS_CM = tuple(np.geomspace(5.0, 40.0, 18))
"""Where rays may end; then closer about the best, by these shares of it."""
NEARER, LIKE = (0.08, 0.015, 0.002), 1.0 + 1e-6
AT_END = 0.015
"""By this share of their range rays are doubtful: readings that hang on it are left out of a descent."""
TIE_DEG = 0.02
"""How well the directions' mean is known where rigs may be turned: turned sensors look like a turned rig."""
HAIR_DEG = 0.3
"""Readings that jump when a sensor turns by this angle are left out too: a ray only just hits or misses."""
SHIFT = {"low": -1.0, "high": 1.0, "prior": 0.2, "step": 1e-3}
"""Offset of a straight series, cm, common to all its distances."""
LIGHT, LIT = {"low": 0.0, "high": 0.05, "prior": 0.002, "step": 1e-5}, 1.1
"""Light that a room may add to what rays bring, 1/cm²; the prior is that of a white wall at 22 cm. And the
factor by which the residual under one light must exceed that under several before several are used: half a
deviation of the noise."""
BY_HAND = 0.01
"""Share of the full scale that a millimetre is worth where each place of a series was set by hand."""
GAIN = 0.3
"""How much the gains of the sensors of a series may easily differ."""


class Descent:
    """Steps from values to better ones.

    Args:
        rows: readings and their places.
        sensors: of the base profile.
        noise: of a reading, counts.
        draws: of the random search.

    Attributes:
        straight: whether all recordings are series of one sensor facing a wall.
    """

    def __init__(self, rows: Rows, sensors: Sequence[ProximitySensor], noise: float, *, draws: int) -> None:
        self._rows, self._sensors, self._noise, self._draws = rows, sensors, noise, draws
        first_of = np.unique(rows.place, return_index=True)[1]
        self._blocks, self._few = rows.block[first_of], rows.sparse()[first_of]
        self.straight = rows.straight
        self._turned = not any(r.exact for r in rows.recordings)

    def frees(self, lobe: Sequence[str]) -> list[Free]:
        """The constants that are free with this lobe."""
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
        if self.straight:
            shifts = [Free(key=shift_of(name), start=0 * one, **SHIFT) for name, _ in scenes]
            gains = [Free(key=gain_of(int(k)), start=one, low=0.1, high=10.0, prior=GAIN, step=1e-3)
                     for k in np.flatnonzero(self._rows.use.any(axis=0))]  # fmt: skip
            return [*size, *shifts, *gains, *self._backgrounds()]
        return [
            free_directions(self._sensors, tie=TIE_DEG if self._turned else None, jump=0.5),
            *size,
            Free(key="aperture_deg", start=45.0 * one, low=5.0, high=85.0, prior=30.0, step=0.1, jump=0.5),
            *shares,
            *free_reflectances(scenes),
            *free_turns([name for (name, _), r in zip(scenes, recordings, strict=True) if not r.exact]),
        ]

    def _backgrounds(self) -> list[Free]:
        """The background light of each recording's room."""
        keys = [background_of(name) for name, _ in self._rows.scenes]
        return [Free(key=key, start=np.zeros(1), **LIGHT) for key in keys]

    def lit(self, optics: Optics, values: dict[str, Floats]) -> dict[str, Floats]:
        """The values with a background for each recording, if that reduces the residual clearly."""
        if self.straight or len(self._rows.recordings) < 2:
            return values
        tried = values | {free.key: np.full(1, free.prior) for free in self._backgrounds()}
        found = self.solved(optics, tried, self._noise).values
        return dict(found) if self.left(optics, found) * LIT < self.left(optics, values) else values

    def left(self, optics: Optics, values: Values) -> float:
        """Residual of the values: mean of the places' misfits, counts."""
        seen = optics.seen
        return float(np.abs((optics.readings(values, seen.use) - seen.counts)[seen.use]).mean())

    def stage(
        self, optics: Optics, values: Values, noise: float, reach: float
    ) -> tuple[Optics, dict[str, Floats]]:
        """One round of improvement: directions, then where rays end, then all other constants.

        Args:
            optics: directions and rays; both change.
            values: of all that is free, by name.
            noise: assumed accuracy of the readings, counts.
            reach: how far a direction may turn, degrees.
        """
        values = self.turned(optics, values, noise, reach)
        optics = optics.centred(values)
        values = self.ended(optics, values, ENDS_CM)
        return optics, self.solved(optics, values, noise).values

    def searched(self, optics: Optics, values: Values) -> dict[str, Floats]:
        """Better values: at random first, by some of the bearings if there are many; then by all of them, and
        by least squares."""
        if not self.straight:
            few = optics.at(self._few)
            use = few.seen.use
            end = Free(key="range_cm", start=values["range_cm"], low=1.0, high=100.0, jump=0.1)
            frees = [*self.frees(optics.lobe), *([end] if values["range_cm"] > 0 else [])]
            found = search(
                frees, lambda v: few.readings(about_rig(v, -1.0), use), self._seen(few, self._noise),
                about_rig(values, 1.0), draws=self._draws,
            )  # fmt: skip
            values = about_rig(found, -1.0)
            for reach in FINE_DEG:
                values = self.turned(optics, values, self._noise, reach)
            values = self.level(values)
        return self.mended(optics, values, self.solved(optics, values, self._noise).values)

    def mended(self, optics: Optics, values: Values, solved: Values) -> dict[str, Floats]:
        """The least-squares values with directions and ray ends readjusted, or the values before: whichever
        have the smaller residual."""
        found = self.level(self.turned(optics, solved, self._noise, FINE_DEG[-1]))
        tried: tuple[Values, ...] = (values, self.ended(optics, found))
        best = min(tried, key=lambda v: self.left(optics, v))
        return dict(best)

    def level(self, values: Values) -> dict[str, Floats]:
        """The values with the directions' mean where it was and the rigs turned instead, if none stood
        exactly."""
        if not self._turned:
            return dict(values)
        by = values["direction_deg"].mean() - np.mean([s.direction_deg for s in self._sensors])
        turns = {key: value + by for key, value in values.items() if key.startswith("turn_")}
        return {**values, **turns, "direction_deg": values["direction_deg"] - by}

    def turned(self, optics: Optics, values: Values, noise: float, reach: float) -> dict[str, Floats]:
        """The values with each sensor's direction at its smallest residual; arguments as of `stage`."""
        if self.straight:
            return dict(values)
        use = optics.seen.use
        return scan(lambda tried: optics.readings(tried, use), values, self._seen(optics, noise), reach)

    def ended(self, optics: Optics, values: Values, ends: Sequence[float] = ()) -> dict[str, Floats]:
        """The values with rays that end where the residual is smallest; without an end unless one is much
        better."""
        if self.straight:  # a dead zone has the same effect
            return dict(values)

        def left(end: float) -> float:
            return self.left(optics, {**values, "range_cm": np.array([end])})

        best = min([float(values["range_cm"][0]), *ends], key=left)
        for near in NEARER if best else ():
            tried = best * (1.0 + near * np.linspace(-1.0, 1.0, 11))
            found = np.array([left(end) for end in tried])
            best = float(tried[found <= found.min() * LIKE].mean())  # the middle of equally good ones
        return {**values, "range_cm": np.array([best if left(best) * PLAIN < left(0.0) else 0.0])}

    def solved(self, optics: Optics, start: Values, noise: float, *, intervals: bool = False) -> Fit:
        """Least squares over all free constants, without readings near a jump, where a difference quotient is
        no derivative.

        Args:
            optics, noise: as of `stage`; both stay.
            start: values to begin from.
            intervals: whether to work out 95 % intervals.
        """
        use, seen, frees = optics.seen.use, self._seen(optics, noise), self.frees(optics.lobe)
        if not self.straight and background_of(self._rows.scenes[0][0]) in start:
            frees += self._backgrounds()
        hang = np.zeros(use.shape, bool)
        if start["range_cm"] > 0:
            near, far = self._beside(optics, start, "range_cm", AT_END * start["range_cm"])
            hang |= np.abs(near - far) > noise
        if not self.straight:
            right, left = self._beside(optics, start, "direction_deg", HAIR_DEG)
            hang |= np.abs(right + left - 2.0 * optics.readings(start, use)) > noise
        seen = replace(seen, use=use & ~hang)
        fit = solve(
            frees, lambda values: optics.readings({**start, **values}, use), seen,
            start=start, intervals=intervals,
        )  # fmt: skip
        return replace(fit, values={**start, **fit.values})

    def _beside(self, optics: Optics, values: Values, key: str, by: Floats | float) -> list[Floats]:
        """The readings with a constant on either side of where it is."""
        use = optics.seen.use
        return [optics.readings({**values, key: values[key] + off}, use) for off in (-by, by)]

    def _seen(self, optics: Optics, noise: float) -> Measured:
        seen = optics.seen
        return Measured(counts=seen.counts, noise=noise, use=seen.use, clusters=self._blocks)
