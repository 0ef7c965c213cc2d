"""Progress, reported now and then: one event, one reporter and one display for all kinds of work.

It shows as a live bar on a terminal, a bar in a notebook's cell, plain lines elsewhere; on stderr.
"""

import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from html import escape
from typing import Any, Self

__all__ = ["FILM_AFTER_S", "OnProgress", "Progress", "ProgressLine", "Reporter", "counts"]

EVERY_S = 0.2
"""Shortest time between two events of one phase."""
PLAIN_EVERY_S = 5.0
"""Time between two lines of one phase where stderr is no terminal."""
KNOWN = 0.05
"""Share of the work that must be done before the time left is told."""
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
    """

    def __init__(
        self, tell: OnProgress | None, work: Mapping[str, float], *, patience_s: float = 0.0
    ) -> None:
        self._tell = tell or (lambda _: None)
        self._left = dict(work)
        self._patience = patience_s
        self._event: dict[str, Any] = {"phase": "", "done": 0, "total": 0}
        self._worked, self.spent = 0.0, 0.0
        self._last = self._told = time.monotonic()

    def phase(self, name: str, *, done: int, total: int, what: str = "", **more: Any) -> None:
        """Start a phase of which `done` things are there already; `more` is for the event."""
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
        ahead = sum(self._left.values())
        known = known and self._worked >= KNOWN * (self._worked + ahead)
        left = ahead * self.spent / self._worked if known else None
        self._tell(Progress(**self._event, seconds_left=left))


class ProgressLine:
    """A context in which progress is shown, from the first event that comes `after_s` after its start."""

    def __init__(self, after_s: float = 0.0) -> None:
        self._since = time.monotonic()
        self._after = self._since + after_s
        self._show: Callable[[Progress, str], object] | None = None
        self._open = ExitStack()
        self._phase, self._spent = "", dict[str, float]()
        self._printed, self._next = "", 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def show(self, event: Progress) -> None:
        """Show how far work is."""
        self._time(event.phase)
        if self._show is None:
            if time.monotonic() < self._after:
                return
            self._show = self._display()
        says = [f"{event.runs_done}/{event.runs_total} runs" if event.runs_total else event.what]
        if event.evaluations_per_second > 0:
            says.append(f"{event.evaluations_per_second:,.0f} evaluations/s")
        if event.seconds_left is not None:
            says.append(f"{_clock(event.seconds_left)} left")
        self._show(event, ", ".join(says))

    def places(self, name: str, done: int, total: int) -> None:
        """Show how far a recording is."""
        self.show(Progress(phase=f"recording {name}", done=done, total=total, what="places"))

    def frames(self, phase: str, done: int, total: int | None) -> None:
        """Show how many frames of a film are done; None: it is unknown how many it has."""
        self.show(Progress(phase=phase, done=done, total=max(total or done, done), what="frames"))

    def took(self) -> str:
        """How long all took until now, and each phase of it."""
        self._time("")
        self._spent.pop("", None)  # it was asked before
        total = _clock(sum(self._spent.values()))
        return f"took {total}: " + ", ".join(f"{phase} {_clock(s)}" for phase, s in self._spent.items())

    def _time(self, phase: str) -> None:
        """What passed since the last time belongs to the phase that was shown then, or to the first."""
        now = time.monotonic()
        before = self._phase or phase
        self._spent[before] = self._spent.get(before, 0.0) + now - self._since
        self._phase, self._since = phase, now

    def _display(self) -> Callable[[Progress, str], object]:
        """What shows an event and what is said of it."""
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
            from rich.progress import Progress as Bar

            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
            said = TextColumn("{task.fields[says]}")
            bar = self._open.enter_context(Bar(*columns, said, console=Console(stderr=True), transient=True))
            task = bar.add_task("starting", total=1, says="")
            return lambda event, says: bar.update(
                task, description=event.phase, completed=event.done, total=max(event.total, 1), says=says
            )
        ipython = sys.modules.get("IPython")
        if ipython is None or not hasattr(ipython.get_ipython(), "kernel"):
            return self._print
        cell = ipython.display.display({"text/plain": ""}, raw=True, display_id=True)

        def put(text: str, bar: str = "") -> None:
            html = f"{bar} <small>{escape(text)}</small>"
            cell.update({"text/plain": text, "text/html": html}, raw=True)

        self._open.callback(lambda: put(self.took()))
        return lambda event, says: put(
            f"{event.phase} {event.done}/{event.total} {says}",
            f'<progress max="{event.total}" value="{event.done}"></progress>',
        )

    def _print(self, event: Progress, says: str) -> None:
        """A line now and then, and at the beginning and the end of a phase."""
        now = time.monotonic()
        finished = (event.done, event.runs_done) == (event.total, event.runs_total)
        if event.phase != self._printed or finished or now >= self._next:
            self._printed, self._next = event.phase, now + PLAIN_EVERY_S
            sys.stderr.write(f"{event.phase}: {event.done}/{event.total}{', ' * bool(says)}{says}\n")
            sys.stderr.flush()


def _clock(seconds: float) -> str:
    """A length of time as h:mm:ss or m:ss."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
