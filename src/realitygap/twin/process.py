"""A twin in a process of its own, as a program starts it."""

import contextlib
import json
import socket
import subprocess
import sys
import weakref
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from realitygap.errors import RobotError, UsageError
from realitygap.twin.server import Settings
from realitygap.values import Closing, Pose
from realitygap.work import child

__all__ = ["LEAVE_S", "TwinProcess", "launch", "start_twin"]

CHANNEL_S = 60.0
START_S = 300.0
"""Longer than any start takes: the first one on a busy machine compiles."""
LEAVE_S = 5.0


class TwinProcess(Closing):
    """A running twin: its serial device, and the experimenter's hand. As a context it is closed.

    Attributes:
        device: path of the pseudo-terminal, which any Khepera program can open.
        channel: path of the second channel, for a virtual clock.
    """

    def __init__(self, process: subprocess.Popen[bytes], device: str, channel: str) -> None:
        self.device = device
        self.channel = channel
        self.pid = process.pid
        self._hand: socket.socket | None = None
        self._finalizer = weakref.finalize(self, child.end, process, LEAVE_S)

    def place(self, pose: Pose) -> None:
        """Put the robot down (under a virtual clock: after the clock has settled)."""
        self._tell(f"place {pose.x!r} {pose.y!r} {pose.heading!r}")

    def film(self, states: str | Path | None) -> None:
        """Write where the robot is, every 20 ms, into a sealed file for the camera; None ends it."""
        self._tell(f"film {Path(states).resolve()}" if states is not None else "film")

    def renew(self, **settings: Any) -> None:
        """Switch the robot off and another on, as a fresh process would with these settings of `start_twin`.

        Those not given stay; the clock always does. Drivers and clocks of before must be closed.
        """
        self._tell(f"renew {json.dumps(settings)}")

    def rest(self) -> None:
        """Leave the experimenter's channel; the next command opens it again."""
        if self._hand is not None:
            self._hand.close()
            self._hand = None

    def close(self) -> None:
        self.rest()
        self._finalizer()

    def _tell(self, line: str) -> None:
        try:
            if self._hand is None:
                self._hand = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
                self._hand.settimeout(CHANNEL_S)
                self._hand.connect(self.channel)
            self._hand.sendall(line.encode() + b"\n")
            with self._hand.makefile("rb") as answers:  # one line for each that was sent
                reply = answers.readline()
        except OSError as error:
            raise RobotError(f"the twin does not answer: {error.strerror or error}") from None
        if not reply.endswith(b"\n"):
            raise RobotError("the twin is gone")
        word, _, rest = reply.decode().strip().partition(" ")
        if word == "error":
            raise RobotError(f"the twin refused {line.split()[0]!r}: {rest}")


def start_twin(arena: Mapping[str, Any], *, pose: Pose | None = None, **settings: Any) -> TwinProcess:
    """Start a twin in a process of its own; it ends when closed, or with this process.

    Arguments as of `realitygap.twin.server.Settings`; `unit` is needed.

    Raises:
        UsageError: a setting that the twin refuses.
    """
    where = None if pose is None else (pose.x, pose.y, pose.heading)
    order = asdict(Settings(arena=dict(arena), pose=where, **settings))
    process, line = launch("realitygap.twin.server", order, start_new_session=True)
    said = json.loads(line or b"{}")
    if "device" not in said:
        child.end(process, LEAVE_S)
        raise UsageError(f"the twin did not start: {said.get('error', 'its own message is above')}")
    return TwinProcess(process, said["device"], said["channel"])


def launch(module: str, order: Mapping[str, Any], **settings: Any) -> tuple[subprocess.Popen[bytes], bytes]:
    """Start a module as a process and hand it a line of JSON.

    Returns:
        The process, and the line that it answers: empty if it ended instead.

    Raises:
        RobotError: it takes nothing, or nothing is heard of it.
    """
    command = [sys.executable, "-m", module]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, **settings)
    said = b""
    try:
        with contextlib.suppress(BrokenPipeError):
            said = child.ask(process, json.dumps(order).encode() + b"\n", within_s=START_S, who=module)
    except BaseException:
        child.end(process, LEAVE_S)
        raise
    return process, said
