"""How far a study is: a live line on a terminal, a plain line now and then elsewhere. On stderr."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import click

if TYPE_CHECKING:
    from realitygap.study.runner import Progress

__all__ = ["ProgressLine", "clock"]

PLAIN_EVERY_S = 5.0
"""Time between two lines where stderr is no terminal."""


class ProgressLine:
    """A context in which progress events become something to look at."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._job: Any = None
        self._phase = ""
        self._next = 0.0

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn

            columns = [
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.completed:.0f}/{task.total:.0f}"),
                TextColumn("{task.fields[pace]}"),
            ]
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._bar.start()
            self._job = self._bar.add_task("starting", total=None, pace="")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, event: Progress) -> None:
        """Show one event."""
        if self._bar is not None:
            self._bar.update(
                self._job,
                description=event.phase,
                completed=event.done,
                total=max(event.total, 1),
                pace=pace(event),
            )
            return
        now = time.monotonic()
        finished = event.done >= event.total
        if event.phase != self._phase or finished or now >= self._next:
            self._phase, self._next = event.phase, now + PLAIN_EVERY_S
            click.echo(f"{event.phase}: {event.done}/{event.total}, {pace(event)}", err=True)


def pace(event: Progress) -> str:
    """Evaluations a second and the time left, in words."""
    rate = event.evaluations_per_second
    if rate <= 0:
        return "…"
    left = max(event.total - event.done, 0) / rate
    return f"{rate:,.0f} evaluations/s, {clock(left)} left"


def clock(seconds: float) -> str:
    """A length of time as h:mm:ss or m:ss."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
