"""Emulated e-pucks: the protocol on a pseudo-terminal, the packets over TCP; Enki's e-puck is their body."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import socket
import struct
import threading
import time
import tty
from collections.abc import Callable

from realitygap.robots.body import Body
from realitygap.robots.enki import EnkiBody
from realitygap.robots.epuck import EPUCK
from realitygap.robots.line import RefusedError, answer
from realitygap.values import Command

DARK = 3900
"""What its sensors read of ambient light: Enki has none."""
COUNTS = 2**16


class Emulated:
    """A robot in a thread of its own, in real time, until `close`. `told` are all speeds that it was told."""

    def __init__(self, body: Body | None = None) -> None:
        self.body = body or EnkiBody("epuck", 0)
        self.told: list[tuple[int, int]] = []
        self.leds = [0] * 8
        self.version = "Version 2.1 August 2018 GCtronic"
        self._zero = [0, 0]
        self._start = time.monotonic() - self.body.clock.now()
        self._wake, self._waker = os.pipe()
        self.source = self.opened()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        os.write(self._waker, b".")
        self._thread.join()
        self.body.close()
        self.hang_up()
        for fd in (self._wake, self._waker):
            os.close(fd)

    def hang_up(self) -> None:
        raise NotImplementedError

    def stands(self) -> bool:
        """Whether the last that it was told is to stand, for a while already."""
        until = time.monotonic() + 15
        while time.monotonic() < until and (not self.told or self.told[-1] != (0, 0)):
            time.sleep(0.05)
        time.sleep(0.3)
        return self.told[-1] == (0, 0)

    def _run(self) -> None:
        while True:
            ready, _, _ = select.select([self.source, self._wake], [], [], 0.02)
            if self._wake in ready:
                return
            self.body.clock.sleep_until(time.monotonic() - self._start)
            if ready:
                self.serve()

    def opened(self) -> object:
        raise NotImplementedError

    def serve(self) -> None:
        raise NotImplementedError

    # what it can do

    def drive(self, left: int, right: int) -> None:
        self.told.append((left, right))
        self.body.act(Command(left=left, right=right))

    def proximity(self) -> list[int]:
        return [int(count) for count in self.body.sense().proximity]

    def steps(self) -> list[int]:
        """Its counters have 16 bits."""
        now = self.body.odometry.counters
        half = COUNTS // 2
        return [(n - z + half) % COUNTS - half for n, z in zip(now, self._zero, strict=True)]

    def set_steps(self, left: int, right: int) -> None:
        now = self.body.odometry.counters
        self._zero = [now[0] - left, now[1] - right]


class SerialEpuck(Emulated):
    """On a pseudo-terminal, `device`."""

    def opened(self) -> int:
        master, slave = pty.openpty()
        tty.setraw(slave)
        self.device, self._half = os.ttyname(slave), b""
        self._slave = slave
        return master

    def hang_up(self) -> None:
        os.close(self.source)
        os.close(self._slave)

    def serve(self) -> None:
        data = self._half + os.read(self.source, 4096).replace(b"\0", b"")
        *lines, self._half = data.replace(b"\r", b"\n").split(b"\n")
        for line in filter(None, lines):
            os.write(self.source, self.answered(line.decode("ascii", "replace")))

    def answered(self, line: str) -> bytes:
        actions: dict[str, Callable[..., object]] = {
            "C": lambda: [3],
            "D": self.drive,
            "E": lambda: self.told[-1] if self.told else (0, 0),
            "L": lambda n, on: self.leds.__setitem__(n, on),
            "N": self.proximity,
            "O": lambda: [DARK] * 8,
            "P": self.set_steps,
            "Q": self.steps,
            "V": lambda: [self.version],
        }
        try:
            asked = EPUCK.parse_request(line)
        except RefusedError as refusal:
            return f"{refusal}\r\n".encode()
        return answer(asked.letter, *(actions[asked.letter](*asked.arguments) or ()))


class Kheperalike(SerialEpuck):
    """A Khepera, as far as an e-puck's driver comes with it."""

    def answered(self, line: str) -> bytes:
        return b"Command not found\r\n"


class WifiEpuck(Emulated):
    """On a TCP port of this computer, `place`; `spoil` makes of an answer what is sent of it."""

    def opened(self) -> socket.socket:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.place = f"127.0.0.1:{self.listener.getsockname()[1]}"
        self.spoil: Callable[[bytes], bytes] = lambda packet: packet
        self._half = b""
        return self.listener

    def hang_up(self) -> None:
        self.listener.close()
        self.source.close()

    def serve(self) -> None:
        if self.source is self.listener:
            self.source = self.listener.accept()[0]
            return
        data = b""
        with contextlib.suppress(ConnectionError):
            data = self.source.recv(4096)
        if not data:
            self.source.close()
            self.source, self._half = self.listener, b""
            return
        self._half += data
        while len(self._half) >= 21:
            packet, self._half = self._half[:21], self._half[21:]
            with contextlib.suppress(ConnectionError):  # whoever asked is gone
                self.source.sendall(self.spoil(self.answered(packet)))

    def answered(self, packet: bytes) -> bytes:
        head, asks, settings, left, right, lights = struct.unpack("<3B2h14s", packet)
        assert head == 0x80 and settings in (0, 4)
        if settings:
            self.set_steps(left, right)
        else:
            self.drive(left, right)
        self.leds = [
            lights[0] >> k // 2 & 1 if k % 2 == 0 else lights[1 + 3 * (k // 2)] > 0 for k in range(8)
        ]
        if not asks:
            return b"\x03"
        sensors = bytearray(104)
        struct.pack_into("<8H", sensors, 37, *self.proximity())
        struct.pack_into("<8H", sensors, 53, *[DARK] * 8)
        struct.pack_into("<2h", sensors, 79, *self.steps())
        return b"\x02" + bytes(sensors)
