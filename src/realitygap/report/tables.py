"""Tables 1 and 2, simulation columns: scores of the evolved individuals on fresh trials.

Behaviour names and correspondence scores need a situated robot; these columns do not.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from realitygap.files import to_csv
from realitygap.report.statistics import Mean, mean_of
from realitygap.study.load import Run
from realitygap.tasks.task import Task

__all__ = ["WHO", "NoiseClass", "Row", "TaskPart", "counted", "decimals", "number", "table_csv"]

WHO = ("fittest", "champion")
"""The paper's individual (highest stored fitness) and the retested champion."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One run, and its fresh trials by (who, noise level)."""

    run: Run
    means: Mapping[tuple[str, float], Mean]

    @property
    def stored(self) -> float | None:
        """The stored fitness of its fittest; None if there is none yet."""
        best = self.run.best_fitness
        return best if best is not None and math.isfinite(best) else None

    def mean(self, who: str, level: float) -> Mean | None:
        """Mean and 95 % interval over the fresh trials of the fittest or the champion at a noise level."""
        return self.means.get((who, level))


@dataclass(frozen=True, kw_only=True)
class NoiseClass:
    """The runs evolved at one noise level."""

    level: float
    name: str
    rows: tuple[Row, ...]

    @property
    def begun(self) -> tuple[Row, ...]:
        """Runs with an individual to show."""
        return tuple(row for row in self.rows if row.stored is not None)

    def means(self, who: str, level: float) -> np.ndarray:
        """Each tested run's mean on fresh trials at a noise level."""
        found = [row.mean(who, level) for row in self.rows]
        return np.array([m.value for m in found if m is not None])

    def stored(self) -> np.ndarray:
        """Each run's stored fitness of the fittest."""
        return np.array([row.stored for row in self.rows if row.stored is not None])

    def mean(self, who: str, level: float) -> Mean | None:
        """The mean of `means` over the runs."""
        return mean_of(self.means(who, level))


@dataclass(frozen=True, kw_only=True)
class TaskPart:
    """A study's results for one task, as in table 1 or 2.

    Attributes:
        conditions: the runs by noise level, rising.
        levels: the noise levels of the fresh trials, with their names.
    """

    task: Task
    conditions: tuple[NoiseClass, ...]
    levels: Mapping[float, str]

    @property
    def names(self) -> dict[float, str]:
        """The noise levels of evolution, as in a legend."""
        return {c.level: f"{c.name} noise" for c in self.conditions}

    @property
    def tests(self) -> list[tuple[str, float]]:
        """Individual and noise level of each fresh test, in the order of the columns."""
        return [(who, level) for who in WHO for level in self.levels]

    @property
    def places(self) -> int:
        """Decimal places that show three significant digits of the largest value."""
        values = [v for c in self.conditions for v in (*c.stored(), *c.means("fittest", c.level))]
        return decimals(max((abs(v) / self.task.fitness_scale for v in values), default=1.0))

    def show(self, mean: Mean | float | None) -> tuple[str, str]:
        """A value and its ± as text, in the table's unit; a dash for None or NaN."""
        value, half = (mean.value, mean.half) if isinstance(mean, Mean) else (mean, math.nan)
        return self.text(value), "" if math.isnan(half) else f"± {self.text(half)}"

    def text(self, value: float | None) -> str:
        """A fitness in the table's unit; a dash for None or NaN."""
        if value is None or math.isnan(value):
            return "–"
        return number(value / self.task.fitness_scale, self.places)


def decimals(largest: float) -> int:
    """Decimal places for three significant digits of `largest`, 0 to 6."""
    if not largest or not math.isfinite(largest):
        return 2
    return int(min(6, max(0, 2 - math.floor(math.log10(largest)))))


def counted(count: int, thing: str) -> str:
    """ "1 run", "5 runs"."""
    return f"{count} {thing}{'s' * (count != 1)}"


def number(value: float, places: int) -> str:
    """A number with a proper minus sign, and none on a zero."""
    return f"{value:z.{places}f}".replace("-", "−")


def table_csv(table: TaskPart) -> str:
    """The table as CSV: a row a run and an average a noise class, fitness unscaled.

    Columns `fittest_LEVEL_mean`, `_sd` and `_n` are over fresh trials; in an average's row over the runs'
    means.
    """
    head = ["task", "noise", "row", "run", "name", "evaluations", "finished", "stored_fitness"]
    head += [
        f"{who}_{table.levels[level]}_{part}" for who, level in table.tests for part in ("mean", "sd", "n")
    ]
    lines: list[list[object]] = [[*head]]
    for one in table.conditions:
        for row in one.rows:
            run = row.run
            told = [run.index, run.id, run.name, run.evaluations, int(run.finished), _exact(row.stored)]
            lines.append([table.task.name, one.name, *told, *_cells(table, row)])
        stored = mean_of(one.stored())
        average = _exact(None if stored is None else stored.value)
        lines.append([table.task.name, one.name, "average", "", "", "", "", average, *_cells(table, one)])
    return to_csv(lines, end="\r\n")


def _exact(value: float | None) -> str:
    """All digits of a number; "" for None."""
    return "" if value is None or math.isnan(value) else repr(float(value))


def _cells(table: TaskPart, of: Row | NoiseClass) -> list[str]:
    """Mean, deviation and count of each test, empty if there is none."""
    cells: list[str] = []
    for mean in (of.mean(*test) for test in table.tests):
        known = (None, None) if mean is None else (mean.value, mean.deviation)
        cells += [*map(_exact, known), str(0 if mean is None else mean.count)]
    return cells
