"""A line between driver and robot that loses, doubles, garbles and delays bytes."""

from __future__ import annotations

import os
import pty
import random
import select
import threading
import time
import tty
from dataclasses import dataclass
from types import TracebackType


@dataclass(frozen=True, kw_only=True)
class Faults:
    """Probabilities for each byte (lost, doubled, garbled) and each piece (late), both ways."""

    lost: float = 0.0
    doubled: float = 0.0
    garbled: float = 0.0
    late: float = 0.0
    late_s: float = 0.0
    seed: int = 0

    def spoil(self, data: bytes, rng: random.Random) -> bytes:
        """What comes of some bytes."""
        out = bytearray()
        for byte in data:
            draw = rng.random()
            if draw < self.lost:
                continue
            draw -= self.lost
            if draw < self.doubled:
                out += bytes((byte, byte))
                continue
            draw -= self.doubled
            out.append(rng.randrange(256) if draw < self.garbled else byte)
        return bytes(out)


class Pump:
    """Hands bytes on between a pseudo-terminal of its own, `device`, and a robot's.

    `asked` and `answered` are what went in at either end; `faults` may be changed while it runs.
    """

    def __init__(self, robot: str, faults: Faults) -> None:
        self.faults = faults
        self.asked = self.answered = b""
        self.silent = False
        self._random = random.Random(faults.seed)
        self._robot = os.open(robot, os.O_RDWR | os.O_NOCTTY)
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.device = os.ttyname(self._slave)
        self._wake, self._waker = os.pipe()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Pump:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.pull()
        os.close(self._robot)

    def pull(self) -> None:
        """Pull the plug: the driver's device is gone."""
        if self._thread.is_alive():
            os.write(self._waker, b".")
            self._thread.join()
            for fd in (self._master, self._slave, self._wake, self._waker):
                os.close(fd)

    def _run(self) -> None:
        while True:
            ready, _, _ = select.select([self._master, self._robot, self._wake], [], [])
            if self._wake in ready:
                return
            if self._master in ready:
                data = os.read(self._master, 4096)
                self.asked += data
                self._hand_on(self._robot, data)
            if self._robot in ready:
                data = os.read(self._robot, 4096)
                self.answered += data
                self._hand_on(self._master, data)

    def _hand_on(self, fd: int, data: bytes) -> None:
        if self.silent:
            return
        if self._random.random() < self.faults.late:
            time.sleep(self.faults.late_s)
        spoilt = self.faults.spoil(data, self._random)
        if spoilt:
            os.write(fd, spoilt)
