"""Two studies side by side: their runs' test scores, the difference of the means, and a test of it."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import ttest_ind

from realitygap.errors import StudyError
from realitygap.report.evolution import Mean, decimals, difference, mean_of
from realitygap.report.style import COLUMN, INK, new_figure, noise_styles, number
from realitygap.study.load import Study
from realitygap.world.robot import noise_name

__all__ = ["Contrast", "compare_figure", "contrasts"]


class Contrast(NamedTuple):
    """One task's champions of two studies: the mean test score of each run at one noise level, in `unit`."""

    task: str
    unit: str
    noise: tuple[float, float]
    """They evolved at."""
    tested: float
    """They were tested at."""
    values: tuple[list[float], list[float]]

    @property
    def difference(self) -> Mean | None:
        """The first study's mean less the second's, with Welch's 95 % interval; None below two runs each."""
        return difference(*self.values)

    @property
    def p(self) -> float:
        """Of Welch's t-test; nan below two runs each, or without any spread."""
        told = self.difference is not None and any(map(np.ptp, self.values))
        return float(ttest_ind(*self.values, equal_var=False).pvalue) if told else math.nan

    def text(self, mean: Mean | None) -> str:
        """A mean ± its interval."""
        places = decimals(max(map(abs, (*self.values[0], *self.values[1]))))
        parts = () if mean is None else (mean.value, mean.half)
        return " ± ".join(number(part, places) for part in parts if not math.isnan(part)) or "–"

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON; values in the unit."""
        gap = self.difference
        facts = {"mean": gap and gap.value, "half": gap and gap.half, "p": self.p}
        names = dict(zip(("runs_a", "runs_b"), self.values, strict=True))
        return {
            "task": self.task, "unit": self.unit, "noise": self.noise, "tested": self.tested, **names,
            "difference": facts,
        }  # fmt: skip


def contrasts(first: Study, second: Study) -> list[Contrast]:
    """Each task at each noise level that two studies have, or at the only one that each has: in that case
    champions are compared as tested at observed noise.

    Raises:
        StudyError: there is nothing to compare.
    """
    a, b = ([(run.task, run.noise) for run in study.runs if run.finished] for study in (first, second))
    found = [(task, noise, noise) for task, noise in dict.fromkeys(a) if (task, noise) in b]
    for task in dict.fromkeys(task for task, _ in a):
        own = [list(dict.fromkeys(noise for of, noise in some if of == task)) for some in (a, b)]
        if len(own[0]) == len(own[1]) == 1 and own[0] != own[1]:
            found.append((task, own[0][0], own[1][0]))
    if not found:
        had = (", ".join(f"{t}/{noise_name(n)}" for t, n in dict.fromkeys(some)) or "none" for some in (a, b))
        expected = "finished runs of one task in both studies, at one noise level or one each"
        raise StudyError(f"expected {expected}, got {' and '.join(had)}.")

    def scores(study: Study, task: str, noise: float, tested: float) -> list[float]:
        scale = study.facts(task)["fitness_scale"]
        runs = [run for run in study.runs if (run.task, run.noise, run.finished) == (task, noise, True)]
        return [float(run.tests["champion", tested].mean()) / scale for run in runs]

    made = []
    for task, one, other in found:
        tested = one if one == other else 1.0
        values = scores(first, task, one, tested), scores(second, task, other, tested)
        made.append(Contrast(task, first.facts(task)["fitness_unit"], (one, other), tested, values))
    return made


def compare_figure(found: Sequence[Contrast], names: tuple[str, str]) -> Figure:
    """A plot for each contrast, a row a study: each run's test score, their mean with its 95 % interval."""
    figure = new_figure(COLUMN * 1.25, 0.2 + 1.05 * len(found), layout="constrained")
    styles = noise_styles(level for one in found for level in one.noise)
    for k, one in enumerate(found, 1):
        ax = figure.add_subplot(len(found), 1, k)
        for y, level, values in zip((1, 0), one.noise, one.values, strict=True):
            look, mean = styles[level], mean_of(values) or Mean(value=math.nan, half=math.nan, count=0)
            drawn: dict[str, Any] = {"color": look.colour, "markersize": 7}
            ends = [mean.value - mean.half, mean.value + mean.half]
            ax.plot(ends, [y, y], linestyle=look.line, marker="|", **drawn)
            ax.plot([mean.value], [y], look.marker, markeredgecolor=INK, **drawn)
            small = drawn | {"markersize": 4, "markerfacecolor": "none"}
            ax.plot(values, [y + 0.25] * len(values), look.marker, **small)
        ax.set(ylim=(-0.5, 1.6), yticks=(1, 0))
        ax.set_yticklabels([f"{n}, {noise_name(of)} noise" for n, of in zip(names, one.noise, strict=True)])
        unit = f" ({one.unit})" if one.unit else ""
        ax.set_xlabel(f"{one.task}: test score at {noise_name(one.tested)} noise{unit}")
        ax.tick_params(axis="y", length=0)
        ax.grid(axis="x")
        ax.set_axisbelow(True)
    return figure
