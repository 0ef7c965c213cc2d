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
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from functools import cache
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from realitygap.errors import RobotStoppedError, StudyInterruptedError, UsageError
from realitygap.evolution.algorithm import Genes
from realitygap.files import atomic_write, must_be, to_toml, written_together
from realitygap.film.camera import CameraModel, load_camera
from realitygap.robots.address import Address
from realitygap.robots.body import Body
from realitygap.robots.drive import Controller, Recorder
from realitygap.simulation.body import drive_simulated
from realitygap.simulation.simulation import Simulation
from realitygap.study.folder import Home, Inputs, exists, home_of, inputs_for
from realitygap.study.load import Study, as_study, load_study
from realitygap.study.provenance import versions
from realitygap.track import Track
from realitygap.transfer.camera import TRACK, ConfirmPose, FilmOfDrive, LiveOverhead, film_and_track
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
from realitygap.values import Pose
from realitygap.work.archive import SIMULATED, SITUATED, TRIAL
from realitygap.work.folder import file_errors, lock
from realitygap.work.pool import Pool, Setup, Tell, Workers, far, opened
from realitygap.work.progress import OnProgress, Reporter
from realitygap.work.shard import Shard, marked

if TYPE_CHECKING:
    from realitygap.twin.camera import OverheadCamera

__all__ = [
    "CONTROLLERS", "WORK", "Operator", "Transfer", "TransferContext", "TransferredTrial", "load_transfers",
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
        says: called with the reason why the camera does not see it, if known.
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
        with _interrupted(place, real=bool(real)):
            if real and operator is not None:
                _by_hand(study, place, real, options, operator)
            done = len(requested) - len(own)
            _by_themselves(study, place, own, done=done, pool=pool, on_progress=on_progress)
        with file_errors(place / FOLDER):
            for run in {(place / spec.folder).parent for spec in requested if spec.robot.unit is not None}:
                archive(run)  # also what an interrupted transfer left
        if mark is not None:
            mark.write(place, finished=True)
    return [load_transfer(place / spec.folder) for spec in requested]


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


@contextmanager
def _interrupted(folder: Path, *, real: bool) -> Iterator[None]:
    """Turn Ctrl-C into one message; stopping a real robot has a message of its own."""
    try:
        yield
    except (RobotStoppedError, KeyboardInterrupt) as stop:
        if real and isinstance(stop, RobotStoppedError):
            raise
        kept = f"Finished trials in {folder / FOLDER} are kept; the same command continues with the others."
        raise StudyInterruptedError(f"stopped. {kept}") from None


# A trial


class TransferContext:
    """What trials of one study need, loaded once in a process; files go to `place` or the study's folder."""

    def __init__(self, study: Study, place: Path | None = None) -> None:
        self.study, self.place = study, place or study.folder
        self.simulation = cache(lambda task, noise: Simulation(study.task(task), study.profile, noise))
        self._versions = cache(versions)  # finding the commit takes three programs
        self._rigs: dict[tuple[str, Address, float, int | None], Rig] = {}

    def camera_file(self, spec: TrialSpec) -> Path:
        """The file of the calibration of the camera over a unit's arena."""
        worn = "" if spec.marker is None else "-" + re.sub(r"[^\w.-]+", "-", str(spec.marker))
        return self.place / FOLDER / spec.robot.folder(spec.twin_noise) / f"camera-{spec.task}{worn}.json"

    def rig(self, spec: TrialSpec) -> Rig:
        """The robot that places itself in a trial's arena; one rig for all trials of both."""
        key = (spec.task, spec.robot, spec.twin_noise, spec.baud)
        if key not in self._rigs:
            task, profile = self.study.task(spec.task), self.study.profile
            rig = Rig(task, profile, robot=spec.robot, twin_noise=spec.twin_noise, baud=spec.baud)
            rig.camera_file, rig.marker = self.camera_file(spec), spec.marker
            self._rigs[key] = rig
        return self._rigs[key]

    def close(self) -> None:
        """Release the robots."""
        for rig in self._rigs.values():
            rig.close()
        self._rigs.clear()

    def genes(self, spec: TrialSpec) -> Genes:
        """Genes of the individual that drives; empty for a controller of your own."""
        if spec.evaluation is None:
            return np.zeros(0, np.int8)
        return self.study.genotype(spec.run, spec.evaluation)

    def by_itself(self, spec: TrialSpec, genes: Genes, folder: Path, tell: Callable[[float], None]) -> None:
        """A whole trial on a robot that places itself.

        Args:
            spec: the trial.
            genes: of the driver, as from `genes`.
            folder: of the trial's files.
            tell: called with the share of the film that is done.
        """
        with written_together(folder):
            pose = self.simulation(spec.task, spec.noise).start(spec.stream)
            facts = self._simulate(spec, genes, pose, folder)
            sealed = folder / SEALED if spec.source in ("camera", "film") else None
            record = self.rig(spec).trial(
                self._driver(spec, genes), spec.stream, pose, spec.seconds,
                recorder=Recorder(folder, facts=spec.facts()), sealed=sealed,
            )  # fmt: skip
            if sealed is not None:
                period_s = self.study.profile.period_s
                seen = self._seen(spec, folder, facts, tell)
                path = of_track(seen, round(spec.seconds / period_s), period_s=period_s)
            else:
                path = self._own_path(spec, record, pose)
            self._write(spec, folder, facts, path, record)

    def by_hand(
        self, spec: TrialSpec, body: Body, place_robot: PlaceRobot, overhead: LiveOverhead | None
    ) -> None:
        """A whole trial on a robot that a person places.

        Args:
            spec: the trial.
            body: the robot.
            place_robot: has it put at its start.
            overhead: the camera above, if there is one.
        """
        genes = self.genes(spec)
        with new_trial(self.place / spec.folder, spec.robot) as folder:
            pose = requested = self.simulation(spec.task, spec.noise).start(spec.stream)
            body.attend(*self.study.task(spec.task).kinds)  # refuses a line that is too slow
            body.stop()
            place_robot(spec, requested)
            body.reset()
            if overhead is not None:
                pose = overhead.start(spec, requested)
                body.reset()  # moving it again has turned its wheels
            facts = self._simulate(spec, genes, pose, folder)
            facts["wished"] = None if overhead is None else requested.to_dict()
            film: AbstractContextManager[FilmOfDrive | None] = nullcontext()
            if overhead is not None and spec.source in ("camera", "film"):
                film = overhead.filming(spec, folder, self.study.profile.period_s)
            with film as filmed:
                record = driven(
                    body, self._driver(spec, genes), task=self.study.task(spec.task),
                    profile=self.study.profile, seconds=spec.seconds, recorder=Recorder(folder, facts=facts),
                )  # fmt: skip
            path = self._own_path(spec, record, pose) if filmed is None else filmed.path(facts)
            self._write(spec, folder, facts, path, record)

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
        """The path as reported by the robot, or by its wheels' counters."""
        if spec.source == "robot":
            return record.known(self.study.task(spec.task), self.study.profile)
        return record.counted(pose, self.study.profile)

    def _seen(
        self, spec: TrialSpec, folder: Path, facts: dict[str, Any], tell: Callable[[float], None]
    ) -> Track:
        """The track of a trial on the twin by the camera above it, which films or only watches."""
        rig = self.rig(spec)
        truth = rig.truth(folder / SEALED, spec.seconds)
        if spec.film:
            with self._camera(spec) as camera:
                facts["view"] = camera.metadata["view"]
                about = {"run": spec.name, "start": spec.start}
                return film_and_track(
                    folder, truth, rig.tracker, overhead=camera, first=spec.stream, facts=about, tell=tell
                )
        track = rig.tracker.track(truth, spec.stream)
        facts["view"] = rig.tracker.view
        track.write_csv(folder / TRACK)
        (folder / SEALED).unlink()
        return track

    def _camera(self, spec: TrialSpec) -> OverheadCamera:
        """The camera that films a trial."""
        from realitygap.calibration.record import plate_of
        from realitygap.twin.camera import OverheadCamera

        arena, unit, noise = self.study.task(spec.task).arena.plain(), spec.robot.unit, spec.twin_noise
        assert unit is not None
        return OverheadCamera(arena, unit=unit, noise=noise, view=spec.view, plate=plate_of(spec.marker))

    def _write(
        self, spec: TrialSpec, folder: Path, facts: dict[str, Any], path: Track, record: DriveRecord
    ) -> None:
        path.write_csv(folder / SITUATED)
        kept = record.recording
        fitness = score(path, self.study.task(spec.task), self.study.profile)
        facts["fitness"]["situated"] = fitness if kept.timing is None else math.nan
        facts |= {
            "timing": kept.timing,
            "film": spec.film,
            "situated_from": spec.source,
            "late_steps": kept.late_steps,
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
    context = TransferContext(study, place)
    with _overhead(options, operator) as overhead:
        for robot in dict.fromkeys(spec.robot for spec in todo):
            specs = [spec for spec in todo if spec.robot == robot]
            body = robot.open(baud=specs[0].baud)
            try:
                for spec in specs:
                    check_body(study, spec.task, body)
                for spec in specs:
                    at_rate = replace(spec, baud=getattr(body, "baud", None))
                    with file_errors(place / spec.folder):
                        context.by_hand(at_rate, body, operator.place_robot, overhead)
            except BaseException:
                body.abandon()  # it was told to stop first, wherever this came from
                raise
            body.close()


def _overhead(options: Transfer, operator: Operator) -> AbstractContextManager[LiveOverhead | None]:
    """The camera over real robots, if there is one."""
    if options.camera is None or options.camera_device is None:
        return nullcontext()
    camera = options.camera if isinstance(options.camera, CameraModel) else load_camera(options.camera)
    return LiveOverhead(options.camera_device, camera, options.worn, operator.confirm_pose, operator.says)


# By workers


class Job(NamedTuple):
    """A trial of an individual on the twin, or (without one) the calibration of the camera over its arena.

    `camera` is its calibration, for workers that cannot see the study's folder.
    """

    spec: TrialSpec
    genes: Genes | None = None
    camera: bytes | None = None


class Made(NamedTuple):
    """The files of a job by name: of a trial, `finished` or as far as it got, or of a camera. Before and
    after it, parts of the job's cost are sent."""

    spec: TrialSpec
    files: dict[str, bytes]
    finished: bool = True
    camera: bool = False


class TrialWorker:
    """Carries out jobs. It writes only cameras into the study's folder, if it can see it.

    `shown` is the folder of its results, for messages.
    """

    def __init__(self, context: TransferContext, shown: Path, home: Home | None = None) -> None:
        self._context, self._shown, self._home = context, shown, home

    def carry_out(self, job: Job, tell: Tell) -> None:
        """Carry out a job; `tell` receives its film's progress, then its files."""
        spec = job.spec
        camera = self._context.camera_file(spec)
        with file_errors(self._shown / spec.folder):
            if job.camera is not None:
                keep_camera(camera, job.camera)
            if job.genes is not None:
                self._trial(spec, job.genes, tell)
                return
            self._context.rig(spec).tracker  # noqa: B018 - it is calibrated when it is first asked for
            tell(Made(spec, {camera.name: camera.read_bytes()}, camera=True))
            tell(CALIBRATION_COST)

    def _trial(self, spec: TrialSpec, genes: Genes, tell: Tell) -> None:
        left = _cost(spec)

        def share(part: float) -> None:
            nonlocal left
            cost = part * spec.seconds * FILM_COST_S
            left -= cost
            tell(cost)

        with tempfile.TemporaryDirectory(prefix="realitygap-") as name:
            folder, finished = Path(name), False
            try:
                with explained(self._shown / spec.folder, spec.robot):
                    self._context.by_itself(spec, genes, folder, share)
                finished = True
            finally:
                files = {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}
                tell(Made(spec, files, finished))
        tell(left)

    def close(self) -> None:
        """End the twins."""
        self._context.close()
        if self._home is not None:
            self._home.close()


def worker_for(inputs: Inputs, shown: str) -> TrialWorker:
    """A worker for a study's trials, in any process."""
    home = home_of(inputs)
    place = Path(shown) if inputs[0] else home.folder
    return TrialWorker(TransferContext(load_study(home.folder), place), Path(shown), home)


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
    away, context = far(pool), TransferContext(study, place)
    for spec in todo if away else ():
        own = spec.controller or (spec.robot if spec.robot.kind == "own" else None)
        if own is not None:
            raise UsageError(
                f"{own}: expected one that the cluster's workers have too: its file is on this "
                "machine. Leave out --workers, or give a number."
            )
    watched = {context.camera_file(spec): spec for spec in todo if spec.source in ("camera", "film")}
    cameras = [Job(spec) for file, spec in watched.items() if not file.is_file()]
    work = len(cameras) * CALIBRATION_COST + sum(map(_cost, todo))
    reporter = Reporter(on_progress, {"transferring": work})
    reporter.phase("transferring", done=done, total=done + len(todo), what="trials")
    left = Counter((place / spec.folder).parent for spec in todo)

    def trials() -> Iterator[Job]:
        for spec in _in_order(todo):
            file = context.camera_file(spec)
            camera = file.read_bytes() if away and file in watched else None
            yield Job(spec, context.genes(spec), camera)

    def save(message: float | Made) -> None:
        if not isinstance(message, Made):
            reporter.add(message)
            return
        spec, files, finished, camera = message
        if camera:
            file = context.camera_file(spec)
            keep_camera(file, files[file.name])
            return
        folder = place / spec.folder
        with file_errors(folder):
            keep(folder, spec.robot, files, finished=finished)
            left[folder.parent] -= finished
            if not left[folder.parent] and spec.robot.unit is not None:
                archive(folder.parent)
        reporter.add(0.0, done=int(finished))

    inputs = (inputs_for(study.folder, pool), str(place.resolve()))
    for jobs in (cameras, trials()) if away else (chain(cameras, trials()),):
        pool.work(Setup(worker_for, inputs, here=TrialWorker(context, place)), jobs, save)


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
