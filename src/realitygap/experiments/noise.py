"""The paper's question as an experiment: which level of noise crosses the reality gap best?

Each unit of a robot is recorded and a simulation calibrated to it. Controllers evolve at every level of
noise, drive every unit from the same starts, and are compared with the simulation at every level (§6).

Another design derives from `NoiseExperiment`: `studies/` has two.
"""

import json
import math
import shlex
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache, cached_property
from hashlib import blake2b
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration import unit as recorded
from realitygap.calibration.plan import check_period
from realitygap.control.encoding import Encoding, genotype_of
from realitygap.correspondence.names import common_name, namer
from realitygap.correspondence.score import compare, exemplar_scale
from realitygap.correspondence.setting import Setting, setting_of
from realitygap.correspondence.trials import Trial, resampled, trial_of
from realitygap.errors import ConfigError, StudyError, TrackError, UsageError
from realitygap.evolution.algorithm import Genes
from realitygap.experiments.experiment import (
    RESULTS,
    Made,
    Phase,
    Phases,
    Recorded,
    Seconds,
    Settings,
    kept,
    missing,
    open_folder,
    session,
    write_table,
)
from realitygap.files import atomic_write, read_toml, to_toml
from realitygap.kernels.types import Networks
from realitygap.plugins import place_of, placed
from realitygap.robots.address import Address
from realitygap.robots.drive import Recording
from realitygap.simulation.simulation import Simulation
from realitygap.streams import named_stream
from realitygap.study.config import LARGEST, Condition, StudyConfig, TaskSettings
from realitygap.study.config import whole as whole_number
from realitygap.study.folder import exists, write_files
from realitygap.study.load import Study, load_study
from realitygap.study.plan import named
from realitygap.study.provenance import versions
from realitygap.study.runner import merge_runs
from realitygap.tasks.load import TASKS, load_task
from realitygap.tasks.task import Task
from realitygap.track import Track, settled
from realitygap.transfer.paths import score
from realitygap.transfer.rig import Rig
from realitygap.values import Floats, Pose
from realitygap.work.folder import file_errors, new_folder, refuse_difference
from realitygap.work.pool import Pool, Setup, Tell, Workers, far, near
from realitygap.work.progress import OnProgress
from realitygap.work.shard import Shard, marked
from realitygap.world.arena import load_arena
from realitygap.world.robot import Profile, load_profile, noise_level
from realitygap.world.toml import require

__all__ = [
    "FIGURES", "WORK", "Controller", "Driven", "NoiseConfig", "NoiseExperiment", "Pair",
    "Trials", "calibration_folder", "check_robot", "levels_of", "merge_noise", "noise_experiment", "tasks_of",
]  # fmt: skip

WORK = "experiment noise"
"""The kind of work that a shard divides."""
ARENA = "arena.toml"
"""Name of the arena's file for workers that cannot see the experiment's folder."""
LOUDEST = 10.0
LEAST_TRIALS = 2
"""Smallest number of trials that must remain without those lost by the camera."""
FIGURES = ("score", "behaviour", "layout", "noisiness", "responsiveness")
CALIBRATION = ("unit", "channel", "model_error", "noise", "ratio", "ratio_over_all")
"""Columns of calibration.csv."""
TWIN_COSTS, ENKI_COSTS = (130.0, 0.37), (45.0, 0.15)
EVALUATION_COST, RETEST_COST, CELL_COST = 1.35e-3, 0.35, 0.08
"""Approximate times on one core, s: a unit's calibration and a trial on it, on the twin and on Enki's robots;
an evaluation, a run's retest, a comparison with a level. Only used to estimate the time left."""


# What is asked


@dataclass(frozen=True, kw_only=True)
class NoiseConfig(Settings):
    """The whole design.

    Attributes:
        levels: of noise: controllers evolve at each, and are compared with the simulation at each.
        runs: controllers of each task and level; the units take turns.
        units: number of the robot's units, from 1 on; a simulation is calibrated to each.
        starts: of each controller on each unit.
        evaluations: of each run.
        twin_noise: the twin's noise scale.
        seed: random seed.
        tasks: of the paper, one or both: the score's exemplars are for them.
        seconds: length of a trial; the task's own if None.
        robot: instead of the twin, `stranger` or `enki:MODEL` with its units; or as the only unit one of your
            own, `file.py:Class` or `module:Class`, or readings recorded of one, `table:PROFILE`.
        base: the approximate profile of your own robot, by name or file; of recorded readings their profile.
        arena: another than the task's, by name or file, if there is one task; for a larger robot.

    Raises:
        ConfigError: names the key, what was expected and what came.
    """

    FILE, FACTS = "noise-study.toml", "study.toml"
    WHAT, COMMAND = "study of the level of noise", "realitygap experiment noise"

    levels: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0, 4.0)
    runs: int = 40
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

    def _check(self) -> None:
        self._check_runs()
        for key, least, largest in (
            ("units", 1, 100), ("evaluations", 1, 10**9), ("starts", 2, 1000), ("seed", 0, LARGEST),
        ):  # fmt: skip
            whole_number(key, getattr(self, key), least, largest)
        object.__setattr__(self, "levels", tuple(sorted(map(noise_level, self.levels))))
        different = len(set(self.levels)) == len(self.levels) >= 2
        require(different, "levels", "two or more, all different", list(self.levels))
        loud = f"a number from 0 to {LOUDEST:g} (1: as noisy as the robot's own)"
        require(0 <= self.twin_noise <= LOUDEST, "twin_noise", loud, self.twin_noise)
        known = bool(self.tasks) and len(set(self.tasks)) == len(self.tasks) and set(self.tasks) <= set(TASKS)
        require(known, "tasks", f"different ones of {', '.join(TASKS)}", list(self.tasks))
        if self.seconds is not None:
            steps = round(self.seconds * 10) if math.isfinite(self.seconds) else 0
            exact = steps >= 20 and abs(steps / 10 - self.seconds) < 1e-6
            require(exact, "seconds", "a multiple of 0.1 from 2 on", self.seconds)
            object.__setattr__(self, "seconds", steps / 10)
        if self.arena is not None:
            load_arena(self.arena)
            require(len(self.tasks) == 1, "arena", "none with several tasks", self.arena)
            object.__setattr__(self, "arena", _whole_path(self.arena))
        if self.robot is None:
            require(self.base is None, "base", "none for a twin", self.base, "Leave it out, or give `robot`.")
        else:
            self._check_robot(self.robot)

    def _check_runs(self) -> None:
        whole_number("runs", self.runs, 1, 10**4)

    def _check_robot(self, robot: str) -> None:
        """Check that a robot of your own has a base and no settings of the twin; make file names absolute."""
        own = "a robot of your own that places itself, file.py:Class or module:Class"
        address = Address.parse(robot)
        if address.unit is not None:
            model = str(address).rpartition(":")[0]
            cure = "Its units are those from 1 to `units`."
            require(robot in (address.kind, model), "robot", model, robot, cure)
            require(self.base is None, "base", f"none for {model}", self.base, "Leave it out.")
            object.__setattr__(self, "robot", None if model == "twin" else model)
            return
        cure = "For one that a person carries, use record, calibrate, evolve and transfer, one by one."
        form = f"twin, stranger, enki:MODEL, table:PROFILE, or {own}"
        require(address.is_file, "robot", form, robot, "" if address.port is None else cure)
        if address.kind == "table":
            object.__setattr__(self, "base", self.base or address.rest)
        rough = f"the rough profile of {robot}: its radius, heights, top command and speed"
        require(isinstance(self.base, str), "base", rough, self.base)
        alone = "1 with a robot of your own, which is the only unit"
        require(self.units == 1, "units", alone, self.units, "Only the twin has several.")
        quiet = "1 with a robot of your own, which has its own noise"
        require(self.twin_noise == 1, "twin_noise", quiet, self.twin_noise)
        file = place_of(robot)
        if address.kind == "table":
            object.__setattr__(self, "robot", f"table:{_whole_path(address.rest)}")
        elif file is not None:
            object.__setattr__(self, "robot", placed(robot, file[0].resolve()))
        object.__setattr__(self, "base", _whole_path(str(self.base)))

    @property
    def named(self) -> str:
        """Option for a robot other than the twin; one of your own is a program."""
        return "" if self.robot is None else f" --robot {shlex.quote(self.robot)}"

    @property
    def command(self) -> str:
        """The command that makes this experiment, without default options."""
        usual = type(self)().to_dict()
        if self.base is not None:
            usual["units"] = self.units  # cannot be set by a user
        changed = {key: value for key, value in self.to_dict().items() if usual.get(key) != value}
        words = [f"--{key.replace('_', '-')} {_typed(value)}" for key, value in changed.items()]
        return " ".join([self.COMMAND, *words])

    def address(self, unit: int) -> str:
        """Address of the robot that is this unit."""
        return self.robot if self.robot and self.base else f"{self.robot or 'twin'}:{unit}"

    def task(self, name: str) -> Task:
        """A task with this experiment's arena and duration."""
        task = load_task(name)
        task = task if self.seconds is None else replace(task, seconds=self.seconds)
        return task if self.arena is None else replace(task, arena=load_arena(self.arena))

    @property
    def every_unit(self) -> range:
        """Numbers of the units."""
        return range(1, self.units + 1)


def _whole_path(name: str) -> str:
    """A file's absolute path; other names are those of shipped ones."""
    return str(Path(name).resolve()) if Path(name).is_file() else name


def _typed(value: Any) -> str:
    """A setting as typed by a person, with all digits."""
    if isinstance(value, list):
        return ",".join(map(_typed, value))
    return repr(value).removesuffix(".0") if isinstance(value, float) else shlex.quote(str(value))


def levels_of(text: str) -> tuple[float, ...]:
    """Noise levels as typed by a person, "0,0.5,observed,2"; ConfigError names the invalid one."""
    return tuple(noise_level(part) for part in text.split(","))


def tasks_of(text: str) -> tuple[str, ...]:
    """Tasks as typed by a person: "both", or names of the paper's tasks; TaskError names the invalid one."""
    return TASKS if text == "both" else tuple(load_task(word).name for word in text.split(","))


def check_robot(config: NoiseConfig) -> None:
    """Refuse a robot of your own that cannot do the trials, before any work.

    Raises:
        UsageError: it does not place itself, its path is unknown, it lacks a task's sensors, its period
            differs from its base's, or a trial is not a whole number of its steps.
        ConfigError: its base is not a profile.
    """
    if config.robot is None:
        return
    base = None if config.base is None else load_profile(config.base)
    with closing(Address.parse(config.address(config.every_unit[0])).open()) as body:
        who = f"robot {config.robot}: expected"
        if not body.places_itself:
            cure = "Give it one; a robot that a person carries is driven by `realitygap transfer`."
            raise UsageError(f"{who} one that places itself; it has no `enter`. {cure}")
        if not (body.knows_pose or body.counts_turns):
            raise UsageError(f"{who} one whose path is known; it has neither a `pose` nor counters.")
        if base is not None:
            check_period(body, base)
        kinds = [one.name for one in body.channels]
    fit = [name for name in TASKS if load_task(name).feeds in kinds]
    for name in config.tasks:
        if name not in fit:
            needs = f"{who} {load_task(name).feeds} sensors for {name}; it has {', '.join(kinds)}."
            raise UsageError(f"{needs} Leave that task out: --tasks {','.join(fit)}.")
        if base is not None:
            config.task(name).steps_of(base)


# The design: controllers, their trials and their comparisons


@dataclass(frozen=True, kw_only=True)
class Controller:
    """A run's champion.

    Attributes:
        task, level: that it evolved for, and under.
        run: its number, from 1, of its task and level.
        home: its calibration unit.
        study: the study of evolution with its run; run_name: the run's name there.
        seed_set: of designs with several sets of runs, each with its own seeds.
    """

    task: str
    level: float
    run: int
    home: int
    study: str
    run_name: str
    seed_set: int = 1

    @property
    def key(self) -> tuple[object, ...]:
        """The names of the streams of its trials."""
        return (self.task, self.seed_set, self.level, self.run)

    @property
    def name(self) -> str:
        """Its name in files and messages."""
        return f"{self.task}-level-{self.level!r}-run-{self.run}"


class Pair(NamedTuple):
    """Unit and start of a trial, both from 1."""

    unit: int
    start: int


Trials = Mapping[Pair, Trial]


class Driven(NamedTuple):
    """A controller's trials on the robot's units, as on file.

    Attributes:
        units: numbers of the units that it drove.
        poses: [units, starts, rows, 3]: x, y (cm), heading (rad), a row a step from the start; NaN where the
            camera lost the robot.
        period_s: of a step.
        more: further arrays [units, starts, …] that a design keeps.
    """

    units: tuple[int, ...]
    poses: Floats
    period_s: float
    more: Mapping[str, NDArray[Any]]

    def track(self, unit: int, start: int) -> Track:
        """One trial."""
        x, y, heading = self.poses[self.units.index(unit), start - 1].T
        t = np.arange(len(x), dtype=np.float64) * self.period_s
        return Track(t=t, x=x, y=y, heading=settled(heading, wrapped=False))


def calibration_folder(folder: Path, unit: int) -> Path:
    """The folder of a unit's recordings and profile."""
    return folder / "calibration" / f"unit-{unit}"


class NoiseExperiment:
    """The experiment in a folder.

    Every draw is a function of names alone, so that neither the order of work nor the rest of the experiment
    affects results. What another design may change is a method of its own: `controllers`, `driven`, `seed`,
    `start_poses`, `calibrate`, `ruler`, `genes`, `keep`, `cell`, and the tables' rows.
    """

    def __init__(self, folder: Path, config: NoiseConfig) -> None:
        self.folder, self.config = folder, config
        self.task = cache(config.task)
        self.profile: Callable[[int], Profile] = cache(lambda unit: load_profile(self.profile_file(unit)))
        self.study: Callable[[str], Study] = cache(lambda name: load_study(self.evolved_folder(name)))
        self.starts = cache(self.start_poses)
        self._encoding = cache(self._made)
        self.known: dict[Controller, Genes] = {}  # for workers that cannot see evolution's studies
        self._rigs: dict[int, Rig] = {}
        self._rigged = ("", 0)

    def controllers(self) -> Sequence[Controller]:
        """All controllers, by task and calibration unit, so that working in order rarely changes robots."""
        config = self.config
        return [
            Controller(
                task=task, level=level, run=run, home=home, study=f"unit-{home}",
                run_name=f"{task}/{named(level)}/{index}",
            )
            for task in config.tasks
            for home in config.every_unit
            for level in config.levels
            for index, run in enumerate(range(home, config.runs + 1, config.units), start=1)
        ]  # fmt: skip

    def driven(self, one: Controller) -> tuple[int, ...]:
        """Units that a controller drives."""
        return tuple(self.config.every_unit)

    def seed(self, seed_set: int) -> int:
        """Of a set of runs."""
        return self.config.seed

    def start_poses(self, task: str, seed_set: int, unit: int) -> tuple[Pose, ...]:
        """Starts of the trials on a unit: the same for all controllers and levels, and here for all units."""
        return self.drawn(task, self.config.every_unit[0], task, seed_set)

    def drawn(self, task: str, unit: int, *names: object) -> tuple[Pose, ...]:
        """A task's starts in the simulation of a unit, from the streams of some names."""
        simulation, numbers = Simulation(self.task(task), self.profile(unit)), range(self.config.starts)
        return tuple(
            simulation.start(named_stream(self.config.seed, "start", *names, k + 1)) for k in numbers
        )

    @cached_property
    def studies(self) -> dict[str, list[Controller]]:
        """The controllers of each study of evolution, those of a run once."""
        made: dict[str, dict[str, Controller]] = {}
        for one in self.controllers():
            made.setdefault(one.study, {}).setdefault(one.run_name, one)
        return {study: list(runs.values()) for study, runs in made.items()}

    def evolved_folder(self, study: str) -> Path:
        """The folder of a study of evolution."""
        return self.folder / "evolved" / study

    def driven_file(self, one: Controller) -> Path:
        """A controller's paths on the robot's units."""
        return self.folder / "situated" / f"{one.name}.npz"

    def compared_file(self, one: Controller) -> Path:
        """The comparisons of those with the simulations."""
        return self.folder / "simulated" / f"{one.name}.json"

    def profile_file(self, unit: int) -> Path:
        """A unit's calibration."""
        return calibration_folder(self.folder, unit) / recorded.PROFILE

    def calibrate(self, unit: int, workers: Workers, report: Recorded) -> None:
        """Make a unit's profile with the experiment's twin noise, which belongs to the unit."""
        config = self.config
        where: dict[str, Any] = {
            "folder": calibration_folder(self.folder, unit), "workers": workers, "on_progress": report,
            "seed": named_stream(config.seed, "calibration", unit) >> 1,
        }  # fmt: skip
        if config.base is not None:
            recorded.calibrated_robot(robot=config.address(unit), base=config.base, **where)
            return
        who = unit if config.robot is None else config.address(unit)
        recorded.calibrated_unit(unit=who, noise=config.twin_noise, **where)

    def ruler(self, unit: int) -> Profile:
        """The robot as which a unit's tracks are scored."""
        return self.profile(unit)

    def evolution(self, study: str) -> StudyConfig:
        """The configuration of a study of evolution, in the simulation of its calibration unit."""
        config, runs = self.config, self.studies[study]
        first, levels = runs[0], {one.level for one in runs}
        return StudyConfig(
            title=f"Noise level: simulation calibrated to unit {first.home}",
            seed=named_stream(self.seed(first.seed_set), "evolution", first.seed_set, first.home) >> 1,
            runs=sum((one.task, one.level) == (first.task, first.level) for one in runs),
            evaluations=config.evaluations,
            fresh_trials=1,  # of the champion at the paper's levels: the compared paths tell more
            profile=str(self.profile_file(first.home)),
            conditions=tuple(
                Condition(task=task, noise=level)
                for task in config.tasks for level in config.levels if level in levels
            ),
            task=TaskSettings(seconds=config.seconds),
            arenas={} if config.arena is None else {config.tasks[0]: config.arena},
        )  # fmt: skip

    def genes(self, one: Controller) -> Genes:
        """A controller's genotype: its run's champion."""
        found = self.known.get(one)
        found = self.study(one.study).run(one.run_name).champion if found is None else found
        assert found is not None
        return found

    def networks(self, one: Controller) -> Networks:
        """A controller's network."""
        return self._encoding(one.task, one.study).decode(self.genes(one)[np.newaxis])

    def _made(self, task: str, study: str) -> Encoding:
        home = self.studies[study][0].home
        return self.evolution(study).encoding_for(self.task(task).of(self.profile(home)))

    def simulation(self, task: str, unit: int, home: int, level: float) -> Simulation:
        """The simulation calibrated to a unit, for controllers calibrated to unit `home`.

        The input range (§7.2, "bands") belongs to the controller, which keeps that of its calibration unit on
        every robot, twin or simulated.
        """
        robot, own = self.profile(unit), self.profile(home)
        infrared = replace(robot.infrared, bands=own.infrared.bands)
        ambient = replace(robot.ambient, bands=own.ambient.bands)
        return Simulation(self.task(task), replace(robot, infrared=infrared, ambient=ambient), level)

    # Trials on the robot

    def rig(self, one: Controller, unit: int) -> Rig:
        """A unit in the arena of the controller's task, with the input range of its calibration unit; units
        stay open while controllers of one task and calibration unit take turns."""
        if self._rigged != (one.task, one.home):
            self.close()
            self._rigged = (one.task, one.home)
        if unit not in self._rigs:
            self._rigs[unit] = Rig(
                self.task(one.task), self.profile(one.home), robot=self.config.address(unit),
                twin_noise=self.config.twin_noise, folder_for_camera=self.folder / "situated" / "cameras",
            )  # fmt: skip
        return self._rigs[unit]

    def close(self) -> None:
        """Release all units."""
        while self._rigs:
            self._rigs.popitem()[1].close()

    def drive(self, one: Controller, tell: Tell) -> bytes:
        """Let a controller drive its units from every start; the content of its file. `tell` receives shares
        of the work."""
        units, task = self.driven(one), self.task(one.task)
        driver = genotype_of(self._encoding(one.task, one.study), self.genes(one)).controller()
        rows: list[dict[str, NDArray[Any]]] = []
        for unit in units:
            for k, pose in enumerate(self.starts(one.task, one.seed_set, unit), start=1):
                stream = named_stream(self.seed(one.seed_set), "situated", *one.key, unit, k)
                rows.append(self.keep(*self.rig(one, unit).drive(driver, stream, pose), task))
                tell(1.0 / (len(units) * self.config.starts))
        arrays = {key: np.array([row[key] for row in rows]) for key in rows[0]}
        file, shape = BytesIO(), (len(units), self.config.starts)
        np.savez_compressed(file, **{k: v.reshape(*shape, *v.shape[1:]) for k, v in arrays.items()})  # type: ignore[arg-type]
        return file.getvalue()

    def keep(self, track: Track, made: Recording, task: Task) -> dict[str, NDArray[Any]]:
        """What is kept of a trial on the robot: arrays by name, of the same shapes in each."""
        return {"poses": np.stack([track.x, track.y, track.heading], axis=1)}

    def read_driven(self, one: Controller) -> Driven:
        """A controller's stored trials.

        Raises:
            StudyError: they are missing, or the file is broken.
        """
        file, home, units = self.driven_file(one), self.profile(one.home), self.driven(one)
        shape = (len(units), self.config.starts, self.task(one.task).steps_of(home) + 1, 3)
        with kept(file, f"paths {list(shape)} of a controller"):
            with ZipFile(file) as parts:
                if parts.testzip() is not None:  # before a damaged header is trusted
                    raise ValueError
            with np.load(file) as arrays:
                more = {name: arrays[name] for name in arrays.files}
            found = Driven(units, more.pop("poses"), home.period_s, more)
            if found.poses.shape != shape:
                raise ValueError
        return found

    def seen(self, one: Controller, driven: Driven) -> tuple[dict[Pair, Trial], dict[int, float], int]:
        """Comparable trials on the robot, mean fitness on each unit, and the number of lost ones."""
        task, robot = self.task(one.task), self.ruler(one.home)
        trials: dict[Pair, Trial] = {}
        fitness: dict[int, list[float]] = {unit: [] for unit in driven.units}
        pairs = [Pair(unit, k) for unit in driven.units for k in range(1, driven.poses.shape[1] + 1)]
        for pair in pairs:
            track = driven.track(*pair)
            fitness[pair.unit].append(score(track, task, robot))
            try:
                radius, label = robot.body.radius_cm, self.start_label(pair)
                trial = resampled(track, start=label, unit=str(pair.unit), source=one.name, radius_cm=radius)
            except TrackError:
                continue  # lost for too long: its behaviour is unknown
            if track.found[0] and track.found[-1]:
                trials[pair] = trial
        return trials, {unit: _mean(scores) for unit, scores in fitness.items()}, len(pairs) - len(trials)

    def start_label(self, pair: Pair) -> str:
        """A start's name, by which pairs of trials are found; units share starts."""
        return str(pair.start)

    # Comparisons with the simulations

    def simulated(
        self, one: Controller, level: float, pairs: Sequence[Pair]
    ) -> tuple[dict[Pair, Trial], list[float]]:
        """A controller in the simulations of all units at a level: trials and their scores."""
        networks = self.networks(one)
        simulation = cache(lambda unit: self.simulation(one.task, unit, one.home, level))
        trials, scores = {}, []
        for pair in pairs:
            stream = named_stream(self.seed(one.seed_set), "simulated", *one.key, *pair)
            pose = self.starts(one.task, one.seed_set, pair.unit)[pair.start - 1]
            trajectory, fitness = simulation(pair.unit).trajectory(networks, stream=stream, pose=pose)
            radius, label = self.profile(pair.unit).body.radius_cm, self.start_label(pair)
            trials[pair] = trial_of(trajectory, start=label, unit=str(pair.unit), radius_cm=radius)
            scores.append(fitness)
        return trials, scores

    def compare(self, one: Controller, tell: Tell) -> dict[str, Any]:
        """Compare a controller's paths on the robot with the simulation at every level.

        Simulated trials of one unit and start have the same draws at every level, scaled by the level: so
        differences between levels are due to noise, not chance.
        """
        config, setting = self.config, setting_of([], self.task(one.task))
        situated, fitness, lost = self.seen(one, self.read_driven(one))
        cells, names, own = [], [], math.nan
        for level in config.levels:
            simulated, scores = self.simulated(one, level, list(situated))
            figures = self.cell(one, simulated, situated, setting)
            cells.append({"comparison_level": level, **figures, "fitness_simulated": _mean(scores)})
            if level == one.level:
                own, radius = _mean(scores), self.profile(one.home).body.radius_cm
                names = namer(setting, radius).name([*simulated.values()], setting)
            tell(1.0 / len(config.levels))
        return {
            "name": common_name(names),
            "fitness_simulated": own,
            "fitness_situated": _mean(list(fitness.values())),
            **{f"fitness_situated_unit_{unit}": mean for unit, mean in fitness.items()},
            "trials": len(situated),
            "trials_lost": lost,
            "cells": cells,
        }

    def cell(
        self, one: Controller, simulated: Trials, situated: Trials, setting: Setting
    ) -> dict[str, float]:
        """One comparison's figures over all units, and the score on each unit alone, which is on the coarser
        scale for one unit's pairs; `simulated` and `situated` are trials of the same units and starts."""
        units = self.driven(one)
        found = self.figures([*simulated.values()], [*situated.values()], setting, len(units))
        for unit in units:
            ours = [pair for pair in situated if pair.unit == unit]
            here, there = ([side[pair] for pair in ours] for side in (simulated, situated))
            found[f"score_unit_{unit}"] = self.figures(here, there, setting, 1)["score"]
        return found

    def figures(
        self, simulated: Sequence[Trial], situated: Sequence[Trial], setting: Setting, units: int
    ) -> dict[str, float]:
        """FIGURES of pairs of trials on a number of units; NaN if too few are left.

        One scale serves all comparisons of a task on this many units: the exemplars', for as many pairs of
        trials. In pairs a start's contribution to a distance cancels, leaving each trial's noise, so every
        trial counts, on any unit.
        """
        if len(situated) < LEAST_TRIALS:
            return dict.fromkeys(FIGURES, math.nan)
        pairs = units * self.config.starts
        scale = exemplar_scale(setting.exemplars, pairs, pairs, matched=True, jitter=setting.jitter)
        found = compare(simulated, situated, setting, scale=scale, resamples=0)
        figures = {key: getattr(found, key) for key in FIGURES}
        return {key: math.nan if value is None else value for key, value in figures.items()}

    def read_compared(self, one: Controller) -> dict[str, Any]:
        """A controller's stored results.

        Raises:
            StudyError: they are missing or broken.
        """
        file = self.compared_file(one)
        with kept(file, "the results of a controller's comparisons"):
            found: dict[str, Any] = json.loads(file.read_text("utf-8"))
            check = found.pop("check")
            levels = [cell["comparison_level"] for cell in found["cells"]]
            if check != _check_of(found) or levels != list(self.config.levels):
                raise ValueError
        return found

    # Tables

    def write_results(self) -> Path:
        """Gather all controllers' results: controllers.csv, cells.csv, calibration.csv, study.toml.

        Raises:
            StudyError: a controller's file is missing or broken.
        """
        folder, config = self.folder / RESULTS, self.config
        folder.mkdir(parents=True, exist_ok=True)
        order = sorted(self.controllers(), key=lambda one: (config.tasks.index(one.task), *one.key[1:]))
        found = {one: self.read_compared(one) for one in order}
        rows = [self.controller_row(one, made) for one, made in found.items()]
        cells = [self.cell_row(one, cell) for one, made in found.items() for cell in made["cells"]]
        write_table(folder / "controllers.csv", rows)
        write_table(folder / "cells.csv", cells)
        write_table(folder / "calibration.csv", list(self.calibration()), CALIBRATION)
        facts = {
            "command": config.command,
            **config.to_dict(),
            "controllers": len(found),
            "twin_trials": config.starts * sum(len(self.driven(one)) for one in found),
            "twin_trials_lost": sum(int(made["trials_lost"]) for made in found.values()),
            "trial_seconds": {task: self.task(task).seconds for task in config.tasks},
            "seconds": Seconds(self.folder).read(),
            "versions": versions(),
            "versions_at_start": read_toml(self.folder / config.FILE, StudyError, "").get("versions", {}),
        }
        atomic_write(folder / config.FACTS, to_toml(facts))
        return folder

    def who(self, one: Controller) -> dict[str, object]:
        """The first columns of each row."""
        return {"task": one.task, "run": one.run, "evolved_level": one.level}

    def controller_row(self, one: Controller, made: Mapping[str, Any]) -> dict[str, object]:
        """A controller's row of controllers.csv."""
        simulated, situated = made["fitness_simulated"], made["fitness_situated"]
        return {
            **self.who(one),
            "home_unit": one.home,
            "name": made["name"],
            "fitness_simulated": simulated,
            "fitness_situated": situated,
            "drop": simulated - situated,
            **{key: made[key] for key in made if key.startswith("fitness_situated_unit_")},
            "trials": made["trials"],
        }

    def cell_row(self, one: Controller, cell: Mapping[str, Any]) -> dict[str, object]:
        """A controller's row of cells.csv for a level."""
        return {**self.who(one), **cell}

    def calibration(self) -> Iterator[dict[str, object]]:
        """Accuracy of each unit's sensor fits: counts, and the model's error over the noise."""
        for unit in self.config.every_unit:
            for fit in self.profile(unit).provenance.fits:
                if fit.noise > 0:
                    row = {key: getattr(fit, key) for key in CALIBRATION[1:]}
                    yield {"unit": unit, **row, "ratio_over_all": fit.ratio_over_all or math.nan}


def _mean(values: Sequence[float]) -> float:
    """Mean of the known values; NaN for none."""
    known = [value for value in values if math.isfinite(value)]
    return math.fsum(known) / len(known) if known else math.nan


def _check_of(facts: object) -> str:
    """A digest of JSON data, to be stored beside it in its file."""
    return blake2b(json.dumps(facts).encode(), digest_size=8).hexdigest()


# The run


def noise_experiment(
    folder: str | Path,
    config: NoiseConfig | None = None,
    *,
    kind: type[NoiseExperiment] = NoiseExperiment,
    settings: type[NoiseConfig] = NoiseConfig,
    workers: Workers = None,
    engine: str = "cores",
    resume: bool = False,
    shard: Shard | str | None = None,
    on_progress: OnProgress | None = None,
) -> Path:
    """Carry out an experiment in a folder, or continue the one that is there.

    Neither `workers` nor interruptions change a bit of its tables.

    Args:
        folder: created if it does not exist.
        config: the settings; None to resume an experiment with its own.
        kind, settings: of another design.
        workers: processes, one a core if None, 1 stays in this process; or a pool.
        engine: for evolution's trials, "cores" or "cuda".
        resume: continue the experiment in the folder; without one, create it from `config`.
        shard: the share of the runs to do, such as "1/2", in a folder of its own; `merge_noise` puts them
            together. None: all runs, or on resuming those of the folder.
        on_progress: called a few times a second.

    Returns:
        The folder `results` with controllers.csv, cells.csv, calibration.csv and study.toml; of a shard the
        experiment's folder.

    Raises:
        UsageError: wrong settings, a folder that cannot be used, a robot that cannot do the trials.
        StudyInterruptedError: Ctrl-C; finished work is kept.
        RobotError: a unit does not follow its commands.
    """
    folder, asked = Path(folder), None if shard is None else Shard.parse(shard)
    if config is not None:
        check_robot(config)
    with session(folder, workers) as pool:
        mark = marked(folder, asked, WORK, begun=(folder / settings.FILE).is_file())
        made = open_folder(folder, settings, config, resume=resume, mark=mark)
        experiment, own = kind(folder.resolve(), made), None if mark is None else mark.shard
        _carry_out(experiment, pool, near(workers), engine, own, on_progress)
        if mark is None:
            return experiment.write_results()
        with file_errors(folder):
            mark.write(folder, finished=True)
        return folder


def _carry_out(
    made: NoiseExperiment, pool: Pool, recorders: Workers, engine: str, shard: Shard | None,
    on_progress: OnProgress | None,
) -> None:  # fmt: skip
    """Every phase that is not finished: calibrate, evolve, drive, compare; `recorders` calibrate."""
    config = made.config
    studies = {name: runs if shard is None else shard.own(runs) for name, runs in made.studies.items()}
    own = {(one.study, one.run_name) for runs in studies.values() for one in runs}
    every = [one for one in made.controllers() if (one.study, one.run_name) in own]
    uncalibrated = missing({unit: made.profile_file(unit) for unit in config.every_unit})
    to_drive = missing({one: made.driven_file(one) for one in every})
    to_compare = missing({one: made.compared_file(one) for one in every})
    evolved = not to_drive and all(exists(made.evolved_folder(study)) for study in studies)

    unit_cost, trial_cost = ENKI_COSTS if (config.robot or "").startswith("enki") else TWIN_COSTS
    run_cost = config.evaluations * EVALUATION_COST + RETEST_COST
    trials = config.starts * sum(len(made.driven(one)) for one in every) / max(len(every), 1)
    where = "on the robot" if config.robot else "on the twin"
    calibrating, evolving, driving, comparing = phases = (
        Phase("calibrate", "calibrating to the units", "units", len(config.every_unit), len(uncalibrated),
              unit_cost),
        Phase("evolve", "evolving", "runs", len(own), 0 if evolved else len(own), run_cost),
        Phase("situated", where, "controllers", len(every), len(to_drive), trial_cost * trials),
        Phase("simulated", "comparing with the simulations", "controllers", len(every), len(to_compare),
              CELL_COST * len(config.levels)),
    )  # fmt: skip
    work = Phases(made.folder, pool, phases, on_progress)

    def jobs(left: list[Controller], *, compared: bool) -> Iterator[Job]:
        for one in left:
            paths = made.driven_file(one).read_bytes() if compared and far(pool) else b""
            yield Job(one, made.genes(one), paths if compared else None)

    work.calibrate(
        calibrating, uncalibrated, lambda unit, report: made.calibrate(unit, recorders, report),
        len(recorded.PARTS) + 1,
    )  # fmt: skip
    evolution = (
        (made.evolved_folder(name), made.evolution(name), len(runs)) for name, runs in studies.items()
    )
    work.evolve(evolving, evolution, engine=engine, shard=shard)
    work.drive(driving, lambda: _setup(made, pool), jobs(to_drive, compared=False))
    work.drive(comparing, lambda: _setup(made, pool), jobs(to_compare, compared=True))


class Job(NamedTuple):
    """A controller to drive the units, or to be compared with the simulations.

    `driven` is the content of its file of paths, for a comparison; b"" if the worker can see the file.
    """

    controller: Controller
    genes: Genes
    driven: bytes | None = None


def _setup(made: NoiseExperiment, pool: Pool) -> Setup:
    """What workers get: the folder, or, if they cannot see it, its calibrations and arena.

    Raises:
        ConfigError: a robot that only this machine has.
    """
    config, files = made.config, {}
    if far(pool):
        if config.base is not None:
            raise ConfigError(
                f"robot {config.robot}: expected one that the cluster's workers have too: its file is on "
                "this machine. Leave out --workers, or give a number."
            )
        with file_errors(made.folder):
            profiles = map(made.profile_file, config.every_unit)
            files = {str(file.relative_to(made.folder)): file.read_bytes() for file in profiles}
        if config.arena is not None:
            files[ARENA] = load_arena(config.arena).to_toml().encode()
            config = replace(config, arena=None)  # its path is this machine's
    return Setup(Bench, (type(made), made.folder, config, files))


class Bench:
    """Carries out jobs in a worker, and writes only the twin's cameras.

    `files` are what a worker needs that cannot see the experiment's folder: contents by name.
    """

    def __init__(
        self, kind: type[NoiseExperiment], folder: Path, config: NoiseConfig, files: Mapping[str, bytes]
    ) -> None:
        self._home = tempfile.TemporaryDirectory(prefix="realitygap-") if files else None
        if self._home is not None:
            folder = Path(self._home.name)
            write_files(folder, files)
            if ARENA in files:
                config = replace(config, arena=str(folder / ARENA))
        self._experiment = kind(folder, config)

    def carry_out(self, job: Job, tell: Tell) -> None:
        """Carry out a job; `tell` receives the share done since its last call, then the result."""
        experiment, one = self._experiment, job.controller
        experiment.known = {one: job.genes}
        with file_errors(experiment.folder):
            if job.driven is None:
                made, file = experiment.drive(one, tell), experiment.driven_file(one)
            else:
                if self._home is not None:
                    write_files(Path(), {str(experiment.driven_file(one)): job.driven})
                found, file = experiment.compare(one, tell), experiment.compared_file(one)
                made = (json.dumps({**found, "check": _check_of(found)}, indent=1) + "\n").encode()
            tell(Made(str(file.relative_to(experiment.folder)), made))

    def close(self) -> None:
        """Release the units, and remove a temporary folder."""
        self._experiment.close()
        if self._home is not None:
            self._home.cleanup()


def merge_noise(shards: Mapping[Shard, Path], out: Path) -> None:
    """The experiment of all shards' controllers, in a folder of its own; `noise_experiment` resumes it to its
    tables.

    Args:
        shards: their folders, as from `work.shard.all_shards`.
        out: the experiment's folder, created complete or not at all.

    Raises:
        StudyError: shards of different experiments or calibrations, a damaged one or file of it, or `out`
            exists.
    """
    parts = {n: NoiseExperiment(folder, NoiseConfig.from_folder(folder)) for n, folder in shards.items()}
    first, *others = parts.values()
    for other in others:
        cure = f"{other.folder} has that. Only shards of one study are merged."
        there, asked = first.config.to_dict(), other.config.to_dict()
        refuse_difference(f"{first.folder}: the study was made", there, asked, cure)
        for ours, theirs in ((first.profile_file(u), other.profile_file(u)) for u in first.config.every_unit):
            if ours.read_bytes() != theirs.read_bytes():
                raise StudyError(
                    f"{ours} and {theirs} differ: the robot was recorded on different kinds of machine. "
                    "Start the shards again on one kind."
                )
    with new_folder(out, first.config.resuming(out)) as half:
        shutil.copyfile(first.folder / NoiseConfig.FILE, half / NoiseConfig.FILE)
        shutil.copytree(first.folder / "calibration", half / "calibration")
        for study in first.studies:
            pieces = {shard: part.evolved_folder(study) for shard, part in parts.items()}
            merge_runs(pieces, NoiseExperiment(half, first.config).evolved_folder(study))
        for one in first.controllers():
            part = next((part for part in parts.values() if part.compared_file(one).is_file()), None)
            if part is None:
                what = f"no shard has the controller {one.name}"
                raise StudyError(f"{first.folder}: {what}. Finish the shards first.")
            part.read_driven(one)  # a damaged file is reported while it can be made again
            part.read_compared(one)
            files = (part.driven_file(one), part.compared_file(one))
            write_files(half, {str(file.relative_to(part.folder)): file.read_bytes() for file in files})
        for part in parts.values():
            for phase, seconds in Seconds(part.folder).read().items():
                Seconds(half).add(phase, seconds)
