"""Who makes the trials of a transfer: this process or several, with progress; a person's robot by hand."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from realitygap.robots.body import abandon
from realitygap.study.load import Study, load_study
from realitygap.study.schema import told
from realitygap.study.workers import Pool, at_work
from realitygap.transfer.plan import Situation, check_body
from realitygap.transfer.trial import Carry, Stage

if TYPE_CHECKING:
    from realitygap.transfer.overhead import Overhead

__all__ = ["OnProgress", "TransferProgress", "by_hand", "on_twins"]

CALIBRATION_COST = 6.0
DRIVE_COST, DRIVE_COST_S = 0.05, 0.03
FILM_COST_S, WATCH_COST_S = 0.8, 0.025
"""About how long things take, s: to get a unit ready, a second of its time, of film, of being watched."""

EVERY_S = 0.2


@dataclass(frozen=True, kw_only=True)
class TransferProgress:
    """An event: trials done and in all, those that were there already included.

    `seconds_left` is None while unknown.
    """

    phase: str
    done: int
    total: int
    seconds_left: float | None = None


OnProgress = Callable[[TransferProgress], None]


class Job(NamedTuple):
    """A trial on the twin, or only the calibration of the camera over its arena."""

    situation: Situation
    calibration: bool = False

    @property
    def cost(self) -> float:
        """About how long it takes, s."""
        if self.calibration:
            return CALIBRATION_COST
        one = self.situation
        seen = {"film": FILM_COST_S, "camera": WATCH_COST_S}.get(one.source, 0.0)
        return DRIVE_COST + one.seconds * (DRIVE_COST_S + seen)


class Worked(NamedTuple):
    """So much of a job is done, in its cost."""

    cost: float


class Done(NamedTuple):
    """A job is done, and what of its cost had not been told before."""

    cost: float
    trial: bool


def on_twins(
    study: Study,
    todo: Sequence[Situation],
    *,
    done: int,
    workers: int,
    on_progress: OnProgress | None,
) -> None:
    """Make trials on robots that place themselves; a twin's results do not depend on the number of workers.

    Raises:
        RealityGapError: the first that fails; the finished ones are kept.
    """
    if not todo:
        return
    jobs = _in_order(study, todo)
    reporter = Reporter(on_progress, done=done, total=done + len(todo), work=sum(job.cost for job in jobs))
    with closing(_messages(study.folder, jobs, min(workers, len(jobs)), reporter)) as messages:
        for message in messages:
            reporter.hear(message)


def by_hand(study: Study, todo: Sequence[Situation], carry: Carry, overhead: Overhead | None = None) -> None:
    """Make trials on a robot that a person places, one after the other; `overhead` sees it.

    Raises:
        UsageError: the port cannot be opened, or its rate is too slow.
        RobotError: the line was lost; the recording is kept.
        RobotStoppedError: Ctrl-C; the robot stands, the recording is kept.
    """
    stage, first = Stage(study), todo[0]
    body = first.robot.open(baud=first.baud)
    try:
        for one in todo:
            check_body(study, one.task, body)
        for one in todo:
            with told(study.folder / one.folder):
                stage.by_hand(replace(one, baud=getattr(body, "baud", None)), body, carry, overhead)
    except BaseException:
        abandon(body)  # it was told to stand first, wherever this came from
        raise
    body.close()


def _in_order(study: Study, todo: Sequence[Situation]) -> list[Job]:
    """Cameras first, then what takes longest, so that no worker is left alone with a film."""
    stage = Stage(study)
    cameras = {stage.camera_file(one): one for one in todo if one.source in ("camera", "film")}
    jobs = [Job(one, calibration=True) for file, one in cameras.items() if not file.is_file()]
    return jobs + sorted((Job(one) for one in todo), key=lambda job: -job.cost)


def _messages(
    folder: Path, jobs: Sequence[Job], workers: int, reporter: Reporter
) -> Generator[Worked | Done]:
    """What comes of the jobs, here or from processes."""
    if workers > 1:
        with Pool(folder, workers, life=_serve, last=Done) as pool:
            yield from pool.work(iter(jobs))
        return
    with closing(Stage(load_study(folder))) as stage:
        for job in jobs:
            yield _carry_out(stage, job, lambda cost: reporter.hear(Worked(cost)))


def _carry_out(stage: Stage, job: Job, tell: Callable[[float], None]) -> Done:
    """One job; `tell` hears how its film comes on."""
    one, told_cost = job.situation, 0.0

    def share(part: float) -> None:
        nonlocal told_cost
        cost = part * one.seconds * FILM_COST_S
        told_cost += cost
        tell(cost)

    with told(stage.study.folder / one.folder):
        if job.calibration:
            stage.calibrate(one)
        else:
            stage.by_itself(one, share)
    return Done(job.cost - told_cost, not job.calibration)


def _serve(connection: Connection, folder: str) -> None:
    """Take a job, say how it comes on, until the parent is gone."""
    with at_work(connection), closing(Stage(load_study(folder, trust=True))) as stage:  # the parent has asked
        while True:
            done = _carry_out(stage, connection.recv(), lambda cost: connection.send(Worked(cost)))
            connection.send(done)


class Reporter:
    """Counts what is done and tells it, a few times a second at most."""

    def __init__(self, tell: OnProgress | None, *, done: int, total: int, work: float) -> None:
        self._tell = tell or (lambda _: None)
        self._done, self._total = done, total
        self._work, self._worked = work, 0.0
        self._began = time.monotonic()
        self._last = 0.0
        self._say()

    def hear(self, message: Worked | Done) -> None:
        """So much more is done."""
        self._worked += message.cost
        if isinstance(message, Done):
            self._done += message.trial
        if time.monotonic() - self._last >= EVERY_S or self._done == self._total:
            self._say()

    def _say(self) -> None:
        self._last = time.monotonic()
        spent, left = self._last - self._began, max(self._work - self._worked, 0.0)
        seconds = spent * left / self._worked if self._worked > 0 else None
        self._tell(
            TransferProgress(phase="transferring", done=self._done, total=self._total, seconds_left=seconds)
        )
