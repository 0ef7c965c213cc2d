"""Robots on a line of letters: the table of commands, the line with its faults, the driver, the body.

A command is a capital letter and decimal arguments, ended by CR or LF; its answer is the letter in lower case
and values, ended by CR LF. What differs between robots is in each one's `Protocol`, a table that is read both
ways: by the driver and by whoever plays the robot.

On a serial line some of what is sent may be lost, duplicated, garbled or late. A question is asked again
until its answer is understood. Before that the line is brought back into step: a line end closes whatever
half line the robot holds, and the answer to `B`, which nothing else asks for, shows that everything older has
passed. (`B` is the Khepera's; a protocol names its own.)
"""

from __future__ import annotations

import contextlib
import os
import re
import select
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, cast

import numpy as np

from realitygap.errors import BaudError, LineError, RealityGapError, RobotError, UsageError
from realitygap.robots.body import KINDS, Body, Clock, Odometry, RealClock
from realitygap.robots.guard import Guard
from realitygap.values import Closing, Command, Pose, Readings

if TYPE_CHECKING:
    import serial

__all__ = [
    "GIVE_UP_S", "LOOK_S", "QUIET_S", "STOP", "Answer", "Budget", "CommandSpec", "Driver", "GarbledError",
    "IntRange", "Line", "LineBody", "Protocol", "RefusedError", "Request", "Wire", "answer", "nothing",
    "step_budget", "why_not_opened",
]  # fmt: skip

_INTEGERS = re.compile(r"(?:,-?[0-9]{1,10})*")
"""What follows a line's letter, if it is whole numbers."""


class GarbledError(RobotError):
    """An answer that does not fit the command."""


class RefusedError(RobotError):
    """The robot's own errors, such as "Command not found"."""


class IntRange(NamedTuple):
    """A whole number from `low` to `high`; its longest text, where that is not the wider of the two."""

    low: int
    high: int
    longest: int = 0

    @property
    def characters(self) -> int:
        """Of the longest number."""
        return self.longest or max(len(str(self.low)), len(str(self.high)))


@dataclass(frozen=True, kw_only=True)
class CommandSpec:
    """One command: what it takes and what it answers."""

    meaning: str
    takes: tuple[IntRange, ...] = ()
    gives: tuple[IntRange, ...] = ()
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
class Protocol:
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
    commands: Mapping[str, CommandSpec]
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


def _fits(spans: tuple[IntRange, ...], values: tuple[int, ...], open_ended: bool) -> bool:
    if len(values) < len(spans) or (len(values) > len(spans) and not open_ended):
        return False
    return all(low <= value <= high for (low, high, _), value in zip(spans, values, strict=False))


@lru_cache(maxsize=1024)
def _written(request: Request) -> bytes:
    """What a loop sends again and again, and reckons its time on the wire by."""
    return (",".join([request.letter, *map(str, request.arguments)]) + "\n").encode("ascii")


Answer = tuple[int, ...] | tuple[str, ...]

CHUNK = 4096

QUIET_S = 0.03
"""After this long a silence no older answer is on its way."""

GIVE_UP_S = 1.0
"""A question not answered by then is given up: the robot keeps driving meanwhile."""

LEAST_TRIES = 5
"""But not before this many tries: time alone says nothing if the computer was suspended."""

BANNER_S = 0.25
"""How long a robot that has just been reset may take for its two lines."""

BATCH_FAILURES = 3
"""After this many failures of questions sent together, the robot is asked one at a time."""

LONGEST = 4096
"""Characters without a line end from which on the input is noise."""

STOP = Request("D", (0, 0))


def nothing() -> None:
    """Nothing."""


def why_not_opened(error: Exception) -> str:
    """What the system says of a port or an address."""
    number = getattr(error, "errno", None) or 0  # below 0: of a name that nobody knows
    return os.strerror(number) if number > 0 else str(error)


class Wire:
    """An open port, whatever is spoken on it; `faults` counts the answers that did not come in time or were
    not understood; `before` is called before each word that is sent."""

    _port: Any

    def __init__(self, device: str, clock: Clock) -> None:
        self.device, self.clock, self.faults = device, clock, 0
        self.before: Callable[[], None] = nothing
        self._heard = b""

    def fileno(self) -> int:
        """The port's file descriptor."""
        return int(self._port.fileno())

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._port.close()

    def tell(self, data: bytes) -> None:
        """Send bytes without waiting.

        Raises:
            LineError: the line is lost.
        """
        self.before()
        self._write(data)

    def forget(self) -> None:
        """Drop the input so far."""
        self._heard = b""
        while self._read(self.clock.now(), 0):
            pass

    def _write(self, data: bytes) -> None:
        sent = 0
        while sent < len(data):
            try:
                sent += os.write(self.fileno(), data[sent:])
            except BlockingIOError:
                raise LineError(f"the line is lost: {self.device} takes no more bytes") from None
            except (OSError, ValueError) as error:
                raise LineError(f"the line is lost: {self.device}: {error}") from None
            except TypeError:  # the port is closed: it has no descriptor
                raise LineError(f"the line is lost: {self.device} is closed") from None

    def _read(self, until: float, lines: int) -> bytes:
        """What comes in: the first bytes, nothing if there are none by `until`.

        A line that is simulated may wait for `lines` lines.

        Raises:
            LineError: the line is lost.
        """
        try:
            if not select.select([self.fileno()], [], [], max(0.0, until - self.clock.now()))[0]:
                return b""
            data = os.read(self.fileno(), CHUNK)
        except BlockingIOError:
            return b""
        except (OSError, ValueError, TypeError) as error:
            raise LineError(f"the line is lost: {getattr(error, 'strerror', None) or error}") from None
        if not data:
            raise LineError("the line is lost: the device has hung up")
        return data


class Line(Wire):
    """One robot's line of letters; `odd` is the last answer that was not understood.

    Args:
        device: path of the serial device.
        protocol: what the robot there understands.
        baud: its rate; 8 data bits, no parity. None: it is no serial one.
        clock: the clock of the time-outs.
        give_up_s: when a question is given up that was asked five times and more.
    """

    def __init__(
        self,
        device: str,
        protocol: Protocol,
        *,
        baud: int | None,
        clock: Clock | None = None,
        give_up_s: float = GIVE_UP_S,
    ) -> None:
        super().__init__(device, clock or RealClock())
        self.protocol, self.baud, self.give_up_s = protocol, baud, give_up_s
        self.odd = ""
        self.together = True
        self._batch_failures = 0
        self._port = self._opened()

    def ask(self, *requests: Request, give_up_s: float | None = None) -> list[Answer]:
        """The answers to some commands, sent together where the robot takes them so.

        Raises:
            LineError: the line is lost, or no answer was understood in time.
            RefusedError: the robot refused a command each time.
        """
        give_up_s = self.give_up_s if give_up_s is None else give_up_s
        start, tries = self.clock.now(), 1
        try:
            return self._first_try(requests)
        except (GarbledError, RefusedError) as error:
            failure: GarbledError | RefusedError = error
        once = next((r for r in requests if not self.protocol.commands[r.letter].repeatable), None)
        if once is not None:
            raise LineError(f"{failure}; {once.text!r} is not sent twice: ask the robot for its state")
        until = start + give_up_s + self._wire_s(requests)
        while tries < LEAST_TRIES or self.clock.now() < until:
            tries += 1
            try:
                self._resynchronise()
                return [answer for request in requests for answer in self._exchange((request,))]
            except (GarbledError, RefusedError) as error:
                self.faults += 1
                failure = error
        if isinstance(failure, RefusedError):
            raise failure
        passed = f"{self.clock.now() - start:.1f} s, asked {tries} times"
        raise LineError(f"no answer understood on {self.device} for {passed}; the last: {failure}")

    def hear(self, within_s: float) -> str | None:
        """The next line that is not empty, without its end; None if there is none in time."""
        return self._next_line(self.clock.now() + within_s, 1)

    def wake(self) -> list[str]:
        """Send a blank line, and hear the banner of a robot that has just been reset."""
        banner: list[str] = []
        with contextlib.suppress(LineError):
            self.tell(self.protocol.wake)
        while len(banner) < 2 and (text := self.hear(BANNER_S)) is not None:
            banner.append(text)
        return banner

    @property
    def halt(self) -> bytes:
        """What stops the robot, whatever it was told before."""
        return self.protocol.wake + STOP.data

    def _first_try(self, requests: Sequence[Request]) -> list[Answer]:
        together = self.together and len(requests) > 1
        groups = [tuple(requests)] if together else [(request,) for request in requests]
        try:
            answers = [answer for group in groups for answer in self._exchange(group)]
        except (GarbledError, RefusedError):
            self.faults += 1
            self._batch_failures += together
            self.together = self._batch_failures < BATCH_FAILURES
            raise
        if together:
            self._batch_failures = 0
        return answers

    def _exchange(self, requests: Sequence[Request]) -> list[Answer]:
        self.forget()
        self.tell(b"".join(request.data for request in requests))
        until = self.clock.now() + self.protocol.patience_s + self._wire_s(requests)
        answers: list[Answer] = []
        for request in requests:
            line = self._next_line(until, len(requests) - len(answers))
            if line is None:
                raise GarbledError(f"nothing to {request.text!r}")
            self.odd = line
            answers.append(self.protocol.parse_answer(line, request))
            self.odd = ""
        return answers

    def _resynchronise(self) -> None:
        """Bring the line back into step.

        Raises:
            GarbledError: no answer came.
        """
        until = self.clock.now() + self.protocol.patience_s
        while self.clock.now() < until and self.hear(QUIET_S) is not None:
            pass
        self.forget()
        barrier = Request(self.protocol.barrier)
        self.tell(self.protocol.wake + barrier.data)
        until = self.clock.now() + self.protocol.patience_s + self._wire_s((barrier,))
        while (line := self._next_line(until, 1)) is not None:
            with contextlib.suppress(GarbledError, RefusedError):
                self.protocol.parse_answer(line, barrier)
                return
        raise GarbledError(f"nothing to {barrier.text!r}")

    def _next_line(self, until: float, lines: int) -> str | None:
        """A line, or None at `until`; but what has come in by then is read, however late it is looked at."""
        late = False
        while True:
            while b"\n" in self._heard:
                line, self._heard = self._heard.split(b"\n", 1)
                if line.strip():
                    return line.strip().decode("ascii", "replace")
            if len(self._heard) > LONGEST:
                self._heard = b""
            if late:
                return None
            heard = self._read(until, lines)
            late = not heard and self.clock.now() >= until
            self._heard += heard

    def _wire_s(self, requests: Sequence[Request]) -> float:
        return self.protocol.wire_ms(self.protocol.characters(*requests), self.baud) / 1000.0

    def _opened(self) -> serial.Serial:
        """The port, for this process alone, never blocking.

        Raises:
            UsageError: no such device, no right to it, or another program has it.
        """
        import serial

        rates = self.protocol.rates
        if self.baud not in rates:
            raise UsageError(f"the robot's baud rates are {', '.join(map(str, rates))}; got {self.baud}")
        settings = {
            "stopbits": self.protocol.stop_bits,
            "timeout": 0,
            "write_timeout": 0.5,
            "exclusive": True,
        }
        try:
            return serial.Serial(self.device, self.baud, **settings)
        except (serial.SerialException, OSError) as error:
            raise UsageError(
                f"the port {self.device!r} cannot be opened: {why_not_opened(error)}; check the cable, the "
                "name, your right to use it (group dialout), and that no other program has it"
            ) from None


STOP_S, STOP_TRIES = 1.4, (2, 4)
"""The robot is told to stop for this long, at least and at most this often."""

STAND_S = 0.5
"""Time that the wheels may take to stop."""

ANSWER_S = 0.1
LOOK_S = 0.02


class Driver(Closing, ABC):
    """Use `connect`; as a context it stops the robot and closes the line."""

    protocol: ClassVar[Protocol]

    def __init__(self, line: Line, versions: Sequence[str], banner: Sequence[str]) -> None:
        self.line = line
        self.versions = dict(zip(self.protocol.facts, versions, strict=True))
        self.banner = tuple(banner)
        self._guard = Guard(None if line.clock.waits else line.fileno(), line.halt)
        line.before = self._guard.beat

    @classmethod
    def connect(
        cls,
        port: str,
        *,
        baud: int | None = None,
        clock: Clock | None = None,
        give_up_s: float = GIVE_UP_S,
    ) -> Self:
        """Open a port and wake the robot.

        Args:
            port: its device.
            baud: rate, bits a second; None: try all of the robot's.
            clock: the line's; None: the computer's.
            give_up_s: when a question that was not answered is given up.

        Raises:
            UsageError: the port cannot be opened.
            LineError: no robot answers, or another robot: says what to check.
        """
        usual, others = cls.protocol.usual, cls.protocol.rates
        rates = (usual, *(rate for rate in others if rate != usual)) if baud is None else (baud,)
        odd = ""
        for rate in rates:
            line = Line(port, cls.protocol, baud=rate, clock=clock, give_up_s=give_up_s)
            try:
                return cls.awake(line)
            except RobotError:
                line.close()
                odd = odd or (line.odd if line.odd.isascii() and line.odd.isprintable() else "")
        if odd:
            raise LineError(
                f"{port}: expected {cls.protocol.robot} to answer, got {odd[:80]!r}; "
                "give the address of the robot that is there"
            )
        tried = f"{rates[0]} baud" if baud else "any of its rates"
        raise LineError(f"no {cls.protocol.robot} answers on {port} at {tried}; {cls.protocol.check}")

    @classmethod
    def awake(cls, line: Line) -> Self:
        """The robot at the end of an open line, once it has identified itself.

        Raises:
            LineError: it does not.
        """
        banner = line.wake()
        return cls(line, cast("Sequence[str]", line.ask(Request(cls.protocol.version))[0]), banner)

    @property
    def clock(self) -> Clock:
        return self.line.clock

    def command(self, left: int, right: int) -> None:
        """Wheel speeds, the robot's own units."""
        self.line.ask(self.protocol.request("D", left, right))

    def speeds(self) -> tuple[int, int]:
        """Wheel speeds as the robot says them, its own units."""
        left, right = self.read("E")
        return left, right

    def counters(self) -> tuple[int, int]:
        """Position counters, pulses."""
        left, right = self.read(self.protocol.counters)
        return left, right

    def set_counters(self, left: int = 0, right: int = 0) -> None:
        """Set the position counters, pulses."""
        self.line.ask(self.protocol.request(self.protocol.set_counters, left, right))

    def led(self, number: int, on: bool) -> None:
        """Switch an LED."""
        request = self.protocol.request("L", number, int(on))
        for _ in range(2):  # the line does not repeat L: 2 would change it twice; 0 and 1 would not
            with contextlib.suppress(LineError):
                self.line.ask(request)
                return
        self.line.ask(request)

    def watch(self) -> None:
        """Until the next `stop` the guard stops the robot if nothing is said on the line for half a second.

        The next command then raises a `FrozenError`. Under a clock that waits nothing is needed.
        """
        self._guard.watch()

    def stop(self) -> None:
        """Stop the robot, and check that it has stopped.

        The command is sent before anything else is heard or asked, repeatedly if needed.

        Raises:
            LineError: the robot did not confirm: it may still be moving.
        """
        failure: RealityGapError | None = None
        until, tries, (least, most) = self.clock.now() + STOP_S, 0, STOP_TRIES
        while tries < least or (tries < most and self.clock.now() < until):
            tries += 1
            try:
                self.line.tell(self.line.halt)
                self.line.hear(ANSWER_S)  # its answer, so that it is not taken for the next one's
                self.line.ask(STOP, give_up_s=self.line.give_up_s / 2)
                if self._stands():
                    self._guard.rest()
                    return
                failure = RobotError("its wheels still turn")
            except RobotError as error:
                failure = error
        raise LineError(
            f"the robot did not confirm that it stopped ({failure}); it may still be moving: "
            f"lift it or switch it off"
        )

    def close(self) -> None:
        """Stop, then close the line and the guard, in any case."""
        try:
            self.stop()
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close the line and the guard without a word to the robot."""
        self.line.before = nothing
        self.line.close()
        self._guard.release()

    def read(self, letter: str) -> tuple[int, ...]:
        """The numbers that answer a question, such as N: proximity, O: ambient light (counts)."""
        return cast("tuple[int, ...]", self.line.ask(self.protocol.request(letter))[0])

    def _stands(self) -> bool:
        until = self.clock.now() + STAND_S
        while self.clock.now() < until:
            if self.is_still():
                return True
            self.clock.sleep_until(self.clock.now() + LOOK_S)
        return False

    @abstractmethod
    def is_still(self) -> bool:
        """Whether its wheels are still, as far as it can tell."""


LED_S = 0.2

STEP_MS = 100.0
"""Length of one step."""

_READS = {"proximity": Request("N"), "ambient": Request("O")}


class Budget(NamedTuple):
    """What is asked at each step, and the time that it and the speed command take at most, ms."""

    reads: tuple[Request, ...]
    ms: float


def step_budget(
    protocol: Protocol, kinds: tuple[str, ...], baud: int | None, *, turns: bool = True
) -> Budget:
    """The commands of one step: the sensors, then (if `turns`) counters and measured speeds where they fit.

    Without sensors it is the counters alone: one question, which takes a body no further in its time.
    Times are the worst case: command and answer one after the other, every number at its longest.

    Args:
        protocol: the line's.
        kinds: of sensors.
        baud: the line's; None: one that takes no time, as over a network.
        turns: whether counters and speeds are requested.

    Raises:
        BaudError: sensors and speed command alone take longer than a step; shows the arithmetic.
        UsageError: an unknown kind, or none.
    """
    if not (kinds or turns) or not set(kinds) <= set(KINDS):
        raise UsageError(f"a robot's sensors are {' and '.join(KINDS)}; got {list(kinds)}")
    fastest = Request("D", (-protocol.top, -protocol.top))  # the longest of the commands that a network gives

    def ms(rate: int | None, *asked: Request) -> float:
        return protocol.wire_ms(protocol.characters(*asked, fastest), rate)

    read = [kind for kind in KINDS if kind in kinds]
    reads = tuple(_READS[kind] for kind in read)
    if ms(baud, *reads) > STEP_MS:
        count = protocol.characters(*reads, fastest)
        enough = next(rate for rate in protocol.rates if ms(rate, *reads) <= STEP_MS)
        one = ", or read one kind of sensors" if len(reads) > 1 and ms(baud, reads[0]) <= STEP_MS else ""
        raise BaudError(
            f"{baud} baud cannot carry a {STEP_MS:g} ms loop with {' and '.join(read)} readings: "
            f"{' + '.join(one.letter for one in reads)} + D are up to {count} characters of "
            f"{protocol.bits} bits, {count} × {protocol.bits} / {baud} s = {ms(baud, *reads):.0f} ms; "
            f"set the robot to {enough} baud or more{one}"
        )
    tells = (protocol.counters, *protocol.measured) if kinds else (protocol.counters,)
    for tell in map(Request, tells if turns else ()):
        if ms(baud, *reads, tell) <= STEP_MS:
            reads = (*reads, tell)
    return Budget(reads, ms(baud, *reads))


class LineBody(Body):
    """From `act` to `stop` something must be asked or told twice a second, or the guard stops the robot.

    Args:
        driver: the robot's; `close` closes it.
        kinds: the sensors that are read at each step: "proximity", "ambient" or both.
        carry: the experimenter's hand, which brings the robot to a pose; without it `reset` takes
            the robot where it stands.

    Raises:
        BaudError: the line is too slow for these sensors in a loop of 100 ms.
    """

    protocol: ClassVar[Protocol]
    units: ClassVar[str]
    """Of its commands and speeds."""
    period_s = STEP_MS / 1000.0
    counts_turns = True

    def __init__(
        self,
        driver: Driver,
        *,
        kinds: tuple[str, ...] = ("proximity",),
        carry: Callable[[Pose], None] | None = None,
    ) -> None:
        self.driver, self._carry, self.baud = driver, carry, driver.line.baud
        self.clock = driver.clock
        self.attend(*kinds)

    @property
    def odometry(self) -> Odometry:
        """As read with the last `sense`; what a slow line has no room for is None."""
        return self._odometry

    @property
    def facts(self) -> dict[str, Any]:
        """What a recording says of it."""
        port = {"robot": self.protocol.robot, "port": self.driver.line.device}
        return {"units": self.units, **port, **self.driver.versions}

    @property
    def wire_ms(self) -> float | None:
        """The time that a step takes on a serial line, at most."""
        return self.budget.ms if self.baud else None

    def attend(self, *kinds: str, turns: bool = True) -> None:
        """Read these kinds of sensors from now on, and what of counters and speeds a step has room for."""
        self.budget = step_budget(self.protocol, kinds, self.baud, turns=turns)
        self.kinds = tuple(kind for kind in KINDS if kind in kinds)
        self._odometry = Odometry()

    def reset(self, pose: Pose | None = None) -> None:
        """Stop, be carried to `pose`, counters at zero."""
        self._stand()
        if pose is not None and self._carry is not None:
            self._carry(pose)
        self._zero()

    def _stand(self) -> None:
        self.driver.stop()

    def _zero(self) -> None:
        self.driver.set_counters(0, 0)
        self._odometry = Odometry()

    def sense(self) -> Readings:
        """All of a step's questions, sent together."""
        answers = self.driver.line.ask(*self.budget.reads)
        said = {read.letter: answer for read, answer in zip(self.budget.reads, answers, strict=True)}
        pairs = cast("dict[str, tuple[int, int]]", said)
        self._odometry = Odometry(pairs.get(self.protocol.counters), pairs.get("E"))
        return Readings(
            proximity=np.array(said.get("N", ()), np.float64), ambient=np.array(said.get("O", ()), np.float64)
        )

    def act(self, command: Command) -> None:
        """Wheel speeds from now on, in the robot's own units."""
        self.driver.watch()
        self.driver.command(command.left, command.right)

    def stop(self) -> None:
        """Stop, and make sure of it."""
        self.driver.stop()

    def close(self) -> None:
        self.driver.close()

    def inspect(self) -> dict[str, Any]:
        """Switch its LEDs on and off, and count the requests repeated so far."""
        for on in (True, False):
            for number in range(self.protocol.leds):
                self.driver.led(number, on)
            self.clock.sleep_until(self.clock.now() + LED_S)
        return {"leds": "answered", "faults": self.driver.line.faults}

    def abandon(self) -> None:
        """Close the line without a word to the robot."""
        self.driver.abandon()

    @classmethod
    def standing(cls, connect: Callable[[], Driver], kinds: tuple[str, ...]) -> Self:
        """The body of a robot that is connected now and told to stop."""
        driver = connect()
        try:
            driver.stop()
            return cls(driver, kinds=kinds)
        except BaseException:
            driver.abandon()  # it was told to stand first
            raise
