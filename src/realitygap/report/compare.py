"""Two studies side by side: their runs' test scores, the difference of the means, and a test of it."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import ttest_ind

from realitygap.errors import StudyError
from realitygap.report.answer import RunsRow, draw_runs
from realitygap.report.evolution import Mean, decimals, difference, mean_of
from realitygap.report.style import COLUMN, new_figure, noise_styles
from realitygap.study.load import Run, Study
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
    def title(self) -> str:
        """What is compared, with its unit."""
        unit = f" ({self.unit})" if self.unit else ""
        return f"{self.task}: test score at {noise_name(self.tested)} noise{unit}"

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
        return mean.text(places) if mean else "–"

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON; values in the unit."""
        gap, (a, b) = self.difference, self.values
        facts = {"mean": gap and gap.value, "half": gap and gap.half, "p": self.p}
        told = {"task": self.task, "unit": self.unit, "noise": self.noise, "tested": self.tested}
        return {**told, "runs_a": a, "runs_b": b, "difference": facts}


def contrasts(first: Study, second: Study) -> list[Contrast]:
    """Each task at each noise level that two studies have, or at the only one that each has: in that case
    champions are compared as tested at observed noise.

    Raises:
        StudyError: there is nothing to compare.
    """
    a, b = (_finished(study) for study in (first, second))
    found = [(task, noise, noise) for task, noise in a if (task, noise) in b]
    for task in dict.fromkeys(task for task, _ in a):
        own = [[noise for of, noise in some if of == task] for some in (a, b)]
        if len(own[0]) == len(own[1]) == 1 and own[0] != own[1]:
            found.append((task, own[0][0], own[1][0]))
    if not found:
        had = (", ".join(f"{task}/{noise_name(noise)}" for task, noise in some) or "none" for some in (a, b))
        expected = "finished runs of one task in both studies, at one noise level or one each"
        raise StudyError(f"expected {expected}, got {' and '.join(had)}.")
    made = []
    for task, one, other in found:
        facts, tested = first.facts(task), one if one == other else 1.0
        values = [
            [float(run.tests["champion", tested].mean()) / facts["fitness_scale"] for run in runs]
            for runs in (a[task, one], b[task, other])
        ]
        made.append(Contrast(task, facts["fitness_unit"], (one, other), tested, (values[0], values[1])))
    return made


def _finished(study: Study) -> dict[tuple[str, float], list[Run]]:
    """Its finished runs by task and noise level."""
    found = dict[tuple[str, float], list[Run]]()
    for run in study.runs:
        if run.finished:
            found.setdefault((run.task, run.noise), []).append(run)
    return found


def compare_figure(found: Sequence[Contrast], names: tuple[str, str]) -> Figure:
    """A plot for each contrast, a row a study: each run's test score, their mean with its 95 % interval."""
    figure = new_figure(COLUMN * 1.25, 0.2 + 1.05 * len(found), layout="constrained")
    styles = noise_styles(level for one in found for level in one.noise)
    for k, one in enumerate(found, 1):
        rows = [
            RunsRow(f"{name}, {noise_name(level)} noise", styles[level], values, mean)
            for name, level, values in zip(names[::-1], one.noise[::-1], one.values[::-1], strict=True)
            if (mean := mean_of(values))
        ]
        draw_runs(figure.add_subplot(len(found), 1, k), rows, one.title)
    return figure
