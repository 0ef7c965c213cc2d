"""An e-puck or e-puck2 as a body: on a serial line, an e-puck2 over WiFi too.

Its protocol is that of the firmware "advanced sercom", which the e-puck2 speaks too. Sources: Asercom.c of
GCtronic, EPFL and the York Robotics Laboratory, Asercom2.c of the e-puck2.

Over WiFi the protocol's questions and commands go in packets over TCP. A packet to the robot has 21 bytes:
0x80, what is asked for (bit 1: the sensors), settings (bit 2: the next two numbers are step counters), speeds
left and right in steps/s, LEDs, a loudspeaker; each is answered: a byte that says of what kind, then its
bytes. Numbers have 16 bits, the low byte first. Sources: GCtronic's wiki and Asercom2.c, Webots' e-puck
remote control.
"""

import contextlib
import re
import socket
import struct
from collections.abc import Sequence
from types import MappingProxyType
from typing import Any

from realitygap.errors import LineError, RobotError, UsageError
from realitygap.robots.body import KINDS, Channel, Odometry
from realitygap.robots.line import (
    QUIET_S,
    Answer,
    CommandSpec,
    GarbledError,
    IntRange,
    Line,
    LineBody,
    Protocol,
    Request,
)
from realitygap.robots.wire import LOOK_S, why_not_opened
from realitygap.values import Readings

__all__ = [
    "EPUCK", "FULL", "PORT", "PULSES_PER_MM", "SENSORS", "EpuckBody", "opened",
    "opened_second",
]  # fmt: skip

PULSES_PER_MM = 1000 / 128.0
"""1000 steps a turn of 128 mm (Enki); 125.7 by GCtronic's ROS driver, 129 by others: to be measured."""

SENSORS, FULL = 8, 4095
"""Sensors of each kind, clockwise from the front's right, and the highest count of 12 bits."""

_LIGHT = (IntRange(0, FULL),) * SENSORS
_STEPS = (IntRange(-(2**31), 2**31 - 1, 6),) * 2

COMMANDS = {
    "C": CommandSpec(meaning="read the selector", gives=(IntRange(0, 15),)),
    "D": CommandSpec(meaning="set the speed, steps per second", takes=(IntRange(-1000, 1000),) * 2),
    "E": CommandSpec(meaning="read the speed that was set", gives=(IntRange(-1000, 1000),) * 2),
    "L": CommandSpec(
        meaning="switch an LED: 0 off, 1 on, 2 change",
        takes=(IntRange(0, 7), IntRange(0, 2)),
        repeatable=False,
    ),
    "N": CommandSpec(meaning="read the proximity sensors", gives=_LIGHT),
    "O": CommandSpec(meaning="read the ambient light sensors", gives=_LIGHT),
    "P": CommandSpec(meaning="set the step counters", takes=_STEPS),
    "Q": CommandSpec(meaning="read the step counters", gives=_STEPS),
    "V": CommandSpec(
        meaning="read the firmware's version", gives=(IntRange(0, 0, 60),), text=r"Version[ -~]*"
    ),
}

EPUCK = Protocol(
    robot="e-puck",
    check="check that it is switched on, that its Bluetooth is bound to this port (rfcomm) or its cable, "
    "and its selector (3 for Bluetooth; 8 for an e-puck2's USB)",
    commands=MappingProxyType(COMMANDS),
    not_found="z,Command not found",
    protocol_error="",  # it has none: what is wrong in a command it reads as something else
    wake=b"\0\n",  # the NUL ends its binary mode, which a garbled byte may have begun
    barrier="C",
    version="V",
    facts=("firmware",),
    counters="Q",
    set_counters="P",
    measured="",  # E only tells what it was told
    rates=(115200,),
    usual=115200,
    stop_bits=1,
    patience_s=0.35,  # Bluetooth; of an e-puck2 over WiFi 99 % of all answers
    top=1000,
)

COUNTS = 2**16
"""Its counters begin again after this many steps: 8 m."""


class _Turns:
    """Counters that go on where the robot's begin again, and their speeds, from zero at a time (s)."""

    def __init__(self, then: float = 0.0) -> None:
        self._turned, self._then = (0, 0), then

    def odometry(self, counted: tuple[int, int], now: float) -> Odometry:
        pairs = zip(self._turned, counted, strict=True)
        left, right = ((count - old + COUNTS // 2) % COUNTS - COUNTS // 2 for old, count in pairs)
        self._turned = self._turned[0] + left, self._turned[1] + right
        passed, self._then = max(now - self._then, 1e-3), now
        return Odometry(self._turned, (round(left / passed), round(right / passed)))


class EpuckBody(LineBody):
    """Its commands are steps per second; its speeds are its counters' since the last `sense`."""

    protocol = EPUCK
    units = "e-puck units (steps/s)"
    pulses_per_mm = PULSES_PER_MM
    channels = tuple(Channel(name=kind, sensors=SENSORS, high=FULL) for kind in KINDS)
    leds = 8
    _turns = _Turns()

    @property
    def facts(self) -> dict[str, Any]:
        """What a recording says of it."""
        return {**super().facts, "base": "e-puck", "pulses_per_mm": PULSES_PER_MM}

    def sense(self) -> Readings:
        """All of a step's questions, sent together; counters continue when the robot's start again."""
        readings = super().sense()
        if self._odometry.counters is not None:
            self._odometry = self._turns.odometry(self._odometry.counters, self.clock.now())
        return readings

    def _zero(self) -> None:
        super()._zero()
        self._turns = _Turns(self.clock.now())

    def _is_still(self) -> bool:
        """By its step counters, which do not change."""
        before = self.read("Q")
        self.clock.sleep_until(self.clock.now() + LOOK_S)
        return self.read("Q") == before


PORT, CONNECT_S = 1000, 5.0
GREETING_S = 0.3
"""An e-puck2 does not speak first; another service at its address does, and is known by what it says."""

READINGS, EMPTY = 2, 3
SIZES = {1: 160 * 120 * 2, READINGS: 104, EMPTY: 0}
"""Bytes that follow the first one of an answer: a picture, the sensors, nothing."""
WHERE = {"N": ("<8H", 37), "O": ("<8H", 53), "Q": ("<2h", 79)}
"""Where the answers to questions stand among the sensors' bytes."""
SET_STEPS = 4
PALE = 15
"""Of 100: brightness of each colour of an LED that is on."""


class PacketLine(Line):
    """One robot's connection, at HOST or HOST:PORT: the protocol's questions, one packet out, one in.

    Raises:
        UsageError: nothing there takes the connection.
    """

    def __init__(self, device: str) -> None:
        self._speeds, self._lights, self._broken = (0, 0), bytearray(14), False
        super().__init__(device, EPUCK, baud=None)
        self.stop_message = self._packet((0, 0))

    def _open(self) -> None:
        host, _, port = self.device.partition(":")
        try:
            if port and not (port.isdecimal() and 0 < int(port) < 2**16):  # glibc takes the lower 16 bits
                note = " (an e-puck2 has no IPv6)" if ":" in port else f", got {port!r}"
                raise ValueError(f"expected a port from 1 to 65535{note}")
            self._port = socket.create_connection((host, int(port or PORT)), CONNECT_S)
        except (OSError, ValueError) as error:
            raise UsageError(
                f"the e-puck2 at {self.device!r} cannot be reached: {why_not_opened(error)}; check that it "
                "is switched on with its WiFi firmware and its selector at 15, its address (HOST or "
                "HOST:PORT), and that this computer is on the same network"
            ) from None
        self._port.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._port.setblocking(False)

    def wake(self) -> list[str]:
        """It has no banner; another service at its address has."""
        self.read_line(GREETING_S)
        self.ask(Request("Q"))
        return []

    def read_line(self, within_s: float) -> str | None:
        """Let the answer to a packet that asked for nothing pass; no text is in it."""
        with contextlib.suppress(GarbledError):
            self._answered(EMPTY, self.clock.now() + within_s)
        return None

    def write(self, data: bytes) -> None:
        """Send bytes; where the connection broke, by a new one, to a robot that is to stand.

        Raises:
            LineError: the line is lost; or it is to drive, by a connection that the guard does not have.
        """
        stands = data == self.stop_message or not any(self._speeds)
        if self._broken and not stands:
            raise LineError(f"the line is lost: the connection to {self.device} broke")
        try:
            super().write(data)
        except LineError:
            if self._broken or not stands:
                raise
            self._broken = True
            self.close()
            try:
                self._open()
            except UsageError as error:
                raise LineError(str(error)) from None
            super().write(data)

    def _packet(self, numbers: tuple[int, ...], *, asks: int = 0, settings: int = 0) -> bytes:
        return struct.pack("<3B2h14s", 0x80, asks, settings, *numbers, bytes(self._lights))

    def _exchange(self, requests: Sequence[Request]) -> list[Answer]:
        self.discard_input()
        until = self._until(self.protocol.patience_s)
        for letter, numbers in requests:
            if letter == "D":
                self._speeds = numbers[0], numbers[1]
            elif letter == "L":
                self._light(*numbers)
            elif letter == "P":
                self.write(self._packet(numbers, settings=SET_STEPS))
                self._answered(EMPTY, until)
        wanted = READINGS if any(request.letter in WHERE for request in requests) else EMPTY
        self.write(self._packet(self._speeds, asks=READINGS if wanted == READINGS else 0))
        packet = self._answered(wanted, until)
        if wanted == READINGS and max(struct.unpack_from("<16H", packet, WHERE["N"][1])) > FULL:
            raise GarbledError("counts beyond 12 bits")
        return [self._value(request.letter, packet) for request in requests]

    def _value(self, letter: str, packet: bytes) -> Answer:
        if letter in WHERE:
            form, where = WHERE[letter]
            return struct.unpack_from(form, packet, where)
        return ("Version for WiFi",) if letter == self.protocol.version else ()

    def _answered(self, wanted: int, until: float) -> bytes:
        """What follows the first byte of the next answer of this kind.

        Raises:
            GarbledError: none by then, or a byte that begins no answer.
        """
        while True:
            if self._input:
                kind = self._input[0]
                if kind not in SIZES:
                    self.odd = repr(bytes(self._input[:20]))
                    raise GarbledError(f"{self.odd} is not an e-puck2's packet")
                end = 1 + SIZES[kind]
                if len(self._input) >= end:
                    packet, self._input = self._input[1:end], self._input[end:]
                    if kind == wanted:
                        return packet
                    continue
            more = self._read(until, 0)
            if not more and self.clock.now() >= until:
                if not self._input:
                    raise GarbledError("no answer to a packet")
                got = f"expected {end - 1} bytes behind the first, got {len(self._input) - 1}"
                raise GarbledError(f"its packets are short: {got}; is its firmware another?")
            self._input += more

    def _resynchronise(self) -> None:
        """Drop what comes in, until it is quiet: an answer that is late would be taken for the next one's."""
        until = self._until(self.protocol.patience_s)
        while self.clock.now() < until and self._read(self.clock.now() + QUIET_S, 0):
            pass
        self.discard_input()

    def _light(self, number: int, on: int) -> None:
        """The even ones are red, a bit each; the others have three colours, a byte each."""
        if number % 2 == 0:
            self._lights[0] = self._lights[0] & ~(1 << number // 2) | on << number // 2
        else:
            self._lights[1 + 3 * (number // 2) : 4 + 3 * (number // 2)] = bytes([PALE * on] * 3)


def opened(port: str, *, kinds: tuple[str, ...] = ("proximity",), **_: Any) -> EpuckBody:
    """The e-puck or e-puck2 on a serial port, told to stop: errors as of `LineBody.connect`."""
    return EpuckBody.connect(port, kinds=kinds)


def opened_second(place: str, *, kinds: tuple[str, ...] = ("proximity",), **_: Any) -> EpuckBody:
    """The e-puck2 on a serial port (a path, or COM3), or over WiFi at HOST or HOST:PORT, told to stop.

    Raises:
        UsageError: the port cannot be opened, or nothing takes the connection.
        LineError: no robot answers, or not as an e-puck2 does.
    """
    if "/" in place or re.fullmatch(r"COM\d+", place):
        return opened(place, kinds=kinds)
    line = PacketLine(place)
    try:
        body = EpuckBody(line, kinds=kinds)
    except RobotError as error:
        line.close()
        why = f"it says {line.odd}" if line.odd else error
        raise LineError(f"no e-puck2 answers at {place}: {why}; is that another device?") from None
    return body.stopped()
