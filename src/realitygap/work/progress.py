"""Progress, reported now and then: one event, one reporter and one display for all kinds of work.

It shows as a live line on a terminal, a bar in a notebook, a plain line now and then elsewhere; on stderr.
"""

import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

from realitygap.errors import UsageError

__all__ = ["FILM_AFTER_S", "OnProgress", "Progress", "ProgressLine", "Reporter", "clock", "counts"]

EVERY_S = 0.2
"""Shortest time between two events of one phase."""
PLAIN_EVERY_S = 5.0
"""Time between two lines of one phase where stderr is no terminal."""
FILM_AFTER_S = 2.0
"""Shorter work on a film shows no progress."""


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


def counts(tell: OnProgress, phase: str, what: str) -> Callable[..., None]:
    """Who tells of a phase of which only counts are known: what is done, and how much there is."""
    return lambda done, total, *_: tell(Progress(phase=phase, done=done, total=total, what=what))


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
            from rich.progress import BarColumn, TextColumn
            from rich.progress import Progress as Bar

            columns = [
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.completed:.0f}/{task.total:.0f}"),
                TextColumn("{task.fields[says]}"),
            ]
            self._bar = Bar(*columns, console=Console(stderr=True), transient=True)
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

    def frames(self, phase: str, done: int, total: int | None) -> None:
        """Show how many frames of a film are done; None: it is unknown how many it has."""
        whole = max(total or done, done)
        self._show(phase, done, whole, "frames", done == whole)

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
            sys.stderr.write(f"{phase}: {done}/{total}{', ' * bool(says)}{says}\n")
            sys.stderr.flush()


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
