"""Robots by their address (`ADDRESSES`), and how each is opened."""

from __future__ import annotations

import importlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from realitygap.errors import UsageError

if TYPE_CHECKING:
    from realitygap.robots.body import Body

__all__ = ["ADDRESSES", "BAUD_RATES", "FORMS", "LARGEST_SCALE", "ROBOT", "Address", "StandIn", "as_scale"]

ADDRESSES = {
    "twin, twin:UNIT": "a unit of the twin, a physics model",
    "stranger:UNIT": "a twin that no calibration can fit exactly",
    "enki:MODEL:UNIT": "EPFL's simulator Enki: khepera, epuck, thymio2",
    "khepera:PORT, serial:PORT": "a Khepera on a serial port",
    "epuck:PORT, epuck2:PORT": "an e-puck or e-puck2 on a serial port",
    "epuck2:HOST[:TCPPORT]": "an e-puck2 over WiFi",
    "thymio:PORT, thymio:HOST:PORT": "a Thymio II on a cable or a dongle, or simulated",
    "table:PROFILE": "a profile with look-up tables: recorded readings",
    "FILE.py:CLASS, MODULE:CLASS": "a body of your own",
}
"""What each form of an address means; a unit or a model may be left out."""
FORMS = (
    "twin, twin:UNIT, stranger:UNIT, enki:MODEL:UNIT, khepera:PORT, serial:PORT, epuck:PORT, "
    "epuck2:HOST, thymio:PORT, table:PROFILE, file.py:Class or module:Class"
)

OPENERS = {
    "twin": "realitygap.robots.twin:opened",
    "stranger": "realitygap.robots.twin:opened_stranger",
    "enki": "realitygap.robots.enki:opened",
    "khepera": "realitygap.robots.khepera:opened",
    "serial": "realitygap.robots.khepera:opened",
    "epuck": "realitygap.robots.epuck:opened",
    "epuck2": "realitygap.robots.epuck:opened_second",
    "thymio": "realitygap.robots.thymio:opened",
    "table": "realitygap.simulation.table:opened",
}
"""What opens each kind of robot, loaded when needed; any other prefix is a user's file or module."""
OWN = "realitygap.robots.body:opened"

BAUD = 38400
BAUD_RATES = (9600, 19200, 38400, 57600, 115200)
"""Of a serial line."""
LARGEST_SCALE = 10.0
"""A twin that is noisier than that can hardly be steered."""
LARGEST_UNIT = 2**63 - 1
STAND_INS = ("twin", "stranger", "enki")
"""Simulated robots, which come in units."""
MODELS = ("khepera", "epuck", "thymio2")
"""Enki's robots; the first is the default."""


ROBOT = "robot"
"""Real robots, not stand-ins."""
RECORDED = "recorded readings"
"""Of a robot, replayed; all else is simulated."""


def as_scale(value: object, name: str) -> float:
    """A noise scale of a twin or of Enki.

    Raises:
        UsageError: anything else, under the name it was given by.
    """
    if isinstance(value, bool) or not isinstance(value, float | int) or not 0 <= value <= LARGEST_SCALE:
        raise UsageError(f"{name}: expected a number from 0 to {LARGEST_SCALE:g}, got {value!r}.")
    return float(value)


class StandIn(NamedTuple):
    """A simulated robot, as its folder's name says: "twin-1", "enki-epuck-3-noise-2"; or recorded readings:
    "table-khepera".

    Attributes:
        name: of such robots: "twin", "stranger", of Enki's "Enki khepera", or RECORDED.
        unit: its number; of recorded readings their profile's name.
        scale: of its noise, "" for 1.
    """

    name: str
    unit: str
    scale: str

    @classmethod
    def of_folder(cls, name: str) -> Self | None:
        """None for a robot."""
        found = re.fullmatch(r"(twin|stranger|enki-\w+)-(\d+)(?:-noise-(.+))?", name)
        if found is None:
            return cls(RECORDED, name.removeprefix("table-"), "") if name.startswith("table-") else None
        return cls(found[1].replace("enki-", "Enki "), found[2], found[3] or "")

    @property
    def kind(self) -> str:
        """What may be judged and averaged together."""
        return f"{self.name} with {self.scale} times its noise" if self.scale else self.name

    @property
    def words(self) -> str:
        if self.name == RECORDED:
            return f"{RECORDED} {self.unit}"
        return f"{self.name} unit {self.unit}" + (f", {self.scale} × noise" if self.scale else "")


@dataclass(frozen=True, kw_only=True)
class Address:
    """Which robot: `kind` is the prefix (one of OPENERS, or "own"), `rest` what follows it."""

    kind: str
    rest: str

    @classmethod
    def parse(cls, text: str) -> Self:
        """From any of the forms above.

        Raises:
            UsageError: anything else.
        """
        kind, colon, rest = text.partition(":")
        if kind in ("twin", "stranger"):
            return cls(kind=kind, rest=_unit(rest if colon else "1", f"a {kind}'s", text))
        if kind == "enki":
            model, more, unit = (rest if colon else MODELS[0]).partition(":")
            if model not in MODELS:
                raise UsageError(f"robot: Enki's robots are {', '.join(MODELS)}, got {model!r} in {text!r}.")
            number = _unit(unit if more else "1", "an Enki robot's", text)
            return cls(kind=kind, rest=f"{model}:{number}")
        if kind in OPENERS and rest:
            return cls(kind=kind, rest=rest)
        if kind in OPENERS or not re.fullmatch(r".+:[^\W\d]\w*", text):
            raise UsageError(f"robot: expected {FORMS}, got {text!r}.")
        return cls(kind="own", rest=text)

    @property
    def unit(self) -> int | None:
        """Of a simulated one, a twin, a stranger or Enki's; None for another robot."""
        return int(self.rest.rpartition(":")[2]) if self.kind in STAND_INS else None

    @property
    def port(self) -> str | None:
        """Where a robot's line is; None for one without."""
        return self.rest if self.unit is None and not self.is_file else None

    @property
    def is_file(self) -> bool:
        """Whether it is a file of this machine: a body of your own, or readings that were recorded."""
        return self.kind in ("own", "table")

    def __str__(self) -> str:
        return self.rest if self.kind == "own" else f"{self.kind}:{self.rest}"

    def folder(self, twin_noise: float = 1.0) -> str:
        """Name of its folder: twin-1, enki-epuck-1-noise-2 (its noise scale), serial-ttyUSB0, mine-Five."""
        if self.unit is None:
            place, _, name = self.rest.rpartition(":")
            path = Path(self.rest)
            words = (
                f"{Path(place).stem}-{name}"
                if self.kind == "own"
                else f"{self.kind}-{path.stem if self.is_file else path.name}"
            )
            return re.sub(r"[^A-Za-z0-9._-]", "-", words)
        short = f"{twin_noise:g}"
        scale = short if float(short) == twin_noise else repr(twin_noise)
        name = f"{self.kind}-{self.rest}".replace(":", "-")
        return name if twin_noise == 1 else f"{name}-noise-{scale}"

    def open(self, **settings: Any) -> Body:
        """The body there.

        Args:
            settings: each for the robots that it applies to: `kinds` of sensors to read, `baud` of a
                line (None: try all), `noise` (its scale) of a twin.

        Raises:
            UsageError: it cannot be opened, or is no body.
            RobotError: no robot answers there.
        """
        module, _, name = OPENERS.get(self.kind, OWN).partition(":")
        opener: Any = getattr(importlib.import_module(module), name)
        body: Body = opener(self.rest, **settings)
        return body


def _unit(number: str, whose: str, text: str) -> str:
    """A unit's number as it is written everywhere."""
    if not (number.isascii() and number.isdecimal() and int(number) <= LARGEST_UNIT):
        raise UsageError(f"robot: {whose} unit is a whole number from 0 on, got {number!r} in {text!r}.")
    return str(int(number))
