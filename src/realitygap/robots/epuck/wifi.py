"""An e-puck2's line over WiFi: the dialect's questions and commands, in packets over TCP.

A packet to the robot has 21 bytes: 0x80, what is asked for (bit 1: the sensors), settings (bit 2: the next
two numbers are step counters), speeds left and right in steps/s, LEDs, a loudspeaker; each is answered: a
byte that says of what kind, then its bytes. Numbers have 16 bits, the low byte first. Sources: GCtronic's
wiki and Asercom2.c, Webots' e-puck remote control.
"""

import socket
import struct
from collections.abc import Sequence

from realitygap.errors import LineError, UsageError
from realitygap.robots.epuck.protocol import EPUCK
from realitygap.robots.line.line import QUIET_S, Answer, Line, why_not_opened
from realitygap.robots.line.protocol import GarbledError, Request, answer

__all__ = ["PORT", "PacketLine"]

PORT = 1000
CONNECT_S = 5.0

SENSORS, EMPTY = 2, 3
SIZES = {1: 160 * 120 * 2, SENSORS: 104, EMPTY: 0}
"""Bytes that follow the first one of an answer: a picture, the sensors, nothing."""
WHERE = {"N": ("<8H", 37), "O": ("<8H", 53), "Q": ("<2h", 79)}
"""Where the answers to questions stand among the sensors' bytes."""
SET_STEPS = 4
PALE = 15
"""Of 100: brightness of each colour of an LED that is on."""


class PacketLine(Line):
    """One robot's line, at HOST or HOST:PORT.

    Raises:
        UsageError: nothing there takes the connection.
    """

    def __init__(self, device: str) -> None:
        self._speeds, self._lights, self._broken = (0, 0), bytearray(14), False
        super().__init__(device, EPUCK, baud=None)

    def _opened(self) -> socket.socket:
        host, _, port = self.device.partition(":")
        try:
            if port and not (port.isdecimal() and 0 < int(port) < 2**16):  # glibc takes the lower 16 bits
                told = " (an e-puck2 has no IPv6)" if ":" in port else f", got {port!r}"
                raise ValueError(f"expected a port from 1 to 65535{told}")
            made = socket.create_connection((host, int(port or PORT)), CONNECT_S)
        except (OSError, ValueError) as error:
            raise UsageError(
                f"the e-puck2 at {self.device!r} cannot be reached: {why_not_opened(error)}; check that it "
                "is switched on with its WiFi firmware and its selector at 15, its address (HOST or "
                "HOST:PORT), and that this computer is on the same network"
            ) from None
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        made.setblocking(False)
        return made

    @property
    def halt(self) -> bytes:
        """A packet whose speeds are 0."""
        return self._packet((0, 0))

    def wake(self) -> list[str]:
        """It has no banner."""
        return []

    def hear(self, within_s: float) -> str | None:
        """The answer to a packet that asked for nothing; no text is in it."""
        try:
            self._answered(EMPTY, self.clock.now() + within_s)
        except GarbledError:
            self.forget()
        return None

    def tell(self, data: bytes) -> None:
        """Send bytes; where the connection broke, by a new one, to a robot that is to stand.

        Raises:
            LineError: the line is lost; or it is to drive, by a connection that the guard does not have.
        """
        stands = data == self.halt or not any(self._speeds)
        if self._broken and not stands:
            raise LineError(f"the line is lost: the connection to {self.device} broke")
        try:
            super().tell(data)
        except LineError:
            if self._broken or not stands:
                raise
            self._broken = True
            self.close()
            try:
                self._port = self._opened()
            except UsageError as error:
                raise LineError(str(error)) from None
            super().tell(data)

    def _packet(self, numbers: tuple[int, ...], *, asks: int = 0, settings: int = 0) -> bytes:
        return struct.pack("<3B2h14s", 0x80, asks, settings, *numbers, bytes(self._lights))

    def _exchange(self, requests: Sequence[Request]) -> list[Answer]:
        self.forget()
        until = self.clock.now() + self.dialect.patience_s
        for letter, numbers in requests:
            if letter == "D":
                self._speeds = numbers[0], numbers[1]
            elif letter == "L":
                self._light(*numbers)
            elif letter == "P":
                self.tell(self._packet(numbers, settings=SET_STEPS))
                self._answered(EMPTY, until)
        wanted = SENSORS if any(request.letter in WHERE for request in requests) else EMPTY
        self.tell(self._packet(self._speeds, asks=SENSORS if wanted == SENSORS else 0))
        packet = self._answered(wanted, until)
        return [self._understood(request, packet) for request in requests]

    def _understood(self, request: Request, packet: bytes) -> Answer:
        values: tuple[object, ...] = ()
        if request.letter in WHERE:
            form, where = WHERE[request.letter]
            values = struct.unpack_from(form, packet, where)
        elif request.letter == self.dialect.version:
            values = ("Version for WiFi",)
        return self.dialect.parse_answer(answer(request.letter, *values).decode("ascii").strip(), request)

    def _answered(self, wanted: int, until: float) -> bytes:
        """What follows the first byte of the next answer of this kind.

        Raises:
            GarbledError: none by then, or a byte that begins no answer.
        """
        while True:
            if self._heard:
                kind = self._heard[0]
                if kind not in SIZES:
                    self.odd = repr(bytes(self._heard[:20]))
                    raise GarbledError(f"{self.odd} is not an e-puck2's packet")
                end = 1 + SIZES[kind]
                if len(self._heard) >= end:
                    packet, self._heard = self._heard[1:end], self._heard[end:]
                    if kind == wanted:
                        return packet
                    continue
            heard = self._read(until, 0)
            if not heard and self.clock.now() >= until:
                raise GarbledError("no answer to a packet")
            self._heard += heard

    def _resynchronise(self) -> None:
        """Drop what comes in, until it is quiet: an answer that is late would be taken for the next one's."""
        until = self.clock.now() + self.dialect.patience_s
        while self.clock.now() < until and self._read(self.clock.now() + QUIET_S, 0):
            pass
        self.forget()

    def _light(self, number: int, on: int) -> None:
        """The even ones are red, a bit each; the others have three colours, a byte each."""
        if number % 2 == 0:
            self._lights[0] = self._lights[0] & ~(1 << number // 2) | on << number // 2
        else:
            self._lights[1 + 3 * (number // 2) : 4 + 3 * (number // 2)] = bytes([PALE * on] * 3)
