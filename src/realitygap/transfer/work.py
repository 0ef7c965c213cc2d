"""Who makes the trials of a transfer: this process or several, with progress; a person's robot by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from realitygap.robots.body import abandon
from realitygap.study.load import Study, load_study
from realitygap.study.schema import told
from realitygap.transfer.plan import Situation, check_body
from realitygap.transfer.trial import Carry, Stage
from realitygap.work.pool import Pool, Setup, Tell
from realitygap.work.progress import OnProgress, Reporter

if TYPE_CHECKING:
    from realitygap.transfer.overhead import Overhead

__all__ = ["by_hand", "on_twins"]

CALIBRATION_COST = 6.0
DRIVE_COST, DRIVE_COST_S = 0.05, 0.03
FILM_COST_S, WATCH_COST_S = 0.8, 0.025
"""About how long things take, s: to get a unit ready, a second of its time, of film, of being watched."""


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
    """So much of a job is done, in its cost, and so many trials are there."""

    cost: float
    trials: int = 0


class Bench:
    """Carries out jobs; made once in a worker. It writes into the study's folder, which it has to see."""

    def __init__(self, study: Study) -> None:
        self._stage = Stage(study)

    def carry_out(self, job: Job, tell: Tell) -> None:
        """One job; `tell` hears how its film comes on, then that it is done."""
        one, left = job.situation, job.cost

        def share(part: float) -> None:
            nonlocal left
            cost = part * one.seconds * FILM_COST_S
            left -= cost
            tell(Worked(cost))

        with told(self._stage.study.folder / one.folder):
            if job.calibration:
                self._stage.calibrate(one)
            else:
                self._stage.by_itself(one, share)
        tell(Worked(left, 0 if job.calibration else 1))

    def close(self) -> None:
        """End the twins."""
        self._stage.close()


def bench_in(folder: str) -> Bench:
    """A bench for the study in a folder."""
    return Bench(load_study(folder, trust=True))  # the parent has asked


def on_twins(
    study: Study, todo: Sequence[Situation], *, done: int, pool: Pool, on_progress: OnProgress | None
) -> None:
    """Make trials on robots that place themselves; a twin's results do not depend on the pool.

    Args:
        study: whose folder they are written in.
        todo: the trials.
        done: how many there are already.
        pool: who makes them.
        on_progress: called a few times a second.

    Raises:
        RealityGapError: the first that fails; the finished ones are kept.
    """
    if not todo:
        return
    jobs, phase = _in_order(study, todo), "transferring"
    reporter = Reporter(on_progress, {phase: sum(job.cost for job in jobs)})
    reporter.phase(phase, done=done, total=done + len(todo), what="trials")
    setup = Setup(bench_in, (str(study.folder.resolve()),), here=Bench(study))
    pool.work(setup, jobs, lambda worked: reporter.add(worked.cost, done=worked.trials))


def by_hand(study: Study, todo: Sequence[Situation], carry: Carry, overhead: Overhead | None = None) -> None:
    """Make trials on a robot that a person places, one after the other; `overhead` sees it.

    Args:
        study: whose folder they are written in.
        todo: trials on one robot, one or more.
        carry: the person who carries it.
        overhead: the camera above, if there is one.

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
