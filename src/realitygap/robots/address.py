"""Robots by their address, and how each is opened.

twin, twin:UNIT                    a unit of the twin (pseudo-reality)
khepera:PORT, serial:PORT          a Khepera on a serial port
file.py:Class, module:Class        a body of your own (`robots/body.py` says what that is)
"""

from __future__ import annotations

import importlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from realitygap.errors import UsageError

if TYPE_CHECKING:
    from realitygap.robots.body import Body

__all__ = ["BAUD_RATES", "FORMS", "Address"]

FORMS = "twin, twin:UNIT, khepera:PORT, serial:PORT, file.py:Class or module:Class"

OPENERS = {
    "twin": "realitygap.robots.khepera.twin:opened",
    "khepera": "realitygap.robots.khepera.body:opened",
    "serial": "realitygap.robots.khepera.body:opened",
}
"""Who opens a robot, loaded when it is asked for; any other prefix is a user's file or module."""
OWN = "realitygap.robots.own:opened"

BAUD = 38400
BAUD_RATES = (9600, 19200, 38400, 57600, 115200)
"""Of a serial line."""
LARGEST_UNIT = 2**63 - 1


@dataclass(frozen=True, kw_only=True)
class Address:
    """Which robot: `kind` is the prefix ("twin", "khepera", "serial", or "own"), `rest` what follows it."""

    kind: str
    rest: str

    @classmethod
    def parse(cls, text: str) -> Self:
        """From any of the forms above.

        Raises:
            UsageError: anything else.
        """
        kind, colon, rest = text.partition(":")
        if kind == "twin":
            unit = rest if colon else "1"
            if not (unit.isascii() and unit.isdecimal() and int(unit) <= LARGEST_UNIT):
                raise UsageError(
                    f"robot: a twin's unit is a whole number from 0 on, got {rest!r} in {text!r}."
                )
            return cls(kind=kind, rest=str(int(unit)))
        if kind in OPENERS and rest:
            return cls(kind=kind, rest=rest)
        if kind in OPENERS or not re.fullmatch(r".+:[^\W\d]\w*", text):
            raise UsageError(f"robot: expected {FORMS}, got {text!r}.")
        return cls(kind="own", rest=text)

    @property
    def unit(self) -> int | None:
        """Of the twin; None for another robot."""
        return int(self.rest) if self.kind == "twin" else None

    @property
    def port(self) -> str | None:
        """Where a robot's line is; None for one without."""
        return self.rest if self.kind not in ("twin", "own") else None

    def __str__(self) -> str:
        return self.rest if self.kind == "own" else f"{self.kind}:{self.rest}"

    def folder(self, twin_noise: float = 1.0) -> str:
        """Name of its folder: twin-1, twin-1-noise-2 (its scale of noise), serial-ttyUSB0, mine-Five."""
        if self.unit is None:
            place, _, name = self.rest.rpartition(":")
            words = (
                f"{Path(place).stem}-{name}" if self.kind == "own" else f"{self.kind}-{Path(self.rest).name}"
            )
            return re.sub(r"[^A-Za-z0-9._-]", "-", words)
        short = f"{twin_noise:g}"
        scale = short if float(short) == twin_noise else repr(twin_noise)
        return f"twin-{self.unit}" if twin_noise == 1 else f"twin-{self.unit}-noise-{scale}"

    def open(self, **settings: Any) -> Body:
        """The body there.

        Args:
            settings: for those that they mean something to: `kinds` of sensors to read, `baud` of a
                line (None: try all), `noise` (its scale) of a twin.

        Raises:
            UsageError: it cannot be opened, or is no body.
            RobotError: nobody answers there.
        """
        module, _, name = OPENERS.get(self.kind, OWN).partition(":")
        opener: Any = getattr(importlib.import_module(module), name)
        body: Body = opener(self.rest, **settings)
        return body
