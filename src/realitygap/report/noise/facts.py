"""The findings of a study of noise: verdicts, mean curves, peaks, fitness, all with intervals."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.scale import EDGE
from realitygap.correspondence.statistics import Correlation, correlation
from realitygap.experiments.noise import claims
from realitygap.experiments.noise.claims import RESAMPLES, Contrast, Finding, Split
from realitygap.experiments.noise.contrasts import Effect, crossing, interval, peak
from realitygap.experiments.noise.crossed import FEWEST, Crossed
from realitygap.report.scores import PAPER_ROWS
from realitygap.tasks import load_task
from realitygap.values import Floats

__all__ = [
    "BOTH", "FAILED", "PAPER", "SATURATED", "Curve", "Fall", "FitnessRow", "NoiseFacts", "Scope", "Span",
    "effect_spans", "gather_facts", "heat", "points",
]  # fmt: skip

Find = Callable[[Floats, Floats], Floats]

BOTH = "both tasks"
FAILED = 6.0
"""Below this score the twin did something else than the simulation: the paper's "hit or miss"."""
SATURATED = 10 - EDGE
"""From this score on a distance is within the scale's floor, so that ranks are mostly chance."""

PAPER = {
    task: {level: tuple(row.correspondence for row in rows) for level, rows in levels.items()}
    for task, levels in PAPER_ROWS.items()
}
"""Tables 1 and 2: correspondence scores of the five runs of each noise class."""


class Span(NamedTuple):
    """A figure with its 95 % interval; nan if there is none."""

    value: float
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Means over levels, each with its interval; those of each seed set; and where the curve peaks."""

    levels: Floats
    spans: tuple[Span, ...]
    sets: Mapping[int, Floats]
    top: Span
    """The peak, or for noisiness the zero crossing."""

    @property
    def means(self) -> Floats:
        return np.array([span.value for span in self.spans])


@dataclass(frozen=True, kw_only=True)
class FitnessRow:
    """One task's controllers evolved at one level; fitness in the task's own unit, unscaled.

    `delta`: Cliff's, of situated fitness against the robot's level, within calibration units; None at that
    level itself.
    """

    task: str
    level: float
    count: int
    simulated: Span
    situated: Span
    drop: Span
    delta: Span | None
    correlation: Correlation | None


class FallRow(NamedTuple):
    """Fitness on the twin of one task's controllers evolved at one level: on the calibration unit, on the
    others, and the fall."""

    level: float
    runs: int
    home: Span
    foreign: Span
    fall: Span


@dataclass(frozen=True, kw_only=True)
class Fall:
    """Fall of fitness on the twin from the calibration unit to the others; not planned.

    `rho`: Spearman's, of evolved level and fall over controllers; falls are relative to the mean of their
    calibration unit, since units are not equally easy. Its interval is Fieller's.
    """

    task: str
    rows: tuple[FallRow, ...]
    rho: Span

    @property
    def shown(self) -> bool:
        """Whether the fall is shown to change with the evolved level, by rho's interval."""
        return self.rho.low * self.rho.high > 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Scope:
    """One task, or both together: the three claims' findings, and the curves behind them.

    `curves`: a: by comparison level; b: by evolved level, against the robot's level; c: the diagonal.
    `split`: the diagonal's parts. `home`: (c) on the calibration unit alone, if its scores were kept.
    """

    name: str
    findings: tuple[Finding, ...]
    curves: Mapping[str, Curve]
    noisiness: Curve
    split: tuple[Split, ...]
    home: tuple[Contrast, ...]

    @property
    def file(self) -> str:
        """Prefix of its tables' names."""
        return self.name.replace(" ", "-")


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseFacts:
    """All findings of a study. The first scope is the headline."""

    data: Crossed
    scopes: tuple[Scope, ...]
    fitness: tuple[FitnessRow, ...]
    falls: tuple[Fall, ...]

    @property
    def headline(self) -> Scope:
        """Both tasks, or the only one."""
        return self.scopes[0]

    @property
    def by_task(self) -> list[Scope]:
        """The scopes of single tasks."""
        return [scope for scope in self.scopes if scope.name in self.data.tasks]

    @cached_property
    def scales(self) -> dict[str, tuple[float, str]]:
        """For each task the divisor of fitness, and the resulting unit."""
        tasks = {name: load_task(name) for name in self.data.tasks}
        return {name: (task.fitness_scale, task.fitness_unit) for name, task in tasks.items()}


def gather_facts(data: Crossed, *, resamples: int = RESAMPLES) -> NoiseFacts:
    """All findings of the report, computed once."""
    tasks = data.tasks
    parts = {BOTH: data} if len(tasks) > 1 else {}
    parts |= {task: data.part(task=task) for task in tasks}
    return NoiseFacts(
        data=data,
        scopes=tuple(_scope(name, part, resamples) for name, part in parts.items()),
        fitness=tuple(row for task in tasks for row in _fitness(task, data.part(task=task), resamples)),
        falls=tuple(fall for task in tasks if (fall := _fall(task, data.part(task=task), resamples))),
    )


def points(data: Crossed, key: str) -> tuple[Floats, Floats]:
    """Level and score of every dot behind a curve: L for each controller in (a), one in (b) and (c)."""
    if key == "a":
        return np.tile(data.levels, len(data)), data.score.ravel()
    return data.evolved, data.own() if key == "c" else data.at(data.robot)


def effect_spans(effect: Effect) -> tuple[Span, Span]:
    """Cliff's delta and the difference of means, each with its interval."""
    delta = Span(effect.delta, *(effect.delta_interval or ()))
    return delta, Span(effect.difference, *(effect.difference_interval or ()))


def heat(data: Crossed) -> Floats:
    """Mean scores [evolved, compared]."""
    return np.array([data.score[data.evolved == level].mean(axis=0) for level in data.levels])


def _scope(name: str, data: Crossed, resamples: int) -> Scope:
    weights = data.resamples(resamples)
    rise = {"a": data.score, "b": _by_evolved(data, data.at(data.robot)), "c": _by_evolved(data, data.own())}
    return Scope(
        name=name,
        findings=claims.judge_claims(data, resamples=resamples),
        curves={key: _curve(data, values, weights, peak) for key, values in rise.items()},
        noisiness=_curve(data, data.noisiness, weights, crossing),
        split=claims.split_diagonal(data, resamples=resamples),
        home=claims.judge_home(data, resamples=resamples),
    )


def _by_evolved(data: Crossed, values: Floats) -> Floats:
    """One value a controller as [n, L]: in its own level's column, nan elsewhere."""
    return np.where(data.evolved[:, None] == data.levels, values[:, None], np.nan)


def _curve(data: Crossed, values: Floats, weights: Floats | None, find: Find) -> Curve:
    """Means of the known values [n, L] of each column."""
    ones = np.ones((1, len(data)))
    mean = _means(values, ones)
    drawn = None if weights is None else _means(values, weights)
    spans = [Span(m) if drawn is None else Span(m, *interval(drawn[:, k])) for k, m in enumerate(mean[0])]
    top = float(find(data.levels, mean)[0])
    return Curve(
        levels=data.levels,
        spans=tuple(spans),
        sets={s: _means(values, ones * (data.seed_set == s))[0] for s in data.sets},
        top=Span(top) if drawn is None else Span(top, *interval(find(data.levels, drawn))),
    )


def _means(values: Floats, weights: Floats) -> Floats:
    """Weighted means [B, L] of the known values [n, L]."""
    known = np.isfinite(values)
    with np.errstate(invalid="ignore", divide="ignore"):
        means: Floats = (weights @ np.where(known, values, 0.0)) / (weights @ known.astype(np.float64))
    return means


def _fitness(task: str, data: Crossed, resamples: int) -> Sequence[FitnessRow]:
    weights = data.resamples(resamples)
    own = np.flatnonzero(data.evolved == data.robot)
    rows = []
    for level in data.levels.tolist():
        at = np.flatnonzero(data.evolved == level)
        fitness = (data.simulated, data.situated, data.simulated - data.situated)
        spans = [_mean(values, at, weights) for values in fitness]
        apart = None if level == data.robot else data.between(data.situated, at, own, weights)
        pair = None if len(at) < 3 else correlation(*(f[at] for f in fitness[:2]), resamples=1000)
        rows.append(
            FitnessRow(
                task=task, level=level, count=len(at), simulated=spans[0], situated=spans[1], drop=spans[2],
                delta=apart and effect_spans(apart)[0],
                correlation=pair,
            )
        )  # fmt: skip
    return rows


def _fall(task: str, data: Crossed, resamples: int) -> Fall | None:
    """None if fitness on single units was not kept, or there is only one unit."""
    data = data.only(np.isfinite(data.situated_home) & np.isfinite(data.situated_foreign))
    if len(data) < FEWEST or len(set(data.evolved.tolist())) < len(data.levels):
        return None
    weights, fall = data.resamples(resamples), data.situated_home - data.situated_foreign
    rows = []
    for level in data.levels.tolist():
        at = np.flatnonzero(data.evolved == level)
        spans = (_mean(v, at, weights) for v in (data.situated_home, data.situated_foreign, fall))
        rows.append(FallRow(level, len(at), *spans))
    means = {home: fall[data.home == home].mean() for home in set(data.home.tolist())}
    beyond = fall - np.array([means[home] for home in data.home.tolist()])
    rho = correlation(data.evolved, beyond, resamples=1).rho
    half = 1.96 * math.sqrt(1.06 / (len(data) - 3))
    ends = (math.tanh(math.atanh(rho) + side * half) for side in (-1, 1))
    return Fall(task=task, rows=tuple(rows), rho=Span(rho, *ends))


def _mean(values: Floats, rows: NDArray[np.int64], weights: Floats | None) -> Span:
    mean = float(values[rows].mean())
    if weights is None:
        return Span(mean)
    w = weights[:, rows]
    return Span(mean, *interval(w @ values[rows] / w.sum(axis=1)))
