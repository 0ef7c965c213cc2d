"""How far a study of noise is, and how long all that is left will take."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

__all__ = ["CALIBRATING", "COMPARING", "DRIVING", "EVOLVING", "NoiseProgress", "OnProgress", "Reporter"]

CALIBRATING, EVOLVING = "calibrating to the units", "evolving"
DRIVING, COMPARING = "on the twin", "comparing with the simulations"

EVERY_S = 0.2
FIRST_GUESS_S = 2.0
"""Before so much time is spent on work that is done nobody can say how long the rest takes."""


@dataclass(frozen=True, kw_only=True)
class NoiseProgress:
    """An event: `done` of `total` things of the phase; `seconds_left` of all phases, None if unknown."""

    phase: str
    done: int
    total: int
    what: str
    seconds_left: float | None = None


OnProgress = Callable[[NoiseProgress], None]


class Reporter:
    """Counts work, in about core-seconds, over all phases and tells it a few times a second at most.

    Args:
        tell: who is told.
        work: of each phase, what an earlier session did left out.
    """

    def __init__(self, tell: OnProgress | None, work: Mapping[str, float]) -> None:
        self._tell = tell or (lambda _: None)
        self._left = dict(work)
        self._done, self._total, self._phase, self._what = 0, 0, "", ""
        self._worked, self._spent = 0.0, 0.0
        self._last = self._told = time.monotonic()

    def phase(self, name: str, *, done: int, total: int, what: str) -> None:
        """A phase begins, of which so much is there already."""
        self._phase, self._done, self._total, self._what = name, done, total, what
        self._last = time.monotonic()
        self._say()

    def end(self) -> None:
        """The phase is over; what was thought to be left of it is not."""
        self._left[self._phase] = 0.0
        self._say()

    def add(self, work: float, *, done: int = 0) -> None:
        """So much more work is done, and so many things are ready."""
        now = time.monotonic()
        self._spent += now - self._last
        self._last = now
        self._worked += work
        self._left[self._phase] = max(0.0, self._left[self._phase] - work)
        self._done += done
        if now - self._told >= EVERY_S or self._done == self._total:
            self._say()

    def found(self, done: int, work_left: float) -> None:
        """So much of the phase was there already, which says nothing of how fast work goes."""
        self._left[self._phase] = min(self._left[self._phase], work_left)
        self._done, self._last = done, time.monotonic()
        self._say()

    def reach(self, done: int, work_left: float) -> None:
        """The phase's own count of what is ready, and of the work that is left of it."""
        self.add(max(0.0, self._left[self._phase] - work_left), done=done - self._done)

    def _say(self) -> None:
        self._told = time.monotonic()
        known = self._spent >= FIRST_GUESS_S and self._worked > 0
        left = sum(self._left.values()) * self._spent / self._worked if known else None
        self._tell(
            NoiseProgress(
                phase=self._phase, done=self._done, total=self._total, what=self._what, seconds_left=left
            )
        )
