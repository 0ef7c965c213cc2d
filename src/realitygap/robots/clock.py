"""Time for a body: the real clock sleeps, a stepped one advances a simulation. A twin's line is its own."""

import math
import time
from collections.abc import Callable
from typing import Protocol

__all__ = ["Clock", "RealClock", "SteppedClock"]

ROUNDING_S = 1e-6
"""A time this little before a step's counts as that step's."""


class Clock(Protocol):
    """What a loop needs of a clock, s."""

    waits: bool
    """Whether it stands still while this process does."""

    def now(self) -> float:
        """The time; only differences mean anything."""

    def sleep_until(self, time_s: float) -> None:
        """Let time pass."""


class RealClock:
    """The computer's own."""

    waits = False

    def now(self) -> float:
        """Seconds since some moment."""
        return time.monotonic()

    def sleep_until(self, time_s: float) -> None:
        """Sleep."""
        left = time_s - time.monotonic()
        if left > 0:
            time.sleep(left)


class SteppedClock:
    """A simulated body's time, s, in which nothing is ever late: it advances by whole steps.

    Args:
        step: advances the simulation by one step.
        period_s: how long that is.
    """

    waits = True

    def __init__(self, step: Callable[[], None], period_s: float) -> None:
        self._step, self._period_s = step, period_s
        self._now = 0.0
        self._begun = 0.0
        self._steps = 0

    def now(self) -> float:
        """Seconds since the body was made."""
        return self._now

    def sleep_until(self, time_s: float) -> None:
        """Advance the simulation by the steps that are due."""
        self._now = max(self._now, time_s)
        due = math.floor((self._now - self._begun + ROUNDING_S) / self._period_s)
        while self._steps < due:
            self._steps += 1
            self._step()

    def begin_step(self) -> None:
        """The robot has been set down: its steps are counted from now on."""
        self._begun, self._steps = self._now, 0
