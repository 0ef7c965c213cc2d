"""Progress, reported now and then: one event and one reporter for all kinds of work."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from realitygap.errors import UsageError

__all__ = ["OnProgress", "Progress", "Reporter"]

EVERY_S = 0.2
"""Shortest time between two events of one phase."""


@dataclass(frozen=True, kw_only=True)
class Progress:
    """An event.

    Attributes:
        phase: what is being done.
        done, total: things of the phase, those of earlier sessions included.
        what: they are, such as "trials".
        seconds_left: of all phases; None while unknown.
        runs_done, runs_total: finished runs of evolution, tests included.
        evaluations_per_second: since this session began to evolve; 0 before.
    """

    phase: str
    done: int
    total: int
    what: str = ""
    seconds_left: float | None = None
    runs_done: int = 0
    runs_total: int = 0
    evaluations_per_second: float = 0.0


OnProgress = Callable[[Progress], None]


class Reporter:
    """Counts work, in about core-seconds or any other unit, and tells it a few times a second at most.

    Args:
        tell: called with each event.
        work: of each phase, what an earlier session did left out.
        patience_s: the time left is estimated once this much time has been spent on work.

    Raises:
        UsageError: `tell` cannot be called.
    """

    def __init__(
        self, tell: OnProgress | None, work: Mapping[str, float], *, patience_s: float = 0.0
    ) -> None:
        given: object = tell
        if given is not None and not callable(given):
            raise UsageError(
                f"on_progress: expected a function of one event, got {given!r}. Give one, or leave it out."
            )
        self._tell = tell or (lambda _: None)
        self._left = dict(work)
        self._patience = patience_s
        self._event: dict[str, Any] = {"phase": "", "done": 0, "total": 0}
        self._worked, self.spent = 0.0, 0.0
        self._last = self._told = time.monotonic()

    def phase(self, name: str, *, done: int, total: int, what: str = "", **more: Any) -> None:
        """Start a phase, of which part may already be done; `more` is for the event.

        Args:
            name: the phase's.
            done: how much of it is there already.
            total: how much there is.
            what: of which things.
            more: for the event.
        """
        self._event |= {"phase": name, "done": done, "total": total, "what": what, **more}
        self._last = time.monotonic()
        self._say()

    def end(self) -> None:
        """End the phase; nothing of it is left."""
        self._left[self._event["phase"]] = 0.0
        self._say()

    def add(self, work: float, *, done: int = 0, of: str | None = None, **more: Any) -> None:
        """Add work done, of this phase or of another, and things that are ready."""
        now = time.monotonic()
        self.spent += now - self._last
        self._last = now
        self._worked += work
        phase = of or self._event["phase"]
        self._left[phase] = max(0.0, self._left[phase] - work)
        self._event |= {"done": self._event["done"] + done, **more}
        if now - self._told >= EVERY_S or self._event["done"] == self._event["total"]:
            self._say()

    def found(self, done: int, work_left: float) -> None:
        """Count part of the phase as already there, which says nothing about the speed of work."""
        phase = self._event["phase"]
        self._left[phase] = min(self._left[phase], work_left)
        self._event["done"], self._last = done, time.monotonic()
        self._say()

    def reach(self, done: int, work_left: float) -> None:
        """The phase's own count of what is ready, and of the work that is left of it."""
        left = self._left[self._event["phase"]]
        self.add(max(0.0, left - work_left), done=done - self._event["done"])

    def _say(self) -> None:
        self._told = time.monotonic()
        known = self.spent > 0 and self.spent >= self._patience and self._worked > 0
        left = sum(self._left.values()) * self.spent / self._worked if known else None
        self._tell(Progress(**self._event, seconds_left=left))
