"""At which level of noise to evolve, where a model errs by so much, by a noise experiment."""

import math
from typing import NamedTuple

import numpy as np
from scipy import stats

from realitygap.report.experiment import FEWEST, NoiseData
from realitygap.values import Floats

__all__ = ["Advice", "advice", "peak"]

LEVEL = 0.05
"""Of the test whether levels differ at all, and, both ends together, of the interval."""
RESAMPLES, SEED = 2000, 1995


class Advice(NamedTuple):
    """For one task.

    Attributes:
        task: its name.
        misfit: median model error over noise of the proximity sensors, held out; NaN if unknown.
        runs: at each level, at least.
        level: of evolution, at which fitness on the robot is highest; low, high: its 95 % interval over runs.
        p: that fitness does not depend on the level, by Kruskal and Wallis's test; NaN with few runs.
    """

    task: str
    misfit: float
    runs: int
    level: float
    low: float
    high: float
    p: float

    @property
    def told(self) -> bool:
        """Whether these runs tell of any level that it is better than another."""
        return self.p < LEVEL

    @property
    def words(self) -> str:
        """For a person."""
        known = f"{self.misfit:.1f} deviations of the noise" if math.isfinite(self.misfit) else "unknown size"
        at = f"{self.task}: at a model error of {known}"
        if self.told:
            return f"{at}, evolve at about level {self.level:.2g} (95 %: {self.low:.2g} to {self.high:.2g})"
        few = f"by {self.runs} runs a level no level is shown to be better than another"
        tested = f" (p = {self.p:.2g})" if math.isfinite(self.p) else ""
        return f"{at}, it cannot be told at which level to evolve: {few}{tested}"


def advice(data: NoiseData) -> list[Advice]:
    """Of each task: by fitness on the robot, over the root of the level that controllers evolved under."""
    made, levels = [], data.levels
    misfit = float(np.median(data.ratios["infrared"])) if "infrared" in data.ratios else math.nan
    for task in data.tasks:
        part, draw = data.part(task), np.random.default_rng(SEED)
        groups = [part.situated[part.at(level) & np.isfinite(part.situated)] for level in levels]
        runs = min(map(len, groups))
        level = low = high = p = math.nan
        if runs >= FEWEST:
            level = float(peak(levels, np.array([one.mean() for one in groups])))
            drawn = [draw.choice(one, (RESAMPLES, len(one))).mean(axis=1) for one in groups]
            low, high = np.percentile(peak(levels, np.stack(drawn, axis=1)), [50 * LEVEL, 100 - 50 * LEVEL])
            differ = len(np.unique(np.concatenate(groups))) > 1
            p = float(stats.kruskal(*groups).pvalue) if differ else 1.0
        made.append(Advice(task, misfit, runs, level, float(low), float(high), p))
    return made


def peak(levels: Floats, means: Floats) -> Floats:
    """[...] the level at which means [..., L] are highest: the top of the parabola through the highest and
    its neighbours over the levels' roots; an end where that is highest, or with two levels."""
    root, best = np.sqrt(levels), np.argmax(means, axis=-1)
    if len(levels) < 3:
        return np.asarray(levels[best])
    near = np.clip(best, 1, len(levels) - 2)[..., None] + np.array([-1, 0, 1])
    x, y = root[near], np.take_along_axis(means, near, -1)
    steps, rises = np.diff(x, axis=-1), np.diff(y, axis=-1)
    slope = rises / steps
    bend = (slope[..., 1] - slope[..., 0]) / steps.sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        top = (x[..., 0] + x[..., 1]) / 2 - slope[..., 0] / (2 * bend)
    inside = (best > 0) & (best < len(levels) - 1) & (bend < 0)
    found: Floats = np.where(inside, top, root[best]) ** 2
    return found
