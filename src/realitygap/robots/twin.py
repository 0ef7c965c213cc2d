"""A unit of a twin as a body: switched on in any room, driven through its serial line in its own time."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from realitygap.robots.khepera import KHEPERA, KheperaBody
from realitygap.robots.line import Line
from realitygap.twin.body import TwinBody
from realitygap.twin.firmware import Firmware
from realitygap.twin.stranger import StrangerBody
from realitygap.values import Command, Pose

__all__ = ["Twin", "TwinLine", "opened", "opened_stranger"]


class TwinLine(Line):
    """The line to a twin in this process, and its clock: time passes only while somebody waits for it.

    Args:
        firmware: the robot's end.
    """

    waits = True

    def __init__(self, firmware: Firmware) -> None:
        self.firmware = firmware
        super().__init__("twin", KHEPERA, baud=firmware.baud, clock=self)

    def now(self) -> float:
        """Seconds since the twin was switched on."""
        return self.firmware.now / 1e9

    def sleep_until(self, time_s: float) -> None:
        """Let the twin run on."""
        self._input += self.firmware.run(round(time_s * 1e9))

    def discard_input(self) -> None:
        self._input = b""

    def close(self) -> None:
        """No resources to release."""

    def _send(self, data: bytes) -> None:
        self.firmware.receive(data)

    def _read(self, until: float, lines: int) -> bytes:
        return self.firmware.run(int(until * 1e9) + 1, lines)  # + 1: surely past `until`

    def _open(self) -> None:
        """There is no port."""


class Twin(KheperaBody):
    """It has to `enter` a room first.

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
        self._name = "stranger" if stranger else "twin"
        self._firmware: Firmware | None = None
        self.attend(*kinds)

    @property
    def facts(self) -> dict[str, Any]:
        """What a recording says of it."""
        return {
            "units": self.units,
            "robot": f"{self._name} (pseudo-reality)",
            "unit": self.unit,
            "twin_noise": self.noise,
        }

    def enter(self, room: Mapping[str, Any], seed: int, pose: Pose | None) -> None:
        """Be switched on anew: no trial affects the next."""
        self.film(None)
        kind = StrangerBody if self._name == "stranger" else TwinBody
        body = kind(room, unit=self.unit, noise=self.noise, seed=seed)
        assert self.baud is not None
        self._firmware = Firmware(body, baud=self.baud, name=f"{self._name} unit {self.unit}")
        self._identify(TwinLine(self._firmware))
        self._carry, self._rests = self._firmware.place, True
        if pose is not None:
            self._carry(pose)

    def act(self, command: Command) -> None:
        """Wheel speeds from now on, pulses per 10 ms."""
        self._rests = False
        super().act(command)

    def film(self, states: Path | None) -> None:
        """Write where it is, every 20 ms, into a sealed file for the camera; None ends it."""
        if self._firmware is not None:
            self._firmware.film(states)

    def close(self) -> None:
        """Switch it off; nothing can be hurt."""
        self.film(None)
        self._firmware = None

    abandon = close


def opened(
    unit: str,
    *,
    baud: int | None = 38400,
    noise: float = 1.0,
    kinds: tuple[str, ...] = ("proximity",),
    stranger: bool = False,
    **_: Any,
) -> Twin:
    """A unit by its number in words; its line has the usual rate if any will do."""
    return Twin(int(unit), noise=noise, baud=baud or 38400, kinds=kinds, stranger=stranger)


opened_stranger = partial(opened, stranger=True)
"""A unit of the strangers, as `opened` has a twin's."""
