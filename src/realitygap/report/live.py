"""The page of a study in progress: growing curves, and the best robot so far.

It is a file that reloads itself every few seconds. There is no server, and nothing is fetched.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from matplotlib.ticker import MaxNLocator

from realitygap.errors import RealityGapError
from realitygap.files import atomic_write
from realitygap.report.evolution import TaskPart, best_so_far, parts_of
from realitygap.report.page import rendered
from realitygap.report.style import NoiseStyle, noise_key, noise_styles
from realitygap.simulation.simulation import Simulation
from realitygap.study.load import Run, Study, load_study
from realitygap.tasks.task import Task
from realitygap.work.progress import Progress

__all__ = ["PAGE", "LivePage"]

PAGE = "watch.html"
EVERY_S = 5.0
"""Time between two versions of the page."""
SHARE = 0.05
"""Largest share of the time spent on making them."""
POINTS = 400
"""Points of a curve."""


class LivePage:
    """Keeps FOLDER/watch.html up to date within its context; `report` is called with each event too."""

    def __init__(self, folder: Path, report: Callable[[Progress], None]) -> None:
        self.page, self._folder, self._report = folder / PAGE, folder, report
        self._next, self._simulations = 0.0, dict[str, Simulation]()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.page.exists():
            self._write("stopped" if kind else "finished", ended=True)

    def show(self, event: Progress) -> None:
        """Pass an event on; write the page when it is due."""
        self._report(event)
        begun = time.monotonic()
        if begun >= self._next:
            left = "" if event.seconds_left is None else str(timedelta(seconds=round(event.seconds_left)))
            self._write(f"{event.phase}: {event.done} of {event.total} {event.what}", left, ended=False)
            self._next = time.monotonic() + max(EVERY_S, (time.monotonic() - begun) / SHARE)

    def _write(self, words: str, left: str = "", *, ended: bool) -> None:
        """Write the page; if that fails it is tried again later, and evolution continues."""
        with suppress(RealityGapError, OSError):
            study = load_study(self._folder)
            parts = [self._part(study, part) for part in parts_of(study)]
            facts = {"words": words, "left": left, "ended": ended, "every_s": round(EVERY_S), "parts": parts}
            report = self._folder / "report" / "index.html"
            title = study.config.title or ", ".join(part["title"] for part in parts)
            facts |= {"title": title or self._folder.resolve().name, "report": ended and report.exists()}
            atomic_write(self.page, rendered("live.html.j2", facts))

    def _part(self, study: Study, part: TaskPart) -> dict[str, Any]:
        """A task's curves and its best robot."""
        scale = part.task.fitness_scale
        looks = {level: _look(style) for level, style in noise_styles(part.names).items()}
        curves = [
            (looks[level], best / scale) for level, runs in best_so_far(study, part).items() for best in runs
        ]
        ends = [float(end) for _, best in curves for end in (best[0], best[-1])]
        low, most = min([0.0, *ends]), max([0.0, *ends])
        total = study.config.evaluations
        begun = [(row.best, row.run, one.level) for one in part.conditions for row in one.begun]
        best, run, level = max(begun, key=lambda one: one[0] or 0.0, default=(0.0, None, 0.0))
        drive = None if run is None else {**self._drive(part.task, run), "look": looks[level]}
        return {
            "title": part.task.title, "unit": part.unit and f" {part.unit}", "total": total,
            "best": f"{(best or 0.0) / scale:.3g}", "key": noise_key(part.names), "drive": drive,
            "across": _ticks(0, total, 100 / total), "along": _ticks(low, most, 48 / ((most - low) or 1.0)),
            "curves": [(look, _line(best, total, low, most)) for look, best in curves],
        }  # fmt: skip

    def _drive(self, task: Task, run: Run) -> dict[str, Any]:
        """The fittest robot on one trial, always the same, at its own noise."""
        study = run.study
        if run.name not in self._simulations:
            self._simulations[run.name] = Simulation(task, study.profile, run.noise)
        kept = self._simulations[run.name]
        assert run.fittest is not None
        trajectory, score = kept.trajectory(study.networks(run.task, run.fittest), stream=1)
        track, depth = trajectory.track, task.arena.size_cm[1]
        places = [f"{x:.2f} {depth - y:.2f}" for x, y in zip(track.x, track.y, strict=True)]
        return {
            "name": run.name, "score": f"{score / task.fitness_scale:.3g}", "arena": task.arena,
            "radius": study.profile.body.radius_cm, "path": " ".join(places), "places": ";".join(places),
            "turns": ";".join(f"{-angle:.1f}" for angle in np.degrees(np.unwrap(track.heading))),
            "seconds": track.t[-1], "across": _ticks(0, task.arena.size_cm[0]), "along": _ticks(0, depth),
        }  # fmt: skip


def _look(style: NoiseStyle) -> dict[str, str]:
    """A noise level's colour, sign and dash, as SVG has them for lines .6 wide."""
    dash = () if isinstance(style.line, str) else style.line[1] or ()
    return {"colour": style.colour, "sign": style.sign, "dash": " ".join(f"{0.6 * gap:g}" for gap in dash)}


def _ticks(low: float, high: float, scale: float = 1.0) -> list[tuple[float, str]]:
    """An axis' numbers, and their places from its low end."""
    ticks = MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(low, high)
    return [(round((v - low) * scale, 2), f"{v:.4g}") for v in ticks if low <= v <= high]


def _line(best: np.ndarray, total: int, low: float, high: float) -> str:
    """A curve in a box of 100 × 50, as SVG's points; 0 is in the box, whatever the signs."""
    rows = np.unique(np.linspace(0, len(best) - 1, min(POINTS, len(best))).astype(int))
    up = 48 / ((high - low) or 1.0)
    return " ".join(f"{100 * (k + 1) / total:.2f},{50 - up * (best[k] - low):.2f}" for k in rows)
