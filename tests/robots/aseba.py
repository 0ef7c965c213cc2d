"""A Thymio's end of the line, in memory and in a time of its own, with faults; and Aseba's own simulator."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from thymiodirect.message import Message

from realitygap.robots.thymio import AsebaLine, ThymioBody

VARIABLES = {
    "_id": 1, "event.args": 32, "_fwversion": 2, "prox.horizontal": 7, "motor.left.target": 1,
    "motor.right.target": 1, "motor.left.speed": 1, "motor.right.speed": 1, "acc": 3,
}  # fmt: skip
AT = dict(zip(VARIABLES, np.cumsum([0, *VARIABLES.values()]).tolist(), strict=False))
DELAY_S = 0.01


class Node:
    """A robot with number `node` whose wheels do at once what they are told; it is a line's clock, too.

    Attributes:
        fault: is given each message on its way, either way, and says what comes of it: a list of
            (seconds later, bytes).
        moves: is told (left, right) targets every 10 ms.
    """

    waits = True

    def __init__(self, node: int = 7) -> None:
        self.node, self.memory = node, np.zeros(64, np.int16)
        self.memory[AT["_fwversion"]] = 13
        self.fault: Callable[[bytes], list[tuple[float, bytes]]] = lambda data: [(0.0, data)]
        self.moves: Callable[[int, int], object] = lambda left, right: None
        self.line, self._theirs = socket.socketpair()
        self._theirs.setblocking(False)
        self._now, self._heard = 0.0, b""
        self._coming: deque[tuple[float, bytes]] = deque()

    def set(self, name: str, *values: int) -> None:
        self.memory[AT[name] : AT[name] + len(values)] = values

    def get(self, name: str) -> int:
        return int(self.memory[AT[name]])

    # its clock

    def now(self) -> float:
        return self._now

    def sleep_until(self, time_s: float) -> None:
        self.take()
        while self._now < time_s:
            self._now = min(time_s, self._now + 0.01)
            self.set("motor.left.speed", self.get("motor.left.target"))
            self.set("motor.right.speed", self.get("motor.right.target"))
            self.moves(self.get("motor.left.target"), self.get("motor.right.target"))

    def read(self, until: float) -> bytes:
        self.take()
        if self._coming and self._coming[0][0] <= until:
            due, data = self._coming.popleft()
            self.sleep_until(due)
            return data
        self.sleep_until(until)
        return b""

    def forget(self) -> None:
        self.take()
        self._coming = deque(one for one in self._coming if one[0] > self._now)

    def close(self) -> None:
        self._theirs.close()

    # what it does

    def take(self) -> None:
        try:
            data = self._theirs.recv(65536)
        except (BlockingIOError, OSError):
            return
        for _, heard in self.fault(data) if data else []:
            self._heard = heard
            while len(self._heard) >= 6:
                length, source, kind = np.frombuffer(self._heard[:6], "<u2").tolist()
                message = Message(kind, source, self._heard[6 : 6 + length])
                self._heard = self._heard[6 + length :]
                if kind >= 0xA000 and len(message.payload) == length:
                    self._answer(message)

    def _answer(self, message: Any) -> None:
        message.decode()
        if message.id == Message.ID_LIST_NODES:
            self._say(Message.ID_NODE_PRESENT, np.array([5], "<u2").tobytes())
        elif message.id == Message.ID_GET_NODE_DESCRIPTION:
            about = np.array([5, 1000, 32, 500, len(VARIABLES), 0, 0], "<u2").tobytes()
            self._say(Message.ID_DESCRIPTION, b"\x09thymio-II" + about)
            for name, size in VARIABLES.items():
                told = np.array([size], "<u2").tobytes() + bytes([len(name)]) + name.encode()
                self._say(Message.ID_NAMED_VARIABLE_DESCRIPTION, told)
        elif message.id == Message.ID_GET_VARIABLES and message.target_node_id == self.node:
            asked = self.memory[message.var_offset : message.var_offset + message.var_count]
            self._say(Message.ID_VARIABLES, np.array([message.var_offset], "<u2").tobytes() + asked.tobytes())
        elif message.id == Message.ID_SET_VARIABLES and message.target_node_id == self.node:
            values = np.array(message.var_val, np.uint16).astype(np.int16)
            self.memory[message.var_offset : message.var_offset + len(values)] = values

    def _say(self, kind: int, payload: bytes) -> None:
        for later, data in self.fault(Message(kind, self.node, payload).serialize()):
            self._coming.append((self._now + DELAY_S + later, data))
            self._coming = deque(sorted(self._coming, key=lambda one: one[0]))


class NodeLine(AsebaLine):
    """A line whose clock is its node: nothing is ever late."""

    clock: Node  # type: ignore[assignment]

    def _read(self, until: float, lines: int) -> bytes:
        return self.clock.read(until)

    def _write(self, data: bytes) -> None:
        super()._write(data)
        self.clock.take()

    def forget(self) -> None:
        self._heard = b""
        self.clock.forget()


@contextmanager
def at_a_node(node: Node) -> Iterator[ThymioBody]:
    """A body on a node's line."""
    with closing(node), closing(node.line):
        body = ThymioBody(NodeLine(node.line, "memory", node))  # type: ignore[arg-type]
        try:
            yield body
        finally:
            node.fault = lambda data: [(0.0, data)]
            body.close()


WORLD = """<!DOCTYPE aseba-playground>
<aseba-playground>
  <color name="wall" r="0.9" g="0.9" b="0.9"/>
  <world w="100" h="60" color="wall"/>
  <robot type="thymio2" port="{port}" name="Thymio" x="70" y="30" angle="0"/>
</aseba-playground>
"""


@contextmanager
def playground(folder: Path) -> Iterator[str]:
    """Aseba's simulator of a Thymio on the real protocol, in real time: its address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    world = folder / "world.playground"
    world.write_text(WORLD.format(port=port))
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    surroundings = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "HOME": str(folder)}
    program = shutil.which("asebaplayground")
    assert program is not None
    with subprocess.Popen([program, str(world)], env=surroundings, **quiet) as simulator:  # type: ignore[call-overload]
        try:
            _wait_for(port)
            yield f"127.0.0.1:{port}"
        finally:
            simulator.kill()


def _wait_for(port: int) -> None:
    """Until it listens; a connection that says nothing would make it wait for more."""
    until, listens = time.monotonic() + 30, f":{port:04X} 00000000:0000 0A"
    while listens not in Path("/proc/net/tcp").read_text():
        assert time.monotonic() < until
        time.sleep(0.1)
