"""Signals while a robot drives: turned into an exception, held back while it is stopped."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from types import FrameType

from realitygap.errors import RobotStoppedError

__all__ = ["MOVING", "NUMBERS", "Stopping", "heed", "undisturbed"]

NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
MOVING = (*NUMBERS, signal.SIGTSTP)
"""While a robot moves whose time does not wait: it must stop before this process is suspended."""

PATIENCE_S = 5.0
"""A robot has this long to stop; then the next signal ends the wait."""

_active: list[Stopping] = []
"""Contexts within which the main thread is, which handle all of `NUMBERS`: signals are a process's own."""


def undisturbed() -> AbstractContextManager[None]:
    """Within it no signal interrupts the main thread; one that came has its effect at the end.

    For exchanges that both ends count: half of one would leave them out of step. While a robot drives it
    costs no system call: its `Stopping` holds back what comes.
    """
    if threading.current_thread() is not threading.main_thread():
        return nullcontext()
    return _active[-1].held() if _active else _put_off()


@contextmanager
def _put_off() -> Iterator[None]:
    """The same where nothing else holds signals back."""
    missed: list[tuple[int, FrameType | None]] = []
    before = {n: signal.signal(n, lambda number, frame: missed.append((number, frame))) for n in NUMBERS}
    try:
        yield
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)
        if missed:
            _again(*missed[0], before[signal.Signals(missed[0][0])])


def heed() -> None:
    """Raise again a signal's exception that was caught on its way: by `except Exception` in a user's robot.

    Raises:
        RobotStoppedError: as at first.
    """
    for one in _active:
        if one.first is not None:
            raise _stopped(one.first)


class Stopping:
    """As a context, in the main thread: each of the signals raises RobotStoppedError.

    SIGTSTP (Ctrl-Z) suspends the process at the context's end, and the error goes on after `fg`. While the
    robot is stopped they wait, but not for ever: a user's driver may hang.
    """

    def __init__(self, numbers: Sequence[signal.Signals] = NUMBERS) -> None:
        self._numbers = numbers
        self._suspend = False
        self._held = False
        self._missed: int | None = None
        self._since: float | None = None
        self.first: int | None = None
        self._before: dict[signal.Signals, object] = {}

    def __enter__(self) -> Stopping:
        if threading.current_thread() is threading.main_thread():
            for number in self._numbers:
                if number == signal.SIGTSTP and signal.getsignal(number) == signal.SIG_IGN:
                    continue  # a shell without job control
                self._before[number] = signal.signal(number, self._arrived)
        if self._before.keys() >= set(NUMBERS):
            _active.append(self)
        return self

    def __exit__(self, *error: object) -> None:
        if self in _active:
            _active.remove(self)
        for number, handler in self._before.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
        self._before.clear()
        if self._suspend:
            signal.raise_signal(signal.SIGTSTP)

    def held(self) -> AbstractContextManager[None]:
        """Within it no signal interrupts; one that came is raised at its end, if nothing else is."""
        return _Held(self)

    def hold(self) -> bool:
        """Let no signal interrupt; returns whether that was so before."""
        before, self._held = self._held, True
        return before

    def release(self, before: bool, error: object) -> None:
        """As it was before; a signal that came is raised now, unless an error is on its way."""
        self._held = before
        if self._missed is not None and not before and error is None:
            self._held = True
            raise _stopped(self._missed)

    def _arrived(self, number: int, frame: FrameType | None) -> None:
        self._suspend |= number == signal.SIGTSTP
        self._since = time.monotonic() if self._since is None else self._since
        if self._held:
            self._missed = number
            if time.monotonic() - self._since >= PATIENCE_S:
                raise RobotStoppedError(f"{_name(number)} again: the robot has not confirmed that "
                                        "it stopped. Check it, or switch it off")  # fmt: skip
            return
        self._held, self.first = True, number  # it stops the robot; what follows must not disturb that
        raise _stopped(number)


class _Held:
    """`Stopping.held`: entered several times a step, which a generator makes ten times as slow."""

    def __init__(self, stopping: Stopping) -> None:
        self._stopping = stopping

    def __enter__(self) -> None:
        self._before = self._stopping.hold()

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        self._stopping.release(self._before, error)


def _stopped(number: int) -> RobotStoppedError:
    if number == signal.SIGTSTP:
        return RobotStoppedError("suspended; the robot was told to stop first, and the drive is over")
    return RobotStoppedError(f"stopped by {_name(number)}; the robot was told to stop first")


def _name(number: int) -> str:
    return signal.Signals(number).name


def _again(number: int, frame: FrameType | None, handler: object) -> None:
    """What a signal would have done had it not been held back."""
    if callable(handler):
        handler(number, frame)
    elif handler == signal.SIG_DFL:
        signal.raise_signal(number)
