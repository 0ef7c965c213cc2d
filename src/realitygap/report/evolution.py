"""A study's results by task and noise level: the curves of figures 4 and 6, tables of fitness, differences.

What a page shows of a task begins here (`parts_of`): its runs by the noise that they evolved under, with the
scores of the evolved individuals in test trials.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy.stats import t as student
from scipy.stats import ttest_ind

from realitygap.control.genotype import Genotype
from realitygap.files import to_csv
from realitygap.kernels.rng import substream
from realitygap.report.drawing import PathPanel
from realitygap.report.style import COLUMN, NoiseStyle, new_figure, noise_styles, number
from realitygap.simulation.simulation import Simulation
from realitygap.streams import PICTURES
from realitygap.study.load import Run, Study
from realitygap.tasks.task import Task
from realitygap.track import Trajectory
from realitygap.transfer.spec import median_run
from realitygap.world.robot import NOISE_LEVELS, noise_level, noise_name

__all__ = [
    "PER_CONDITION", "WHO", "Mean", "NoiseClass", "Paths", "Row", "TaskPart", "best_so_far",
    "curves_figure", "decimals", "difference", "ends_of_paths", "individual", "mean_curve", "mean_of",
    "parts_of", "running_best", "table_csv", "unit_of",
]  # fmt: skip

PER_CONDITION = 5
"""Runs of a condition whose paths, networks and table rows a page shows at most."""
WHO = {"fittest": "best during evolution", "champion": "champion"}
"""The individuals of a run, and what a page calls them; the paper's is the first."""


# Means and their uncertainty


@dataclass(frozen=True, kw_only=True)
class Mean:
    """A mean, the half width of its 95 % interval (nan for a single value), and the number of values."""

    value: float
    half: float
    count: int
    deviation: float = math.nan

    def text(self, places: int) -> str:
        """With ± where its interval is known."""
        spread = "" if math.isnan(self.half) else f" ± {number(self.half, places)}"
        return number(self.value, places) + spread


def mean_of(values: ArrayLike) -> Mean | None:
    """The mean of some values with Student's interval, None without any."""
    array = np.asarray(values, dtype=float)
    if not array.size:
        return None
    if array.size == 1:
        return Mean(value=float(array[0]), half=math.nan, count=1)
    deviation = float(array.std(ddof=1))
    half = float(student.ppf(0.975, array.size - 1)) * deviation / math.sqrt(array.size)
    return Mean(value=float(array.mean()), half=half, count=array.size, deviation=deviation)


def difference(first: ArrayLike, second: ArrayLike) -> Mean | None:
    """Excess of the first mean over the second, with Welch's 95 % interval; None below two values each."""
    a, b = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    if a.size < 2 or b.size < 2:
        return None
    gap, half = float(a.mean() - b.mean()), 0.0
    if np.ptp(a) or np.ptp(b):
        half = float(ttest_ind(a, b, equal_var=False).confidence_interval().high) - gap
    return Mean(value=gap, half=half, count=a.size + b.size)


def running_best(fitness: ArrayLike) -> np.ndarray:
    """The highest fitness so far at each evaluation."""
    return np.maximum.accumulate(np.asarray(fitness, dtype=float))


# Tables


@dataclass(frozen=True, kw_only=True)
class Row:
    """One run, and its means over test trials by (who, noise level)."""

    run: Run
    means: Mapping[tuple[str, float], Mean]

    @property
    def best(self) -> float | None:
        """The best fitness during evolution; None if there is none yet."""
        best = self.run.best_fitness
        return best if best is not None and math.isfinite(best) else None

    def mean(self, who: str, level: float) -> Mean | None:
        """Of the best or the champion, over its test trials at a noise level."""
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
        return tuple(row for row in self.rows if row.best is not None)

    @cached_property
    def chosen(self) -> Row | None:
        """The run shown in a figure: the median one."""
        run = median_run(row.run for row in self.begun)
        return next((row for row in self.begun if row.run is run), None)

    def shown(self, most: int) -> list[Row]:
        """The first `most` runs with an individual to show, and the chosen one."""
        rows = self.begun[:most]
        return [*rows, *(row for row in (self.chosen,) if row is not None and row not in rows)]

    def best(self) -> list[float]:
        """Each run's best fitness during evolution."""
        return [row.best for row in self.rows if row.best is not None]

    def means(self, who: str, level: float) -> list[float]:
        """Each tested run's mean over test trials at a noise level."""
        return [mean.value for row in self.rows if (mean := row.mean(who, level)) is not None]

    def mean(self, who: str, level: float) -> Mean | None:
        """The mean of `means` over the runs."""
        return mean_of(self.means(who, level))


@dataclass(frozen=True, kw_only=True)
class TaskPart:
    """A study's results for one task, as in table 1 or 2.

    Attributes:
        conditions: the runs by noise level, rising.
        levels: the noise levels of the test trials, with their names.
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
        """Individual and noise level of each test, in the order of the columns."""
        return [(who, level) for who in WHO for level in self.levels]

    @property
    def places(self) -> int:
        """Decimal places that show three significant digits of the largest value."""
        values = [v for c in self.conditions for v in (*c.best(), *c.means("fittest", c.level))]
        return decimals(max((abs(v) / self.task.fitness_scale for v in values), default=1.0))

    @property
    def unit(self) -> str:
        """The unit of its values, to be written after them."""
        return unit_of(self.task.fitness_unit)

    def show(self, mean: Mean | float | None) -> tuple[str, str]:
        """A value and its ± as text, in the table's unit; a dash for None or NaN."""
        value, half = (mean.value, mean.half) if isinstance(mean, Mean) else (mean, math.nan)
        return self.text(value), "" if math.isnan(half) else f"± {self.text(half)}"

    def text(self, value: float | None) -> str:
        """A fitness in the table's unit; a dash for None or NaN."""
        if value is None or math.isnan(value):
            return "–"
        return number(value / self.task.fitness_scale, self.places)


def unit_of(unit: str) -> str:
    """A task's unit of fitness, to be written after a number: "× 10⁻⁶ cm⁻²"."""
    return f"× {unit}" if unit[:1].isdigit() else unit


def decimals(largest: float) -> int:
    """Decimal places for three significant digits of `largest`, 0 to 6."""
    if not largest or not math.isfinite(largest):
        return 2
    return int(min(6, max(0, 2 - math.floor(math.log10(largest)))))


def table_csv(table: TaskPart) -> str:
    """The table as CSV: a row a run and an average a noise class, fitness unscaled.

    Columns `fittest_LEVEL_mean`, `_sd` and `_n` are over test trials; in an average's row over the runs'
    means.
    """
    head = ["task", "noise", "row", "run", "name", "evaluations", "finished", "stored_fitness"]
    head += [f"{who}_{table.levels[level]}_{of}" for who, level in table.tests for of in ("mean", "sd", "n")]
    lines: list[list[object]] = [[*head]]

    def exact(value: float | None) -> str:
        return "" if value is None or math.isnan(value) else repr(float(value))

    def add(one: NoiseClass, of: Row | NoiseClass, facts: Sequence[object], best: float | None) -> None:
        means = [of.mean(*test) or Mean(value=math.nan, half=math.nan, count=0) for test in table.tests]
        cells = [cell for mean in means for cell in (exact(mean.value), exact(mean.deviation), mean.count)]
        lines.append([table.task.name, one.name, *facts, exact(best), *cells])

    for one in table.conditions:
        for row in one.rows:
            run = row.run
            add(one, row, [run.index, run.id, run.name, run.evaluations, int(run.finished)], row.best)
        best = mean_of(one.best())
        add(one, one, ["average", "", "", "", ""], None if best is None else best.value)
    return to_csv(lines, end="\r\n")


# Of a study


def parts_of(study: Study) -> list[TaskPart]:
    """The study's runs by task and by noise level, tasks in the study's order, levels rising."""
    groups: dict[str, dict[float, list[Row]]] = {}
    for run in study.runs:
        means = {(who, noise_level(noise)): mean_of(scores) for (who, noise), scores in run.tests.items()}
        row = Row(run=run, means={key: mean for key, mean in means.items() if mean is not None})
        groups.setdefault(run.task, {}).setdefault(noise_level(run.noise), []).append(row)
    parts = []
    for name, rows_at in groups.items():
        tested = {level for rows in rows_at.values() for row in rows for _, level in row.means}
        classes = (
            NoiseClass(level=level, name=noise_name(level), rows=tuple(rows_at[level]))
            for level in sorted(rows_at)
        )
        levels = {level: noise_name(level) for level in sorted(tested or NOISE_LEVELS.values())}
        parts.append(TaskPart(task=study.task(name), conditions=tuple(classes), levels=levels))
    return parts


def individual(run: Run) -> Genotype:
    """The genotype shown for a run: its champion's, or that of the best so far."""
    genes = run.fittest if run.champion is None else run.champion
    assert genes is not None  # the run has begun
    return run.study.slots(run.task, genes)


def best_so_far(study: Study, part: TaskPart) -> dict[float, list[np.ndarray]]:
    """For each noise level the running best fitness of each run, read one run at a time."""
    return {
        one.level: [running_best(study.evaluations(row.run.id)["fitness"]) for row in one.begun]
        for one in part.conditions
        if one.begun
    }


class Paths:
    """Simulates a study's individuals again, each once, all of a task from the same start."""

    def __init__(self, study: Study) -> None:
        self._study = study
        self._stream = int(substream(np.uint64(study.config.seed), np.uint64(PICTURES)))
        self._simulations: dict[tuple[str, float], Simulation] = {}
        self._made: dict[int, tuple[Trajectory, float]] = {}

    def of(self, part: TaskPart, condition: NoiseClass, row: Row) -> tuple[Trajectory, float]:
        """One trial of a run's champion at the noise it evolved under, and its score."""
        if row.run.id not in self._made:
            key = (part.task.name, condition.level)
            if key not in self._simulations:
                self._simulations[key] = Simulation(part.task, self._study.profile, condition.level)
            networks = individual(row.run).networks()
            self._made[row.run.id] = self._simulations[key].trajectory(networks, stream=self._stream)
        return self._made[row.run.id]

    def panel(self, part: TaskPart, condition: NoiseClass, row: Row, title: str) -> PathPanel:
        """The same as a picture's panel, with its score after the title."""
        trajectory, score = self.of(part, condition, row)
        title = f"{title}: {score / part.task.fitness_scale:.2f}"
        return PathPanel(noise=condition.level, title=title, trajectory=trajectory)


def ends_of_paths(names: Mapping[float, str], rows: Sequence[Sequence[PathPanel]]) -> str:
    """Text alternative of a picture of paths."""
    paths = ((names[panel.noise], panel.trajectory) for row in rows for panel in row)
    return "; ".join(
        f"{name}: from ({path.x[0]:.0f}, {path.y[0]:.0f}) to ({path.end.x:.0f}, {path.end.y:.0f}) cm"
        for name, path in paths
    )


# Curves


def mean_curve(runs: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mean [n] over the runs and the half width [n] of its 95 % interval (nan for one run).

    Runs of different lengths (an unfinished study) are averaged up to the shortest.
    """
    reach = min(len(run) for run in runs)
    rows = np.array([run[:reach] for run in runs], dtype=float)
    if len(rows) == 1:
        return rows[0], np.full(reach, np.nan)
    half = student.ppf(0.975, len(rows) - 1) * rows.std(axis=0, ddof=1) / np.sqrt(len(rows))
    return rows.mean(axis=0), half


def curves_figure(
    curves: Mapping[float, Sequence[np.ndarray]], names: Mapping[float, str], *,
    tested: Mapping[float, float] | None = None, scale: float = 1.0, unit: str = "",
) -> Figure:  # fmt: skip
    """Figure 4 or 6 in one column of a paper: a curve a noise level with its 95 % band.

    Args:
        curves: by noise level the running best fitness of each run, from evaluation 1, unscaled.
        names: of the page's noise levels, also of those without runs.
        tested: a mean over test trials, drawn as a mark behind the curve's end.
        scale: divisor of fitness; unit: the resulting unit, shown on the axis.
    """
    figure = new_figure(COLUMN * 1.25, COLUMN * 0.85, layout="constrained")
    ax = figure.add_subplot()
    styles, tested = noise_styles(names), tested or {}
    begun = {level: some for level, runs in curves.items() if (some := [run for run in runs if len(run)])}
    ends = [_draw_one(ax, runs, names[level], styles[level], scale) for level, runs in begun.items()]
    longest = max(ends, default=1)
    for level, value in tested.items():
        look = styles[level]
        ax.plot(
            [longest * 1.035], [value / scale], marker=look.marker, color=look.colour, markersize=5,
            markerfacecolor="none", clip_on=False, linestyle="none", zorder=4,
        )  # fmt: skip
    seen = [float(end) for runs in begun.values() for run in runs for end in (run.min(), run.max())]
    low, *_, high = sorted([0.0, *seen, *tested.values()])
    ax.set(xlim=(0, longest * 1.06), xlabel="evaluations")
    # Two runs' interval may be many times as high as they: it is cut.
    ax.set_ylim(low / scale, min(ax.get_ylim()[1], (1.1 * high - 0.1 * low) / scale) or None)
    ax.set_ylabel("best during evolution" + (f" ({unit})" if unit else ""))
    ax.grid(axis="y")
    ax.set_axisbelow(True)
    ax.legend()
    return figure


def _draw_one(ax: Axes, runs: Sequence[np.ndarray], name: str, look: NoiseStyle, scale: float) -> int:
    """One noise level's curve and band; returns its number of evaluations."""
    mean, half = mean_curve(runs)
    at = np.arange(1, len(mean) + 1)
    if len(runs) > 1:
        low, high = (mean - half) / scale, (mean + half) / scale
        ax.fill_between(at, low, high, color=look.colour, alpha=0.14, linewidth=0, zorder=1)
    marks = np.unique(np.linspace(0, len(mean) - 1, 6).astype(int)[1:])
    ax.plot(
        at, mean / scale, color=look.colour, linestyle=look.line, marker=look.marker, label=name,
        markevery=list(marks), markersize=4, zorder=3,
    )  # fmt: skip
    return len(mean)
