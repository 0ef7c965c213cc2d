"""The plan of an experiment on measuring or randomising: settings, conditions and controllers.

`docs/noise-level-2.md` states the design; every draw is a function of names alone.
"""

import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from realitygap.calibration.unit_folder import PROFILE
from realitygap.experiments.folder import Settings
from realitygap.robots.address import Address
from realitygap.simulation.simulation import Simulation
from realitygap.streams import named_stream
from realitygap.study.config import StudyConfig
from realitygap.study.parts import Condition as Evolved
from realitygap.study.parts import TaskSettings
from realitygap.study.plan import named
from realitygap.study.settings import LARGEST, whole
from realitygap.tasks.load import load_task
from realitygap.tasks.task import Task
from realitygap.values import Floats, Pose
from realitygap.world.files import require
from realitygap.world.profile import Profile, load_profile

__all__ = [
    "ALL", "CONFIG", "KNOWN", "LOOKUP", "NOISES", "Condition", "Controller", "Profiles", "RandomiseConfig",
    "Spread", "calibrated_folder", "conditions", "controllers", "evolution", "spread_of",
]  # fmt: skip

CONFIG = "measure-or-randomise.toml"
"""The file in the experiment's folder."""
TASK = "obstacle-avoidance"
NOISES = (0.0, 1.0)
ALL, LOOKUP = "own, all", "look-up table"
KNOWN = {"paper": 0.0, "another unit": 0.0, "own, 5 %": 0.05, "own, 20 %": 0.2, ALL: 1.0, LOOKUP: 1.0}
"""What the simulation may know of the unit, and the share of the standard recording that it needs."""

DISTANCES_CM, HEADINGS_DEG = (1.0, 2.0, 3.0), range(0, 360, 45)
"""Distances from a wall at which units' readings are compared."""
LEAST = 0.15
"""Share of the full scale: lower readings show a sensor's dark value, not its sensitivity."""
WIDEST = 0.9

ROBOTS = ("twin", "stranger", "enki:khepera")
"""Robots that the paper's constants are for: Kheperas with units."""


@dataclass(frozen=True, kw_only=True)
class RandomiseConfig(Settings):
    """The whole design.

    Attributes:
        robot: one of ROBOTS, which has the units.
        units: their number, from `first_unit` on.
        first_unit: its number.
        runs: of each condition; the units take turns.
        starts: trials of each controller on its unit.
        evaluations: of each run.
        twin_noise: the robot's noise scale.
        seed: random seed.
        seconds: length of a trial; the task's own if None.

    Raises:
        ConfigError: names the key, what was expected and what came.
    """

    FILE, FACTS = CONFIG, "experiment.toml"
    WHAT, COMMAND = "experiment of measuring or randomising", "realitygap experiment measure-or-randomise"

    robot: str = "enki:khepera"
    units: int = 16
    first_unit: int = 101
    runs: int = 20
    starts: int = 4
    evaluations: int = 1000
    twin_noise: float = 1.0
    seed: int = 20263
    seconds: float | None = None

    def _check(self) -> None:
        require(self.robot in ROBOTS, "robot", f"one of {', '.join(ROBOTS)}", self.robot)
        whole("units", self.units, 2, 100)  # "another unit" is one of these
        whole("first_unit", self.first_unit, 1, 10**6)
        whole("runs", self.runs, 1, 10**4)
        whole("starts", self.starts, 2, 1000)
        whole("evaluations", self.evaluations, 1, 10**9)
        whole("seed", self.seed, 0, LARGEST)
        require(0 <= self.twin_noise <= 10, "twin_noise", "a number from 0 to 10", self.twin_noise)
        if self.seconds is not None:
            require(self.seconds >= 2, "seconds", "2 or more", self.seconds)
            replace(load_task(TASK), seconds=self.seconds)

    @property
    def numbers(self) -> range:
        return range(self.first_unit, self.first_unit + self.units)

    @property
    def task(self) -> Task:
        """Obstacle avoidance with its duration."""
        task = load_task(TASK)
        return task if self.seconds is None else replace(task, seconds=self.seconds)

    def address(self, unit: int) -> Address:
        return Address.parse(f"{self.robot}:{unit}")


class Spread(NamedTuple):
    """Shares within which constants are drawn: sensors' sensitivities; wheels and track."""

    infrared: float
    wheels: float


class Condition(NamedTuple):
    """What the simulation is based on, whether constants are randomised, and its noise."""

    known: str
    randomised: bool
    noise: float

    @property
    def name(self) -> str:
        """Its name in files."""
        known = self.known.replace(" %", "").replace(", ", "-").replace(" ", "-")
        return f"{known}{'-randomised' * self.randomised}-noise-{self.noise:g}"


@dataclass(frozen=True, kw_only=True)
class Controller:
    """The champion of a run, from 1, of a condition; `unit` is the number of its calibration unit."""

    condition: Condition
    run: int
    unit: int

    @property
    def name(self) -> str:
        """Its name in files and messages."""
        return f"{self.condition.name}-run-{self.run}"


def conditions() -> tuple[Condition, ...]:
    """All conditions, in the order of the tables; a look-up table has no constants to randomise."""
    return tuple(
        Condition(known, randomised, noise)
        for known in KNOWN
        for randomised in ((False,) if known == LOOKUP else (False, True))
        for noise in NOISES
    )


def controllers(config: RandomiseConfig) -> tuple[Controller, ...]:
    """All controllers, grouped by unit, so that working in order rarely changes robots."""
    return tuple(
        Controller(condition=condition, run=run, unit=unit)
        for unit in config.numbers
        for condition in conditions()
        for run in _runs(config, unit)
    )


def evolution(
    config: RandomiseConfig, unit: int, known: str, profile: str, spread: Spread
) -> tuple[StudyConfig, dict[Controller, str]]:
    """The study of a unit in one state of knowledge, and each controller's run in it, by name.

    All states of a unit have the same seeds.

    Args:
        config: the whole design.
        unit: its number.
        known: one of KNOWN.
        profile: the state's profile, a file or a shipped one's name.
        spread: of the randomised conditions.
    """
    mine = [condition for condition in conditions() if condition.known == known]
    drawn = {"spread": spread.infrared, "spread_wheels": spread.wheels}
    evolved = {one: Evolved(task=TASK, noise=one.noise, **(drawn if one.randomised else {})) for one in mine}
    runs = _runs(config, unit)
    study = StudyConfig(
        title=f"Measure or randomise: {config.robot}:{unit}, known: {known}",
        seed=named_stream(config.seed, "evolution", unit) >> 1,
        runs=len(runs),
        evaluations=config.evaluations,
        fresh_trials=1,
        profile=profile,
        conditions=tuple(evolved.values()),
        task=TaskSettings(seconds=config.seconds),
    )
    names = {
        Controller(condition=condition, run=run, unit=unit): (
            f"{config.task.under(one.spread, one.spread_wheels).name}/{named(one.noise)}/{index}"
        )
        for condition, one in evolved.items()
        for index, run in enumerate(runs, start=1)
    }
    return study, names


def _runs(config: RandomiseConfig, unit: int) -> list[int]:
    """Numbers of a condition's runs on this unit: the units alternate."""
    return [run for run in range(1, config.runs + 1) if config.numbers[(run - 1) % config.units] == unit]


def calibrated_folder(folder: Path, unit: int, known: str) -> Path:
    """The folder of a unit's profile by its own recording, a share of it, or a look-up table."""
    name = "table" if known == LOOKUP else f"{100 * KNOWN[known]:g}"
    return folder / "calibration" / f"unit-{unit}" / name


class Profiles:
    """The calibrated units of an experiment."""

    def __init__(self, folder: Path, config: RandomiseConfig) -> None:
        self.folder, self.config = folder, config
        self.of = cache(lambda unit, known: load_profile(self.file(unit, known)))
        self.spread = cache(lambda: spread_of([self.of(unit, ALL) for unit in config.numbers]))

    def file(self, unit: int, known: str) -> str:
        """The profile of a state of knowledge of a unit: a file, or a shipped one's name."""
        if known == "paper":
            return known
        numbers = self.config.numbers
        if known == "another unit":
            unit, known = numbers[(numbers.index(unit) + 1) % len(numbers)], ALL
        return str(calibrated_folder(self.folder, unit, known) / PROFILE)


def spread_of(units: list[Profile]) -> Spread:
    """Shares, in whole hundredths, for which uniform draws vary as much as some units do.

    For sensors from the median relative deviation between units of readings near a wall, which needs no
    common form of profiles; for wheels from the root mean square deviation of speeds and track. A uniform
    draw within ±s has deviation s/√3.
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


def _readings(one: Profile) -> Floats:
    """[places · sensors] noise-free counts in front of the left wall of the task's arena."""
    simulation = Simulation("obstacle-avoidance", one, 0.0)
    middle, radius = simulation.task.arena.size_cm[1] / 2, one.body.radius_cm
    poses = [Pose.from_degrees(radius + d, middle, h) for d in DISTANCES_CM for h in HEADINGS_DEG]
    return np.concatenate([simulation.probe(pose)[0][0] for pose in poses])
