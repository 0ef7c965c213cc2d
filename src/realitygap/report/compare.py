"""Two studies side by side: their runs' test scores, the difference of the means, and a test of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import ttest_ind

from realitygap.errors import StudyError
from realitygap.report.evolution import Mean, decimals, difference, mean_of
from realitygap.report.style import COLUMN, INK, new_figure, noise_styles, number
from realitygap.study.load import Study
from realitygap.world.robot import noise_name

__all__ = ["Contrast", "compare_figure", "contrasts"]

SIGNIFICANT = 0.05


@dataclass(frozen=True, kw_only=True)
class Contrast:
    """One task's runs of two studies: the champions' mean test scores at one noise level, in `unit`.

    Attributes:
        noise: they evolved at, a level each; tested: they were tested at.
        values: of the runs of each study.
    """

    task: str
    unit: str
    noise: tuple[float, float]
    tested: float
    values: tuple[Sequence[float], Sequence[float]]

    @property
    def difference(self) -> Mean | None:
        """The first study's mean less the second's, with Welch's 95 % interval; None below two runs each."""
        return difference(*self.values)

    @property
    def p(self) -> float:
        """Of Welch's t-test; nan below two runs each, or without any spread."""
        if self.difference is None or not any(map(np.ptp, self.values)):
            return math.nan
        return float(ttest_ind(*self.values, equal_var=False).pvalue)

    def text(self, mean: Mean | None) -> str:
        """A mean ± its interval."""
        if mean is None:
            return "–"
        places = decimals(max(map(abs, (*self.values[0], *self.values[1]))))
        half = "" if math.isnan(mean.half) else f" ± {number(mean.half, places)}"
        return number(mean.value, places) + half

    @property
    def verdict(self) -> str:
        """What the runs say, with the test."""
        gap = self.difference
        if gap is None:
            return "no interval: it takes two runs of each study"
        found = "significant" if self.p < SIGNIFICANT else "not significant"
        return f"difference {self.text(gap)}: {found} (Welch's t-test, p = {self.p:.2g})"

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON; values in the unit."""
        sides = {}
        for name, level, values in zip("ab", self.noise, self.values, strict=True):
            mean = mean_of(values)
            sides[name] = {"noise": level, "runs": list(values), **_facts(mean)}
        gap = {**_facts(self.difference), "p": self.p}
        return {
            "task": self.task, "unit": self.unit, "tested_noise": self.tested, **sides, "difference": gap
        }  # fmt: skip


def _facts(mean: Mean | None) -> dict[str, float | None]:
    return {"mean": None, "half": None} if mean is None else {"mean": mean.value, "half": mean.half}


def contrasts(first: Study, second: Study) -> list[Contrast]:
    """What two studies have in common: each task at each noise level, or at the only one that each has; in
    that case the champions are compared as tested at observed noise.

    Raises:
        StudyError: there is nothing to compare.
    """
    levels = [
        {(run.task, run.noise): None for run in study.runs if run.finished} for study in (first, second)
    ]
    pairs = [(task, noise, noise) for task, noise in levels[0] if (task, noise) in levels[1]]
    for task in dict.fromkeys(task for task, _ in levels[0]):
        own = [[noise for of, noise in some if of == task] for some in levels]
        if own[0] != own[1] and len(own[0]) == len(own[1]) == 1:
            pairs.append((task, own[0][0], own[1][0]))
    if not pairs:
        had = " and ".join(
            ", ".join(f"{task}/{noise_name(noise)}" for task, noise in some) or "no finished run"
            for some in levels
        )
        raise StudyError(f"expected two studies of one task, at one noise level or one each, got {had}.")
    return [_contrast(first, second, *pair) for pair in pairs]


def _contrast(first: Study, second: Study, task: str, one: float, other: float) -> Contrast:
    facts, tested = first.facts(task), one if one == other else 1.0
    values = tuple(
        [
            float(run.tests["champion", tested].mean()) / facts["fitness_scale"]
            for run in study.runs
            if (run.task, run.noise, run.finished) == (task, noise, True)
        ]
        for study, noise in ((first, one), (second, other))
    )
    return Contrast(
        task=task, unit=facts["fitness_unit"], noise=(one, other), tested=tested, values=values
    )  # fmt: skip


def compare_figure(found: Sequence[Contrast], names: tuple[str, str]) -> Figure:
    """A plot for each contrast, a row a study: each run's test score, their mean with its 95 % interval."""
    figure = new_figure(COLUMN * 1.25, 0.2 + 1.05 * len(found), layout="constrained")
    styles = noise_styles(level for one in found for level in one.noise)
    for k, one in enumerate(found, 1):
        ax = figure.add_subplot(len(found), 1, k)
        labels = []
        for y, name, level, values in zip((1, 0), names, one.noise, one.values, strict=True):
            look, mean = styles[level], mean_of(values)
            assert mean is not None
            labels.append(f"{name}, {noise_name(level)} noise")
            ax.plot(np.sort(values), [y + 0.25] * len(values), look.marker, color=look.colour, markersize=4,
                    markerfacecolor="none")  # fmt: skip
            if math.isfinite(mean.half):
                ends = [mean.value - mean.half, mean.value + mean.half]
                ax.plot(ends, [y, y], color=look.colour, linestyle=look.line, marker="|", markersize=7)
            ax.plot([mean.value], [y], look.marker, color=look.colour, markersize=7, markeredgecolor=INK)
        ax.set(ylim=(-0.5, 1.6), yticks=(1, 0))
        ax.set_yticklabels(labels)
        unit = f" ({one.unit})" if one.unit else ""
        ax.set_xlabel(f"{one.task}: test score at {noise_name(one.tested)} noise{unit}")
        ax.tick_params(axis="y", length=0)
        ax.grid(axis="x")
        ax.set_axisbelow(True)
    return figure
