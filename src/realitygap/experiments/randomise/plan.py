"""What an experiment of measuring or randomising is to do: its settings, conditions and controllers.

`docs/noise-level-2.md` states the design; whatever is drawn is a function of names alone.
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
"""In the experiment's folder."""
TASK = "obstacle-avoidance"
NOISES = (0.0, 1.0)
ALL, LOOKUP = "own, all", "look-up table"
KNOWN = {"paper": 0.0, "another unit": 0.0, "own, 5 %": 0.05, "own, 20 %": 0.2, ALL: 1.0, LOOKUP: 1.0}
"""What the simulation may know of the unit, and the share of the standard recording that this takes."""

DISTANCES_CM, HEADINGS_DEG = (1.0, 2.0, 3.0), range(0, 360, 45)
"""From a wall, where units' readings are compared."""
LEAST = 0.15
"""Of the full scale: readings below show a sensor's dark, not its sensitivity."""
WIDEST = 0.9

ROBOTS = ("twin", "stranger", "enki:khepera")
"""Those that the paper's constants are meant for: Kheperas with units."""


@dataclass(frozen=True, kw_only=True)
class RandomiseConfig(Settings):
    """The whole design.

    Attributes:
        robot: whose units: one of ROBOTS.
        units: so many, from `first_unit` on.
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
        """The units' numbers."""
        return range(self.first_unit, self.first_unit + self.units)

    @property
    def task(self) -> Task:
        """Obstacle avoidance, for its time."""
        task = load_task(TASK)
        return task if self.seconds is None else replace(task, seconds=self.seconds)

    def address(self, unit: int) -> Address:
        """Of a unit."""
        return Address.parse(f"{self.robot}:{unit}")


class Spread(NamedTuple):
    """Shares within which constants are drawn anew: sensors' sensitivities; wheels and track."""

    infrared: float
    wheels: float


class Condition(NamedTuple):
    """What the simulation is made of, whether constants are drawn anew, and its noise."""

    known: str
    randomised: bool
    noise: float

    @property
    def name(self) -> str:
        """As in the names of files."""
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
        """As in the names of files and messages."""
        return f"{self.condition.name}-run-{self.run}"


def conditions() -> tuple[Condition, ...]:
    """All of them, in the order of the tables; a look-up table has no constants to draw."""
    return tuple(
        Condition(known, randomised, noise)
        for known in KNOWN
        for randomised in ((False,) if known == LOOKUP else (False, True))
        for noise in NOISES
    )


def controllers(config: RandomiseConfig) -> tuple[Controller, ...]:
    """All of them, grouped by unit, so that whoever takes them in order changes robots seldom."""
    return tuple(
        Controller(condition=condition, run=run, unit=unit)
        for unit in config.numbers
        for condition in conditions()
        for run in _runs(config, unit)
    )


def evolution(
    config: RandomiseConfig, unit: int, known: str, profile: str, spread: Spread
) -> tuple[StudyConfig, dict[Controller, str]]:
    """What evolves for a unit in one state of knowledge, and each controller's run there, by name.

    All states of a unit have the same seeds. `profile` is what is known: a file, or a shipped one's name.

    Args:
        config: the whole design.
        unit: its number.
        known: one of KNOWN.
        profile: what is known, a file or a shipped profile's name.
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
    """Numbers of a condition's runs on this unit: the units take turns."""
    return [run for run in range(1, config.runs + 1) if config.numbers[(run - 1) % config.units] == unit]


def calibrated_folder(folder: Path, unit: int, known: str) -> Path:
    """Where a unit's profile by its own recording, a share of that, or its look-up table, is."""
    name = "table" if known == LOOKUP else f"{100 * KNOWN[known]:g}"
    return folder / "calibration" / f"unit-{unit}" / name


class Profiles:
    """The calibrated units of an experiment."""

    def __init__(self, folder: Path, config: RandomiseConfig) -> None:
        self.folder, self.config = folder, config
        self.of = cache(lambda unit, known: load_profile(self.file(unit, known)))
        self.spread = cache(lambda: spread_of([self.of(unit, ALL) for unit in config.numbers]))

    def file(self, unit: int, known: str) -> str:
        """The profile of what is known of a unit: a file, or a shipped one's name."""
        if known == "paper":
            return known
        numbers = self.config.numbers
        if known == "another unit":
            unit, known = numbers[(numbers.index(unit) + 1) % len(numbers)], ALL
        return str(calibrated_folder(self.folder, unit, known) / PROFILE)


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


def _readings(one: Profile) -> Floats:
    """[places · sensors] noise-free counts before the left wall of the task's arena."""
    simulation = Simulation("obstacle-avoidance", one, 0.0)
    middle, radius = simulation.task.arena.size_cm[1] / 2, one.body.radius_cm
    poses = [Pose.from_degrees(radius + d, middle, h) for d in DISTANCES_CM for h in HEADINGS_DEG]
    return np.concatenate([simulation.probe(pose)[0][0] for pose in poses])
