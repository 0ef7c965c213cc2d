"""Progress: a live line on a terminal, a plain line now and then elsewhere. On stderr."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import click

if TYPE_CHECKING:
    from realitygap.work.progress import Progress

__all__ = ["FILM_AFTER_S", "ProgressLine", "clock"]

PLAIN_EVERY_S = 5.0
"""Time between two lines of one phase where stderr is no terminal."""
FILM_AFTER_S = 2.0
"""Shorter work on a film shows no progress."""


class ProgressLine:
    """A context in which progress becomes something to look at.

    Attributes:
        after_s: nothing is shown before the first event that comes this long after the start;
            None: something is shown from the beginning on.
    """

    def __init__(self, after_s: float | None = None) -> None:
        self.after_s = after_s
        self._begun = time.monotonic()
        self._open = False
        self._bar: Any = None
        self._job: Any = None
        self._phase = ""
        self._places: dict[str, tuple[int, int]] = {}
        self._next = 0.0
        self._spent: dict[str, float] = {}
        self._timed, self._since = "", self._begun

    def __enter__(self) -> Self:
        if self.after_s is None:
            self._begin()
        return self

    def _begin(self) -> None:
        self._open = True
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn

            columns = [
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.completed:.0f}/{task.total:.0f}"),
                TextColumn("{task.fields[says]}"),
            ]
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._bar.start()
            self._job = self._bar.add_task("starting", total=1, says="")
        elif _in_notebook():
            self._bar = _NotebookBar(self)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def show(self, event: Progress) -> None:
        """Show how far a study, a transfer or an experiment is."""
        says = [f"{event.runs_done}/{event.runs_total} runs" if event.runs_total else event.what]
        if event.evaluations_per_second > 0:
            says.append(f"{event.evaluations_per_second:,.0f} evaluations/s")
        if event.seconds_left is not None:
            says.append(f"{clock(event.seconds_left)} left")
        finished = (event.done, event.runs_done) == (event.total, event.runs_total)
        self._show(event.phase, event.done, event.total, ", ".join(says), finished)

    def places(self, name: str, done: int, total: int) -> None:
        """Show how far a recording is."""
        self._show(f"recording {name}", done, total, "places", done == total)

    def calibrating(self, name: str, done: int, total: int) -> None:
        """Show how far the recordings for a calibration are, several at a time, or that it is fitted."""
        if name == "fit":
            self._show("fitting the simulation to the recordings", done, total, "", done == total)
            return
        self._places[name] = (done, total)
        made, places = (sum(numbers) for numbers in zip(*self._places.values(), strict=True))
        self._show("recording the robot", made, places, "places", False)

    def marks(self, done: int, total: int) -> None:
        """Show how far the scoring is."""
        self._show("scoring behaviour", done, total, "runs", done == total)

    def frames(self, phase: str, done: int, total: int | None) -> None:
        """Show how many frames of a film are done; None: it is unknown how many it has."""
        whole = max(total or done, done)
        self._show(phase, done, whole, "frames", done == whole)

    def report(self, done: int, total: int, name: str) -> None:
        """Show how far a report is."""
        self._show("making the report", done, total, "figures", done == total)

    def took(self) -> str:
        """How long all took until now, and each phase of it."""
        self._time("")
        self._spent.pop("", None)  # it was asked before
        total = clock(sum(self._spent.values()))
        return f"took {total}: " + ", ".join(f"{phase} {clock(s)}" for phase, s in self._spent.items())

    def _time(self, phase: str) -> None:
        """What passed since the last time belongs to the phase that was shown then, or to the first."""
        now = time.monotonic()
        before = self._timed or phase
        self._spent[before] = self._spent.get(before, 0.0) + now - self._since
        self._timed, self._since = phase, now

    def _show(self, phase: str, done: int, total: int, says: str, finished: bool) -> None:
        self._time(phase)
        if not self._open:
            if time.monotonic() - self._begun < (self.after_s or 0.0):
                return
            self._begin()
        if self._bar is not None:
            self._bar.update(self._job, description=phase, completed=done, total=max(total, 1), says=says)
            return
        now = time.monotonic()
        if phase != self._phase or finished or now >= self._next:
            self._phase, self._next = phase, now + PLAIN_EVERY_S
            click.echo(f"{phase}: {done}/{total}{', ' * bool(says)}{says}", err=True)


class _NotebookBar:
    """A bar in a notebook's cell, in the place of rich's, which would need ipywidgets; at the end how long
    each phase took."""

    def __init__(self, line: ProgressLine) -> None:
        self._line = line
        self._handle = sys.modules["IPython"].display.display(
            {"text/plain": "starting"}, raw=True, display_id=True
        )

    def update(self, _: object, *, description: str, completed: int, total: int, says: str) -> None:
        """Show how far it is."""
        bar = f'<progress max="{total}" value="{completed}" style="vertical-align: middle"></progress>'
        self._say(f"{description} {completed}/{total}{', ' * bool(says)}{says}", "div", bar)

    def stop(self) -> None:
        """Leave the last line where it is worth keeping."""
        self._say(self._line.took(), "small")

    def _say(self, words: str, tag: str, bar: str = "") -> None:
        from html import escape

        rich = f"<{tag}>{bar} {escape(words)}</{tag}>"
        self._handle.update({"text/plain": words, "text/html": rich}, raw=True)


def _in_notebook() -> bool:
    """Whether a Jupyter kernel (Colab's too) runs this."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return hasattr(shell, "kernel")


def clock(seconds: float) -> str:
    """A length of time as h:mm:ss or m:ss."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
