"""The settings of a study of noise levels: everything that its results depend on."""

import math
import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from realitygap.experiments.folder import Settings
from realitygap.robots.address import Address
from realitygap.study.settings import LARGEST, whole
from realitygap.tasks.load import TASKS, load_task
from realitygap.tasks.task import Task
from realitygap.user_code import place_of, placed
from realitygap.world.arena import load_arena
from realitygap.world.files import require
from realitygap.world.noise import noise_level

__all__ = ["CONFIG", "NoiseConfig", "levels_of", "tasks_of"]

CONFIG = "noise-study.toml"
"""The file in the study's folder."""

LOUDEST = 10.0

ARMS_ONLY = ("first_unit", "foreign", "fittest", "starts_by_unit", "seeds")
"""Settings that only an arm of the plan may have."""


@dataclass(frozen=True, kw_only=True)
class NoiseConfig(Settings):
    """The whole design.

    Attributes:
        arm: of the second study's plan (`second.arms`), which alone may set the last ones here; None: a
            design of your own.
        levels: of noise: controllers evolve at each, and are compared with the simulation at each.
        runs: controllers of each task and level, over all seed sets; or of each level, in the levels' order.
        seed_sets: sets of runs with separate seeds: each is a study in itself.
        units: number of the twin's units, from `first_unit` on; a simulation is calibrated to each.
        starts: of each controller on each unit.
        evaluations: of each run.
        twin_noise: the twin's noise scale.
        seed: random seed.
        tasks: of the paper, one or both: the score's exemplars are for them.
        seconds: length of a trial; the task's own if None.
        robot: instead of the twin, `stranger` or `enki:MODEL` with its units; or one of your own,
            `file.py:Class` or `module:Class`, as the only unit.
        base: the approximate profile of your own robot, by name or file.
        arena: another than the task's, by name or file, if there is one task; for a larger robot.
        first_unit: its number.
        foreign: number of units that a controller drives besides its calibration unit, the next ones
            cyclically; all if None.
        fittest: whether each run's fittest of the last population drives too, on its calibration unit alone.
        starts_by_unit: whether starts are drawn for each unit, for both seed sets; else for each seed set,
            for all units.
        seeds: of the seed sets, if separate; `seed` is then only the units'.

    Raises:
        ConfigError: names the key, what was expected and what came.
    """

    FILE, FACTS = CONFIG, "study.toml"
    WHAT, COMMAND = "study of the level of noise", "realitygap experiment noise"

    arm: str | None = None
    levels: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0, 4.0)
    runs: int | tuple[int, ...] = 40
    seed_sets: int = 2
    units: int = 3
    starts: int = 8
    evaluations: int = 1000
    twin_noise: float = 1.0
    seed: int = 1995
    tasks: tuple[str, ...] = TASKS
    seconds: float | None = None
    robot: str | None = None
    base: str | None = None
    arena: str | None = None
    first_unit: int = 1
    foreign: int | None = None
    fittest: bool = False
    starts_by_unit: bool = False
    seeds: tuple[int, ...] = ()

    def _check(self) -> None:
        for key, largest in (("seed_sets", 100), ("units", 100), ("evaluations", 10**9)):
            whole(key, getattr(self, key), 1, largest)
        whole("starts", self.starts, 2, 1000)  # one start is not enough for a comparison
        whole("seed", self.seed, 0, LARGEST)
        given = tuple(noise_level(level) for level in self.levels)
        object.__setattr__(self, "levels", tuple(sorted(given)))
        different = len(set(self.levels)) == len(self.levels) >= 2
        require(different, "levels", "two or more, all different", list(self.levels))
        self._check_runs(given)
        loud = f"a number from 0 to {LOUDEST:g} (1: as noisy as the robot's own)"
        require(0 <= self.twin_noise <= LOUDEST, "twin_noise", loud, self.twin_noise)
        known = bool(self.tasks) and len(set(self.tasks)) == len(self.tasks) and set(self.tasks) <= set(TASKS)
        require(known, "tasks", f"different ones of {', '.join(TASKS)}", list(self.tasks))
        if self.seconds is not None:
            object.__setattr__(self, "seconds", _seconds(self.seconds))
        if self.arena is not None:
            load_arena(self.arena)
            require(len(self.tasks) == 1, "arena", "none with several tasks", self.arena)
            object.__setattr__(self, "arena", _whole_path(self.arena))
        self._check_robot()
        if self.arm is None:
            for key in ARMS_ONLY:
                usual = getattr(type(self), key)
                require(getattr(self, key) == usual, key, f"{usual!r} except in an arm of the plan",
                        getattr(self, key))  # fmt: skip
            return
        whole("first_unit", self.first_unit, 1, 10**6)
        whole("foreign", self.foreign, 0, self.units - 1)
        require(len(self.seeds) == self.seed_sets, "seeds", f"one for each of {self.seed_sets} seed sets",
                self.seeds)  # fmt: skip

    def _check_runs(self, levels: tuple[float, ...]) -> None:
        """Runs of each level, or of all, sorted like the levels."""
        each = self.runs if isinstance(self.runs, tuple | list) else (self.runs,)
        for runs in each:
            whole("runs", runs, 1, 10**4)
            cure = f"Give a multiple of {self.seed_sets}."
            require(runs % self.seed_sets == 0, "runs", f"as many in each of {self.seed_sets} seed sets",
                    runs, cure)  # fmt: skip
        if not isinstance(self.runs, int):
            require(len(each) == len(levels), "runs", f"one for each of {len(levels)} levels", self.runs)
            rising = sorted(zip(levels, each, strict=True))
            object.__setattr__(self, "runs", tuple(runs for _, runs in rising))

    def _check_robot(self) -> None:
        """Check that a robot of your own has a base and no settings of the twin; make file names absolute."""
        if self.robot is None:
            require(self.base is None, "base", "none for a twin", self.base, "Leave it out, or give `robot`.")
            return
        own = "a robot of your own that places itself, file.py:Class or module:Class"
        form = f"twin, stranger, enki:MODEL, or {own}"
        require(isinstance(self.robot, str), "robot", form, self.robot)
        address = Address.parse(self.robot)
        if address.unit is not None:
            model = str(address).rpartition(":")[0]
            cure = "Its units are those from 1 to `units`."
            require(self.robot in (address.kind, model), "robot", model, self.robot, cure)
            require(self.base is None, "base", f"none for {model}", self.base, "Leave it out.")
            object.__setattr__(self, "robot", model)
            return
        cure = "For one that a person carries, use record, calibrate, evolve and transfer, one by one."
        require(address.kind == "own", "robot", form, self.robot, "" if address.port is None else cure)
        rough = f"the rough profile of {self.robot}: its radius, heights, top command and speed"
        require(isinstance(self.base, str), "base", rough, self.base)
        alone = "1 with a robot of your own, which is the only unit"
        require(self.units == 1, "units", alone, self.units, "Only the twin has several.")
        require(self.twin_noise == 1, "twin_noise", "1 with a robot of your own, which has its own noise",
                self.twin_noise)  # fmt: skip
        file = place_of(self.robot)
        if file is not None:
            object.__setattr__(self, "robot", placed(self.robot, file[0].resolve()))
        object.__setattr__(self, "base", _whole_path(str(self.base)))

    def address(self, unit: int) -> str:
        """Address of the robot that is this unit."""
        return self.robot if self.robot and self.base else f"{self.robot or 'twin'}:{unit}"

    def task(self, name: str) -> Task:
        """A task with this study's arena and duration."""
        task = load_task(name)
        task = task if self.seconds is None else replace(task, seconds=self.seconds)
        return task if self.arena is None else replace(task, arena=load_arena(self.arena))

    def runs_in_set(self, level: float) -> int:
        """Runs of a task in one seed set at a level."""
        runs = self.runs if isinstance(self.runs, int) else self.runs[self.levels.index(level)]
        return runs // self.seed_sets

    @property
    def every_unit(self) -> range:
        return range(self.first_unit, self.first_unit + self.units)

    @property
    def individuals(self) -> tuple[str, ...]:
        """The individuals of each run that drive."""
        return ("champion", "fittest") if self.fittest else ("champion",)

    def driven(self, home: int, individual: str = "champion") -> tuple[int, ...]:
        """Units that an individual of a calibration unit drives: all in order, or its own first."""
        if self.foreign is None:
            return tuple(self.every_unit)
        more = self.foreign if individual == "champion" else 0
        return tuple(self.every_unit[(home - self.first_unit + k) % self.units] for k in range(more + 1))

    @property
    def controllers(self) -> int:
        """Number of runs."""
        return len(self.tasks) * self.seed_sets * sum(map(self.runs_in_set, self.levels))

    @property
    def twin_trials(self) -> int:
        """Number of trials on the twin."""
        units = sum(len(self.driven(self.first_unit, individual)) for individual in self.individuals)
        return self.controllers * units * self.starts

    def to_dict(self) -> dict[str, Any]:
        """The settings with the file's keys, without None, and without an arm's settings outside arms."""
        hidden = () if self.arm else ARMS_ONLY
        return {key: value for key, value in super().to_dict().items() if key not in hidden}

    @property
    def named(self) -> str:
        """Options for a robot of your own, which is a program, or for the arm."""
        robot = "" if self.robot is None else f" --robot {shlex.quote(self.robot)}"
        return robot if self.arm is None else f" --arm {self.arm}"


def _whole_path(name: str) -> str:
    """A file's absolute path; other names are those of shipped ones."""
    return str(Path(name).resolve()) if Path(name).is_file() else name


def levels_of(text: str) -> tuple[float, ...]:
    """Noise levels as typed by a person: "0,0.5,observed,2".

    Raises:
        ConfigError: names the invalid one.
    """
    return tuple(noise_level(part) for part in text.split(","))


def tasks_of(text: str) -> tuple[str, ...]:
    """Tasks as typed by a person: "both", or names or words of the paper's tasks.

    Raises:
        TaskError: names the invalid one.
    """
    return TASKS if text == "both" else tuple(load_task(word).name for word in text.split(","))


def _seconds(value: object) -> float:
    """A trial's duration: whole steps, and long enough for a comparison."""
    number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    steps = round(float(value) * 10) if number else 0  # type: ignore[arg-type]
    exact = number and abs(steps / 10 - float(value)) < 1e-6  # type: ignore[arg-type]
    require(exact and steps >= 20, "seconds", "a multiple of 0.1 from 2 on", value)
    return steps / 10
