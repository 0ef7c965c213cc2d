"""How far a study is, told now and then."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["COMPILING", "EVOLVING", "FINISHED", "TESTING", "OnProgress", "Progress", "Reporter"]

COMPILING = "compiling (once)"
EVOLVING = "evolving"
TESTING = "testing"
FINISHED = "finished already"

EVERY_S = 0.2
"""Shortest time between two events of one phase."""


@dataclass(frozen=True, kw_only=True)
class Progress:
    """An event.

    Attributes:
        phase: "compiling (once)", "evolving", then "testing" (of individuals, when all evaluations are
            done); or "finished already", of a study that is resumed for nothing.
        done, total: evaluations, those of earlier sessions included.
        evaluations_per_second: since this session began to evolve; 0 before.
        runs_done, runs_total: finished runs, tests included.
        seconds_left: until all runs are finished, tests included; None while unknown.
    """

    phase: str
    done: int
    total: int
    evaluations_per_second: float = 0.0
    runs_done: int = 0
    runs_total: int = 0
    seconds_left: float | None = None


OnProgress = Callable[[Progress], None]


class Reporter:
    """Counts what is done and tells it, a few times a second at most."""

    def __init__(self, on_progress: OnProgress | None, *, runs: int, evaluations: int) -> None:
        self._tell = on_progress or (lambda _: None)
        self._runs, self._total = runs, runs * evaluations
        self._done = self._runs_done = self._new = 0
        self._left = self._work = 0.0
        self._began = self._last = -1e9

    def start(self, *, done: int, runs_done: int, work: float) -> None:
        """The state of things before the first new evaluation; `work` in any unit of cost."""
        self._done, self._runs_done, self._left = done, runs_done, work
        self._tell(self._event(COMPILING if runs_done < self._runs else FINISHED))

    def begin(self) -> None:
        """Compiled: the clock runs from now on."""
        self._began = time.monotonic()
        self._tell(self._event(EVOLVING))

    def add(self, *, evaluations: int = 0, runs: int = 0, work: float) -> None:
        """So much more is done."""
        self._done += evaluations
        self._new += evaluations
        self._runs_done += runs
        self._work += work
        self._left -= work
        now = time.monotonic()
        if now - self._last >= EVERY_S or self._runs_done == self._runs:
            self._last = now
            self._tell(self._event(TESTING if self._done == self._total else EVOLVING))

    def _event(self, phase: str) -> Progress:
        spent = max(time.monotonic() - self._began, 1e-9) if self._began > 0 else 0.0
        return Progress(
            phase=phase,
            done=self._done,
            total=self._total,
            evaluations_per_second=self._new / spent if spent else 0.0,
            runs_done=self._runs_done,
            runs_total=self._runs,
            seconds_left=max(self._left, 0.0) * spent / self._work if self._work else None,
        )
