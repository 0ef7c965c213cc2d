"""Carries out a transfer: evolved individuals on robots, each trial paired with a simulated one.

    from realitygap import Transfer, load_study, run_transfer

    run_transfer(load_study("out/reproduce"), Transfer(robots=("twin:1", "twin:2"), starts=3))

Trials on robots that place themselves go to a pool's workers; a person carries a real robot to its starts.
A trial on the twin is a function of its TrialSpec alone.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from realitygap.errors import RobotStoppedError, StudyInterruptedError, UsageError
from realitygap.evolution.algorithm import Genes
from realitygap.files import atomic_write, must_be, to_toml, written_together
from realitygap.film.camera import CameraModel, load_camera
from realitygap.robots.address import Address
from realitygap.robots.body import Body
from realitygap.robots.drive import Controller, Recorder, Recording
from realitygap.simulation.body import drive_simulated
from realitygap.simulation.simulation import Simulation
from realitygap.study.folder import Inputs, exists, home_of, inputs_for
from realitygap.study.load import Study, as_study, load_study
from realitygap.study.provenance import versions
from realitygap.track import Track
from realitygap.transfer.camera import ConfirmPose, LiveOverhead
from realitygap.transfer.options import Transfer
from realitygap.transfer.paths import of_track, score
from realitygap.transfer.record import (
    TransferredTrial,
    archive,
    explained,
    is_done,
    keep,
    keep_camera,
    load_transfer,
    load_transfers,
    new_trial,
)
from realitygap.transfer.rig import DriveRecord, Rig, driven
from realitygap.transfer.spec import FOLDER, TrialSpec, check_body, controller_for, trial_specs
from realitygap.values import Pose, steps_in
from realitygap.work.archive import SIMULATED, SITUATED, STALLED, TRIAL
from realitygap.work.folder import file_errors, lock
from realitygap.work.pool import Pool, Setup, Tell, Workers, far, opened
from realitygap.work.progress import OnProgress, Reporter
from realitygap.work.shard import Shard, marked

__all__ = [
    "WORK", "Operator", "Transfer", "TransferredTrial", "TrialWorker", "load_transfers",
    "place_of", "run_transfer", "shard_folder",
]  # fmt: skip

WORK = "transfer"
"""The kind of work that a shard divides."""
CONTROLLERS = "controllers"
"""In a study's folder: trials of controllers of your own, a folder each; the report omits them."""
SEALED = "sealed.csv"
"""A twin's true states, kept with a film, to test the tracker."""

CALIBRATION_COST = 6.0
DRIVE_COST, DRIVE_COST_S = 0.05, 0.03
FILM_COST_S, WATCH_COST_S = 0.8, 0.025
"""Approximate times, s: to start a unit; for a second of its time; of film; of watching."""

PlaceRobot = Callable[[TrialSpec, Pose], None]
"""Has a real robot put at its start; returns when it is there."""


class Operator(NamedTuple):
    """The person beside a real robot.

    Attributes:
        place_robot: has the robot put at a start, and returns when it is there.
        confirm_pose: decides whether to start where the camera sees it; without it, being seen is enough.
        says: called with the reason why the camera does not see it, if known, and why a trial is repeated.
    """

    place_robot: PlaceRobot
    confirm_pose: ConfirmPose | None = None
    says: Callable[[str], object] | None = None


def run_transfer(
    study: Study | str | PathLike[str],
    options: Transfer | None = None,
    *,
    workers: Workers = None,
    operator: Operator | None = None,
    shard: Shard | str | None = None,
    on_progress: OnProgress | None = None,
) -> list[TransferredTrial]:
    """Drive robots with individuals of a study, each from the same poses as in simulation.

    Existing trials are kept, so that an interrupted transfer continues.

    Args:
        study: the study or its folder, which gets a folder `transfer`.
        options: who drives where; by default all champions, once, on unit 1 of the twin.
        workers: processes for trials on the twin, one a core if None; or a pool.
        operator: places a real robot; required for one.
        shard: the share of the trials to make, such as "1/2", in a folder of its own beside the study's.
        on_progress: called a few times a second.

    Returns:
        All requested trials (for a shard its own), old and new.

    Raises:
        RobotError, FilmError: a robot or a camera fails; recordings are kept.
        UsageError: something is impossible, or was done with other settings; names it.
        StudyInterruptedError: Ctrl-C; finished trials are kept.
    """
    study, options = as_study(study), options or Transfer()
    must_be(options, Transfer, "options", "Transfer(robots=…, starts=…) makes one.")
    shard = None if shard is None else Shard.parse(shard)
    if shard is not None and options.named is not None:
        raise UsageError("shard: expected none with a controller of your own. Leave it out.")
    place = place_of(study.folder, options) if shard is None else shard_folder(study.folder, shard)
    with opened(workers) as pool, lock(place):
        requested, mark = list(trial_specs(study, options)), None
        if shard is not None:
            mark = marked(place, shard, WORK, begun=exists(place), **_facts(study, options, requested))
            requested = shard.own(requested)
        if operator is None and not all(spec.placed for spec in requested):
            raise UsageError(
                "operator: expected an Operator, who asks a person to put the real robot at its starts."
            )
        todo = [spec for spec in requested if not is_done(place, spec)]  # a refusal leaves the mark unchanged
        real, own = [spec for spec in todo if not spec.placed], [spec for spec in todo if spec.placed]
        with file_errors(place / FOLDER):
            (place / FOLDER).mkdir(exist_ok=True)
            if mark is not None:
                mark.write(place, finished=False)
        try:
            if real and operator is not None:
                _by_hand(study, place, real, options, operator)
            done = len(requested) - len(own)
            _by_themselves(study, place, own, done=done, pool=pool, on_progress=on_progress)
        except (RobotStoppedError, KeyboardInterrupt) as stop:
            if real and isinstance(stop, RobotStoppedError):
                raise  # which says where the robot's recording is
            kept = f"Finished trials in {place / FOLDER} are kept"
            raise StudyInterruptedError(
                f"stopped. {kept}; the same command continues with the others."
            ) from None
        with file_errors(place / FOLDER):
            for run in {(place / spec.folder).parent for spec in requested if spec.robot.unit is not None}:
                archive(run)  # also what an interrupted transfer left
        made = [load_transfer(place / spec.folder) for spec in requested]
        if mark is not None:
            mark.write(place, finished=True)
    return made


def place_of(study: Path, options: Transfer) -> Path:
    """The folder that gets a folder `transfer`: the study's, or that of a controller of your own."""
    return study if options.named is None else study / CONTROLLERS / options.named.name


def shard_folder(study: Path, shard: Shard) -> Path:
    """The folder of a shard of a study's transfer: beside the study's, and beside its shards."""
    study = study if study.name.strip(".") else study.resolve()
    return shard.folder(study.with_name(f"{study.name}-{WORK}"))


def _facts(study: Study, options: Transfer, requested: Sequence[TrialSpec]) -> dict[str, Any]:
    """Facts that all shards of a transfer must share."""
    keys = ("starts", "individual", "path_from", "twin_noise", "seed", "seconds")
    return {
        "study": study.digest(),
        "runs": list(dict.fromkeys(spec.run for spec in requested)),
        "robots": [str(robot) for robot in options.bodies],
        "film": options.film if isinstance(options.film, bool) else sorted(options.film, key=str),
        "marker": str(options.worn),
        **{key: getattr(options, key) for key in keys},
    }


# A trial


class Job(NamedTuple):
    """A trial of an individual on the twin, or (without one) the calibration of the camera over its arena.

    `camera` is its calibration, for workers that cannot see the study's folder.
    """

    spec: TrialSpec
    genes: Genes | None = None
    camera: bytes | None = None


class Made(NamedTuple):
    """The files of a job by name: of a trial, `finished` or as far as it got, or of a camera."""

    spec: TrialSpec
    files: dict[str, bytes]
    finished: bool = True
    camera: bool = False


class TrialWorker:
    """Makes trials of one study, with what they need loaded once in a process.

    A job writes only cameras into `place`, where this process sees the study's folder: its files are sent.
    `shown` is that place for messages.
    """

    def __init__(self, study: Study, place: Path, shown: Path, held: ExitStack | None = None) -> None:
        self.study, self._place, self._shown, self._held = study, place, shown, held or ExitStack()
        self.simulation = cache(lambda task, noise: Simulation(study.task(task), study.profile, noise))
        self._versions = cache(versions)  # finding the commit takes three programs
        self._rigs: dict[tuple[str, Address, float, int | None], Rig] = {}

    def carry_out(self, job: Job, tell: Tell) -> None:
        """Make a trial or calibrate a camera; `tell` receives what was made."""
        spec, camera = job.spec, self.camera_file(job.spec)
        final = self._shown / spec.folder
        with file_errors(final):
            if job.camera is not None:
                keep_camera(camera, job.camera)
            if job.genes is None:
                self.rig(spec).tracker  # noqa: B018 - it is calibrated when it is first asked for
                tell(Made(spec, {camera.name: camera.read_bytes()}, camera=True))
                return
            with tempfile.TemporaryDirectory(prefix="realitygap-") as name:
                folder, finished = Path(name), False
                try:
                    with explained(final, spec.robot):
                        self.by_itself(spec, job.genes, folder)
                    finished = True
                finally:
                    files = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
                    tell(Made(spec, files, finished))

    def close(self) -> None:
        """Release the robots."""
        for rig in self._rigs.values():
            rig.close()
        self._rigs.clear()
        self._held.close()

    def camera_file(self, spec: TrialSpec) -> Path:
        """The file of the calibration of the camera over a unit's arena."""
        worn = "" if spec.marker is None else "-" + re.sub(r"[^\w.-]+", "-", str(spec.marker))
        return self._place / FOLDER / spec.robot.folder(spec.twin_noise) / f"camera-{spec.task}{worn}.json"

    def rig(self, spec: TrialSpec) -> Rig:
        """The robot that places itself in a trial's arena; one rig for all trials of both."""
        key = (spec.task, spec.robot, spec.twin_noise, spec.baud)
        if key not in self._rigs:
            task, profile = self.study.task(spec.task), self.study.profile
            rig = Rig(task, profile, robot=spec.robot, twin_noise=spec.twin_noise, baud=spec.baud)
            rig.camera_file, rig.marker = self.camera_file(spec), spec.marker
            self._rigs[key] = rig
        return self._rigs[key]

    def genes(self, spec: TrialSpec) -> Genes:
        """Genes of the individual that drives; empty for a controller of your own."""
        if spec.evaluation is None:
            return np.zeros(0, np.int8)
        return self.study.genotype(spec.run, spec.evaluation)

    def by_itself(self, spec: TrialSpec, genes: Genes, folder: Path) -> None:
        """A whole trial on a robot that places itself, its files into the folder."""
        rig, seen = self.rig(spec), spec.source in ("camera", "film")
        with written_together(folder):
            pose = self.simulation(spec.task, spec.noise).start(spec.stream)
            facts = self._simulate(spec, genes, pose, folder)
            record = rig.trial(
                self._driver(spec, genes), spec.stream, pose, spec.seconds,
                recorder=Recorder(folder, facts=spec.facts()), sealed=folder / SEALED if seen else None,
            )  # fmt: skip
            if not seen:
                path = self._own_path(spec, record, pose)
            else:
                truth, period_s = rig.truth(folder / SEALED, spec.seconds), rig.profile.period_s
                if spec.film:
                    about = {"run": spec.name, "start": spec.start}
                    track, facts["view"] = rig.tracker.film(folder, truth, spec.stream, spec.view, about)
                else:
                    track, facts["view"] = rig.tracker.watch(folder, truth, spec.stream)
                    (folder / SEALED).unlink()
                path = of_track(track, steps_in(spec.seconds, period_s), period_s=period_s)
            self._write(spec, folder, facts, path, record.recording)

    def by_hand(self, spec: TrialSpec, body: Body, person: Operator, overhead: LiveOverhead | None) -> None:
        """A whole trial on a robot that a person places; once more if the robot's line stalled."""
        with new_trial(self._place / spec.folder, spec.robot) as folder:
            record, path, facts = self._placed(spec, body, person, overhead, folder)
            if (kept := record.recording).stalls:
                if person.says is not None:
                    took = f"{kept.stalls} ×, {kept.stalled_s:.1f} s in all"
                    person.says(f"The robot's line stalled ({took}); this trial is repeated, once.")
                files, aside = list(folder.iterdir()), folder / STALLED
                aside.mkdir()
                for file in files:
                    file.rename(aside / file.name)
                record, path, facts = self._placed(spec, body, person, overhead, folder)
                facts["repeated"] = True
            self._write(spec, folder, facts, path, record.recording)

    def _placed(
        self, spec: TrialSpec, body: Body, person: Operator, overhead: LiveOverhead | None, folder: Path
    ) -> tuple[DriveRecord, Track, dict[str, Any]]:
        """A drive from where a person has placed the robot: the record, its path, the trial's facts."""
        genes, task = self.genes(spec), self.study.task(spec.task)
        seen = overhead is not None and spec.source in ("camera", "film")
        pose = requested = self.simulation(spec.task, spec.noise).start(spec.stream)
        body.attend(*task.kinds)  # refuses a line that is too slow
        body.stop()
        person.place_robot(spec, requested)
        body.reset()
        if overhead is not None:
            pose = overhead.start(spec, requested)
            body.reset()  # moving it again has turned its wheels
        facts = self._simulate(spec, genes, pose, folder)
        facts["wished"] = None if overhead is None else requested.to_dict()
        with overhead.filming(spec, folder) if overhead is not None and seen else nullcontext():
            record = driven(
                body, self._driver(spec, genes), task=task, profile=self.study.profile,
                seconds=spec.seconds, recorder=Recorder(folder, facts=facts),
            )  # fmt: skip
        if overhead is not None and seen:
            path, found = overhead.path(spec, folder, self.study.profile.period_s)
            return record, path, {**facts, **found}
        return record, self._own_path(spec, record, pose), facts

    def _driver(self, spec: TrialSpec, genes: Genes) -> Controller:
        if spec.controller is not None:
            return controller_for(self.study, spec.task, spec.controller)
        return self.study.controller(spec.task, genes)

    def _simulate(self, spec: TrialSpec, genes: Genes, pose: Pose, folder: Path) -> dict[str, Any]:
        """The paired trial in simulation; returns the facts known before the other."""
        simulation, driver = self.simulation(spec.task, spec.noise), self._driver(spec, genes)
        trajectory, fitness = drive_simulated(
            simulation, driver, stream=spec.stream, pose=pose, seconds=spec.seconds
        )
        trajectory.track.write_csv(folder / SIMULATED)
        return {**spec.facts(), "pose": pose.to_dict(), "fitness": {"simulated": fitness}}

    def _own_path(self, spec: TrialSpec, record: DriveRecord, pose: Pose) -> Track:
        """The path as reported by the robot, or by its wheels."""
        task, profile = self.study.task(spec.task), self.study.profile
        return record.path(pose, task, profile, wheels=spec.source != "robot")

    def _write(
        self, spec: TrialSpec, folder: Path, facts: dict[str, Any], path: Track, kept: Recording
    ) -> None:
        """The robot's path, its score and the trial's facts."""
        path.write_csv(folder / SITUATED)
        fitness = score(path, self.study.task(spec.task), self.study.profile)
        facts["fitness"]["situated"] = fitness if kept.timing is None else math.nan
        facts |= {
            "timing": kept.timing,
            "film": spec.film,
            "situated_from": spec.source,
            "late_steps": kept.late_steps,
            **({"stalls": kept.stalls, "stalled_s": kept.stalled_s} if kept.stalls else {}),
            "missed_steps": None if np.isnan(kept.read).all() else kept.missed_steps,
            "lost_steps": path.lost,
            "versions": self._versions(),
        }
        atomic_write(folder / TRIAL, to_toml(facts))


# By a person


def _by_hand(
    study: Study, place: Path, todo: Sequence[TrialSpec], options: Transfer, operator: Operator
) -> None:
    """Make trials on real robots, one robot after the other, with a camera if there is one.

    Raises:
        UsageError: a port cannot be opened, or its rate is too slow.
        RobotError: the line was lost; the recording is kept.
        RobotStoppedError: Ctrl-C; the robot stands, the recording is kept.
    """
    worker, overhead = TrialWorker(study, place, place), None
    with ExitStack() as held:
        if options.camera is not None and options.camera_device is not None:
            given = options.camera
            camera, asks = given if isinstance(given, CameraModel) else load_camera(given), operator[1:]
            overhead = held.enter_context(LiveOverhead(options.camera_device, camera, options.worn, *asks))
        for robot in dict.fromkeys(spec.robot for spec in todo):
            specs = [spec for spec in todo if spec.robot == robot]
            body = robot.open(baud=specs[0].baud)
            try:
                for spec in specs:
                    check_body(study, spec.task, body)
                for spec in specs:
                    at_rate = replace(spec, baud=getattr(body, "baud", None))
                    with file_errors(place / spec.folder):
                        worker.by_hand(at_rate, body, operator, overhead)
            except BaseException:
                body.abandon()  # it was told to stop first, wherever this came from
                raise
            body.close()


# By workers


def worker_for(inputs: Inputs, shown: str) -> TrialWorker:
    """A worker for a study's trials, in any process."""
    held = ExitStack()
    home = home_of(inputs, held)
    place = Path(shown) if inputs[0] else home
    return TrialWorker(load_study(home), place, Path(shown), held)


def _by_themselves(
    study: Study,
    place: Path,
    todo: Sequence[TrialSpec],
    *,
    done: int,
    pool: Pool,
    on_progress: OnProgress | None,
) -> None:
    """Make trials on robots that place themselves; a twin's results do not depend on the pool.

    Args:
        study: whose individuals drive.
        place: where their folders are.
        todo: the trials.
        done: number of existing ones.
        pool: of workers.
        on_progress: called a few times a second.

    Raises:
        RealityGapError: the first that fails; the finished ones are kept.
    """
    if not todo:
        return
    away, here = far(pool), TrialWorker(study, place, place)
    for spec in todo if away else ():
        own = spec.controller or (spec.robot if spec.robot.is_file else None)
        if own is not None:
            raise UsageError(
                f"{own}: expected one that the cluster's workers have too: its file is on this "
                "machine. Leave out --workers, or give a number."
            )
    watched = {here.camera_file(spec): spec for spec in todo if spec.source in ("camera", "film")}
    cameras = [Job(spec) for file, spec in watched.items() if not file.is_file()]
    work = len(cameras) * CALIBRATION_COST + sum(map(_cost, todo))
    reporter = Reporter(on_progress, {"transferring": work})
    reporter.phase("transferring", done=done, total=done + len(todo), what="trials")

    def trials() -> Iterator[Job]:
        for spec in _in_order(todo):
            file = here.camera_file(spec)
            camera = file.read_bytes() if away and file in watched else None
            yield Job(spec, here.genes(spec), camera)

    def save(made: Made) -> None:
        spec, files, finished, camera = made
        if camera:
            file = here.camera_file(spec)
            keep_camera(file, files[file.name])
            reporter.add(CALIBRATION_COST)
            return
        folder = place / spec.folder
        with file_errors(folder):
            keep(folder, spec.robot, files, finished=finished)
        reporter.add(_cost(spec), done=int(finished))

    inputs = (inputs_for(study.folder, pool), str(place.resolve()))
    for jobs in (cameras, trials()):
        pool.work(Setup(worker_for, inputs, here=here), jobs, save)


def _in_order(todo: Sequence[TrialSpec]) -> list[TrialSpec]:
    """The longest trials first, films in the first half of the rest, so that no worker ends alone with a film
    while others have nothing to do."""
    films, others = ([spec for spec in todo if spec.film is film] for film in (True, False))
    others.sort(key=lambda spec: -_cost(spec))
    apart = 1 + max(1, len(others) // 2 // max(1, len(films)))
    for k, film in enumerate(films):
        others.insert(k * apart, film)
    return others


def _cost(spec: TrialSpec) -> float:
    """Approximate time of a trial, s."""
    seen = {"film": FILM_COST_S, "camera": WATCH_COST_S}.get(spec.source, 0.0)
    return DRIVE_COST + spec.seconds * (DRIVE_COST_S + seen)
