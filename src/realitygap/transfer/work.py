"""Makes the trials of a transfer: in a pool's workers, with progress; on a person's robot by hand."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from realitygap.errors import UsageError
from realitygap.evolution.algorithm import Genes
from realitygap.study.folder import Home, Inputs, home_of, inputs_for
from realitygap.study.load import Study, load_study
from realitygap.transfer.folder import blamed, files_in, keep, keep_camera, put_aside
from realitygap.transfer.overhead import Overhead
from realitygap.transfer.packed import Packed
from realitygap.transfer.plan import FOLDER, Situation, check_body
from realitygap.transfer.trial import Carry, Stage
from realitygap.work.folder import file_errors
from realitygap.work.pool import Pool, Setup, Tell, far
from realitygap.work.progress import OnProgress, Reporter

__all__ = ["by_hand", "on_twins"]

CALIBRATION_COST = 6.0
DRIVE_COST, DRIVE_COST_S = 0.05, 0.03
FILM_COST_S, WATCH_COST_S = 0.8, 0.025
"""Approximate times, s: to start a unit; for a second of its time; of film; of watching."""


class Job(NamedTuple):
    """A trial of an individual on the twin, or (without one) the calibration of the camera over its arena.

    `camera` is its calibration, for workers that cannot see the study's folder.
    """

    situation: Situation
    genes: Genes | None = None
    camera: bytes | None = None


class Made(NamedTuple):
    """The files of a job by name: of a trial, `finished` or as far as it got, or of a camera. Before and
    after it, parts of the job's cost are sent."""

    situation: Situation
    files: dict[str, bytes]
    finished: bool = True
    camera: bool = False


class Bench:
    """Carries out jobs; created once in a worker. It writes only cameras into the study's folder, if it can
    see it.

    `shown` is the folder of its results, for messages.
    """

    def __init__(self, stage: Stage, shown: Path, home: Home | None = None) -> None:
        self._stage, self._shown, self._home = stage, shown, home

    def carry_out(self, job: Job, tell: Tell) -> None:
        """Carry out a job; `tell` receives its film's progress, then its files."""
        one = job.situation
        camera = self._stage.camera_file(one)
        with file_errors(self._shown / one.folder):
            if job.camera is not None:
                keep_camera(camera, job.camera)
            if job.genes is not None:
                self._trial(one, job.genes, tell)
                return
            self._stage.rig(one).watcher  # noqa: B018 - it is calibrated when it is first asked for
            tell(Made(one, {camera.name: camera.read_bytes()}, camera=True))
            tell(CALIBRATION_COST)

    def _trial(self, one: Situation, genes: Genes, tell: Tell) -> None:
        left = _cost(one)

        def share(part: float) -> None:
            nonlocal left
            cost = part * one.seconds * FILM_COST_S
            left -= cost
            tell(cost)

        with (
            tempfile.TemporaryDirectory(prefix="realitygap-") as name,
            blamed(self._shown / one.folder, one.robot),
        ):
            try:
                self._stage.by_itself(one, genes, Path(name), share)
            except BaseException:
                tell(Made(one, files_in(Path(name)), finished=False))
                raise
            tell(Made(one, files_in(Path(name))))
        tell(left)

    def close(self) -> None:
        """End the twins."""
        self._stage.close()
        if self._home is not None:
            self._home.close()


def bench_in(words: Inputs, shown: str) -> Bench:
    """A bench for a study, in any worker."""
    home = home_of(words)
    place = Path(shown) if words[0] else home.folder
    return Bench(Stage(load_study(home.folder), place), Path(shown), home)


def on_twins(
    study: Study,
    place: Path,
    todo: Sequence[Situation],
    *,
    pack: bool,
    done: int,
    pool: Pool,
    on_progress: OnProgress | None,
) -> None:
    """Make trials on robots that place themselves; a twin's results do not depend on the pool.

    Args:
        study: whose individuals drive.
        place: where their folders are.
        todo: the trials.
        pack: whether unfilmed ones go into one file.
        done: number of existing ones.
        pool: of workers.
        on_progress: called a few times a second.

    Raises:
        RealityGapError: the first that fails; the finished ones are kept.
    """
    if not todo:
        return
    away, stage, phase = far(pool), Stage(study, place), "transferring"
    _refuse_own(todo, away=away)
    watched = {stage.camera_file(one): one for one in todo if one.source in ("camera", "film")}
    cameras = [Job(one) for file, one in watched.items() if not file.is_file()]
    work = len(cameras) * CALIBRATION_COST + sum(map(_cost, todo))
    reporter = Reporter(on_progress, {phase: work})
    reporter.phase(phase, done=done, total=done + len(todo), what="trials")

    def trials() -> Iterator[Job]:
        for one in _in_order(todo):
            file = stage.camera_file(one)
            camera = file.read_bytes() if away and file in watched else None
            yield Job(one, stage.genes(one), camera)

    words = (inputs_for(study.folder, pool), str(place.resolve()))
    with Packed(place / FOLDER) if pack else nullcontext() as archive:
        keeper = _Keeper(place=place, stage=stage, archive=archive, reporter=reporter)
        for jobs in (cameras, trials()) if away else (chain(cameras, trials()),):
            pool.work(Setup(bench_in, words, here=Bench(stage, place)), jobs, keeper.hear)


@dataclass(frozen=True, kw_only=True)
class _Keeper:
    """Stores what workers send: trials in folders of their own, or in one file for all."""

    place: Path
    stage: Stage
    archive: Packed | None
    reporter: Reporter

    def hear(self, message: float | Made) -> None:
        if not isinstance(message, Made):
            self.reporter.add(message)
            return
        one, files = message.situation, message.files
        if message.camera:
            file = self.stage.camera_file(one)
            keep_camera(file, files[file.name])
            return
        folder = self.place / one.folder
        with file_errors(folder):
            if self.archive is not None and message.finished and one.robot.unit is not None and not one.film:
                self.archive.keep(str(Path(one.folder).relative_to(FOLDER)), files)
                put_aside(folder, one.robot, "earlier")
            else:
                keep(folder, one.robot, files, finished=message.finished)
        self.reporter.add(0.0, done=int(message.finished))


def _refuse_own(todo: Sequence[Situation], *, away: bool) -> None:
    """Refuse to send out a robot or a controller that only this machine has."""
    for one in todo:
        own = one.controller or (one.robot if one.robot.kind == "own" else None)
        if away and own is not None:
            raise UsageError(
                f"{own}: expected one that the cluster's workers have too: its file is on this "
                "machine. Leave out --workers, or give a number."
            )


def _in_order(todo: Sequence[Situation]) -> list[Situation]:
    """The longest trials first, films in the first half of the rest, so that no worker ends alone with a film
    while others have nothing to do."""
    films, others = ([one for one in todo if one.film is film] for film in (True, False))
    others.sort(key=lambda one: -_cost(one))
    apart = 1 + max(1, len(others) // 2 // max(1, len(films)))
    for k, film in enumerate(films):
        others.insert(k * apart, film)
    return others


def _cost(one: Situation) -> float:
    """Approximate time of a trial, s."""
    seen = {"film": FILM_COST_S, "camera": WATCH_COST_S}.get(one.source, 0.0)
    return DRIVE_COST + one.seconds * (DRIVE_COST_S + seen)


def by_hand(
    study: Study, place: Path, todo: Sequence[Situation], carry: Carry, overhead: Overhead | None = None
) -> None:
    """Make trials on one robot that a person places.

    Args:
        study: whose individuals drive.
        place: where their folders are.
        todo: trials on one robot, one or more.
        carry: the person who carries it.
        overhead: the camera above, if there is one.

    Raises:
        UsageError: the port cannot be opened, or its rate is too slow.
        RobotError: the line was lost; the recording is kept.
        RobotStoppedError: Ctrl-C; the robot stands, the recording is kept.
    """
    stage, first = Stage(study, place), todo[0]
    body = first.robot.open(baud=first.baud)
    try:
        for one in todo:
            check_body(study, one.task, body)
        for one in todo:
            with file_errors(place / one.folder):
                stage.by_hand(replace(one, baud=getattr(body, "baud", None)), body, carry, overhead)
    except BaseException:
        body.abandon()  # it was told to stop first, wherever this came from
        raise
    body.close()
