"""A Khepera: what it can be asked and told, and how it is made to stand whatever happens."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import NamedTuple, cast

from realitygap.errors import LineError, RealityGapError, RobotError
from realitygap.robots.clock import LineClock
from realitygap.robots.guard import Guard
from realitygap.robots.khepera.line import GIVE_UP_S, Answer, Line, nothing
from realitygap.robots.khepera.protocol import BAUD_RATES, Request, request
from realitygap.values import Closing

__all__ = ["Khepera", "Versions"]

BANNER_S = 0.25
"""How long a robot that has just been reset may take for its two lines."""

STOP_S, STOP_TRIES = 1.4, (2, 4)
"""The robot is told to stand for so long, and at least and at most so often."""

STANDS = 2
"""Measured speeds up to this, pulses per 10 ms, are a robot that stands."""

STAND_S = 0.5
"""Time that the wheels may take to come to rest."""

ANSWER_S = 0.1

STOP = request("D", 0, 0)


class Versions(NamedTuple):
    """Of the robot's bios and of its serial protocol."""

    bios: str
    protocol: str


class Khepera(Closing):
    """The driver. Use `Khepera.connect`; as a context it stops the robot and closes the line."""

    def __init__(self, line: Line, versions: Versions, banner: Sequence[str]) -> None:
        self.line = line
        self.versions = versions
        self.banner = tuple(banner)
        self._guard = None if line.clock.waits else Guard(line.fileno(), b"\n" + STOP.data)
        if self._guard is not None:
            line.before = self._guard.beat

    @classmethod
    def connect(
        cls,
        port: str,
        *,
        baud: int | None = 38400,
        clock: LineClock | None = None,
        give_up_s: float = GIVE_UP_S,
    ) -> Khepera:
        """Open a port and wake the robot; `baud=None` tries the robot's five rates.

        `give_up_s` is when a question is given up that was not answered.

        Args:
            port: its device.
            baud: rate, bits a second; None: try all five.
            clock: the line's; None: the computer's.
            give_up_s: when an unanswered question is given up.

        Raises:
            UsageError: the port cannot be opened.
            LineError: nobody answers: says what to check.
        """
        rates = (38400, 9600, 19200, 57600, 115200) if baud is None else (baud,)
        for rate in rates:
            line = Line(port, baud=rate, clock=clock, give_up_s=give_up_s)
            try:
                banner = _wake(line)
                return cls(line, Versions(*cast("list[str]", _answer(line, "B"))), banner)
            except RobotError:
                line.close()
        tried = f"{rates[0]} baud" if baud else "any of its rates"
        raise LineError(
            f"no Khepera answers on {port} at {tried}; check that it is switched on, its cable, and its "
            f"jumper ({', '.join(map(str, BAUD_RATES))} baud; 9600 from the factory)"
        )

    @property
    def baud(self) -> int:
        """Of the line."""
        return self.line.baud

    @property
    def clock(self) -> LineClock:
        """Of the line."""
        return self.line.clock

    def ask(self, *requests: Request) -> list[Answer]:
        """The answers to any commands, asked together."""
        return self.line.ask(*requests)

    def proximity(self) -> tuple[int, ...]:
        """Eight proximity readings, counts."""
        return self._read("N")

    def ambient(self) -> tuple[int, ...]:
        """Eight ambient light readings, counts: the brighter, the lower."""
        return self._read("O")

    def command(self, left: int, right: int) -> None:
        """Wheel speeds, Khepera units (pulses per 10 ms)."""
        self.line.ask(request("D", left, right))

    def speeds(self) -> tuple[int, int]:
        """Measured wheel speeds, Khepera units."""
        left, right = self._read("E")
        return left, right

    def counters(self) -> tuple[int, int]:
        """Position counters, pulses."""
        left, right = self._read("H")
        return left, right

    def set_counters(self, left: int = 0, right: int = 0) -> None:
        """Set the position counters, pulses."""
        self.line.ask(request("G", left, right))

    def led(self, number: int, on: bool) -> None:
        """Switch LED 0 (at the side) or 1 (in front)."""
        again = 3
        while True:
            try:
                self.line.ask(request("L", number, int(on)))
                return
            except LineError:  # the line does not repeat L: 2 would change it twice; 0 and 1 would not
                again -= 1
                if not again:
                    raise

    def watch(self) -> None:
        """Until the next `stop` the guard stops the robot if nothing is said on the line for half a second.

        Whoever speaks next is told so by a `FrozenError`. Under a clock that waits nothing is needed.
        """
        if self._guard is not None:
            self._guard.watch()

    def stop(self) -> None:
        """Make the robot stand, and see that it does.

        The command is sent before anything else is heard or asked, again and again if need be.

        Raises:
            LineError: the robot did not confirm: it may still be moving.
        """
        failure: RealityGapError | None = None
        until, tries, (least, most) = self.clock.now() + STOP_S, 0, STOP_TRIES
        while tries < least or (tries < most and self.clock.now() < until):
            tries += 1
            try:
                self.line.tell(b"\n" + STOP.data)
                self.line.hear(ANSWER_S)  # its answer, so that it is not taken for the next one's
                self.line.ask(STOP, give_up_s=self.line.give_up_s / 2)
                if self._stands():
                    self._rest()
                    return
                failure = RobotError("its wheels turn on")
            except RobotError as error:
                failure = error
        raise LineError(
            f"the robot did not confirm that it stands ({failure}); it may still be moving: "
            f"lift it or switch it off"
        )

    def close(self) -> None:
        """Stop, then close the line and the guard, in any case."""
        try:
            self.stop()
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close the line and the guard without a word to the robot."""
        self.line.before = nothing
        self.line.close()
        if self._guard is not None:
            self._guard.release()
            self._guard = None

    def _read(self, letter: str, *arguments: int) -> tuple[int, ...]:
        return cast("tuple[int, ...]", self.line.ask(request(letter, *arguments))[0])

    def _rest(self) -> None:
        if self._guard is not None:
            self._guard.rest()

    def _stands(self) -> bool:
        until = self.clock.now() + STAND_S
        while self.clock.now() < until:
            if max(map(abs, self.speeds())) <= STANDS:
                return True
            self.clock.sleep_until(self.clock.now() + 0.02)
        return False


def _answer(line: Line, letter: str) -> Answer:
    return line.ask(request(letter))[0]


def _wake(line: Line) -> list[str]:
    """Send a blank line, and hear the banner of a robot that has just been reset."""
    banner: list[str] = []
    with contextlib.suppress(LineError):
        line.tell(b"\n")
    while len(banner) < 2 and (text := line.hear(BANNER_S)) is not None:
        banner.append(text)
    return banner
