"""A robot on a line: what it can be asked and told, and how it is stopped whatever happens."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from typing import ClassVar, Self, cast

from realitygap.errors import LineError, RealityGapError, RobotError
from realitygap.robots.clock import Clock
from realitygap.robots.guard import Guard
from realitygap.robots.line.line import GIVE_UP_S, STOP, Line, nothing
from realitygap.robots.line.protocol import Dialect, Request
from realitygap.values import Closing

__all__ = ["Driver"]

STOP_S, STOP_TRIES = 1.4, (2, 4)
"""The robot is told to stop for this long, at least and at most this often."""

STAND_S = 0.5
"""Time that the wheels may take to stop."""

ANSWER_S = 0.1
LOOK_S = 0.02


class Driver(Closing, ABC):
    """Use `connect`; as a context it stops the robot and closes the line."""

    dialect: ClassVar[Dialect]

    def __init__(self, line: Line, versions: Sequence[str], banner: Sequence[str]) -> None:
        self.line = line
        self.versions = dict(zip(self.dialect.facts, versions, strict=True))
        self.banner = tuple(banner)
        self._guard = Guard(None if line.clock.waits else line.fileno(), line.halt)
        line.before = self._guard.beat

    @classmethod
    def connect(
        cls,
        port: str,
        *,
        baud: int | None = None,
        clock: Clock | None = None,
        give_up_s: float = GIVE_UP_S,
    ) -> Self:
        """Open a port and wake the robot.

        Args:
            port: its device.
            baud: rate, bits a second; None: try all of the robot's.
            clock: the line's; None: the computer's.
            give_up_s: when a question that was not answered is given up.

        Raises:
            UsageError: the port cannot be opened.
            LineError: no robot answers, or another robot: says what to check.
        """
        usual, others = cls.dialect.usual, cls.dialect.rates
        rates = (usual, *(rate for rate in others if rate != usual)) if baud is None else (baud,)
        odd = ""
        for rate in rates:
            line = Line(port, cls.dialect, baud=rate, clock=clock, give_up_s=give_up_s)
            try:
                return cls.awake(line)
            except RobotError:
                line.close()
                odd = odd or (line.odd if line.odd.isascii() and line.odd.isprintable() else "")
        if odd:
            raise LineError(
                f"{port}: expected {cls.dialect.robot} to answer, got {odd[:80]!r}; "
                "give the address of the robot that is there"
            )
        tried = f"{rates[0]} baud" if baud else "any of its rates"
        raise LineError(f"no {cls.dialect.robot} answers on {port} at {tried}; {cls.dialect.check}")

    @classmethod
    def awake(cls, line: Line) -> Self:
        """The robot at the end of an open line, once it has identified itself.

        Raises:
            LineError: it does not.
        """
        banner = line.wake()
        return cls(line, cast("Sequence[str]", line.ask(Request(cls.dialect.version))[0]), banner)

    @property
    def clock(self) -> Clock:
        return self.line.clock

    def command(self, left: int, right: int) -> None:
        """Wheel speeds, the robot's own units."""
        self.line.ask(self.dialect.request("D", left, right))

    def speeds(self) -> tuple[int, int]:
        """Wheel speeds as the robot says them, its own units."""
        left, right = self.read("E")
        return left, right

    def counters(self) -> tuple[int, int]:
        """Position counters, pulses."""
        left, right = self.read(self.dialect.counters)
        return left, right

    def set_counters(self, left: int = 0, right: int = 0) -> None:
        """Set the position counters, pulses."""
        self.line.ask(self.dialect.request(self.dialect.set_counters, left, right))

    def led(self, number: int, on: bool) -> None:
        """Switch an LED."""
        request = self.dialect.request("L", number, int(on))
        for _ in range(2):  # the line does not repeat L: 2 would change it twice; 0 and 1 would not
            with suppress(LineError):
                self.line.ask(request)
                return
        self.line.ask(request)

    def watch(self) -> None:
        """Until the next `stop` the guard stops the robot if nothing is said on the line for half a second.

        The next command then raises a `FrozenError`. Under a clock that waits nothing is needed.
        """
        self._guard.watch()

    def stop(self) -> None:
        """Stop the robot, and check that it has stopped.

        The command is sent before anything else is heard or asked, repeatedly if needed.

        Raises:
            LineError: the robot did not confirm: it may still be moving.
        """
        failure: RealityGapError | None = None
        until, tries, (least, most) = self.clock.now() + STOP_S, 0, STOP_TRIES
        while tries < least or (tries < most and self.clock.now() < until):
            tries += 1
            try:
                self.line.tell(self.line.halt)
                self.line.hear(ANSWER_S)  # its answer, so that it is not taken for the next one's
                self.line.ask(STOP, give_up_s=self.line.give_up_s / 2)
                if self._stands():
                    self._guard.rest()
                    return
                failure = RobotError("its wheels still turn")
            except RobotError as error:
                failure = error
        raise LineError(
            f"the robot did not confirm that it stopped ({failure}); it may still be moving: "
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
        self._guard.release()

    def read(self, letter: str) -> tuple[int, ...]:
        """The numbers that answer a question, such as N: proximity, O: ambient light (counts)."""
        return cast("tuple[int, ...]", self.line.ask(self.dialect.request(letter))[0])

    def _stands(self) -> bool:
        until = self.clock.now() + STAND_S
        while self.clock.now() < until:
            if self.is_still():
                return True
            self.clock.sleep_until(self.clock.now() + LOOK_S)
        return False

    @abstractmethod
    def is_still(self) -> bool:
        """Whether its wheels are still, as far as it can tell."""
