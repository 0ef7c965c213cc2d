"""The Khepera's serial protocol as one table, read both ways: by the driver and by the twin.

A command is a capital letter and decimal arguments, ended by CR or LF; its answer is the letter in
lower case and values, ended by CR LF. Sources: Player's khepera driver, KiKS, pykhepera, Webots.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

from realitygap.errors import RobotError, UsageError
from realitygap.robots.address import BAUD_RATES

__all__ = [
    "BAUD_RATES",
    "BITS_PER_CHARACTER",
    "COMMANDS",
    "FULL",
    "NOT_FOUND",
    "PROTOCOL_ERROR",
    "PULSES_PER_MM",
    "SENSORS",
    "Form",
    "GarbledError",
    "RefusedError",
    "Request",
    "Span",
    "answer",
    "characters",
    "parse_answer",
    "parse_request",
    "request",
    "wire_ms",
]

PULSES_PER_MM = 12.0
"""Most sources; 0.08 mm a pulse (12.5) by others: a calibration measures it."""

SENSORS, FULL = 8, 1023
"""Sensors of each kind, and the highest count of their converter of 10 bits."""

BITS_PER_CHARACTER = 11
"""One start bit, eight data bits, two stop bits (8N2)."""

NOT_FOUND = "Command not found"
"""The robot's answer to a text that is no command (one source)."""

PROTOCOL_ERROR = "z,Protocol error"
"""The robot's answer to wrong arguments (one source)."""

COUNTER_CHARACTERS = 7
"""Of a position counter, for times on the wire: a robot drives 83 m before there are more."""

_INTEGER = re.compile(r"-?[0-9]{1,10}")
_VERSION = re.compile(r"[0-9]{1,3}(\.[0-9]{1,4})?")


class GarbledError(RobotError):
    """An answer that is none to the command."""


class RefusedError(RobotError):
    """The robot's own errors: "Command not found", "z,Protocol error"."""


class Span(NamedTuple):
    """A whole number from `low` to `high`; its longest text, where that is not the wider of the two."""

    low: int
    high: int
    longest: int = 0

    @property
    def characters(self) -> int:
        """Of the longest number."""
        return self.longest or max(len(str(self.low)), len(str(self.high)))


@dataclass(frozen=True, kw_only=True)
class Form:
    """One command: what it takes and what it answers."""

    meaning: str
    takes: tuple[Span, ...] = ()
    gives: tuple[Span, ...] = ()
    repeatable: bool = True
    """Whether it may be sent again when no answer came."""
    versions: bool = False
    """Whether the answers are versions such as 5.02."""
    open_ended: bool = False
    """Whether any further numbers may follow, both ways."""

    @cached_property
    def answered(self) -> int:
        """Characters of the longest answer."""
        widths = [5 if self.versions else span.characters for span in self.gives]
        return 1 + sum(1 + width for width in widths) + 2


class Request(NamedTuple):
    """A command with its arguments."""

    letter: str
    arguments: tuple[int, ...] = ()

    @property
    def data(self) -> bytes:
        """As it goes on the wire."""
        return (",".join([self.letter, *map(str, self.arguments)]) + "\n").encode("ascii")

    @property
    def text(self) -> str:
        """As a person reads it."""
        return self.data.decode("ascii").rstrip()


_GAIN = Span(0, 32767)
_PULSES = Span(-(2**31), 2**31 - 1, COUNTER_CHARACTERS)
_SPEED = Span(-127, 127)
_MEASURED = Span(-1023, 1023, 4)
_LIGHT = (Span(0, FULL),) * SENSORS
_FLAG = Span(0, 1)

COMMANDS: Mapping[str, Form] = MappingProxyType(
    {
        "A": Form(meaning="set the speed controller's Kp, Ki, Kd", takes=(_GAIN,) * 3),
        "B": Form(meaning="read the versions of bios and protocol", gives=(_FLAG,) * 2, versions=True),
        "C": Form(meaning="go to a position, pulses", takes=(_PULSES,) * 2),
        "D": Form(meaning="set the speed, pulses per 10 ms", takes=(_SPEED,) * 2),
        "E": Form(meaning="read the measured speed, pulses per 10 ms", gives=(_MEASURED,) * 2),
        "F": Form(meaning="set the position controller's Kp, Ki, Kd", takes=(_GAIN,) * 3),
        "G": Form(meaning="set the position counters, pulses", takes=(_PULSES,) * 2),
        "H": Form(meaning="read the position counters, pulses", gives=(_PULSES,) * 2),
        "I": Form(meaning="read an analogue input, 10 bits", takes=(Span(0, 5),), gives=(Span(0, FULL),)),
        "J": Form(
            meaning="set the speed profile: top speed and acceleration, left and right",
            takes=(Span(0, 127), Span(0, 255)) * 2,
        ),
        "K": Form(
            meaning="read the motion's status: on target, mode, error, left and right",
            gives=(_FLAG, _FLAG, _PULSES) * 2,
        ),
        "L": Form(
            meaning="switch an LED: 0 off, 1 on, 2 change", takes=(_FLAG, Span(0, 2)), repeatable=False
        ),
        "N": Form(meaning="read the proximity sensors", gives=_LIGHT),
        "O": Form(meaning="read the ambient light sensors", gives=_LIGHT),
        "P": Form(meaning="set the motors' pulse width", takes=(Span(-255, 255),) * 2),
        "T": Form(
            meaning="pass on to a turret",
            takes=(Span(0, 255),),
            gives=(Span(0, 255),),
            repeatable=False,
            open_ended=True,
        ),
    }
)


def request(letter: str, *arguments: int) -> Request:
    """A command, checked against the table.

    Raises:
        UsageError: no such command, or arguments that the robot would refuse.
    """
    form = COMMANDS.get(letter)
    if form is None:
        raise UsageError(f"no command {letter!r}; the robot knows {' '.join(COMMANDS)}")
    if not _fits(form.takes, arguments, form.open_ended):
        takes = ", ".join(f"{span.low}..{span.high}" for span in form.takes) or "no arguments"
        raise UsageError(f"command {letter} ({form.meaning}) takes {takes}; got {list(arguments)}")
    return Request(letter, tuple(map(int, arguments)))


def parse_request(line: str) -> Request:
    """The command that a line asks for, as the robot reads it.

    Raises:
        RefusedError: with the robot's own words.
    """
    letter, *rest = line.strip().split(",")
    form = COMMANDS.get(letter)
    if form is None:
        raise RefusedError(NOT_FOUND)
    if not all(_INTEGER.fullmatch(word) for word in rest):
        raise RefusedError(PROTOCOL_ERROR)
    arguments = tuple(map(int, rest))
    if not _fits(form.takes, arguments, form.open_ended):
        raise RefusedError(PROTOCOL_ERROR)
    return Request(letter, arguments)


def answer(letter: str, *values: object) -> bytes:
    """The robot's answer to command `letter`, as it goes on the wire."""
    return (",".join([letter.lower(), *map(str, values)]) + "\r\n").encode("ascii")


def parse_answer(line: str, to: Request) -> tuple[int, ...] | tuple[str, ...]:
    """The values that a line answers to a command: whole numbers, or for `B` the versions.

    Raises:
        RefusedError: the robot's own errors.
        GarbledError: anything else that is no answer to this command.
    """
    if line in (NOT_FOUND, PROTOCOL_ERROR):
        raise RefusedError(f"the robot answered {line!r} to {to.text!r}")
    letter, *words = line.split(",")
    form = COMMANDS[to.letter]
    if letter == to.letter.lower():
        if form.versions and len(words) == len(form.gives) and all(map(_VERSION.fullmatch, words)):
            return tuple(words)
        if not form.versions and all(map(_INTEGER.fullmatch, words)):
            values = tuple(map(int, words))
            if _fits(form.gives, values, form.open_ended):
                return values
    raise GarbledError(f"{line!r} is no answer to {to.text!r}")


def _fits(spans: tuple[Span, ...], values: tuple[int, ...], open_ended: bool) -> bool:
    if len(values) < len(spans) or (len(values) > len(spans) and not open_ended):
        return False
    return all(span.low <= value <= span.high for span, value in zip(spans, values, strict=False))


def characters(to: Request) -> int:
    """Characters on the wire, at most: the command and its answer."""
    return len(to.data) + COMMANDS[to.letter].answered


def wire_ms(count: int, baud: int) -> float:
    """How long so many characters take on the wire, ms."""
    return 1000.0 * BITS_PER_CHARACTER * count / baud
