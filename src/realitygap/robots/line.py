"""Robots on a line: the table of commands, the line with its faults, the body.

A command is a capital letter and decimal arguments, ended by CR or LF; its answer is the letter in lower case
and values, ended by CR LF. What differs between robots is in each one's `Protocol`, a table that is read both
ways: by the driver and by whoever plays the robot.

On a serial line some of what is sent may be lost, duplicated, garbled or late. A question is asked again
until its answer is understood. Before that the line is brought back into step: a line end closes whatever
half line the robot holds, and the answer to `B`, which nothing else asks for, shows that everything older has
passed. (`B` is the Khepera's; a protocol names its own.)

A line over the air may stall for seconds. A robot whose wheels may turn is then told to stop until it answers
again; what was asked is asked once more.
"""

from __future__ import annotations

import contextlib
import math
import re
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar, NamedTuple, Self, cast

import numpy as np

from realitygap.errors import BaudError, LineError, RobotError, UsageError
from realitygap.robots.body import KINDS, Clock, Odometry, RealClock
from realitygap.robots.wire import LOOK_S, STALL_S, STAND_S, WAIT_S, Wire, WireBody, why_not_opened
from realitygap.values import Command, Pose, Readings

__all__ = [
    "GIVE_UP_S", "LEAST_TRIES", "QUIET_S", "Answer", "CommandSpec", "GarbledError", "IntRange", "Line",
    "LineBody", "Protocol", "RefusedError", "Request", "answer", "step_budget",
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
        top: the largest command that a network gives, its own units.
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

    def request(self, letter: str, *arguments: int) -> Request:
        """A command, checked against the table.

        Raises:
            UsageError: no such command, or arguments that the robot would refuse.
        """
        form = self.commands.get(letter)
        if form is None:
            raise UsageError(f"no command {letter!r}; the robot knows {' '.join(self.commands)}")
        if not _fits(form.takes, arguments):
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
            if _fits(form.takes, arguments):
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
                if _fits(form.gives, values):
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


def _fits(spans: tuple[IntRange, ...], values: tuple[int, ...]) -> bool:
    if len(values) != len(spans):
        return False
    for (low, high, _), value in zip(spans, values, strict=True):  # noqa: SIM110 - of every answer, faster so
        if not low <= value <= high:
            return False
    return True


@lru_cache(maxsize=1024)
def _written(request: Request) -> bytes:
    """What a loop sends again and again, and reckons its time on the wire by."""
    return (",".join([request.letter, *map(str, request.arguments)]) + "\n").encode("ascii")


Answer = tuple[int, ...] | tuple[str, ...]

QUIET_S = 0.03
"""After this long a silence no older answer is on its way."""

GIVE_UP_S, LEAST_TRIES = 1.0, 5
"""A question not answered by then is given up: the robot keeps driving meanwhile. But not before this many
tries: time alone says nothing if the computer was suspended."""

BANNER_S = 0.25
"""How long a robot that has just been reset may take for its two lines."""

BATCH_FAILURES = 3
"""After this many failures of questions sent together, the robot is asked one at a time."""

LONGEST = 4096
"""Characters without a line end from which on the input is noise."""

STOP = Request("D", (0, 0))


class Line(Wire):
    """One robot's line of letters; `odd` is the last answer that was not understood.

    Args:
        device: path of the serial device.
        protocol: what the robot there understands.
        baud: its rate; 8 data bits, no parity. None: it is no serial one.
        clock: the clock of the time-outs; None: the computer's.
        give_up_s: when a question is given up that was asked five times and more.

    Raises:
        UsageError: no such device, no right to it, or another program has it.
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
        self.stop_message = protocol.wake + STOP.data
        self.odd = ""
        self._batch_failures, self._latest = 0, math.inf
        self._open()

    def ask(self, *requests: Request, give_up_s: float | None = None) -> list[Answer]:
        """The answers to some commands, sent together where the robot takes them so.

        Raises:
            LineError: the line is lost, no answer was understood in time, or a stall did not end.
            RefusedError: the robot refused a command each time.
        """
        together = len(requests) > 1 and self._batch_failures < BATCH_FAILURES
        once = next((r for r in requests if not self.protocol.commands[r.letter].repeatable), None)
        start, tries, wire_s = self.clock.now(), 0, self._wire_s(requests)
        heard, until = start, start + (self.give_up_s if give_up_s is None else give_up_s) + wire_s
        while tries < LEAST_TRIES or self.clock.now() < until:
            tries += 1
            self._latest = heard + STALL_S if self.moving else math.inf
            groups = [requests] if together else [(request,) for request in requests]
            try:
                if tries > 1:
                    self._resynchronise()
                answers = [answer for group in groups for answer in self._exchange(group)]
                self._batch_failures *= not together
                return answers
            except (GarbledError, RefusedError) as error:
                failure = error
            self.faults += 1
            self._batch_failures += together
            together = False
            if once is not None:
                raise LineError(f"{failure}; {once.text!r} is not sent twice: ask the robot for its state")
            if self.clock.now() >= self._latest:
                until += self._waited_out(heard)
                heard = self.clock.now()
        if isinstance(failure, RefusedError):
            raise failure
        passed = f"{self.clock.now() - start:.1f} s, asked {tries} times"
        raise LineError(f"no answer understood on {self.device} for {passed}; the last: {failure}")

    def _waited_out(self, heard: float) -> float:
        """Tell the robot, last heard of then, to stop until it answers; how long that took, s.

        Raises:
            LineError: it does not.
        """
        begun, self._latest = self.clock.now(), math.inf
        while True:
            self.write(self.stop_message)
            try:
                self._resynchronise()
                self._exchange((STOP,))
            except (GarbledError, RefusedError) as error:
                silent = self.clock.now() - heard
                if silent < WAIT_S:
                    continue
                told = f"no answer understood on {self.device} for {silent:.1f} s, told to stop all the while"
                raise LineError(f"{told}; the last: {error}") from None
            self.stalls.append(self.clock.now() - heard)
            return self.clock.now() - begun

    def read_line(self, within_s: float) -> str | None:
        """The next line that is not empty, without its end; None if there is none in time."""
        return self._next_line(self.clock.now() + within_s, 1)

    def wake(self) -> list[str]:
        """Send a blank line, and read the banner of a robot that has just been reset."""
        banner: list[str] = []
        with contextlib.suppress(LineError):
            self.write(self.protocol.wake)
        while len(banner) < 2 and (text := self.read_line(BANNER_S)) is not None:
            banner.append(text)
        return banner

    def _exchange(self, requests: Sequence[Request]) -> list[Answer]:
        self.discard_input()
        self.write(b"".join(request.data for request in requests))
        until = self._until(self.protocol.patience_s + self._wire_s(requests))
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
        until = self._until(self.protocol.patience_s)
        while self.clock.now() < until and self.read_line(QUIET_S) is not None:
            pass
        self.discard_input()
        barrier = Request(self.protocol.barrier)
        self.write(self.protocol.wake + barrier.data)
        until = self._until(self.protocol.patience_s + self._wire_s((barrier,)))
        while (line := self._next_line(until, 1)) is not None:
            with contextlib.suppress(GarbledError, RefusedError):
                self.protocol.parse_answer(line, barrier)
                return
        raise GarbledError(f"nothing to {barrier.text!r}")

    def _next_line(self, until: float, lines: int) -> str | None:
        """A line, or None at `until`; but what has come in by then is read, however late it is looked at."""
        late = False
        while True:
            while b"\n" in self._input:
                line, self._input = self._input.split(b"\n", 1)
                if line.strip():
                    return line.strip().decode("ascii", "replace")
            if len(self._input) > LONGEST:
                self._input = b""
            if late:
                return None
            more = self._read(until, lines)
            late = not more and self.clock.now() >= until
            self._input += more

    def _until(self, patience_s: float) -> float:
        """When to wait no longer: of a robot whose wheels may turn before it must be told to stop."""
        return min(self.clock.now() + patience_s, self._latest)

    def _wire_s(self, requests: Sequence[Request]) -> float:
        return self.protocol.wire_ms(self.protocol.characters(*requests), self.baud) / 1000.0

    def _open(self) -> None:
        """Open the port, for this process alone, never blocking."""
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
            self._port = serial.Serial(self.device, self.baud, **settings)
        except (serial.SerialException, OSError) as error:
            raise UsageError(
                f"the port {self.device!r} cannot be opened: {why_not_opened(error)}; check the cable, the "
                "name, your right to use it (group dialout), and that no other program has it"
            ) from None


STEP_MS = 100.0
"""Length of one step, unless the profile says another."""

_READS = {"proximity": Request("N"), "ambient": Request("O")}


class Budget(NamedTuple):
    """What is asked at each step, and the time that it and the speed command take at most, ms."""

    reads: tuple[Request, ...]
    ms: float


def step_budget(
    protocol: Protocol, kinds: tuple[str, ...], baud: int | None, *, turns: bool = True,
    step_ms: float = STEP_MS,
) -> Budget:  # fmt: skip
    """The commands of one step: the sensors, then (if `turns`) counters and measured speeds where they fit.

    Without sensors it is the counters alone: one question, which takes a body no further in its time.
    Times are the worst case: command and answer one after the other, every number at its longest.

    Args:
        protocol: the line's.
        kinds: of sensors.
        baud: the line's; None: one that takes no time, as over a network.
        turns: whether counters and speeds are requested.
        step_ms: length of a step.

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
    if ms(baud, *reads) > step_ms:
        count = protocol.characters(*reads, fastest)
        enough = [f"{rate} baud or more" for rate in protocol.rates if ms(rate, *reads) <= step_ms]
        cure = f"set the robot to {enough[0]}" if enough else "no rate of its can: take longer steps"
        one = ", or read one kind of sensors" if len(reads) > 1 and ms(baud, reads[0]) <= step_ms else ""
        raise BaudError(
            f"{baud} baud cannot carry a {step_ms:g} ms loop with {' and '.join(read)} readings: "
            f"{' + '.join(one.letter for one in reads)} + D are up to {count} characters of "
            f"{protocol.bits} bits, {count} × {protocol.bits} / {baud} s = {ms(baud, *reads):.0f} ms; "
            f"{cure}{one}"
        )
    wheels = (protocol.counters, *protocol.measured) if kinds else (protocol.counters,)
    for asked in map(Request, wheels if turns else ()):
        if ms(baud, *reads, asked) <= step_ms:
            reads = (*reads, asked)
    return Budget(reads, ms(baud, *reads))


ANSWER_S = 0.1


class LineBody(WireBody):
    """A robot on a line of letters.

    Args:
        line: open, to a robot that is there.
        kinds: the sensors that are read at each step: "proximity", "ambient" or both.
        carry: the experimenter's hand, which brings the robot to a pose; without it `reset` takes
            the robot where it stands.

    Attributes:
        versions: by the names of `protocol.facts`; banner: what it said after a reset.

    Raises:
        LineError: it does not identify itself.
        BaudError: the line is too slow for these sensors in a loop of 100 ms.
    """

    protocol: ClassVar[Protocol]
    units: ClassVar[str]
    """Of its commands and speeds."""
    line: Line
    period_s = STEP_MS / 1000.0
    counts_turns = True
    _rests = False
    """Whether it is known to stand."""

    def __init__(
        self,
        line: Line,
        *,
        kinds: tuple[str, ...] = ("proximity",),
        carry: Callable[[Pose], None] | None = None,
    ) -> None:
        self._carry, self.baud = carry, line.baud
        self.attend(*kinds)
        self._identify(line)  # last: now it has a guard, which its user dismisses

    @classmethod
    def connect(
        cls,
        port: str,
        *,
        baud: int | None = None,
        kinds: tuple[str, ...] = ("proximity",),
        give_up_s: float = GIVE_UP_S,
        carry: Callable[[Pose], None] | None = None,
    ) -> Self:
        """The robot on a serial port, told to stop.

        Args:
            port: its device.
            baud: rate, bits a second; None: try all of the robot's.
            kinds, carry: as above.
            give_up_s: when a question that was not answered is given up.

        Raises:
            UsageError: the port cannot be opened, or is too slow for these sensors.
            LineError: no robot answers, or another robot: says what to check.
        """
        usual, others = cls.protocol.usual, cls.protocol.rates
        rates = (usual, *(rate for rate in others if rate != usual)) if baud is None else (baud,)
        odd = ""
        for rate in rates:
            line = Line(port, cls.protocol, baud=rate, give_up_s=give_up_s)
            try:
                body = cls(line, carry=carry)
            except RobotError:
                line.close()
                odd = odd or (line.odd if line.odd.isascii() and line.odd.isprintable() else "")
                continue
            return body.stopped(*kinds)
        if odd:
            raise LineError(
                f"{port}: expected {cls.protocol.robot} to answer, got {odd[:80]!r}; "
                "give the address of the robot that is there"
            )
        tried = f"{rates[0]} baud" if baud else "any of its rates"
        raise LineError(f"no {cls.protocol.robot} answers on {port} at {tried}; {cls.protocol.check}")

    def stopped(self, *kinds: str) -> Self:
        """The same once it was told to stop, reading these kinds of sensors, if any are given."""
        try:
            self.stop()
            if kinds:
                self.attend(*kinds)
        except BaseException:
            self.abandon()
            raise
        return self

    def _identify(self, line: Line) -> None:
        self.banner = tuple(line.wake())
        said = cast("tuple[str, ...]", line.ask(Request(self.protocol.version))[0])
        self.versions = dict(zip(self.protocol.facts, said, strict=True))
        WireBody.__init__(self, line)

    @property
    def odometry(self) -> Odometry:
        """As read with the last `sense`; what a slow line has no room for is None."""
        return self._odometry

    @property
    def facts(self) -> dict[str, Any]:
        """What a recording says of it."""
        port = {"robot": self.protocol.robot, "port": self.line.device}
        return {"units": self.units, **port, **self.versions}

    @property
    def wire_ms(self) -> float | None:
        """The time that a step takes on a serial line, at most."""
        return self.budget.ms if self.baud else None

    def attend(self, *kinds: str, turns: bool = True) -> None:
        """Read these kinds of sensors from now on, and what of counters and speeds a step has room for."""
        step_ms = 1000.0 * self.period_s
        self.budget = step_budget(self.protocol, kinds, self.baud, turns=turns, step_ms=step_ms)
        self._odometry = Odometry()

    def reset(self, pose: Pose | None = None) -> None:
        """Stop, be carried to `pose`, counters at zero."""
        if not self._rests:
            self.stop()
        if pose is not None and self._carry is not None:
            self._carry(pose)
        self._zero()

    def _zero(self) -> None:
        self.line.ask(self.protocol.request(self.protocol.set_counters, 0, 0))
        self._odometry = Odometry()

    def sense(self) -> Readings:
        """All of a step's questions, sent together."""
        answers = self.line.ask(*self.budget.reads)
        said = {read.letter: answer for read, answer in zip(self.budget.reads, answers, strict=True)}
        pairs = cast("dict[str, tuple[int, int]]", said)
        self._odometry = Odometry(pairs.get(self.protocol.counters), pairs.get("E"))
        return Readings(
            proximity=np.array(said.get("N", ()), np.float64), ambient=np.array(said.get("O", ()), np.float64)
        )

    def act(self, command: Command) -> None:
        """Wheel speeds from now on, in the robot's own units."""
        self._guard.watch()
        self.line.moving = True
        self.line.ask(self.protocol.request("D", command.left, command.right))

    def read(self, letter: str) -> tuple[int, ...]:
        """The numbers that answer a question, such as N: proximity, O: ambient light (counts)."""
        return cast("tuple[int, ...]", self.line.ask(self.protocol.request(letter))[0])

    def led(self, number: int, on: bool) -> None:
        """Switch an LED."""
        request = self.protocol.request("L", number, int(on))
        for _ in range(2):  # the line does not repeat L: 2 would change it twice; 0 and 1 would not
            with contextlib.suppress(LineError):
                self.line.ask(request)
                return
        self.line.ask(request)

    def _stands(self) -> bool:
        self.line.read_line(ANSWER_S)  # its answer, so that it is not taken for the next one's
        self.line.ask(STOP, give_up_s=self.line.give_up_s / 2)
        until = self.clock.now() + STAND_S
        while self.clock.now() < until:
            if self._is_still():
                return True
            self.clock.sleep_until(self.clock.now() + LOOK_S)
        return False

    @abstractmethod
    def _is_still(self) -> bool:
        """Whether its wheels are still, as far as it can tell."""
