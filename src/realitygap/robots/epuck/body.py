"""An e-puck or e-puck2 as a body, on a serial line or over WiFi."""

import re
from functools import partial
from typing import Any, Self

from realitygap.errors import LineError, RobotError
from realitygap.robots.body import KINDS, Channel, Odometry
from realitygap.robots.epuck.protocol import EPUCK, FULL, PULSES_PER_MM, SENSORS
from realitygap.robots.epuck.wifi import PacketLine
from realitygap.robots.line.body import LineBody
from realitygap.robots.line.driver import LOOK_S, Driver
from realitygap.values import Readings

__all__ = ["Epuck", "EpuckBody", "opened", "opened_second"]

COUNTS = 2**16
"""Its counters begin again after this many steps: 8 m."""


GREETING_S = 0.3
"""An e-puck2 does not speak first; another service at its address does, and is known by what it says."""


class Epuck(Driver):
    """The driver."""

    dialect = EPUCK

    def is_still(self) -> bool:
        """By its step counters, which do not change."""
        before = self.counters()
        self.clock.sleep_until(self.clock.now() + LOOK_S)
        return self.counters() == before

    @classmethod
    def over_wifi(cls, place: str) -> Self:
        """The e-puck2 at HOST or HOST:PORT.

        Raises:
            UsageError: nothing there takes the connection.
            LineError: no robot answers, or not as an e-puck2 does.
        """
        line = PacketLine(place)
        try:
            line.hear(GREETING_S)
            line.ask(EPUCK.request("Q"))
            return cls.awake(line)
        except RobotError as error:
            line.close()
            why = f"it says {line.odd}" if line.odd else error
            raise LineError(f"no e-puck2 answers at {place}: {why}; is that another device?") from None


class EpuckBody(LineBody):
    """Its commands are steps per second; its speeds are its counters' since the last `sense`."""

    dialect = EPUCK
    units = "e-puck units (steps/s)"
    pulses_per_mm = PULSES_PER_MM
    channels = tuple(Channel(name=kind, sensors=SENSORS, high=FULL) for kind in KINDS)
    _turned, _then = (0, 0), 0.0

    @property
    def facts(self) -> dict[str, Any]:
        """What a recording says of it."""
        return {**super().facts, "base": "e-puck", "pulses_per_mm": self.pulses_per_mm}

    def sense(self) -> Readings:
        """All of a step's questions, sent together; counters continue when the robot's start again."""
        readings, now = super().sense(), self.clock.now()
        if self._odometry.counters is not None:
            pairs = zip(self._turned, self._odometry.counters, strict=True)
            left, right = ((count - old + COUNTS // 2) % COUNTS - COUNTS // 2 for old, count in pairs)
            self._turned = self._turned[0] + left, self._turned[1] + right
            passed = max(now - self._then, 1e-3)
            self._odometry = Odometry(self._turned, (round(left / passed), round(right / passed)))
        self._then = now
        return readings

    def _zero(self) -> None:
        super()._zero()
        self._turned, self._then = (0, 0), self.clock.now()


def opened(port: str, *, kinds: tuple[str, ...] = ("proximity",), **_: Any) -> EpuckBody:
    """The e-puck or e-puck2 on a serial port, told to stop.

    Raises:
        UsageError: the port cannot be opened.
        LineError: no robot answers.
    """
    return EpuckBody.standing(partial(Epuck.connect, port), kinds)


def opened_second(place: str, *, kinds: tuple[str, ...] = ("proximity",), **_: Any) -> EpuckBody:
    """The e-puck2 on a serial port (a path, or COM3), or over WiFi at HOST or HOST:PORT, told to stop.

    Raises:
        UsageError: the port cannot be opened, or nothing takes the connection.
        LineError: no robot answers.
    """
    serial = "/" in place or re.fullmatch(r"COM\d+", place)
    return EpuckBody.standing(partial(Epuck.connect if serial else Epuck.over_wifi, place), kinds)
