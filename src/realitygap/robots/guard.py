"""The robot's guard: a small process that stops the wheels if the driver's process is killed or frozen.

It shares the driver's open line and hears from it over a socket. While the wheels may turn, each word
to the robot is a heartbeat for the guard: after a silence (Ctrl-Z, SIGSTOP, a controller that hangs),
and when the socket closes without a word (kill -9), it tells the robot to stop.

The guard echoes each heartbeat. A driver that hears none for 0.3 s, of a guard that is frozen, or that was
itself silent for longer than the guard allows, as all processes of a container that was paused, stops the
robot too. What stops both of them for good only a robot's own watchdog can meet.
"""

import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
import time

from realitygap.errors import FrozenError
from realitygap.work import child

__all__ = ["SILENCE_S", "Guard", "Watchdog"]

REPEATS = 5
PAUSE_S = 0.05
LEAVE_S = 2.0

SILENCE_S = 0.4
TICK_S = 0.05
"""A silence is seen a tick late at most, and ends within half a second."""
UNGUARDED_S, STEP_S, START_S = 0.3, 0.1, 10.0
"""The driver stops the robot when the guard has echoed nothing for so long; it beats once a step and more.
A drive begins once the guard has echoed its first word, which on a busy computer takes a while."""

DRIVES, STANDS, LEAVES, STOPPED = b"+", b"-", b".", b"!"
"""The driver's words, and the guard's beside the echo of the first."""

GONE, CHUNK = b"\0", 4096

_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)


def _now() -> float:
    """Seconds, those in which the computer slept too where the system counts them."""
    return time.clock_gettime(_CLOCK)


class Guard:
    """Watches over this process, for the line with descriptor `fd`; `stop` makes its robot stop.

    A simulated robot, whose time waits for this process, has no line (None): nobody watches.
    """

    def __init__(self, fd: int | None, stop: bytes) -> None:
        self._last: float | None = None
        self._echoed = 0.0
        self._process: subprocess.Popen[bytes] | None = None
        if fd is None:
            return
        self._socket, theirs = socket.socketpair()
        self._socket.setblocking(False)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "realitygap.robots.guard", str(theirs.fileno()), str(fd), stop.hex()],
                pass_fds=(theirs.fileno(), fd),
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )

    def watch(self) -> None:
        """From now on the wheels may turn: a silence stops them.

        Raises:
            FrozenError: nobody watches.
        """
        if self._last is None and self._process is not None:
            self._received()  # what was said after the last drive
            self._send(DRIVES)
            if not select.select([self._socket], [], [], START_S)[0]:  # it is just being started, say
                raise FrozenError(
                    f"the guard's process has not answered for {START_S:g} s; nothing is driven"
                )
            self._last = self._echoed = _now()

    def beat(self) -> None:
        """This process is alive; call it before each word to the robot.

        Raises:
            FrozenError: it did not for too long, or the guard is frozen or gone: the robot must stop.
        """
        if self._last is None:
            return
        now = _now()
        silent, before = now - self._last, self._last
        words = self._received()
        if not words and now - self._echoed > UNGUARDED_S:  # on a busy computer its turn may come now
            select.select([self._socket], [], [], TICK_S)
            words = self._received()
        if DRIVES in words:
            self._echoed = max(before, now - STEP_S)  # it came since then
        reason = None
        if STOPPED in words or silent > SILENCE_S:
            reason = (
                f"the drive was frozen for {silent:.1f} s (suspended, paused, or a controller that hung); "
                "the robot was stopped meanwhile, or is now, and this trial is over"
            )
        elif words.endswith(GONE):
            reason = "the guard's process has ended; no robot is driven without it"
        elif now - self._echoed > UNGUARDED_S:
            reason = (
                f"the guard's process has not answered for {now - self._echoed:.1f} s (suspended, or the "
                "computer is too busy); no robot is driven without it"
            )
        if reason is not None:
            self._last = None  # nobody watches any more
            raise FrozenError(reason)
        self._last = now
        self._send(DRIVES)

    def _received(self) -> bytes:
        """What the guard has said, with `GONE` at the end if it has ended."""
        try:
            return self._socket.recv(CHUNK) or GONE
        except BlockingIOError:
            return b""
        except ConnectionError:
            return GONE

    def rest(self) -> None:
        """The robot stands still: silence means nothing."""
        if self._process is not None:
            self._last = None
            self._send(STANDS)

    def release(self) -> None:
        """Dismiss the guard: the robot has stopped, or is no longer ours."""
        if self._process is not None:
            self._send(LEAVES)
            self._socket.close()
            child.end(self._process, LEAVE_S)
            self._process = self._last = None

    def _send(self, word: bytes) -> None:
        with contextlib.suppress(OSError):
            self._socket.send(word)


class Watchdog:
    """How long the driver has said nothing while its wheels may turn.

    Only time that the guard has lived through counts, a tick at a time: on a computer that stood still
    as a whole the driver is heard first.
    """

    def __init__(self) -> None:
        self.watched = False
        self._seconds = 0.0

    def hear(self, words: bytes) -> None:
        """The driver's words; the last one says how things are."""
        self.watched, self._seconds = words.endswith(DRIVES), 0.0

    def expired(self, seconds: float) -> bool:
        """Whether it is too long, some seconds later; True only once."""
        self._seconds += min(seconds, 2 * TICK_S)
        if not self.watched or self._seconds < SILENCE_S:
            return False
        self.watched = False
        return True


def guard(driver: socket.socket, line: int, stop: bytes) -> None:
    """Hear the driver until it leaves or dies; tell the robot to stop when it must."""
    silence, last = Watchdog(), time.monotonic()
    while True:
        ready, _, _ = select.select([driver], [], [], TICK_S if silence.watched else None)
        passed, last = time.monotonic() - last, time.monotonic()
        if not ready:
            if silence.expired(passed):
                with contextlib.suppress(OSError):
                    driver.send(STOPPED)  # first, so that it is there when the driver goes on
                _stop(line, stop, "heard nothing from the driver for half a second")
            continue
        words = _received(driver)
        if LEAVES in words:
            return
        if not words:
            _stop(line, stop, "the driver is gone")
            return
        silence.hear(words)
        with contextlib.suppress(OSError):
            driver.send(DRIVES)


def _received(driver: socket.socket) -> bytes:
    try:
        return driver.recv(CHUNK)
    except OSError:
        return b""


def _stop(line: int, stop: bytes, why: str) -> None:
    for k in range(REPEATS):
        with contextlib.suppress(OSError):
            os.write(line, stop)
        if k == 0:
            with contextlib.suppress(OSError):
                os.write(2, f"guard: {why}; the robot was told to stop\n".encode())
        time.sleep(PAUSE_S)


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    guard(socket.socket(fileno=int(sys.argv[1])), int(sys.argv[2]), bytes.fromhex(sys.argv[3]))
