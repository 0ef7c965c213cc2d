"""Arm K's realities: real Kheperas' readings as look-up tables (plan.md, "Arm K").

The readings stay where they are: `--data` names their folder, with khepera/wall.sam and
logs/khepera2-edinburgh/.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.calibrate import Calibration, calibrate
from realitygap.calibration.load import load_recording
from realitygap.calibration.recordings import SensorRecording
from realitygap.values import Floats
from realitygap.world.robot import load_profile

WALL, SECOND = "khepera/wall.sam", "logs/khepera2-edinburgh"
BASE = "paper"
DAYS = 5
FLAT = 5
"""Neighbouring bearings over which the first Khepera's readings are averaged: 10 degrees."""
BETWEEN_DAYS = 18.4
"""Deviation of the second Khepera's readings between days, counts, without contact: its noise, since nobody
read a place twice on one day."""


class Readings:
    """Both Kheperas' readings in a folder.

    Raises:
        SystemExit: they are not there.
    """

    def __init__(self, data: Path) -> None:
        missing = [str(data / name) for name in (WALL, SECOND) if not (data / name).exists()]
        if missing:
            raise SystemExit(f"arm K: expected real readings, {' and '.join(missing)}. Name them: --data")
        self.wall: SensorRecording = load_recording(data / WALL, object="wall")
        self._days = data / SECOND
        self.recording = cache(self._recording)

    def _recording(self, reality: str) -> SensorRecording:
        """Readings round a wall, of "khepera-1", or of "khepera-2 day 3": that one's readings by distance on
        that day, each sensor facing the wall, spread over bearings as the first one's are."""
        if reality == "khepera-1":
            return self.wall
        curves = self._curves(int(reality.rpartition(" ")[2]) - 1)
        draw = np.random.default_rng([int(reality[-1]), 31170])
        return replace(self.wall, counts=spread(self.wall, curves, draw), source=reality)

    def told(self, reality: str) -> SensorRecording:
        """What a simulation of it is fitted to: of the second Khepera the next day's readings."""
        if reality == "khepera-1":
            return self.wall
        return self.recording(f"khepera-2 day {int(reality[-1]) % DAYS + 1}")

    def _curves(self, day: int) -> list[tuple[Floats, Floats]]:
        """Of each sensor distances (cm) and counts on a day; without a reading in contact, other days'."""
        found = []
        for sensor in range(8):
            by_day = {}
            for folder in sorted(self._days.glob(f"*D/s{sensor}d*")):
                rows = np.genfromtxt(folder / "readings.csv", delimiter=",", skip_header=1)
                by_day[int(re.findall(r"\d+$", folder.name)[0])] = rows[:, [0, 3 + sensor]].T
            at, counts = by_day[day]
            if at[0] > 0:
                contact = np.mean([row[1, 0] for row in by_day.values() if row[0, 0] == 0])
                at, counts = np.r_[0.0, at], np.r_[contact, counts]
            found.append((at, counts))
        return found

    def fitted(self, reality: str, simulation: str) -> Calibration:
        """A simulation of a reality: its own table, or a form of law fitted to readings."""
        table = simulation == "table"
        recording = self.recording(reality) if table else self.told(reality)
        form = "lookup" if table else simulation
        return calibrate([recording], load_profile(BASE), form=form, beside=False)


def spread(
    wall: SensorRecording, curves: list[tuple[Floats, Floats]], draw: np.random.Generator
) -> NDArray[np.float64]:
    """[n, S] readings by distance alone, spread over bearings as those of another robot are.

    At each distance a sensor reads what its curve has above its floor (its least) times a share: the other
    robot's reading above its own floor, over the most that it reads at that distance. Curves are straight in
    the logarithm between distances. Noise is added where there is anything to read.
    """
    made = np.zeros(wall.counts.shape)
    for k, (at, counts) in enumerate(curves):
        least, there = counts.min(), np.percentile(wall.counts[:, k], 5)
        for distance in np.unique(wall.distance_cm):
            rows = np.flatnonzero(wall.distance_cm == distance)
            rows = rows[np.argsort(wall.bearing_deg[rows])]
            above = wall.counts[rows, k] - there
            around = np.convolve(np.r_[above[-FLAT:], above, above[:FLAT]], np.ones(FLAT) / FLAT, "same")
            around = np.maximum(around[FLAT:-FLAT], 0.0)
            curve = np.exp(np.interp(distance, at, np.log(counts - least + 1.0))) - 1.0
            made[rows, k] = curve * around / max(around.max(), 1.0)
    lit = made > BETWEEN_DAYS
    return np.clip(np.rint(made + lit * BETWEEN_DAYS * draw.standard_normal(made.shape)), 0, 1023)
