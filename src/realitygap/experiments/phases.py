"""Phases of an experiment: calibrate, evolve, drive; each writes files that the next reads.

A file appears complete or not at all and a finished one is never made again: this is all that resuming needs.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from realitygap import whole
from realitygap.errors import StudyInterruptedError
from realitygap.experiments.folder import Seconds
from realitygap.study.config import StudyConfig
from realitygap.study.folder import exists
from realitygap.study.load import Study
from realitygap.study.lock import lock
from realitygap.study.runner import COMPILING, FINISHED, run_study
from realitygap.study.schema import told
from realitygap.work.pool import Pool, Setup
from realitygap.work.progress import OnProgress, Progress, Reporter
from realitygap.work.workers import Workers, opened

__all__ = ["Made", "Phase", "Phases", "Recorded", "session"]

FIRST_GUESS_S = 2.0
"""The time left is estimated once this much time has been spent on finished work."""
KEEP_S = 10.0
"""Interval at which a phase's duration is saved."""

Recorded = Callable[[str, int, int], None]
"""Called with a calibration's part, how much of it is done, and of how much."""


@contextmanager
def session(folder: Path, workers: Workers) -> Iterator[Pool]:
    """Lock a folder and open a pool for a session.

    Raises:
        StudyInterruptedError: Ctrl-C; finished work is kept.
    """
    try:
        with opened(workers) as pool, lock(folder):
            yield pool
    except KeyboardInterrupt:
        kept = f"Finished work in {folder} is kept: resume it (--resume)."
        raise StudyInterruptedError(f"stopped. {kept}") from None


class Phase(NamedTuple):
    """A phase of the work.

    Attributes:
        key: its name in files.
        title: for display.
        what: its items are called.
        total: number of items, with those of earlier sessions.
        left: to do.
        cost: approximate time of one on one core, s: only used to estimate the time left.
    """

    key: str
    title: str
    what: str
    total: int
    left: int
    cost: float


class Made(NamedTuple):
    """The result of a job: a file, named relative to the experiment's folder. Shares of it come before."""

    file: str
    content: bytes


class Phases:
    """Does the remaining work, phase by phase, and reports progress.

    Args:
        folder: the experiment's.
        pool: of workers.
        phases: all of them, in order.
        on_progress: called with progress.
    """

    def __init__(
        self, folder: Path, pool: Pool, phases: Sequence[Phase], on_progress: OnProgress | None
    ) -> None:
        self._folder, self._pool = folder, pool
        work = {one.title: one.cost * one.left for one in phases}
        self._reporter = Reporter(on_progress, work, patience_s=FIRST_GUESS_S)

    def calibrate(
        self, phase: Phase, units: Iterable[int], record: Callable[[int, Recorded], None], steps: int
    ) -> None:
        """Record and fit units without a profile, one after the other.

        Args:
            phase: this one.
            units: without a profile.
            record: makes one, and reports its parts.
            steps: number of a unit's parts.
        """
        with self._timed(phase, phase.total - phase.left):
            for unit in units:
                record(unit, self._parts(phase.cost / steps))
                self._reporter.add(0.0, done=1)

    def _parts(self, cost: float) -> Recorded:
        shares: dict[str, float] = {}

        def heard(name: str, done: int, total: int) -> None:
            before = sum(shares.values())
            shares[name] = done / max(total, 1)
            self._reporter.add(cost * max(0.0, sum(shares.values()) - before))
            self._keep_time(KEEP_S)

        return heard

    def evolve(
        self, phase: Phase, studies: Iterable[tuple[Path, StudyConfig, int]], **options: Any
    ) -> list[Study]:
        """Carry out studies one after the other: each a folder, a configuration and the number of its runs;
        `options` are those of `run_study`."""
        made, before = [], 0
        with self._timed(phase, 0):
            for place, requested, runs in studies:
                heard = self._runs(phase, before)
                made.append(
                    run_study(place, requested, workers=self._pool, resume=exists(place), on_progress=heard,
                              **options)
                )  # fmt: skip
                before += runs
        return made

    def _runs(self, phase: Phase, before: int) -> OnProgress:
        def heard(event: Progress) -> None:
            share = event.done / max(event.total, 1) * event.runs_total
            tell = self._reporter.found if event.phase in (COMPILING, FINISHED) else self._reporter.reach
            tell(before + event.runs_done, phase.cost * (phase.total - before - share))
            self._keep_time(KEEP_S)

        return heard

    def drive(self, phase: Phase, setup: Callable[[], Setup], jobs: Iterable[Any]) -> None:
        """Have jobs done, each of which sends shares of its work and then its result.

        `setup`, for starting workers, is called if there is something to do.
        """

        def heard(message: float | Made) -> None:
            if isinstance(message, Made):
                with told(self._folder):
                    file = self._folder / message.file
                    file.parent.mkdir(parents=True, exist_ok=True)
                    whole.write(file, message.content)
                self._reporter.add(0.0, done=1)
            else:
                self._reporter.add(phase.cost * message)
            self._keep_time(KEEP_S)

        with self._timed(phase, phase.total - phase.left):
            if phase.left:
                self._pool.work(setup(), iter(jobs), heard)

    @contextmanager
    def _timed(self, phase: Phase, done: int) -> Iterator[None]:
        self._key, self._since = phase.key, time.monotonic()
        self._reporter.phase(phase.title, done=done, total=phase.total, what=phase.what)
        try:
            yield
        finally:
            self._keep_time()
        self._reporter.end()

    def _keep_time(self, every_s: float = 0.0) -> None:
        """Save the phase's duration, also now and then during it, so that it survives a kill."""
        now = time.monotonic()
        if now - self._since >= every_s:
            Seconds(self._folder).add(self._key, now - self._since)
            self._since = now
