"""The general experiment: a folder with its settings, phases that resume, and tables of results.

A kind of experiment is a value of settings, derived from `Settings`, and work in phases (calibrate, evolve,
drive), each of which writes files that the next one reads. A file appears complete or not at all, and a
finished one is never made again: that is all that resuming needs.
"""

import json
import math
import shlex
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

from realitygap.errors import StudyError, StudyInterruptedError
from realitygap.files import atomic_write, to_csv
from realitygap.study.config import StudyConfig
from realitygap.study.folder import exists
from realitygap.study.load import Study
from realitygap.study.provenance import versions
from realitygap.study.runner import COMPILING, FINISHED, run_study
from realitygap.work.folder import RunFolder, file_errors, lock, require_only_own
from realitygap.work.pool import Pool, Setup, Workers, opened
from realitygap.work.progress import OnProgress, Progress, Reporter
from realitygap.work.shard import MARK, Mark, Shard
from realitygap.world.toml import Value, build

__all__ = [
    "RESULTS", "Made", "Phase", "Phases", "Recorded", "Seconds", "Settings", "kept", "missing", "open_folder",
    "session", "write_table",
]  # fmt: skip

T = TypeVar("T")
S = TypeVar("S", bound="Settings")

RESULTS = "results"
"""Folder of the resulting tables: everything that a report needs."""
FIRST_GUESS_S = 2.0
"""The time left is estimated once this much time has been spent on finished work."""
KEEP_S = 10.0
"""Interval at which a phase's duration is saved."""

Recorded = Callable[[str, int, int], None]
"""Called with a calibration's part, how much of it is done, and of how much."""


@dataclass(frozen=True, kw_only=True)
class Settings(Value):
    """An experiment's settings: everything that its results depend on.

    A kind of experiment defines FILE, its settings' file; WHAT, its name in messages; the COMMAND that makes
    it; FACTS, the last file of its results, if any.
    """

    FILE = COMMAND = WHAT = FACTS = ""

    def to_dict(self) -> dict[str, Any]:
        """The settings with the file's keys; None is left out."""
        return {key: value for key, value in super().to_dict().items() if value is not None}

    @property
    def named(self) -> str:
        """Options to repeat when it is continued: a user's program runs only if it is named."""
        return ""

    def resuming(self, folder: str | Path) -> str:
        """The command that continues it."""
        return f"{self.COMMAND} --out {shlex.quote(str(folder))}{self.named} --resume"

    @classmethod
    def from_folder(cls, folder: Path) -> Self:
        """The settings of the experiment in a folder.

        Raises:
            StudyError: no such experiment there, or its file is broken or was edited.
        """
        place = RunFolder(folder, cls.FILE, cls.WHAT)
        if not place.begun:
            cure = f"Give the folder of `{cls.COMMAND}`."
            raise StudyError(f"{folder}: no {cls.WHAT} there ({cls.FILE} is missing). {cure}")
        return build(cls, place.settings())

    @classmethod
    def begun(cls, folder: Path, *, resume: bool) -> Self:
        """The default settings; or, to resume, those of the experiment in a folder, if there is one."""
        return cls.from_folder(folder) if resume and (folder / cls.FILE).is_file() else cls()


def open_folder(
    folder: Path, kind: type[S], requested: S | None, *, resume: bool, mark: Mark | None = None
) -> S:
    """Create the requested experiment in the folder, or open the one there; the lock is held.

    Args:
        folder: the experiment's.
        kind: of experiment.
        requested: the settings; None: those in the folder.
        resume: whether to continue one.
        mark: of a new one that is a shard.

    Raises:
        StudyError: there is one but `resume` is not set, or it was made with other settings, or
            there is none to resume, or the folder holds something else.
    """
    place = RunFolder(folder, kind.FILE, kind.WHAT)
    if not place.begun:
        if requested is None:
            raise StudyError(f"{folder}: no {kind.WHAT} there. Start it without --resume.")
        require_only_own(folder, kind.WHAT, (MARK,))
        head = f"# {kind.WHAT.capitalize()}: all that its results depend on.\n"
        again = f"# To continue it: {requested.resuming('THIS_FOLDER')}\n"
        if mark is not None:  # first: without its mark, a shard would be continued as the whole
            with file_errors(folder):
                mark.write(folder, finished=False)
        place.begin(requested.to_dict(), head=head + again, versions=versions())
        return requested
    there = kind.from_folder(folder)
    if not resume:
        done = "a finished" if kind.FACTS and (folder / RESULTS / kind.FACTS).is_file() else "an unfinished"
        cure = "Resume it (--resume) or choose another --out."
        raise StudyError(f"{folder} already holds {done if kind.FACTS else 'an'} {kind.WHAT}. {cure}")
    if requested is not None:
        place.refuse_other(there.to_dict(), requested.to_dict())
    return there


def missing(files: Mapping[T, Path]) -> list[T]:
    """Keys whose file does not exist yet."""
    return [one for one, file in files.items() if not file.is_file()]


@contextmanager
def kept(file: Path, what: str) -> Iterator[None]:
    """Read a file of an earlier phase; any fault is reported in one line.

    Raises:
        StudyError: it is missing or broken.
    """
    try:
        yield
    except Exception:  # a broken archive raises a dozen kinds of errors
        cure = "Delete it and resume: it is made again."
        raise StudyError(f"{file}: expected {what}. {cure}") from None


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
        again = f"Finished work in {folder} is kept: resume it (--resume)."
        raise StudyInterruptedError(f"stopped. {again}") from None


class Seconds:
    """Duration of each phase over all sessions, kept in the experiment's folder."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "seconds.json"

    def read(self) -> dict[str, float]:
        """Seconds by phase; an unreadable file counts as empty, since no result depends on it."""
        try:
            return {str(key): float(value) for key, value in json.loads(self._file.read_text()).items()}
        except (OSError, ValueError, AttributeError, TypeError, ArithmeticError, RecursionError):
            return {}

    def add(self, phase: str, seconds: float) -> None:
        """Add to a phase's duration."""
        table = self.read()
        table[phase] = round(table.get(phase, 0.0) + seconds, 1)
        atomic_write(self._file, json.dumps(table, indent=1) + "\n")


def write_table(file: Path, rows: Sequence[Mapping[str, object]], head: Sequence[str] = ()) -> None:
    """Write a CSV file with five digits; unknown values are empty. `head` is needed if there are no rows."""
    head = head or list(rows[0])
    atomic_write(file, to_csv([head, *([_text(row[key]) for key in head] for row in rows)]))


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.5g}" if math.isfinite(value) else ""
    return str(value).lower() if isinstance(value, bool) else str(value)


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
        self, phase: Phase, units: Iterable[int], record: Callable[[int, Recorded], object], steps: int
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

        def report(name: str, done: int, total: int) -> None:
            before = sum(shares.values())
            shares[name] = done / max(total, 1)
            self._reporter.add(cost * max(0.0, sum(shares.values()) - before))
            self._keep_time(KEEP_S)

        return report

    def evolve(
        self,
        phase: Phase,
        studies: Iterable[tuple[Path, StudyConfig, int]],
        *,
        engine: str = "cores",
        shard: Shard | None = None,
    ) -> list[Study]:
        """Carry out studies one after the other: each a folder, a configuration and the number of its runs;
        `engine` and `shard` are those of `run_study`."""
        made, before = [], 0
        with self._timed(phase, 0):
            for place, requested, runs in studies:
                made.append(
                    run_study(
                        place, requested, workers=self._pool, engine=engine, resume=exists(place),
                        shard=shard, on_progress=self._runs(phase, before),
                    )
                )  # fmt: skip
                before += runs
        return made

    def _runs(self, phase: Phase, before: int) -> OnProgress:
        def report(event: Progress) -> None:
            share = event.done / max(event.total, 1) * event.runs_total
            count = self._reporter.found if event.phase in (COMPILING, FINISHED) else self._reporter.reach
            count(before + event.runs_done, phase.cost * (phase.total - before - share))
            self._keep_time(KEEP_S)

        return report

    def drive(self, phase: Phase, setup: Callable[[], Setup], jobs: Iterable[Any]) -> None:
        """Have jobs done, each of which sends shares of its work and then its result.

        `setup`, for starting workers, is called if there is something to do.
        """

        def receive(message: float | Made) -> None:
            if isinstance(message, Made):
                with file_errors(self._folder):
                    file = self._folder / message.file
                    file.parent.mkdir(parents=True, exist_ok=True)
                    atomic_write(file, message.content)
                self._reporter.add(0.0, done=1)
            else:
                self._reporter.add(phase.cost * message)
            self._keep_time(KEEP_S)

        with self._timed(phase, phase.total - phase.left):
            if phase.left:
                self._pool.work(setup(), iter(jobs), receive)

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
