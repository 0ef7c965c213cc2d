"""A Khepera, or a twin of one, as a body on its serial line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np

from realitygap.robots.body import KINDS, Channel, Odometry
from realitygap.robots.clock import LineClock, RealClock, VirtualClock
from realitygap.robots.khepera.budget import STEP_MS, step_budget
from realitygap.robots.khepera.driver import Khepera
from realitygap.robots.khepera.protocol import FULL, PULSES_PER_MM, SENSORS, request
from realitygap.values import Command, Pose, Readings

__all__ = ["KheperaBody", "opened"]

LED_S = 0.2

UNITS = "Khepera units"
"""Of its commands and speeds: pulses per 10 ms."""


class KheperaBody:
    """From `act` to `stop` something has to be asked or told twice a second, or the guard stops the robot.

    Args:
        khepera: the driver; `close` closes it.
        kinds: the sensors that are read at each step: "proximity", "ambient" or both.
        carry: the experimenter's hand, which brings the robot to a pose; without it `reset` takes
            the robot where it stands.

    Raises:
        BaudError: the line is too slow for these sensors in a loop of 100 ms.
    """

    period_s = STEP_MS / 1000.0
    counts_turns = True
    pulses_per_mm = PULSES_PER_MM

    def __init__(
        self,
        khepera: Khepera,
        *,
        kinds: tuple[str, ...] = ("proximity",),
        carry: Callable[[Pose], None] | None = None,
    ) -> None:
        self._take(khepera, carry)
        self.attend(kinds, turns=True)

    def _take(self, khepera: Khepera, carry: Callable[[Pose], None] | None) -> None:
        self.khepera, self._carry, self.baud = khepera, carry, khepera.baud

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Eight sensors of 10 bits of each kind, whichever of them are read."""
        return tuple(Channel(name=kind, sensors=SENSORS, high=FULL) for kind in KINDS)

    @property
    def clock(self) -> LineClock:
        """The line's."""
        return self.khepera.clock

    @property
    def odometry(self) -> Odometry:
        """As read with the last `sense`; what a slow line has no room for is None."""
        return self._odometry

    @property
    def facts(self) -> dict[str, Any]:
        """What a recording says of it."""
        return {
            "units": UNITS,
            "robot": "Khepera",
            "port": self.khepera.line.device,
            **self.khepera.versions._asdict(),
        }

    @property
    def wire_ms(self) -> float:
        """The time that a step takes on the line, at most."""
        return self.budget.ms

    def attend(self, kinds: tuple[str, ...], turns: bool) -> None:
        """Read these kinds of sensors from now on, and what of counters and speeds a step has room for."""
        self.budget = step_budget(kinds, self.baud, turns=turns)
        self.kinds = tuple(kind for kind in KINDS if kind in kinds)
        self._odometry = Odometry()

    def reset(self, pose: Pose | None = None) -> None:
        """Stand, be carried to `pose`, counters at zero."""
        self.khepera.stop()
        if pose is not None and self._carry is not None:
            self.clock.settle()
            self._carry(pose)
        self._zero()

    def _zero(self) -> None:
        self.khepera.set_counters(0, 0)
        self._odometry = Odometry()

    def sense(self) -> Readings:
        """All of a step's questions, sent together."""
        answers = self.khepera.ask(*self.budget.reads)
        said = {read.letter: answer for read, answer in zip(self.budget.reads, answers, strict=True)}
        pairs = cast("dict[str, tuple[int, int]]", said)
        self._odometry = Odometry(pairs.get("H"), pairs.get("E"))
        return Readings(
            proximity=np.array(said.get("N", ()), np.float64),
            ambient=np.array(said.get("O", ()), np.float64),
        )

    def act(self, command: Command) -> None:
        """Wheel speeds from now on, pulses per 10 ms."""
        self.khepera.watch()
        self.khepera.ask(request("D", command.left, command.right))

    def stop(self) -> None:
        """Stand, and be sure of it."""
        self.khepera.stop()

    def close(self) -> None:
        """Stand, and close the line."""
        self.khepera.close()
        self.clock.close()

    def inspect(self) -> dict[str, Any]:
        """Switch both LEDs on and off; and count what had to be asked for again so far."""
        for on in (True, False):
            for number in (0, 1):
                self.khepera.led(number, on)
            self.clock.sleep_until(self.clock.now() + LED_S)
        return {"leds": "answered", "faults": self.khepera.line.faults}

    def abandon(self) -> None:
        """Close the line without a word to the robot."""
        self.khepera.abandon()


def opened(
    port: str,
    *,
    baud: int | None = 38400,
    kinds: tuple[str, ...] = ("proximity",),
    clock_channel: str | None = None,
    **_: Any,
) -> KheperaBody:
    """The Khepera on a serial port, told to stand; with a clock channel a twin in virtual time.

    Raises:
        UsageError: the port cannot be opened, or is too slow for these sensors.
        LineError: nobody answers.
    """
    clock = VirtualClock(clock_channel) if clock_channel else RealClock()
    try:
        khepera = Khepera.connect(port, baud=baud, clock=clock)
    except BaseException:
        clock.close()
        raise
    try:
        khepera.stop()
        return KheperaBody(khepera, kinds=kinds)
    except BaseException:
        khepera.abandon()  # it was told to stand first
        raise
