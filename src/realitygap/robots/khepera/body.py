"""A Khepera, or a twin of one, as a body on its serial line."""

from functools import partial
from typing import Any

from realitygap.robots.body import KINDS, Channel
from realitygap.robots.khepera.protocol import FULL, KHEPERA, PULSES_PER_MM, SENSORS
from realitygap.robots.line.body import LineBody
from realitygap.robots.line.driver import Driver

__all__ = ["Khepera", "KheperaBody", "opened"]

STANDS = 2
"""Measured speeds up to this, pulses per 10 ms, count as standing still."""


class Khepera(Driver):
    """The driver."""

    dialect = KHEPERA

    def is_still(self) -> bool:
        """By its measured speeds."""
        return max(map(abs, self.speeds())) <= STANDS


class KheperaBody(LineBody):
    """Its commands and speeds are pulses per 10 ms."""

    dialect = KHEPERA
    units = "Khepera units"
    pulses_per_mm = PULSES_PER_MM
    channels = tuple(Channel(name=kind, sensors=SENSORS, high=FULL) for kind in KINDS)


def opened(
    port: str, *, baud: int | None = KHEPERA.usual, kinds: tuple[str, ...] = ("proximity",), **_: Any
) -> KheperaBody:
    """The Khepera on a serial port, told to stop.

    Args:
        port: of the line.
        baud: its rate; None: try all.
        kinds: of sensors to read.

    Raises:
        UsageError: the port cannot be opened, or is too slow for these sensors.
        LineError: no robot answers.
    """
    return KheperaBody.standing(partial(Khepera.connect, port, baud=baud), kinds)
