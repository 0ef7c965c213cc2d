"""Carries out a noise experiment: calibrate, evolve, drive, compare, gather; by shards, and merged again."""

import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from realitygap.calibration.plan import check_period
from realitygap.calibration.unit import PARTS
from realitygap.errors import ConfigError, RealityGapError, StudyError, UsageError
from realitygap.evolution.algorithm import Genes
from realitygap.experiments.experiment import (
    Made,
    Phase,
    Phases,
    Recorded,
    Seconds,
    missing,
    open_folder,
    session,
)
from realitygap.experiments.noise import (
    CONFIG,
    Controller,
    NoiseConfig,
    NoiseExperiment,
    Rigs,
    calibration_folder,
    check_of,
)
from realitygap.robots.address import Address
from realitygap.streams import named_stream
from realitygap.study.config import StudyConfig
from realitygap.study.folder import exists
from realitygap.study.runner import merge_runs
from realitygap.tasks.load import TASKS, load_task
from realitygap.work.folder import file_errors, new_folder, refuse_difference
from realitygap.work.pool import Pool, Setup, Tell, Workers, far, near
from realitygap.work.progress import OnProgress
from realitygap.work.shard import MARK, Mark, Shard, marked
from realitygap.world.arena import load_arena
from realitygap.world.robot import load_profile

__all__ = ["WORK", "check_robot", "merge_noise", "noise_experiment"]

WORK = "experiment noise"
"""The kind of work that a shard divides."""
ARENA = "arena.toml"
"""Name of the arena's file for workers that cannot see the experiment's folder."""

TWIN_COSTS, ENKI_COSTS = (130.0, 0.37), (45.0, 0.15)
EVALUATION_COST, RETEST_COST, CELL_COST = 1.35e-3, 0.35, 0.08
"""Approximate times on one core, s: a unit's calibration and a trial on it, on the twin and on Enki's robots;
an evaluation, a run's retest, a comparison with a level. Only used to estimate the time left."""


class Job(NamedTuple):
    """A controller to drive the units, or to be compared with the simulations.

    `driven` is the content of its file of paths, for a comparison; b"" if the worker can see the file.
    """

    controller: Controller
    genes: Genes
    driven: bytes | None = None


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
            for name, content in files.items():
                self._write(folder / name, content)
            if ARENA in files:
                config = replace(config, arena=str(folder / ARENA))
        self._experiment = kind(folder, config)
        self._rigs = Rigs(self._experiment)

    def carry_out(self, job: Job, tell: Tell) -> None:
        """Carry out a job; `tell` receives the share done since its last call, then the result."""
        experiment, one = self._experiment, job.controller
        experiment.known = {one: job.genes}
        with file_errors(experiment.folder):
            if job.driven is None:
                made, file = experiment.drive(self._rigs, one, tell), experiment.driven_file(one)
            else:
                if self._home is not None:
                    self._write(experiment.driven_file(one), job.driven)
                found, file = experiment.compare(one, tell), experiment.compared_file(one)
                made = (json.dumps({**found, "check": check_of(found)}, indent=1) + "\n").encode()
            tell(Made(str(file.relative_to(experiment.folder)), made))

    def _write(self, file: Path, content: bytes) -> None:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)

    def close(self) -> None:
        """Release the units, and remove a temporary folder."""
        self._rigs.close()
        if self._home is not None:
            self._home.cleanup()


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
        begun = (folder / CONFIG).is_file()
        mark = marked(folder, asked, WORK, begun=begun)
        made = _opened(folder, settings, config, resume=resume, mark=None if begun else mark)
        experiment = kind(folder.resolve(), made)
        left = _Left(experiment, pool, None if mark is None else mark.shard, on_progress)
        left.carry_out(near(workers), engine)
        if mark is None:
            return experiment.write_results()
        with file_errors(folder):
            mark.write(folder, finished=True)
        return folder


def _opened(
    folder: Path, kind: type[NoiseConfig], config: NoiseConfig | None, *, resume: bool, mark: Mark | None
) -> NoiseConfig:
    """The folder's settings; a new shard is marked before it is created, and a refusal changes nothing."""
    try:
        if mark is not None:
            with file_errors(folder):
                mark.write(folder, finished=False)
        return open_folder(folder, kind, config, resume=resume)
    except RealityGapError:
        if mark is not None:
            (folder / MARK).unlink(missing_ok=True)
        raise


class _Left(Phases):
    """The phases of an experiment that are not finished."""

    def __init__(
        self, experiment: NoiseExperiment, pool: Pool, shard: Shard | None, on_progress: OnProgress | None
    ) -> None:
        self.made, self.pool, self.shard, config = experiment, pool, shard, experiment.config
        every = list(experiment.controllers())
        if shard is not None:
            own = {
                (one.study, one.run_name) for runs in experiment.studies.values() for one in shard.own(runs)
            }
            every = [one for one in every if (one.study, one.run_name) in own]
        self.to_drive = missing({one: experiment.driven_file(one) for one in every})
        self.to_compare = missing({one: experiment.compared_file(one) for one in every})
        self.uncalibrated = missing({unit: experiment.profile_file(unit) for unit in config.every_unit})
        runs = len({(one.study, one.run_name) for one in every})
        begun = all(exists(experiment.evolved_folder(study)) for study in experiment.studies)
        unit, trial = ENKI_COSTS if (config.robot or "").startswith("enki") else TWIN_COSTS
        units = sum(len(experiment.driven(one)) for one in every) / max(len(every), 1)
        where = "on the robot" if config.robot else "on the twin"
        run, jobs = config.evaluations * EVALUATION_COST + RETEST_COST, ("controllers", len(every))
        self.phases = (
            Phase("calibrate", "calibrating to the units", "units", config.units, len(self.uncalibrated),
                  unit),
            Phase("evolve", "evolving", "runs", runs, runs if self.to_drive or not begun else 0, run),
            Phase("situated", where, *jobs, len(self.to_drive), trial * units * config.starts),
            Phase("simulated", "comparing with the simulations", *jobs, len(self.to_compare),
                  CELL_COST * len(config.levels)),
        )  # fmt: skip
        super().__init__(experiment.folder, pool, self.phases, on_progress)

    def carry_out(self, recorders: Workers, engine: str) -> None:
        """Carry out every unfinished phase; calibration has its own workers, evolution may have an engine."""
        calibrating, evolving, driving, comparing = self.phases
        self.calibrate(calibrating, self.uncalibrated, partial(self._record, recorders), len(PARTS) + 1)
        self.evolve(evolving, self._studies(), engine=engine, shard=self.shard)
        self.drive(driving, self._setup, self._jobs(self.to_drive))
        self.drive(comparing, self._setup, self._jobs(self.to_compare, compared=True))

    def _record(self, recorders: Workers, unit: int, heard: Recorded) -> None:
        """Make a unit's profile with the experiment's twin noise, which belongs to the unit."""
        from realitygap.calibration.unit import calibrated_robot, calibrated_unit

        config, place = self.made.config, calibration_folder(self.made.folder, unit)
        seed = named_stream(config.seed, "calibration", unit) >> 1
        how: dict[str, Any] = {"seed": seed, "workers": recorders, "on_progress": heard}
        if config.base is None:
            which = unit if config.robot is None else config.address(unit)
            calibrated_unit(place, unit=which, noise=config.twin_noise, **how)
        else:
            calibrated_robot(place, robot=config.address(unit), base=config.base, **how)

    def _studies(self) -> Iterator[tuple[Path, StudyConfig, int]]:
        for study, every in self.made.studies.items():
            runs = len(every if self.shard is None else self.shard.own(every))
            yield self.made.evolved_folder(study), self.made.evolution(study), runs

    def _setup(self) -> Setup:
        """What workers get: the folder, or, if they cannot see it, its calibrations and arena.

        Raises:
            ConfigError: a robot that only this machine has.
        """
        made, config, files = self.made, self.made.config, {}
        if far(self.pool):
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

    def _jobs(self, left: list[Controller], *, compared: bool = False) -> Iterator[Job]:
        for one in left:
            seen = b"" if compared else None
            if far(self.pool) and compared:
                seen = self.made.driven_file(one).read_bytes()
            yield Job(one, self.made.genes(one), seen)


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
    parts = {
        shard: NoiseExperiment(folder, NoiseConfig.from_folder(folder)) for shard, folder in shards.items()
    }
    first, *others = parts.values()
    for other in others:
        cure = f"{other.folder} has that. Only shards of one study are merged."
        there, asked = first.config.to_dict(), other.config.to_dict()
        refuse_difference(f"{first.folder}: the study was made", there, asked, cure)
        for unit in first.config.every_unit:
            ours, theirs = first.profile_file(unit), other.profile_file(unit)
            if ours.read_bytes() != theirs.read_bytes():
                raise StudyError(
                    f"{ours} and {theirs} differ: the robot was recorded on different kinds of machine. "
                    "Start the shards again on one kind."
                )
    with new_folder(out, first.config.resuming(out)) as half:
        merged = NoiseExperiment(half, first.config)
        shutil.copyfile(first.folder / CONFIG, half / CONFIG)
        shutil.copytree(first.folder / "calibration", half / "calibration")
        for study in first.studies:
            pieces = {shard: part.evolved_folder(study) for shard, part in parts.items()}
            merge_runs(pieces, merged.evolved_folder(study))
        for one in first.controllers():
            part = next((part for part in parts.values() if part.compared_file(one).is_file()), None)
            if part is None:
                what = f"no shard has the controller {one.name}"
                raise StudyError(f"{first.folder}: {what}. Finish the shards first.")
            part.read_driven(one)  # a damaged file is told while it can be made again
            part.read_compared(one)
            for ours, theirs in ((merged.driven_file(one), part.driven_file(one)),
                                 (merged.compared_file(one), part.compared_file(one))):  # fmt: skip
                ours.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(theirs, ours)
        for part in parts.values():
            for phase, seconds in Seconds(part.folder).read().items():
                Seconds(half).add(phase, seconds)
