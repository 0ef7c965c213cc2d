"""Every pool keeps the contract; a study is the same by any of them."""

from __future__ import annotations

import pytest

from realitygap.errors import ConfigError
from realitygap.study.folder import gather, input_files, open_folder
from realitygap.study.jobs import Job, StudyExecutor
from realitygap.study.runner import executor_for
from realitygap.testing import PoolContract
from realitygap.work.cluster import named_pool
from realitygap.work.pool import Here, Processes
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


def test_a_worker_needs_nothing_but_messages(tmp_path):
    """Where a study's folder is not to be seen, its files' content makes the same executor."""
    folder = tmp_path / "study"
    folder.mkdir()
    own = StudyExecutor(open_folder(folder, gather(small()), resume=False))
    far = executor_for((str(tmp_path / "elsewhere"), input_files(folder)))
    near, away = ([], [])
    own.carry_out(Job(1, None), near.append)
    far.carry_out(Job(1, None), away.append)
    far.close()
    assert [m.state for m in near[:-1]] == [m.state for m in away[:-1]]
    assert near[-1].results.champion == away[-1].results.champion


def test_a_pool_by_its_name(tmp_path):
    """What a file names is made without arguments; what is no pool, or stops, is refused by name."""
    file = tmp_path / "mine.py"
    file.write_text("from realitygap.work.pool import Here\nclass Mine(Here): pass\nclass Other: pass\n")
    assert type(named_pool(f"{file}:Mine")).__name__ == "Mine"
    with pytest.raises(ConfigError, match=r"mine.py:Other: expected a pool, with methods work and close"):
        named_pool(f"{file}:Other")
