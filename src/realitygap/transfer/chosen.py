"""Which runs of a study drive robots, and which are shown."""

import math
from collections.abc import Iterable

from realitygap.errors import StudyError, UsageError
from realitygap.study.load import Run, Study
from realitygap.study.run import WHO
from realitygap.transfer.options import Transfer

__all__ = ["chosen_runs", "median_run", "number_of", "shown_runs"]

FINISH = "Finish the study (`realitygap … --resume`)."


def chosen_runs(study: Study, options: Transfer) -> list[Run]:
    """The named runs, or all finished ones; for a controller of your own, one run of each task and noise.

    Raises:
        UsageError: no such run or individual, or one that does not exist yet.
    """
    if options.named is not None:
        first = {
            (run.task, run.noise): run
            for run in [*map(study.run, reversed(options.runs))] or study.runs[::-1]
        }
        return list(first.values())[::-1]
    if options.individual not in WHO:
        raise UsageError(f"individual: expected {' or '.join(WHO)}, got {options.individual!r}.")
    if not options.runs:
        finished = [run for run in study.runs if run.finished]
        if not finished:
            raise StudyError(f"{study.folder}: no run is finished yet. {FINISH}")
        return finished
    chosen = list({run.id: run for run in map(study.run, options.runs)}.values())
    for run in chosen:
        if number_of(run, options.individual) is None:
            raise StudyError(f"{study.folder}: run {run.id} has no {options.individual} yet. {FINISH}")
    return chosen


def number_of(run: Run, individual: str) -> int | None:
    """Evaluation number of a run's champion or fittest; None: there is none yet."""
    return run.champion_number if individual == "champion" else run.fittest_number


def median_run(runs: Iterable[Run]) -> Run | None:
    """The median run of a condition, by its champion's fresh trials at its own noise.

    Where those are missing, by stored fitness; of an even number the lower of the middle two.
    """
    ranked = sorted((run for run in runs if run.evaluations), key=lambda run: (_worth(run), -run.id))
    return ranked[(len(ranked) - 1) // 2] if ranked else None


def shown_runs(study: Study) -> list[Run]:
    """One finished run of each condition, in the study's order: those in figures 3 and 5."""
    conditions = dict.fromkeys((run.task, run.noise) for run in study.runs)
    chosen = (median_run(r for r in study.runs if (r.task, r.noise) == pair) for pair in conditions)
    return [run for run in chosen if run is not None and run.finished]


def _worth(run: Run) -> float:
    """Quality of a run's champion, as far as it is known."""
    fresh = run.tests.get(("champion", run.noise))
    if fresh is not None and fresh.size:
        return float(fresh.mean())
    return -math.inf if run.best_fitness is None else run.best_fitness
