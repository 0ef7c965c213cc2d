"""The runs that a study's figures show: one of each task and noise level."""

from __future__ import annotations

import math
from collections.abc import Iterable

from realitygap.study.load import Run, Study

__all__ = ["median_run", "shown_runs"]


def median_run(runs: Iterable[Run]) -> Run | None:
    """The median run of a condition, by its champion's fresh trials at its own noise.

    Where those are missing, by stored fitness; of an even number the lower of the middle two.
    """
    ranked = sorted((run for run in runs if run.evaluations), key=lambda run: (_worth(run), -run.id))
    return ranked[(len(ranked) - 1) // 2] if ranked else None


def shown_runs(study: Study) -> list[Run]:
    """One finished run of each condition, in the study's order: whom figures 3 and 5 show."""
    conditions = dict.fromkeys((run.task, run.noise) for run in study.runs)
    chosen = (median_run(r for r in study.runs if (r.task, r.noise) == pair) for pair in conditions)
    return [run for run in chosen if run is not None and run.finished]


def _worth(run: Run) -> float:
    """How good a run's champion is, as far as is known."""
    fresh = run.tests.get(("champion", run.noise))
    if fresh is not None and fresh.size:
        return float(fresh.mean())
    return -math.inf if run.best_fitness is None else run.best_fitness
