"""A serial line on which some of what is sent may be lost, duplicated, garbled or late.

A question is asked again until its answer is understood. Before that the line is brought back into
step: a line end closes whatever half line the robot holds, and the answer to `B`, which nothing
else asks for, shows that everything older has passed. (`B` is the Khepera's; a dialect names its own.)
"""

from __future__ import annotations

import contextlib
import os
import select
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from realitygap.errors import LineError, UsageError
from realitygap.robots.clock import Clock, RealClock
from realitygap.robots.line.protocol import Dialect, GarbledError, RefusedError, Request

if TYPE_CHECKING:
    import serial

__all__ = ["GIVE_UP_S", "STOP", "Answer", "Line", "Wire", "nothing", "why_not_opened"]

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
        dialect: what the robot there understands.
        baud: its rate; 8 data bits, no parity. None: it is no serial one.
        clock: the clock of the time-outs.
        give_up_s: when a question is given up that was asked five times and more.
    """

    def __init__(
        self,
        device: str,
        dialect: Dialect,
        *,
        baud: int | None,
        clock: Clock | None = None,
        give_up_s: float = GIVE_UP_S,
    ) -> None:
        super().__init__(device, clock or RealClock())
        self.dialect, self.baud, self.give_up_s = dialect, baud, give_up_s
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
        once = next((r for r in requests if not self.dialect.commands[r.letter].repeatable), None)
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
            self.tell(self.dialect.wake)
        while len(banner) < 2 and (text := self.hear(BANNER_S)) is not None:
            banner.append(text)
        return banner

    @property
    def halt(self) -> bytes:
        """What stops the robot, whatever it was told before."""
        return self.dialect.wake + STOP.data

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
        until = self.clock.now() + self.dialect.patience_s + self._wire_s(requests)
        answers: list[Answer] = []
        for request in requests:
            line = self._next_line(until, len(requests) - len(answers))
            if line is None:
                raise GarbledError(f"nothing to {request.text!r}")
            self.odd = line
            answers.append(self.dialect.parse_answer(line, request))
            self.odd = ""
        return answers

    def _resynchronise(self) -> None:
        """Bring the line back into step.

        Raises:
            GarbledError: no answer came.
        """
        until = self.clock.now() + self.dialect.patience_s
        while self.clock.now() < until and self.hear(QUIET_S) is not None:
            pass
        self.forget()
        barrier = Request(self.dialect.barrier)
        self.tell(self.dialect.wake + barrier.data)
        until = self.clock.now() + self.dialect.patience_s + self._wire_s((barrier,))
        while (line := self._next_line(until, 1)) is not None:
            with contextlib.suppress(GarbledError, RefusedError):
                self.dialect.parse_answer(line, barrier)
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
        return self.dialect.wire_ms(self.dialect.characters(*requests), self.baud) / 1000.0

    def _opened(self) -> serial.Serial:
        """The port, for this process alone, never blocking.

        Raises:
            UsageError: no such device, no right to it, or another program has it.
        """
        import serial

        rates = self.dialect.rates
        if self.baud not in rates:
            raise UsageError(f"the robot's baud rates are {', '.join(map(str, rates))}; got {self.baud}")
        settings = {"stopbits": self.dialect.stop_bits, "timeout": 0, "write_timeout": 0.5, "exclusive": True}
        try:
            return serial.Serial(self.device, self.baud, **settings)
        except (serial.SerialException, OSError) as error:
            raise UsageError(
                f"the port {self.device!r} cannot be opened: {why_not_opened(error)}; check the cable, the "
                "name, your right to use it (group dialout), and that no other program has it"
            ) from None
