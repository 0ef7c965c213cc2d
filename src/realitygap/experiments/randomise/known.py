"""What the simulation knows of each unit: its profile in every state of knowledge, and the units' spread."""

import math
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.unit_folder import PROFILE
from realitygap.experiments.randomise.plan import ALL, KNOWN, LOOKUP, RandomiseConfig, Spread
from realitygap.simulation.simulation import Simulation
from realitygap.values import Pose
from realitygap.world.profile import Profile, load_profile

__all__ = ["Profiles", "calibrated_folder", "spread_of"]

DISTANCES_CM, HEADINGS_DEG = (1.0, 2.0, 3.0), range(0, 360, 45)
"""From a wall, where units' readings are held against each other."""
LEAST = 0.15
"""Of the full scale: readings below tell of a sensor's dark, not of its sensitivity."""
WIDEST = 0.9


def calibrated_folder(folder: Path, unit: int, known: str) -> Path:
    """Where a unit's profile by its own recording, a share of that, or its look-up table, is."""
    name = "table" if known == LOOKUP else f"{100 * KNOWN[known]:g}"
    return folder / "calibration" / f"unit-{unit}" / name


class Profiles:
    """The calibrated units of an experiment."""

    def __init__(self, folder: Path, config: RandomiseConfig) -> None:
        self.folder, self.config = folder, config
        self.of = cache(self._of)
        self.spread = cache(self._spread)

    def file(self, unit: int, known: str) -> str:
        """The profile of what is known of a unit: a file, or a shipped one's name."""
        if known == "paper":
            return known
        numbers = self.config.numbers
        if known == "another unit":
            unit, known = numbers[(numbers.index(unit) + 1) % len(numbers)], ALL
        return str(calibrated_folder(self.folder, unit, known) / PROFILE)

    def _of(self, unit: int, known: str) -> Profile:
        return load_profile(self.file(unit, known))

    def _spread(self) -> Spread:
        return spread_of([self.of(unit, ALL) for unit in self.config.numbers])


def spread_of(units: list[Profile]) -> Spread:
    """The shares within which uniform draws vary as much as some units do, in whole hundredths.

    Of sensors by the median relative deviation between units of what a sensor reads near a wall, which needs
    no common form of the profiles; of wheels by that of their speeds and track, root mean square. A uniform
    draw within ±s deviates by s/√3.
    """
    readings = np.array([_readings(one) for one in units])
    mean = readings.mean(axis=0)
    told = mean > LEAST * units[0].infrared.top
    turns = np.array([[*one.wheels.speed_per_unit_cm_s, one.wheels.track_cm] for one in units])
    wheels = turns.std(axis=0, ddof=1) / turns.mean(axis=0)
    infrared = float(np.median(readings.std(axis=0, ddof=1)[told] / mean[told])) if told.any() else 0.0
    return Spread(_share(infrared), _share(float(np.sqrt((wheels**2).mean()))))


def _share(deviation: float) -> float:
    return min(WIDEST, max(0.01, round(math.sqrt(3.0) * deviation, 2)))


def _readings(one: Profile) -> NDArray[np.float64]:
    """[places · sensors] noise-free counts before the left wall of the task's arena."""
    simulation = Simulation("obstacle-avoidance", one, 0.0)
    middle, radius = simulation.task.arena.size_cm[1] / 2, one.body.radius_cm
    poses = [Pose.from_degrees(radius + d, middle, h) for d in DISTANCES_CM for h in HEADINGS_DEG]
    return np.concatenate([simulation.probe(pose)[0][0] for pose in poses])
