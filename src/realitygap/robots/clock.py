"""Time for a body: the real clock sleeps, a stepped one advances a simulation, the virtual one a twin.

The conversation on the serial line is the same under both: nothing on it speaks of steps. The
virtual clock tells the twin over a second channel, a Unix socket, how far time may run:

    run UNTIL_NS BYTES LINES     BYTES were written to the line now; run until UNTIL_NS, or until
                                 the robot has put out LINES lines (0: no matter how many)
    at NOW_NS BYTES              the answer: the time now, and how many bytes were put out

Both sides count bytes, so that no result depends on how fast a pseudo-terminal hands them on. Messages
that need no answer at once are sent with the next one that does: a step of a loop is one exchange.
"""

import math
import os
import select
import socket
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Protocol

from realitygap.errors import LineError
from realitygap.robots.signals import undisturbed
from realitygap.work import child

__all__ = ["Clock", "RealClock", "SteppedClock", "VirtualClock"]

CHUNK = 4096
PATIENCE_S = 3.0
"""Real time to wait for bytes that were announced: after it they are lost."""

ROUNDING_S = 1e-6
"""A time this little before a step's counts as that step's."""

TWIN_LOST_S = 120.0
"""Real time after which a twin that does not answer on its channel is given up."""


class Clock(Protocol):
    """What a loop needs of a clock, s."""

    waits: bool
    """Whether it stands still while this process does."""

    def now(self) -> float:
        """The time; only differences mean anything."""

    def sleep_until(self, time_s: float) -> None:
        """Let time pass."""


class RealClock:
    """The computer's own; with what a driver on a line also needs of a clock."""

    waits = False

    def now(self) -> float:
        """Seconds since some moment."""
        return time.monotonic()

    def sleep_until(self, time_s: float) -> None:
        """Sleep."""
        left = time_s - time.monotonic()
        if left > 0:
            time.sleep(left)

    def settle(self) -> None:
        """Return when everything up to now has happened."""

    def wrote(self, count: int) -> None:
        """So many bytes have just been written to the line."""

    def read(self, fd: int, *, until: float, lines: int) -> bytes:
        """What comes in: at the first bytes or after `lines` lines, nothing if none by `until`."""
        if not _ready(fd, max(0.0, until - time.monotonic())):
            return b""
        return _read(fd, CHUNK)

    def fetch(self, fd: int) -> bytes:
        """The input so far."""
        return _read(fd, CHUNK) if _ready(fd, 0.0) else b""

    def forget(self, fd: int) -> None:
        """Drop the input so far."""
        while _ready(fd, 0.0):
            _read(fd, CHUNK)

    def undisturbed(self) -> AbstractContextManager[None]:
        """Around an exchange that no signal may cut in half; a robot's line is brought into step again."""
        return nullcontext()

    def close(self) -> None:
        """Release the clock."""


class SteppedClock:
    """A simulated body's time, s, in which nothing is ever late: it advances by whole steps.

    Args:
        step: advances the simulation by one step.
        period_s: how long that is.
    """

    waits = True

    def __init__(self, step: Callable[[], None], period_s: float) -> None:
        self._step, self._period_s = step, period_s
        self._now = 0.0
        self._begun = 0.0
        self._steps = 0

    def now(self) -> float:
        """Seconds since the body was made."""
        return self._now

    def sleep_until(self, time_s: float) -> None:
        """Advance the simulation by the steps that are due."""
        self._now = max(self._now, time_s)
        due = math.floor((self._now - self._begun + ROUNDING_S) / self._period_s)
        while self._steps < due:
            self._steps += 1
            self._step()

    def begin_step(self) -> None:
        """The robot has been set down: its steps are counted from now on."""
        self._begun, self._steps = self._now, 0


class VirtualClock(RealClock):
    """A twin's time, which runs only as far as this clock allows.

    Args:
        channel: path of the twin's socket.
    """

    waits = True

    def __init__(self, channel: str) -> None:
        self.channel = channel
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        child.give_up_after(self._socket, TWIN_LOST_S)
        try:
            self._socket.connect(channel)
        except OSError as error:
            self._socket.close()
            raise LineError(f"no twin on the clock channel {channel!r}: {error.strerror}") from None
        self._now_ns = 0
        self._unsent = self._replies = b""
        self._owed = self._written = self._announced = 0
        self._dropping = False
        self._run(0, 0)
        self.settle()

    def now(self) -> float:
        """Seconds since the twin was switched on."""
        return self._now_ns / 1e9

    def sleep_until(self, time_s: float) -> None:
        """Let the twin run on by itself; it is told with the next message that is waited for."""
        until = round(time_s * 1e9)
        if until > self._now_ns:
            with self.undisturbed():
                self._run(until, 0)
                self._now_ns = until

    def settle(self) -> None:
        """Wait until the twin's time is as far as it was told."""
        with self.undisturbed():
            if self._written:
                self._run(self._now_ns, 0)
            self._catch_up()

    def _catch_up(self, owed: int = 0) -> None:
        """Send what waits to be sent, and take the answers until only so many are owed."""
        self._send()
        while self._owed > owed:
            self._take_reply()

    def undisturbed(self) -> AbstractContextManager[None]:
        """Both ends count bytes: half an exchange would leave them out of step for good."""
        return undisturbed()

    def wrote(self, count: int) -> None:
        """The twin is told with the next message."""
        self._written += count

    def read(self, fd: int, *, until: float, lines: int) -> bytes:
        """Let the twin run until it has put out `lines` lines; all that it has put out."""
        self._run(max(int(until * 1e9) + 1, self._now_ns), lines)  # + 1: surely past `until`
        if self._dropping:
            self._catch_up(owed=1)
            self._collect(fd)
            self._dropping = False
        return self.fetch(fd)

    def fetch(self, fd: int) -> bytes:
        """All that the twin has put out up to now."""
        self._catch_up()
        return self._collect(fd)

    def forget(self, fd: int) -> None:
        """What the twin has put out so far is dropped when the next answer is fetched."""
        self._dropping = True

    def close(self) -> None:
        """Close the channel: the twin's time stops where somebody waited for it last."""
        self._socket.close()

    def _run(self, until_ns: int, lines: int) -> None:
        self._unsent += b"run %d %d %d\n" % (until_ns, self._written, lines)
        self._written = 0
        self._owed += 1

    def _send(self) -> None:
        unsent, self._unsent = self._unsent, b""
        try:
            if unsent:
                self._socket.sendall(unsent)
        except OSError as error:
            raise LineError(f"the twin is gone from its clock channel: {error.strerror}") from None

    def _take_reply(self) -> None:
        while b"\n" not in self._replies:
            try:
                data = self._socket.recv(CHUNK)
            except OSError as error:
                self.close()
                why = f" for {TWIN_LOST_S:g} s" if isinstance(error, BlockingIOError) else f": {error}"
                raise LineError(f"the twin does not answer on its clock channel{why}") from None
            if not data:
                raise LineError("the twin is gone: it has closed its clock channel")
            self._replies += data
        reply, self._replies = self._replies.split(b"\n", 1)
        self._owed -= 1
        word, _, rest = reply.decode("utf-8", "replace").partition(" ")
        if word != "at":
            self.close()
            raise LineError(f"the clock channel {self.channel!r} says: {rest or word}")
        now_ns, count = map(int, rest.split())
        self._now_ns = now_ns
        self._announced += count

    def _collect(self, fd: int) -> bytes:
        """The bytes that the twin has announced."""
        data = b""
        while len(data) < self._announced and _ready(fd, PATIENCE_S):
            data += _read(fd, self._announced - len(data))
        self._announced = 0
        return data


def _ready(fd: int, timeout_s: float) -> bool:
    try:
        return bool(select.select([fd], [], [], timeout_s)[0])
    except (OSError, ValueError) as error:
        raise LineError(f"the line is lost: {error}") from None


def _read(fd: int, size: int) -> bytes:
    try:
        data = os.read(fd, size)
    except BlockingIOError:
        return b""
    except OSError as error:
        raise LineError(f"the line is lost: {error.strerror}") from None
    if not data:
        raise LineError("the line is lost: the device has hung up")
    return data
