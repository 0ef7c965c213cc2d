"""A program in a process of its own, spoken to through its pipes: no wait for it is without end."""

import os
import select
import subprocess
from contextlib import suppress

from realitygap.errors import RobotError

__all__ = ["end", "read_some", "write_all"]

CHUNK = 1 << 16


def write_all(target: int, data: bytes, *, within_s: float, who: str) -> None:
    """All of some bytes into a pipe, which takes so much at once.

    Args:
        target: its descriptor.
        data: the bytes.
        within_s: how long it may take none.
        who: reads them, for the message.

    Raises:
        RobotError: it took none for so long.
        OSError: nobody reads any more.
    """
    while data:
        if not select.select([], [target], [], within_s)[1]:
            raise RobotError(f"{who} has taken nothing for {within_s:g} s; begin again")
        data = data[os.write(target, data[: select.PIPE_BUF]) :]  # so many never block where there is room


def read_some(source: int, *, within_s: float, who: str) -> bytes:
    """What comes out of a pipe; nothing if whoever writes has ended.

    Args:
        source: its descriptor.
        within_s: how long nothing may come.
        who: writes it, for the message.

    Raises:
        RobotError: nothing came for so long.
    """
    if not select.select([source], [], [], within_s)[0]:
        raise RobotError(f"{who} has not answered for {within_s:g} s; begin again")
    return os.read(source, CHUNK)


def end(process: subprocess.Popen[bytes], leave_s: float) -> None:
    """Close its pipes, which ends it; insist if need be, after `leave_s`."""
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()
    try:
        process.wait(leave_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
