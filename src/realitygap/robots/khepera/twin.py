"""A unit of a twin as a body: switched on in any room, driven through its serial line in virtual time."""

import os
from collections.abc import Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from realitygap.errors import RobotError
from realitygap.robots.clock import VirtualClock
from realitygap.robots.khepera.body import Khepera, KheperaBody
from realitygap.twin.process import TwinProcess, start_twin
from realitygap.twin.server import BODY, STRANGER
from realitygap.values import Command, Pose

__all__ = ["TwinBody", "opened", "opened_stranger"]


class TwinBody(KheperaBody):
    """It has to `enter` a room first. One process serves it, and whoever is opened after it is closed.

    Args:
        unit: which robot of the population.
        noise: the scale of its whole noise.
        baud: of its line.
        kinds: as of `KheperaBody`.
        stranger: outside the family of laws that a calibration can fit.

    Raises:
        BaudError: the line is too slow for these sensors in a loop of 100 ms.
    """

    def __init__(
        self,
        unit: int,
        *,
        noise: float = 1.0,
        baud: int = 38400,
        kinds: tuple[str, ...] = ("proximity",),
        stranger: bool = False,
    ) -> None:
        self.unit, self.noise, self.baud = unit, noise, baud
        self._kind = ("stranger", STRANGER) if stranger else ("twin", BODY)
        self.twin: TwinProcess | None = None
        self._line = ExitStack()
        self._rests = True
        self.attend(kinds, turns=True)

    @property
    def facts(self) -> dict[str, Any]:
        """What a recording says of it."""
        return {
            "units": self.units,
            "robot": f"{self._kind[0]} (pseudo-reality)",
            "unit": self.unit,
            "twin_noise": self.noise,
        }

    def enter(self, room: Mapping[str, Any], seed: int, pose: Pose | None) -> None:
        """Be switched off, and on as a process of its own would be: no trial affects the next."""
        self._line.close()
        settings = {
            "arena": room, "body": self._kind[1], "unit": self.unit, "noise": self.noise, "baud": self.baud,
            "seed": seed,
        }  # fmt: skip
        if self.twin is None:
            self.twin = _started(settings)
        else:
            self.twin.renew(**settings)
        clock = VirtualClock(self.twin.channel)
        self._line.callback(clock.close)
        self.driver = Khepera.connect(self.twin.device, baud=self.baud, clock=clock)
        self._carry = self.twin.place
        self._line.callback(self.driver.abandon)
        self._rests = True
        if pose is not None:
            clock.settle()
            self.twin.place(pose)

    def _stand(self) -> None:
        """One that was just switched on gets no command to stand."""
        if not self._rests:
            super()._stand()

    def act(self, command: Command) -> None:
        """Wheel speeds from now on, pulses per 10 ms."""
        self._rests = False
        super().act(command)

    def film(self, states: Path | None) -> None:
        """Write where it is, every 20 ms, into a sealed file for the camera; None ends it."""
        if self.twin is not None:
            self.clock.settle()
            self.twin.film(states)

    def close(self) -> None:
        """Close the line; nothing can be hurt. Its process waits for another robot."""
        self._line.close()
        twin, self.twin = self.twin, None
        if twin is not None and not _IDLE:
            twin.rest()
            _IDLE.append(twin)
        elif twin is not None:
            twin.close()

    def abandon(self) -> None:
        """Close the line and end the process."""
        self._line.close()
        if self.twin is not None:
            self.twin.close()
            self.twin = None


_IDLE: list[TwinProcess] = []
"""One that nobody uses: starting another takes a second. A forked process has none: it is its parent's."""
os.register_at_fork(after_in_child=_IDLE.clear)


def _started(settings: Mapping[str, Any]) -> TwinProcess:
    """A twin's process that has just been started, or is as good as new."""
    try:
        twin = _IDLE.pop()
    except IndexError:  # none waits
        return start_twin(**settings)
    try:
        twin.renew(**settings)
    except RobotError:  # it is gone, or refuses what a new one will refuse too
        twin.close()
        return start_twin(**settings)
    return twin


def opened(
    unit: str,
    *,
    baud: int | None = 38400,
    noise: float = 1.0,
    kinds: tuple[str, ...] = ("proximity",),
    stranger: bool = False,
    **_: Any,
) -> TwinBody:
    """A unit by its number in words; its line has the usual rate if any will do.

    Args:
        unit: its number.
        baud: of its line.
        noise: a scale.
        kinds: of sensors to read.
        stranger: as of `TwinBody`.
    """
    return TwinBody(int(unit), noise=noise, baud=baud or 38400, kinds=kinds, stranger=stranger)


opened_stranger = partial(opened, stranger=True)
"""A unit of the strangers, as `opened` has a twin's."""
