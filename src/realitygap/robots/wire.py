"""A robot at the end of a wire, whatever is spoken on it: the open port, and how it is stopped."""

import contextlib
import os
import select
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

from realitygap.errors import LineError, RealityGapError, RobotError
from realitygap.robots.body import Body, Clock
from realitygap.robots.guard import Guard

__all__ = ["LOOK_S", "STALL_S", "STAND_S", "WAIT_S", "Wire", "WireBody", "why_not_opened"]

CHUNK = 4096

STALL_S, WAIT_S = 0.35, 5.0
"""A robot whose wheels may turn and that has not answered for so long is told to stop, before its guard
would; it may take so long altogether to answer again. Of 4051 steps of e-puck2s over WiFi, 99 % took
0.31 s at most, the longest 2.19 s."""

BEAT_S = 0.1
"""How often whoever waits for an answer says so to the guard."""


def why_not_opened(error: Exception) -> str:
    """What the system says of a port or an address."""
    number = getattr(error, "errno", None) or 0  # below 0: of a name that nobody knows
    return os.strerror(number) if number > 0 else str(error)


class Wire:
    """An open port, whatever is spoken on it.

    Attributes:
        stop_message: what stops the robot, whatever it was sent before.
        faults: how many answers did not come in time or were not understood.
        before: called before each word that is sent, and now and then while an answer is waited for.
        moving: whether the wheels may turn: then a stall stops them.
        stalls: how long each stall took, s.
    """

    stop_message: bytes
    _port: Any

    def __init__(self, device: str, clock: Clock) -> None:
        self.device, self.clock, self.faults = device, clock, 0
        self.before: Callable[[], None] = lambda: None
        self.moving, self.stalls = False, list[float]()
        self._input = b""

    def fileno(self) -> int:
        """The port's file descriptor."""
        return int(self._port.fileno())

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._port.close()

    def write(self, data: bytes) -> None:
        """Send bytes without waiting.

        Raises:
            LineError: the line is lost.
        """
        self.before()
        self._send(data)

    def discard_input(self) -> None:
        self._input = b""
        while self._read(self.clock.now(), 0):
            pass

    def _send(self, data: bytes) -> None:
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
        left = max(0.0, until - self.clock.now())
        try:
            while not select.select([self.fileno()], [], [], min(left, BEAT_S))[0]:
                left -= BEAT_S
                if left <= 0.0:
                    return b""
                self.before()
            data = os.read(self.fileno(), CHUNK)
        except BlockingIOError:
            return b""
        except (OSError, ValueError, TypeError) as error:
            raise LineError(f"the line is lost: {getattr(error, 'strerror', None) or error}") from None
        if not data:
            raise LineError("the line is lost: the device has hung up")
        return data


STOP_S, STOP_TRIES = 1.4, 2
"""The robot is told to stop for this long, and at least this often."""

STAND_S, LOOK_S = 0.5, 0.02
"""Time that the wheels may take to stop, and from one look at them to the next."""

LED_S = 0.2


class WireBody(Body):
    """A body at the end of a wire, watched by a guard.

    From `act` to `stop` something must be asked or told twice a second, or the guard stops the robot, and the
    next word raises a `FrozenError`. Under a clock that waits nothing is needed.

    Args:
        line: the robot's; `close` closes it.
    """

    leds = 0
    """How many it has, which `led` switches."""

    def __init__(self, line: Wire) -> None:
        self.line, self.clock = line, line.clock
        self._guard = Guard(None if line.clock.waits else line.fileno(), line.stop_message)
        line.before = self._guard.beat

    def pace(self, period_s: float) -> None:
        """Take steps of this length from now on; what a line carries in one follows with `attend`."""
        self.period_s = period_s

    @abstractmethod
    def _stands(self) -> bool:
        """Whether it confirms that it was told to stop, and its wheels are still, now or soon."""

    def led(self, number: int, on: bool) -> None:
        """Switch an LED."""

    @property
    def stalls(self) -> Sequence[float]:  # type: ignore[override]
        """How long each stall of its line took, s."""
        return tuple(self.line.stalls)

    def stop(self) -> None:
        """Stop, and make sure of it.

        The command is sent before anything else is read or asked, repeatedly if needed.

        Raises:
            LineError: the robot did not confirm: it may still be moving.
        """
        failure: RealityGapError | None = None
        self.line.moving = False
        until, tries = self.clock.now() + STOP_S, 0
        while tries < STOP_TRIES or self.clock.now() < until:
            tries += 1
            try:
                self.line.write(self.line.stop_message)
                if self._stands():
                    self._guard.rest()
                    return
                failure = RobotError("its wheels still turn")
            except RobotError as error:
                failure = error
            self.clock.sleep_until(self.clock.now() + LOOK_S)
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
        self.line.before = lambda: None
        self.line.close()
        self._guard.release()

    def inspect(self) -> dict[str, Any]:
        """Switch its LEDs on and off, and count the requests repeated so far."""
        for on in (True, False) if self.leds else ():
            for number in range(self.leds):
                self.led(number, on)
            self.clock.sleep_until(self.clock.now() + LED_S)
        return {**({"leds": "answered"} if self.leds else {}), "faults": self.line.faults}
