"""What every pool does, wherever its workers are."""

import os
import signal
import tempfile
import threading
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import NamedTuple
from unittest import SkipTest, TestCase

from realitygap.errors import ConfigError, StudyError
from realitygap.work.pool import Pool, Setup, Tell

__all__ = ["PoolContract"]

MESSAGES = 3
"""Of each job."""


class _Job(NamedTuple):
    """A job: what goes wrong with it before its second message, and where that is noted."""

    number: int
    trouble: str = ""
    note: str = ""


class _Bench:
    """Carries them out."""

    def __init__(self, name: str) -> None:
        self._name = name

    def carry_out(self, job: _Job, tell: Tell) -> None:
        """Its messages: the bench's name, the job's number, and their own."""
        for k in range(MESSAGES):
            tell((self._name, job.number, k))
            if job.trouble == "refused":
                raise ConfigError(f"job {job.number} is refused")
            if job.trouble == "lost" or (job.trouble == "lost once" and not Path(job.note).exists()):
                if job.note:
                    Path(job.note).touch()
                os.kill(os.getpid(), signal.SIGKILL)

    def close(self) -> None:
        """Nothing to release."""


class PoolContract:
    """Tests of a pool: override `opened`, and `loses` if its workers are processes that may be killed.

    Example:
        class TestMyPool(PoolContract):
            def opened(self):
                return MyPool()
    """

    loses = False
    """Whether a worker is a process of this machine that can be lost without this one."""

    def opened(self) -> Pool:
        """A pool of two workers or more, where it can have so many."""
        raise NotImplementedError("override opened()")

    def test_every_job_is_answered_once(self) -> None:
        """Each job's messages come once and in order; which job comes first is up to the pool."""
        with closing(self.opened()) as pool:
            _complete(_heard(pool, map(_Job, range(20))), 20)

    def test_a_pool_takes_more_work(self) -> None:
        """None at all, and work with another bench."""
        with closing(self.opened()) as pool:
            assert _heard(pool, []) == []
            _complete(_heard(pool, map(_Job, range(3)), "one"), 3)
            _complete(_heard(pool, map(_Job, range(4)), "two"), 4)

    def test_an_error_arrives_as_itself(self) -> None:
        """With its message; the pool can then be closed."""
        with closing(self.opened()) as pool, TestCase().assertRaises(ConfigError) as met:
            _heard(pool, [_Job(0), _Job(1, "refused"), _Job(2)])
        assert str(met.exception) == "job 1 is refused"

    def test_whoever_listens_may_stop_the_work(self) -> None:
        """Messages are heard in the thread that asked; what is raised there ends the work."""
        threads = []

        def stop(message: object) -> None:
            threads.append(threading.current_thread())
            raise KeyboardInterrupt

        with closing(self.opened()) as pool, TestCase().assertRaises(KeyboardInterrupt):
            pool.work(Setup(_Bench, ("stopped",)), map(_Job, range(5)), stop)
        assert threads == [threading.current_thread()]

    def test_a_lost_worker_is_replaced(self) -> None:
        """Another does its job again, and no message comes twice."""
        if not self.loses:
            raise SkipTest("its workers are not lost without this process")
        with tempfile.TemporaryDirectory() as folder, closing(self.opened()) as pool:
            jobs = [_Job(k, "lost once" if k % 3 else "", f"{folder}/{k}") for k in range(9)]
            _complete(_heard(pool, jobs), 9)
            assert len(list(Path(folder).iterdir())) == 6

    def test_a_job_may_not_lose_workers_for_ever(self) -> None:
        """It ends in one error that says how the worker died."""
        if not self.loses:
            raise SkipTest("its workers are not lost without this process")
        with closing(self.opened()) as pool, TestCase().assertRaises(StudyError) as met:
            _heard(pool, [_Job(0), _Job(1, "lost")])
        assert "a worker process died (signal 9). What was saved is kept" in str(met.exception)

    def test_a_closed_pool_leaves_nothing_behind(self) -> None:
        """No process and no thread; closing once more does nothing."""
        if not Path("/proc/self/stat").exists():
            raise SkipTest("looks at processes in /proc")
        left, pools = [], []
        for _ in range(2):  # Python's own helpers start with the first
            pool = self.opened()
            pools.append(pool)  # what only ends with its pool is left behind, too
            _heard(pool, map(_Job, range(4)))
            pool.close()
            pool.close()
            left.append((_children(), threading.active_count()))
        assert left[0] == left[1]


def _heard(pool: Pool, jobs: Iterable[_Job], name: str = "") -> list[tuple[str, int, int]]:
    heard: list[tuple[str, int, int]] = []
    pool.work(Setup(_Bench, (name,)), jobs, heard.append)
    assert {who for who, _, _ in heard} <= {name}
    return heard


def _complete(heard: list[tuple[str, int, int]], jobs: int) -> None:
    """All of them, and each job's in order."""
    assert sorted(job for _, job, _ in heard) == [job for job in range(jobs) for _ in range(MESSAGES)]
    for number in range(jobs):
        assert [k for _, job, k in heard if job == number] == list(range(MESSAGES))


def _children() -> set[str]:
    """Processes that this one started."""
    found = set()
    for place in Path("/proc").iterdir():
        if place.name.isdigit():
            try:
                state, parent = (place / "stat").read_text().rsplit(")", 1)[1].split()[:2]
            except OSError:
                continue
            if parent == str(os.getpid()) and state != "Z":
                found.add(place.name)
    return found
