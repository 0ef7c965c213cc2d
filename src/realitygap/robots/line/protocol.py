"""A robot's line of letters as one table, read both ways: by the driver and by whoever plays the robot.

A command is a capital letter and decimal arguments, ended by CR or LF; its answer is the letter in
lower case and values, ended by CR LF. What differs between robots is in each one's `Dialect`.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

from realitygap.errors import RobotError, UsageError

__all__ = ["Dialect", "Form", "GarbledError", "RefusedError", "Request", "Span", "answer"]

_INTEGERS = re.compile(r"(?:,-?[0-9]{1,10})*")
"""What follows a line's letter, if it is whole numbers."""


class GarbledError(RobotError):
    """An answer that does not fit the command."""


class RefusedError(RobotError):
    """The robot's own errors, such as "Command not found"."""


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
    text: str | None = None
    """A pattern for each answer that is not a number, such as 5.02."""
    open_ended: bool = False
    """Whether any further numbers may follow, both ways."""

    @cached_property
    def answered(self) -> int:
        """Characters of the longest answer."""
        return 1 + sum(1 + span.characters for span in self.gives) + 2


class Request(NamedTuple):
    """A command with its arguments."""

    letter: str
    arguments: tuple[int, ...] = ()

    @property
    def data(self) -> bytes:
        """As it goes on the wire."""
        return _written(self)

    @property
    def text(self) -> str:
        """As a person reads it."""
        return self.data.decode("ascii").rstrip()


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """What one kind of robot understands, and what its line is like.

    Attributes:
        robot: its name for a person; check: what to look at if it does not answer.
        commands: by their letters.
        not_found, protocol_error: its answers to a text that is no command, and to wrong arguments.
        wake: closes whatever half command it holds, and wakes it.
        barrier: the letter of a question that nothing else asks.
        version: the letter that asks which one it is; facts: names of what it answers.
        counters, set_counters: letters; measured: of what else is asked about the wheels at each step.
        rates: baud rates, ascending; usual: the first to try; stop_bits: 1 or 2.
        patience_s: for an answer, besides its time on the wire.
        top: the largest command that a network gives, its own units; leds: how many.
    """

    robot: str
    check: str
    commands: Mapping[str, Form]
    not_found: str
    protocol_error: str
    wake: bytes
    barrier: str
    version: str
    facts: tuple[str, ...]
    counters: str
    set_counters: str
    measured: str
    rates: tuple[int, ...]
    usual: int
    stop_bits: int
    patience_s: float
    top: int
    leds: int

    def request(self, letter: str, *arguments: int) -> Request:
        """A command, checked against the table.

        Raises:
            UsageError: no such command, or arguments that the robot would refuse.
        """
        form = self.commands.get(letter)
        if form is None:
            raise UsageError(f"no command {letter!r}; the robot knows {' '.join(self.commands)}")
        if not _fits(form.takes, arguments, form.open_ended):
            takes = ", ".join(f"{span.low}..{span.high}" for span in form.takes) or "no arguments"
            raise UsageError(f"command {letter} ({form.meaning}) takes {takes}; got {list(arguments)}")
        return Request(letter, tuple(map(int, arguments)))

    def parse_request(self, line: str) -> Request:
        """The command that a line asks for, as the robot reads it.

        Raises:
            RefusedError: with the robot's own words.
        """
        letter, *words = line.strip().split(",")
        form = self.commands.get(letter)
        if form is None:
            raise RefusedError(self.not_found)
        if _INTEGERS.fullmatch(line.strip(), len(letter)):
            arguments = tuple(map(int, words))
            if _fits(form.takes, arguments, form.open_ended):
                return Request(letter, arguments)
        raise RefusedError(self.protocol_error)

    def parse_answer(self, line: str, to: Request) -> tuple[int, ...] | tuple[str, ...]:
        """The values that a line answers to a command: whole numbers, or texts such as versions.

        Raises:
            RefusedError: the robot's own errors.
            GarbledError: anything else that is no answer to this command.
        """
        if line in (self.not_found, self.protocol_error):
            raise RefusedError(f"the robot answered {line!r} to {to.text!r}")
        letter, *words = line.split(",")
        form = self.commands[to.letter]
        if letter == to.letter.lower():
            if form.text is not None:
                words = line.split(",", len(form.gives))[1:]
                if len(words) == len(form.gives) and all(re.fullmatch(form.text, word) for word in words):
                    return tuple(words)
            elif _INTEGERS.fullmatch(line, len(letter)):
                values = tuple(map(int, words))
                if _fits(form.gives, values, form.open_ended):
                    return values
        raise GarbledError(f"{line!r} is no answer to {to.text!r}")

    @property
    def bits(self) -> int:
        """Of a character on the wire: a start bit, eight data bits, stop bits."""
        return 9 + self.stop_bits

    def characters(self, *requests: Request) -> int:
        """On the wire, at most: commands and their answers."""
        return sum(len(to.data) + self.commands[to.letter].answered for to in requests)

    def wire_ms(self, count: int, baud: int | None) -> float:
        """How long some characters take on the wire, ms; 0 without a rate."""
        return 1000.0 * self.bits * count / baud if baud else 0.0


def answer(letter: str, *values: object) -> bytes:
    """The robot's answer to command `letter`, as it goes on the wire."""
    return (",".join([letter.lower(), *map(str, values)]) + "\r\n").encode("ascii")


def _fits(spans: tuple[Span, ...], values: tuple[int, ...], open_ended: bool) -> bool:
    if len(values) < len(spans) or (len(values) > len(spans) and not open_ended):
        return False
    return all(low <= value <= high for (low, high, _), value in zip(spans, values, strict=False))


@lru_cache(maxsize=1024)
def _written(request: Request) -> bytes:
    """What a loop sends again and again, and reckons its time on the wire by."""
    return (",".join([request.letter, *map(str, request.arguments)]) + "\n").encode("ascii")
