"""Every pool keeps the contract; a study is the same by any of them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from itertools import islice

import pytest

from realitygap.errors import ConfigError, StudyError
from realitygap.study.folder import open_folder
from realitygap.study.jobs import Job, Workshop
from realitygap.study.materials import gather
from realitygap.study.reader import Reader
from realitygap.study.runner import workshop_of
from realitygap.testing import PoolContract
from realitygap.work.pool import Counted, Here, Processes, Setup
from realitygap.work.workers import named_pool, opened
from tests.study.helpers import small


class TestHere(PoolContract):
    """This process."""

    def opened(self):
        return Here()


class TestProcesses(PoolContract):
    """Two processes."""

    loses = True

    def opened(self):
        return Processes(2)


class TestCounted(PoolContract):
    """Somebody's, held to its word."""

    def opened(self):
        return Counted(Here())


class Leaky(Here):
    """A thread waits in it for as long as there is a reference to the pool."""

    def __init__(self):
        super().__init__()
        self.executor = ThreadPoolExecutor(1)

    def work(self, setup, jobs, tell):
        self.executor.submit(int).result()
        super().work(setup, jobs, tell)


def test_a_pool_that_leaves_a_thread_behind_is_found_out():
    """Though the thread ends with the pool itself, which is kept as a user's script would keep it."""

    class Wrong(PoolContract):
        def opened(self):
            return Leaky()

    with pytest.raises(AssertionError):
        Wrong().test_a_closed_pool_leaves_nothing_behind()


class Bench:
    """Answers a job twice."""

    def carry_out(self, job, tell):
        """Its number, and the next."""
        tell(job)
        tell(job + 1)

    def close(self):
        """Nothing."""


class Faulty:
    """Carries out the first of the jobs, and passes on what `fault` makes of all that was told."""

    def __init__(self, fault, jobs=None):
        self.fault, self.jobs = fault, jobs

    def work(self, setup, jobs, tell):
        """Of an iterator."""
        told = []
        Here().work(setup, islice(jobs, self.jobs), told.append)
        for message in self.fault(told):
            tell(message)

    def close(self):
        """Nothing."""


@pytest.mark.parametrize(
    ("fault", "heard"),
    [
        (lambda told: told, [0, 1, 10, 11]),
        (lambda told: told[3:] + told[:3], [10, 11, 0, 1]),
        (lambda told: told[1:], []),
        (lambda told: told[:1] + told[2:], [0]),
        (lambda told: told[:4] + told[5:], [0, 1, 10]),
        (lambda told: told[:5], [0, 1, 10, 11]),
        (lambda told: told[:3], [0, 1]),
        (lambda told: told[:1] + told, [0]),
        (lambda told: told + told[:1], [0, 1, 10, 11]),
        (lambda told: [getattr(told[0], "message", 0)], []),
        (lambda told: [told], []),
    ],
)
def test_a_pool_is_held_to_its_word(fault, heard):
    """What comes in turn is heard; the first message that is lost, doubled or no message ends the work."""
    wanted, told = [0, 1, 10, 11], []
    complete = sorted(heard) == wanted and len(fault(list(range(6)))) == 6
    with (
        opened(Faulty(fault)) as pool,
        nullcontext() if complete else pytest.raises(StudyError, match="once"),
    ):
        pool.work(Setup(Bench), [0, 10], told.append)
    assert told == heard


def test_a_pool_that_leaves_jobs_out_is_found_out():
    """So is one that carries out none."""
    for jobs in (0, 1):
        with opened(Faulty(list, jobs)) as pool, pytest.raises(StudyError, match="lost or duplicated"):
            pool.work(Setup(Bench), [0, 10], [].append)


def test_a_worker_needs_nothing_but_messages(tmp_path):
    """Where a study's folder is not to be seen, its files' content makes the same workshop."""
    folder = tmp_path / "study"
    folder.mkdir()
    own = Workshop(open_folder(folder, gather(small()), resume=False))
    sources = Reader(folder / "study.db").sources()
    far = workshop_of((str(tmp_path / "elsewhere"), sources))
    near, away = ([], [])
    own.carry_out(Job(1, None), near.append)
    far.carry_out(Job(1, None), away.append)
    far.close()
    assert [m.state for m in near[:-1]] == [m.state for m in away[:-1]]
    assert near[-1].results.champion == away[-1].results.champion


@pytest.mark.parametrize("workers", [0, 1025, True, "two", 1.5, object()])
def test_what_is_no_pool_is_refused(workers):
    """A number from 1 on, or something with work and close."""
    with pytest.raises(ConfigError, match="workers: expected a whole number from 1 to 1024, or a pool"):
        opened(workers).__enter__()


def test_a_pool_by_its_name(tmp_path):
    """What a file names is made without arguments; what is no pool, or stops, is refused by name."""
    file = tmp_path / "mine.py"
    file.write_text("from realitygap.work.pool import Here\nclass Mine(Here): pass\nclass Other: pass\n")
    assert type(named_pool(f"{file}:Mine")).__name__ == "Mine"
    with pytest.raises(ConfigError, match=r"mine.py:Other: expected a pool, with methods work and close"):
        named_pool(f"{file}:Other")
    file.write_text(
        "class Mine:\n    def __init__(self, queue): pass\nclass Shut:\n    def __init__(self): {}['no']\n"
    )
    with pytest.raises(ConfigError, match=r"mine.py: Mine\(\) fails with TypeError: .* 'queue'"):
        named_pool(f"{file}:Mine")
    with pytest.raises(ConfigError, match=r"mine.py, line 4: Shut\(\) fails with KeyError: 'no'"):
        named_pool(f"{file}:Shut")
