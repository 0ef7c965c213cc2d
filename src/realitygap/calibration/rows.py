"""All that was read of one kind of sensor: several recordings' rows, one after another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.checks import dead_sensors, refuse_other_kind, refuse_swapped, refuse_units
from realitygap.calibration.forward import scene_of
from realitygap.calibration.recordings.recording import SensorRecording, count_unit
from realitygap.calibration.solve import Measured
from realitygap.errors import CalibrationError
from realitygap.world.profile import Profile

__all__ = ["FOLDS", "REFLECTANCE", "Rows"]

Array = NDArray[np.float64]

FOLDS = 4
REFLECTANCE = "reflectance_"
"""How a constant that is a recording's reflectance begins; its number ends it."""
LIT = 63.0
"""Counts of the paper's robot from either end of the converter: three deviations of its noise."""


class Rows:
    """The rows of several recordings of one kind, one after another.

    `top` is the converter's highest count, `unit` so many of its counts that are one of the paper's robot's.
    """

    def __init__(self, recordings: Sequence[SensorRecording], base: Profile) -> None:
        self.recordings = recordings
        self.dead: dict[int, str] = {}
        warned: list[str] = []
        self.top = base.channel(recordings[0].kind).top
        self.unit = count_unit(self.top)
        for recording in recordings:
            refuse_other_kind(recording, self.top)
            refuse_units(recording, self.top)
            dead = dead_sensors(recording, self.top)
            warned += [f"{recording.source}: {reason}" for reason in dead.values()]
            warned += refuse_swapped(recording, base, dead)
            self.dead |= dead
        self.warnings = tuple(warned)
        self.counts = np.nan_to_num(np.concatenate([r.counts for r in recordings]))
        self.distance = np.concatenate([r.distance_cm for r in recordings])
        self.bearing = np.concatenate([r.bearing_deg for r in recordings])
        self.scenes = [(f"turn_{i}_deg", scene_of(r, f"{REFLECTANCE}{i}")) for i, r in enumerate(recordings)]
        if all(scene.paint for _, scene in self.scenes):
            raise CalibrationError(
                f"{recordings[0].source}: reflectance: expected it of one recording at least, all say that "
                "it is unknown: only how surfaces differ can be fitted. Say 1 of one."
            )
        places, first = [], 0
        for recording in recordings:
            places.append(recording.place() + first)
            first = int(places[-1].max()) + 1
        self.place = np.concatenate(places)
        self.use = np.isfinite(np.concatenate([r.counts for r in recordings]))
        for k in np.flatnonzero(~self.use.any(axis=0)).tolist():
            self.dead[k] = f"sensor {k} was not recorded"
            self.warnings += (f"{self.dead[k]}: it is taken to be like the others",)
        self.use[:, list(self.dead)] = False
        self.block = self._blocks()

    def measured(self, noise: float, *, without: NDArray[np.bool_] | None = None) -> Measured:
        """All readings of live sensors but those of rows [n] `without`, weighed by `noise` (counts)."""
        use = self.use if without is None else self.use & ~without[:, None]
        return Measured(counts=self.counts, noise=noise, use=use, clusters=self.block)

    def _blocks(self) -> NDArray[np.int64]:
        """[n] patches of neighbouring distances and bearings: what errs, and is held out, together."""
        known = np.isfinite(self.distance) & np.isfinite(self.bearing)
        if not known.all() or self.recordings[0].pose is not None:
            return self.place
        _, rank = np.unique(self.distance, return_inverse=True)
        thick = max(1, (int(rank.max()) + 1) // 6)
        patch = (rank // thick) * 18 + ((self.bearing + 180.0) // 20.0).astype(np.int64)
        of = np.concatenate([np.full(len(r.counts), i) for i, r in enumerate(self.recordings)])
        return np.asarray(of * 10_000 + patch, np.int64)

    def folds(self) -> NDArray[np.int64]:
        """[n] which fold a row is held out with."""
        numbers = np.unique(self.block, return_inverse=True)[1]
        order = np.random.default_rng(0).permutation(int(numbers.max()) + 1)
        return np.asarray(order[numbers] % FOLDS)

    def rmse_lit(self, model: Array) -> float:
        """The same where readings are neither dark nor saturated; of all, where none are."""
        edge = LIT * self.unit
        lit = self.use & (self.counts > edge) & (self.counts < self.top - edge)
        return float(np.sqrt(((model - self.counts)[lit if lit.any() else self.use] ** 2).mean()))

    def rmse(self, model: Array, rows: NDArray[np.bool_] | None = None) -> float:
        use = self.use if rows is None else self.use & rows[:, None]
        return float(np.sqrt(((model - self.counts)[use] ** 2).mean()))
