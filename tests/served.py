"""A twin served in real time by a process of its own; its body may be any class with the twin's interface.

python -m tests.served                      # settings as JSON on stdin, device and channel on stdout
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

from realitygap.errors import RobotError
from realitygap.twin.firmware import Firmware
from realitygap.twin.serve import Server
from realitygap.values import Pose

ROOT = Path(__file__).parents[1]
TWIN = "realitygap.twin.body:TwinBody"


class Served:
    """A running twin: its serial device, and the experimenter's hand. As a context it is ended."""

    def __init__(
        self, arena: dict[str, Any], *, baud: int = 38400, body: str = TWIN, **settings: Any
    ) -> None:
        order = {
            "arena": arena,
            "baud": baud,
            "body": body,
            "unit": 1,
            "noise": 1.0,
            "seed": 0,
            **settings,
        }
        paths = [str(ROOT), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.served"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps(order).encode() + b"\n")
        self._process.stdin.flush()
        self.pid = self._process.pid
        self.device, self.channel = json.loads(self._process.stdout.readline())

    def __enter__(self) -> Served:
        return self

    def __exit__(self, *error: object) -> None:
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()
        self._process.wait(20)

    def place(self, pose: Pose) -> None:
        """Put the robot down."""
        self._tell(f"place {pose.x!r} {pose.y!r} {pose.heading!r}")

    def film(self, states: Path | None) -> None:
        """Write where it is; None ends it."""
        self._tell("film" if states is None else f"film {states.resolve()}")

    def _tell(self, line: str) -> None:
        if (said := channel(self, line)[0]) != "ok":
            raise RobotError(f"the twin says {said!r}")


def channel(twin: Served, *lines: str) -> list[str]:
    """What the second channel answers."""
    with socket.socket(socket.AF_UNIX) as sock:
        sock.settimeout(60)
        sock.connect(twin.channel)
        with sock.makefile("rw") as file:
            answers = []
            for line in lines:
                file.write(line + "\n")
                file.flush()
                answers.append(file.readline().strip())
        return answers


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the driver's: it must stop the robot first
    order = json.loads(sys.stdin.buffer.readline())
    module, name = order.pop("body").split(":")
    baud, pose, arena = order.pop("baud"), order.pop("pose", None), order.pop("arena")
    body = getattr(importlib.import_module(module), name)(arena, **order)
    if pose is not None:
        body.place(*pose)
    with Server(Firmware(body, baud=baud, name=f"twin unit {order['unit']}")) as server:
        os.write(1, json.dumps([server.device, server.channel]).encode() + b"\n")
        server.serve(0)


if __name__ == "__main__":
    main()
