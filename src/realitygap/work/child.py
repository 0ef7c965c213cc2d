"""A program in a process of its own, reached through its pipes or a socket: every wait for it ends."""

import os
import select
import socket
import struct
import subprocess
from contextlib import suppress

from realitygap.errors import RobotError

__all__ = ["ask", "end", "give_up_after"]

CHUNK = 1 << 16


def ask(process: subprocess.Popen[bytes], question: bytes, *, within_s: float, who: str) -> bytes:
    """The line that a program answers to a line, or what there is of it if the program has ended.

    Args:
        process: the program, with pipes.
        question: the line.
        within_s: how long it may accept nothing, or say nothing.
        who: it is, for the message.

    Raises:
        RobotError: it accepted nothing, or said nothing, for so long.
        OSError: it reads no more.
    """
    assert process.stdin is not None and process.stdout is not None
    target, source, answer = process.stdin.fileno(), process.stdout.fileno(), b""
    while question:
        if not select.select([], [target], [], within_s)[1]:
            raise RobotError(f"{who} has accepted nothing for {within_s:g} s; start again")
        sent = os.write(target, question[: select.PIPE_BUF])  # so many never block where there is room
        question = question[sent:]
    while not answer.endswith(b"\n"):
        if not select.select([source], [], [], within_s)[0]:
            raise RobotError(f"{who} has not answered for {within_s:g} s; start again")
        more = os.read(source, CHUNK)
        if not more:
            break
        answer += more
    return answer


def end(process: subprocess.Popen[bytes], leave_s: float) -> None:
    """Close its pipes, which ends it; kill it after `leave_s` if needed."""
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()
    try:
        process.wait(leave_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def give_up_after(waiting: socket.socket, seconds: float) -> None:
    """Let the system end what a socket waits for; Python's own time-out costs a system call each time.

    Such an end is a BlockingIOError.
    """
    interval = struct.pack("ll", int(seconds), int(seconds % 1 * 1e6))
    for way in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
        waiting.setsockopt(socket.SOL_SOCKET, way, interval)
