"""Programs in processes of their own."""

from __future__ import annotations

import subprocess
import sys

import pytest

from realitygap.errors import RobotError
from realitygap.work import child

PIPES: dict[str, int] = {
    "stdin": subprocess.PIPE,
    "stdout": subprocess.PIPE,
    "stderr": subprocess.DEVNULL,
}


def test_no_wait_for_a_child_is_without_end() -> None:
    """Whoever takes nothing, or says nothing, is given up, and the message says who and for how long."""
    for question, says in ((bytes(1 << 20), "accepted nothing"), (b"?\n", "not answered")):
        with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], **PIPES) as deaf:  # type: ignore[call-overload]
            with pytest.raises(RobotError, match=rf"the deaf one has {says} for 0\.05 s"):
                child.ask(deaf, question, within_s=0.05, who="the deaf one")
            deaf.kill()


def test_a_child_answers_a_line() -> None:
    """One line for one line; half of it, or nothing, from one that ends."""
    for code, said in (("print(input())", b"so\n"), ("print(input(), end='')", b"so"), ("input()", b"")):
        with subprocess.Popen([sys.executable, "-c", code], **PIPES) as process:  # type: ignore[call-overload]
            assert child.ask(process, b"so\n", within_s=60.0, who="it") == said


def test_a_child_that_does_not_leave_is_ended() -> None:
    """One that ends with its input does so; one that stays is killed."""
    for code, ends in (("input()", 1), ("import time; time.sleep(600)", -9)):
        process = subprocess.Popen([sys.executable, "-c", code], **PIPES)  # type: ignore[call-overload]
        child.end(process, 20.0 if ends > 0 else 0.05)
        assert process.returncode == ends
