"""Processes that are killed, stopped or in each other's way."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import time
from pathlib import Path

import pytest

from realitygap.errors import StudyBusyError
from realitygap.study.load import load_study
from realitygap.study.runner import run_study
from tests.study.helpers import content, end, small, start, wait_for

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at processes in /proc")


@pytest.fixture(scope="module")
def longer():
    """A study that takes half a second or more."""
    return small(runs=3, evaluations=800, checkpoint_every=25)


@pytest.fixture(scope="module")
def uninterrupted(longer, tmp_path_factory):
    """What it holds when nobody kills it."""
    folder = tmp_path_factory.mktemp("uninterrupted") / "study"
    run_study(folder, longer, workers=1)
    return content(folder)


@pytest.fixture
def requested(folder, longer) -> Path:
    """A folder whose study a child process can make."""
    folder.with_suffix(".toml").write_text(longer.to_toml())
    return folder


@pytest.mark.parametrize("workers", [1, 2])
def test_kills_at_random_moments(requested, uninterrupted, workers):
    """Killed again and again, resumed each time, a study comes to the bits of an undisturbed one.

    This is a slice of `tests/hostile/kill.py`.
    """
    moments = random.Random(workers)
    kills = ((0, signal.SIGKILL), (1, signal.SIGTERM), (1000, signal.SIGKILL))
    for least, number in kills if workers == 2 else kills[-1:]:
        process = start(requested, "--workers", str(workers))
        wait_for(process, "evolving", least)
        time.sleep(moments.uniform(0.0, 0.4))
        process.send_signal(number)
        end(process)
        runs = load_study(requested).runs
        assert all(run.evaluations % 25 == 0 for run in runs)
    assert sum(run.evaluations for run in runs) >= 1000
    code, said = end(start(requested))
    assert (code, said) == (0, "")
    assert content(requested) == uninterrupted


def test_a_second_process_is_refused(requested):
    """The second process on a study is told who holds it; the first is not disturbed."""
    first = start(requested)
    try:
        wait_for(first, "evolving")
        with pytest.raises(StudyBusyError, match=rf"another process \(pid {first.pid}\) is working on this"):
            run_study(requested, resume=True)
        assert first.poll() is None
    finally:
        first.kill()
        end(first)


def test_ctrl_c_ends_workers_at_once(requested):
    """After Ctrl-C to all of its processes a study ends in one line, long before it is done, and leaves none
    running."""
    process = start(requested, "--workers", "2")
    wait_for(process, "evolving", 1)
    workers = children(process.pid)
    assert len(workers) >= 2
    for pid in [process.pid, *workers]:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGINT)
    code, said = end(process)
    assert code == 130 and said.startswith("StudyInterruptedError: stopped.") and len(said.splitlines()) == 1
    assert not all(run.finished for run in load_study(requested).runs)
    assert gone(workers)


def test_workers_die_with_the_parent(requested):
    """Killing the parent leaves no process behind."""
    process = start(requested, "--workers", "2")
    wait_for(process, "evolving", 1)
    workers = children(process.pid)
    assert len(workers) >= 2
    process.kill()
    end(process)
    assert gone(workers)


def test_workers_that_are_killed_are_replaced(requested, uninterrupted):
    """A dead worker (such as by the kernel, for want of memory) costs nothing but time."""
    process = start(requested, "--workers", "2")
    wait_for(process, "evolving", 1)
    for pid in children(process.pid):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    code, said = end(process)  # which tells of Python's own helper, killed too
    assert code == 0 and "Error" not in said
    assert content(requested) == uninterrupted


def children(pid: int) -> list[int]:
    """Processes whose parent is `pid`."""
    listed = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]
    return [one for one in listed if state(one)[1:2] == [str(pid)]]


def gone(pids: list[int]) -> bool:
    """Whether all of them end within some seconds."""
    for _ in range(50):
        if not any(state(pid)[:1] not in ([], ["Z"]) for pid in pids):
            return True
        time.sleep(0.1)
    return False


def state(pid: int) -> list[str]:
    """What the kernel says of a process: its state, its parent's id …; nothing if there is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return []
