"""A robot on a line as a body, and what a step of its loop can carry at a baud rate."""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Self, cast

import numpy as np

from realitygap.errors import BaudError, UsageError
from realitygap.robots.body import KINDS, Channel, Odometry
from realitygap.robots.clock import Clock
from realitygap.robots.line.driver import Driver
from realitygap.robots.line.protocol import Dialect, Request
from realitygap.values import Command, Pose, Readings

__all__ = ["Budget", "LineBody", "step_budget"]

LED_S = 0.2

STEP_MS = 100.0
"""Length of one step."""

_READS = {"proximity": Request("N"), "ambient": Request("O")}


class Budget(NamedTuple):
    """What is asked at each step, and the time that it and the speed command take at most, ms."""

    reads: tuple[Request, ...]
    ms: float


def step_budget(dialect: Dialect, kinds: tuple[str, ...], baud: int | None, *, turns: bool = True) -> Budget:
    """The commands of one step: the sensors, then (if `turns`) counters and measured speeds where they fit.

    Without sensors it is the counters alone: one question, which takes a body no further in its time.
    Times are the worst case: command and answer one after the other, every number at its longest.

    Args:
        dialect: the line's.
        kinds: of sensors.
        baud: the line's; None: one that takes no time, as over a network.
        turns: whether counters and speeds are requested.

    Raises:
        BaudError: sensors and speed command alone take longer than a step; shows the arithmetic.
        UsageError: an unknown kind, or none.
    """
    if not (kinds or turns) or not set(kinds) <= set(KINDS):
        raise UsageError(f"a robot's sensors are {' and '.join(KINDS)}; got {list(kinds)}")
    fastest = Request("D", (-dialect.top, -dialect.top))  # the longest of the commands that a network gives

    def ms(rate: int | None, *asked: Request) -> float:
        return dialect.wire_ms(dialect.characters(*asked, fastest), rate)

    read = [kind for kind in KINDS if kind in kinds]
    reads = tuple(_READS[kind] for kind in read)
    if ms(baud, *reads) > STEP_MS:
        count = dialect.characters(*reads, fastest)
        enough = next(rate for rate in dialect.rates if ms(rate, *reads) <= STEP_MS)
        one = ", or read one kind of sensors" if len(reads) > 1 and ms(baud, reads[0]) <= STEP_MS else ""
        raise BaudError(
            f"{baud} baud cannot carry a {STEP_MS:g} ms loop with {' and '.join(read)} readings: "
            f"{' + '.join(one.letter for one in reads)} + D are up to {count} characters of "
            f"{dialect.bits} bits, {count} × {dialect.bits} / {baud} s = {ms(baud, *reads):.0f} ms; "
            f"set the robot to {enough} baud or more{one}"
        )
    tells = (dialect.counters, *dialect.measured) if kinds else (dialect.counters,)
    for tell in map(Request, tells if turns else ()):
        if ms(baud, *reads, tell) <= STEP_MS:
            reads = (*reads, tell)
    return Budget(reads, ms(baud, *reads))


class LineBody:
    """From `act` to `stop` something must be asked or told twice a second, or the guard stops the robot.

    Args:
        driver: the robot's; `close` closes it.
        kinds: the sensors that are read at each step: "proximity", "ambient" or both.
        carry: the experimenter's hand, which brings the robot to a pose; without it `reset` takes
            the robot where it stands.

    Raises:
        BaudError: the line is too slow for these sensors in a loop of 100 ms.
    """

    dialect: ClassVar[Dialect]
    units: ClassVar[str]
    """Of its commands and speeds."""
    pulses_per_mm: ClassVar[float]
    channels: ClassVar[tuple[Channel, ...]]
    """Of each kind, whichever of them are read."""
    period_s = STEP_MS / 1000.0
    counts_turns = True

    def __init__(
        self,
        driver: Driver,
        *,
        kinds: tuple[str, ...] = ("proximity",),
        carry: Callable[[Pose], None] | None = None,
    ) -> None:
        self.driver, self._carry, self.baud = driver, carry, driver.line.baud
        self.attend(kinds, turns=True)

    @property
    def clock(self) -> Clock:
        return self.driver.clock

    @property
    def odometry(self) -> Odometry:
        """As read with the last `sense`; what a slow line has no room for is None."""
        return self._odometry

    @property
    def facts(self) -> dict[str, Any]:
        """What a recording says of it."""
        port = {"robot": self.dialect.robot, "port": self.driver.line.device}
        return {"units": self.units, **port, **self.driver.versions}

    @property
    def wire_ms(self) -> float | None:
        """The time that a step takes on a serial line, at most."""
        return self.budget.ms if self.baud else None

    def attend(self, kinds: tuple[str, ...], turns: bool) -> None:
        """Read these kinds of sensors from now on, and what of counters and speeds a step has room for."""
        self.budget = step_budget(self.dialect, kinds, self.baud, turns=turns)
        self.kinds = tuple(kind for kind in KINDS if kind in kinds)
        self._odometry = Odometry()

    def reset(self, pose: Pose | None = None) -> None:
        """Stop, be carried to `pose`, counters at zero."""
        self._stand()
        if pose is not None and self._carry is not None:
            self._carry(pose)
        self._zero()

    def _stand(self) -> None:
        self.driver.stop()

    def _zero(self) -> None:
        self.driver.set_counters(0, 0)
        self._odometry = Odometry()

    def sense(self) -> Readings:
        """All of a step's questions, sent together."""
        answers = self.driver.line.ask(*self.budget.reads)
        said = {read.letter: answer for read, answer in zip(self.budget.reads, answers, strict=True)}
        pairs = cast("dict[str, tuple[int, int]]", said)
        self._odometry = Odometry(pairs.get(self.dialect.counters), pairs.get("E"))
        return Readings(
            proximity=np.array(said.get("N", ()), np.float64), ambient=np.array(said.get("O", ()), np.float64)
        )

    def act(self, command: Command) -> None:
        """Wheel speeds from now on, in the robot's own units."""
        self.driver.watch()
        self.driver.command(command.left, command.right)

    def stop(self) -> None:
        """Stop, and make sure of it."""
        self.driver.stop()

    def close(self) -> None:
        self.driver.close()

    def inspect(self) -> dict[str, Any]:
        """Switch its LEDs on and off, and count the requests repeated so far."""
        for on in (True, False):
            for number in range(self.dialect.leds):
                self.driver.led(number, on)
            self.clock.sleep_until(self.clock.now() + LED_S)
        return {"leds": "answered", "faults": self.driver.line.faults}

    def abandon(self) -> None:
        """Close the line without a word to the robot."""
        self.driver.abandon()

    @classmethod
    def standing(cls, connect: Callable[[], Driver], kinds: tuple[str, ...]) -> Self:
        """The body of a robot that is connected now and told to stop."""
        driver = connect()
        try:
            driver.stop()
            return cls(driver, kinds=kinds)
        except BaseException:
            driver.abandon()  # it was told to stand first
            raise
