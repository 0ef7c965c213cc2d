"""The emulated robot: commands in, answers out, each at its time on the wire.

Simulated time is in nanoseconds. A character takes 11 bits at the line's rate, in each direction on
a wire of its own; a command is carried out when its line end has arrived, its answer is put out
when the answer's last character has gone. Between events the body's physics runs on.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from pathlib import Path
from typing import IO, TYPE_CHECKING, NamedTuple

from realitygap.files import naming_errors
from realitygap.robots.khepera import KHEPERA
from realitygap.robots.line import RefusedError, answer
from realitygap.values import Pose

if TYPE_CHECKING:
    from realitygap.twin.body import TwinBody

__all__ = ["Firmware"]

BIOS, PROTOCOL = "5.02", "5.01"
"""As khepera.md's example of command B."""

SPEED, POSITION = 0, 1
"""Modes that command K reports."""

LONGEST = 256
"""Characters of a command that the robot keeps; more are no command."""

FILM_MS = 20
"""Where the robot is is written for the camera this often."""

NEVER = 1 << 62
MS = 1_000_000


class _Sent(NamedTuple):
    """Something on a wire, and when its last character arrives, ns."""

    at: int
    data: bytes


class Firmware:
    """What the robot's processor does with a line.

    Args:
        body: the robot.
        baud: the jumper's rate.
        name: what the first of the two lines after a reset says of it.
    """

    def __init__(self, body: TwinBody, *, baud: int, name: str) -> None:
        self.body = body
        self.baud = baud
        self.now = body.time_ms * MS
        self._bit = 1_000_000_000 * KHEPERA.bits
        self._inbox: deque[_Sent] = deque()
        self._outbox: deque[_Sent] = deque()
        self._half = b""
        self._in_free = self._out_free = self.now
        self._mode = SPEED
        self._target: tuple[int, ...] = (0, 0)
        self._film: IO[str] | None = None
        self._look_ms = 0
        self._put_out(f"Khepera, {name}: pseudo-reality, no robot\r\n".encode("ascii"))
        self._put_out(f"bios {BIOS}, serial protocol {PROTOCOL}\r\n".encode("ascii"))

    def receive(self, data: bytes) -> None:
        """Bytes that somebody writes to the line now."""
        start = max(self._in_free, self.now)
        self._in_free = start + self._wire(len(data))
        gone = 0
        for piece in data.replace(b"\r", b"\n").split(b"\n")[:-1]:
            gone += len(piece) + 1
            self._inbox.append(_Sent(start + self._wire(gone), self._half + piece))
            self._half = b""
        self._half = (self._half + data[gone:])[: LONGEST + 1]

    def run(self, until: int, lines: int = 0) -> bytes:
        """Let time pass up to `until`, or until `lines` lines have been put out (0: no limit).

        Returns:
            What was put out.
        """
        out, inbox, outbox = b"", self._inbox, self._outbox
        while True:
            arrives, ready = inbox[0].at if inbox else NEVER, outbox[0].at if outbox else NEVER
            at = min(arrives, ready)
            if at > until:
                break
            self.now = max(self.now, at)
            if arrives < ready:
                self._carry_out(inbox.popleft().data)
                continue
            out += outbox.popleft().data
            lines -= 1
            if lines == 0:
                return out
        self.now = max(self.now, until)
        self.catch_up()
        return out

    def catch_up(self) -> None:
        """Bring the body to the present."""
        end, leds = self.now // MS, self.body.leds
        while self._film is not None and self._look_ms <= end:
            self._advance_to(self._look_ms)
            x, y, heading = self.body.truth()
            where = f"{self._look_ms / 1000:.3f},{x:.6f},{y:.6f},{math.degrees(heading):.6f}"
            self._film.write(f"{where},{leds[0]},{leds[1]}\n")
            self._look_ms += FILM_MS
        self._advance_to(end)

    def _advance_to(self, time_ms: int) -> None:
        if time_ms > self.body.time_ms:
            self.body.advance(time_ms - self.body.time_ms)

    def place(self, pose: Pose) -> None:
        """The experimenter's hand."""
        self.catch_up()
        self.body.place(pose.x, pose.y, pose.heading)

    def film(self, states: Path | None) -> None:
        """Write where the robot is, now and every 20 ms, into a sealed file for the camera; None ends it."""
        self.catch_up()
        if self._film is not None:
            film, self._film = self._film, None
            with naming_errors(film.name):
                film.close()
        if states is not None:
            self._film, self._look_ms = states.open("w", encoding="utf-8"), self.body.time_ms
            self._film.write("t_s,x_cm,y_cm,heading_deg,led_0,led_1\n")
            self.catch_up()

    def next_event(self) -> int:
        """When something happens next, ns."""
        return min((box[0].at for box in (self._inbox, self._outbox) if box), default=NEVER)

    def _wire(self, characters: int) -> int:
        return characters * self._bit // self.baud

    def _put_out(self, data: bytes) -> None:
        self._out_free = max(self._out_free, self.now) + self._wire(len(data))
        self._outbox.append(_Sent(self._out_free, data))

    def _carry_out(self, line: bytes) -> None:
        """Answer one line; an empty one only wakes the robot."""
        if not line.strip():
            return
        self.catch_up()
        try:
            if len(line) > LONGEST:
                raise RefusedError(KHEPERA.not_found)
            asked = KHEPERA.parse_request(line.decode("ascii", "replace"))
            values = self._done(*asked)
        except RefusedError as refusal:
            self._put_out(str(refusal).encode("ascii") + b"\r\n")
            return
        self._put_out(answer(asked.letter, *values))

    def _done(self, letter: str, arguments: tuple[int, ...]) -> Iterable[object]:
        """Carry out a command; the values of its answer."""
        if letter in DRIVES:
            mode, name = DRIVES[letter]
            getattr(self.body, name)(*arguments)
            self._mode, self._target = mode, arguments
            return ()
        if letter in PLAIN:
            said = getattr(self.body, PLAIN[letter])(*arguments)
            return () if said is None else said if isinstance(said, list | tuple) else (said,)
        if letter == "L":
            number, action = arguments
            self.body.leds[number] = action if action < 2 else 1 - int(self.body.leds[number])
            return ()
        return self._motion() if letter == "K" else (BIOS, PROTOCOL)

    def _motion(self) -> tuple[int, ...]:
        """Command K: the error is target less present, in pulses or Khepera units."""
        there = self.body.pulses() if self._mode == POSITION else self.body.speeds()
        done = self.body.on_target()
        return tuple(
            int(value)
            for side in (0, 1)
            for value in (done[side], self._mode, self._target[side] - there[side])
        )


DRIVES = {"C": (POSITION, "set_position"), "D": (SPEED, "set_speed"), "P": (SPEED, "set_pwm")}
PLAIN = {
    "A": "set_speed_gains",
    "E": "speeds",
    "F": "set_position_gains",
    "G": "set_pulses",
    "H": "pulses",
    "I": "analog",
    "J": "set_profile",
    "N": "proximity",
    "O": "ambient",
}
"""What carries out a command: members of the body, in Khepera units, pulses and counts."""
