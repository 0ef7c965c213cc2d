"""Programs in processes of their own."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from realitygap.errors import RobotError
from realitygap.work import child


def test_no_wait_for_a_child_is_without_end() -> None:
    """Whoever takes nothing, or says nothing, is given up, and the message says who and for how long."""
    pipes = os.pipe(), os.pipe()
    with pytest.raises(RobotError, match=r"the deaf one has taken nothing for 0\.05 s"):
        child.write_all(pipes[0][1], bytes(1 << 20), within_s=0.05, who="the deaf one")
    with pytest.raises(RobotError, match=r"the dumb one has not answered for 0\.05 s"):
        child.read_some(pipes[1][0], within_s=0.05, who="the dumb one")
    child.write_all(pipes[1][1], b"said", within_s=0.05, who="it")
    assert child.read_some(pipes[1][0], within_s=0.05, who="it") == b"said"
    for end in (*pipes[0], *pipes[1]):
        os.close(end)


def test_a_child_that_does_not_leave_is_ended() -> None:
    """One that ends with its input does so; one that stays is killed."""
    for code, ends in (("input()", 1), ("import time; time.sleep(600)", -9)):
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        process = subprocess.Popen([sys.executable, "-c", code], **pipes)  # type: ignore[call-overload]
        child.end(process, 20.0 if ends > 0 else 0.05)
        assert process.returncode == ends
