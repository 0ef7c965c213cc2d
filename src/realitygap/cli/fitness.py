"""Fitness as a person reads it: two figures a run, "best during evolution" and "test score", in the task's
unit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from realitygap.cli.console import shown

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from realitygap.report.evolution import Mean
    from realitygap.study.load import Run, Study

__all__ = ["Fitness", "after", "test_facts", "test_score"]


def test_score(run: Run) -> Mean | None:
    """The mean of the champion's new trials at the noise it evolved under, with its 95 % interval."""
    from realitygap.report.evolution import mean_of

    return mean_of(run.tests.get(("champion", run.noise), ()))


def test_facts(run: Run) -> dict[str, Any] | None:
    """The same for JSON."""
    found = test_score(run)
    return None if found is None else {"mean": found.value, "half": found.half, "trials": found.count}


def after(unit: str) -> str:
    """A unit as it follows a number."""
    return f" {'× ' * unit[:1].isdigit()}{unit}" if unit else ""


class Fitness:
    """How the fitness of a study's tasks is written: in their units, with three digits of the largest."""

    def __init__(self, study: Study) -> None:
        from realitygap.report.evolution import decimals

        self._scale, self._unit, self._places = dict[str, float](), dict[str, str](), dict[str, int]()
        for task in dict.fromkeys(run.task for run in study.runs):
            facts, best = (
                study.facts(task),
                [run.best_fitness or 0.0 for run in study.runs if run.task == task],
            )
            self._scale[task] = facts["fitness_scale"]
            self._unit[task] = after(facts["fitness_unit"])
            self._places[task] = decimals(max(map(abs, best)) / self._scale[task])

    def unit(self, task: str) -> str:
        """The unit, as it follows a number: " × 10⁻⁶ cm⁻²"; nothing if there is none."""
        return self._unit[task]

    def text(self, task: str, value: float | Mean | None) -> str:
        """A value, or a mean ± its interval, without the unit."""
        if value is None or isinstance(value, float | int):
            return shown(None if value is None else value / self._scale[task], f".{self._places[task]}f")
        half = self.text(task, value.half)
        return self.text(task, value.value) + (f" ± {half}" if half != "–" else "")

    def both(self, run: Run) -> tuple[str, str]:
        """A run's two figures, without the unit."""
        return self.text(run.task, run.best_fitness), self.text(run.task, test_score(run))

    def sentence(self, run: Run) -> str:
        """Its test score, or while there is none the best fitness so far, with the unit."""
        best, test = self.both(run)
        figure = f"best during evolution {best}" if test == "–" else f"test score {test}"
        return figure + self._unit[run.task]

    def units(self, tasks: Iterable[str]) -> Iterator[str]:
        """What units the numbers of some tasks are in."""
        return (f"{task}: in{self._unit[task]}" for task in dict.fromkeys(tasks) if self._unit[task])
