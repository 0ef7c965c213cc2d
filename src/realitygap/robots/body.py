"""A body that a controller drives: simulated, twin or real, all alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol, cast

import numpy as np

from realitygap.robots.budget import KINDS, step_budget
from realitygap.robots.khepera.driver import Khepera
from realitygap.robots.khepera.protocol import request
from realitygap.values import Command, Pose, Readings

__all__ = ["Body", "Odometry", "SerialBody"]


class Odometry(NamedTuple):
    """What the wheels say: counters in pulses, measured speeds in Khepera units; None: not asked."""

    counters: tuple[int, int] | None = None
    speeds: tuple[int, int] | None = None


class Body(Protocol):
    """Sensors and wheels, wherever they are."""

    @property
    def odometry(self) -> Odometry:
        """As read with the last `sense`."""

    def reset(self, pose: Pose | None = None) -> None:
        """Stand, counters at zero, at `pose` (None: where it is)."""

    def sense(self) -> Readings:
        """What the sensors read now, counts; empty for a kind that is not fed."""

    def act(self, command: Command) -> None:
        """Wheel speeds from now on, Khepera units."""

    def stop(self) -> None:
        """Stand, and be sure of it."""

    def close(self) -> None:
        """Stand, and let go of the body."""


class SerialBody:
    """A Khepera, or a twin, on its serial line.

    From `act` to `stop` something has to be asked or told twice a second, or the guard stops the robot.

    Args:
        khepera: the driver; `close` closes it.
        kinds: the sensors that are read at each step: "proximity", "ambient" or both.
        carry: the experimenter's hand, which brings the robot to a pose; without it `reset` takes
            the robot where it stands.

    Raises:
        BaudError: the line is too slow for these sensors in a loop of 100 ms.
    """

    def __init__(
        self,
        khepera: Khepera,
        *,
        kinds: tuple[str, ...] = ("proximity",),
        carry: Callable[[Pose], None] | None = None,
    ) -> None:
        self.khepera = khepera
        self.kinds = tuple(kind for kind in KINDS if kind in kinds)
        self.budget = step_budget(tuple(kinds), khepera.baud)
        self._carry = carry
        self._odometry = Odometry()

    @property
    def odometry(self) -> Odometry:
        """As read with the last `sense`; what a slow line has no room for is None."""
        return self._odometry

    def reset(self, pose: Pose | None = None) -> None:
        """Stand, be carried to `pose`, counters at zero."""
        self.khepera.stop()
        if pose is not None and self._carry is not None:
            self.khepera.clock.settle()
            self._carry(pose)
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
        """Wheel speeds from now on, Khepera units."""
        self.khepera.watch()
        self.khepera.ask(request("D", command.left, command.right))

    def stop(self) -> None:
        """Stand, and be sure of it."""
        self.khepera.stop()

    def close(self) -> None:
        """Stand, and close the line."""
        self.khepera.close()
