"""What the second study's planned tests find of what may be there, by simulation on first studies' scores.

`python docs/figures/noise_level_2_power.py` prints the tables of docs/noise-level-2.md (a minute).

Each arm with its own tasks, runs and levels. Claims (b) and (c): two groups of controllers draw their scores
from those that the first study most like the arm had against the simulation at the robot's level, task by
task, spread over sixteen calibration units and two seed sets; then the second group is made worse, and three
statistics look for it. Claim (d): controllers draw their fall of fitness, from calibration unit to foreign
units, from the same study; a slope over the noise that they evolved under is put in, and units differ
besides. Found is only what both seed sets show with the same sign, as planned.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.experiments.noise.crossed import Crossed
from realitygap.report.noise.facts import FAILED
from realitygap.report.noise.results import read_results

sys.path.insert(0, str(Path(__file__).resolve().parent))

from noise_level_power import rank_tests

DATA = Path(__file__).resolve().parent.parent / "noise-level"
STUDIES = 2000
UNITS = 16
TESTS = 12
"""Planned comparisons of an arm; here each meets the first, hardest step of Holm's correction."""
STEP = 0.05 / TESTS
BOUND = 0.5
"""Points of the score: the smallest difference of interest, and so what a null has to exclude."""
CORRELATIONS = (0.0, -0.1, -0.2, -0.3)
"""Of the fall of fitness with the root of the level, in the mean unit."""
SLOPE_SPREAD, UNIT_SPREAD = 0.1, 0.5
"""Standard deviations over units: of that correlation, and of the fall itself, in those of the fall."""
PLANNED = (0.0, 1.0, 2.0)
"""Levels that (d) is tested over first; then over all that the arm has."""

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]


class Arm(NamedTuple):
    """An arm of the plan: how many of its two tasks, its runs of a task by level, and the first study whose
    scores and falls stand for its own."""

    name: str
    tasks: int
    runs: dict[float, int]
    study: str

    @property
    def most(self) -> int:
        """Runs of a task at levels 0, 1 and 2, which (a), (b) and (c) compare."""
        return self.runs[1.0]


FULL = {0.0: 160, 0.5: 80, 1.0: 160, 2.0: 160, 4.0: 80}
ARMS = (
    Arm("E", 1, FULL, "default"),
    Arm("T", 2, FULL, "default"),
    Arm("E5", 1, dict.fromkeys(PLANNED, 160), "evaluations-5000"),
    Arm("T5", 2, dict.fromkeys(PLANNED, 80), "evaluations-5000"),
    Arm("T2", 2, dict.fromkeys((0.0, 0.5, 1.0, 2.0), 80), "twin-noise-2"),
)
"""All that support claims, as docs/noise-level-2.md has them; the tests hold one to the other."""


class Found(NamedTuple):
    """Shares of studies: found by ranks, by means, by failures; and a difference of half a point excluded."""

    arm: str
    what: str
    ranks: float
    means: float
    failures: float
    excluded: float


def home_units(runs: int) -> tuple[Whole, Whole]:
    """Calibration unit and seed set [runs] of an arm's runs: half in each set, the units in turn."""
    return np.tile(np.arange(runs // 2) % UNITS, 2), np.repeat([0, 1], runs // 2)


def by_means(first: Floats, second: Floats, strata: Whole) -> tuple[Floats, Floats, Floats]:
    """Difference of means, its p by the stratified permutation test (the normal limit), standard error."""
    gap, null, error = np.zeros(len(first)), np.zeros(len(first)), np.zeros(len(first))
    for k in set(strata.tolist()):
        x, y = first[:, strata == k], second[:, strata == k]
        share, n, m = np.mean(strata == k), x.shape[1], y.shape[1]
        gap += share * (x.mean(axis=1) - y.mean(axis=1))
        both = np.concatenate([x, y], axis=1)
        null += share**2 * both.var(axis=1, ddof=1) * (1 / n + 1 / m)
        error += share**2 * (x.var(axis=1, ddof=1) / n + y.var(axis=1, ddof=1) / m)
    return gap, _two_sided(gap / np.sqrt(null)), np.sqrt(error)


def by_failures(first: Floats, second: Floats, strata: Whole) -> tuple[Floats, Floats]:
    """Excess of failures in the first, its p by Cochran, Mantel and Haenszel's test."""
    excess, spread = np.zeros(len(first)), np.zeros(len(first))
    for k in set(strata.tolist()):
        x, y = first[:, strata == k] < FAILED, second[:, strata == k] < FAILED
        n, m, failed = x.shape[1], y.shape[1], x.sum(axis=1) + y.sum(axis=1)
        total = n + m
        excess += x.sum(axis=1) - n * failed / total
        spread += n * m * failed * (total - failed) / (total**2 * (total - 1))
    return excess, _two_sided(np.maximum(np.abs(excess) - 0.5, 0.0) / np.sqrt(np.maximum(spread, 1e-12)))


def levels_compared(arm: Arm, data: Crossed, *, studies: int = STUDIES, seed: int = 2026) -> list[Found]:
    """A row for each difference that there may be between two levels of an arm."""
    draw, scores = np.random.default_rng(seed), data.at(data.robot)
    pools = [scores[data.task == task] for task in data.tasks[: arm.tasks]]
    unit, one_set = home_units(arm.most)
    strata = np.concatenate([UNITS * t + unit for t in range(arm.tasks)])
    sets = np.tile(one_set, arm.tasks)
    first, rows = _drawn(draw, pools, arm.most, studies), []
    for what, second in _worse(draw, pools, arm.most, studies):
        ranks, means, failures = (
            _found(test, first, second, strata, sets) for test in (rank_tests, _means, by_failures)
        )
        gap, _, error = by_means(first, second, strata)
        inside = np.abs(gap) + 1.6449 * error < BOUND
        rows.append(Found(arm.name, what, ranks, means, failures, float(inside.mean())))
    return rows


def _means(first: Floats, second: Floats, strata: Whole) -> tuple[Floats, Floats]:
    return by_means(first, second, strata)[:2]


_Test = Callable[[Floats, Floats, Whole], tuple[Floats, Floats]]


def _found(test: _Test, first: Floats, second: Floats, strata: Whole, sets: Whole) -> float:
    """Share of studies in which p is below the step, and the effect has one sign in both seed sets."""
    _, p = test(first, second, strata)
    signs = [np.sign(test(first[:, at], second[:, at], strata[at])[0]) for at in (sets == 0, sets == 1)]
    return float(((p < STEP) & (signs[0] * signs[1] > 0)).mean())


def _worse(
    draw: np.random.Generator, pools: list[Floats], runs: int, studies: int
) -> list[tuple[str, Floats]]:
    """The second group, by what is worse in it."""
    plain = _drawn(draw, pools, runs, studies)
    lower = np.minimum(plain, _drawn(draw, pools, runs, studies))
    some = np.where(draw.random(plain.shape) < 0.6, lower, plain)
    failing = []
    for pool in pools:
        low, high = pool[pool < FAILED], pool[pool >= FAILED]
        fails = draw.random((studies, runs)) < len(low) / len(pool) + 0.1
        chosen = draw.choice(low, fails.shape), draw.choice(high, fails.shape)
        failing.append(np.where(fails, *chosen))
    return [
        ("nothing", plain), ("60 % score the lower of two draws", some),
        ("all do", lower), ("a tenth more failures", np.concatenate(failing, axis=1)),
    ]  # fmt: skip


def _drawn(draw: np.random.Generator, pools: list[Floats], runs: int, studies: int) -> Floats:
    """Scores [studies, tasks · runs]."""
    return np.concatenate([draw.choice(pool, (studies, runs)) for pool in pools], axis=1)


def falls(data: Crossed) -> list[Floats]:
    """By task: how much fitness falls from calibration unit to foreign units, about its mean at a level, in
    standard deviations."""
    out = []
    for task in data.tasks:
        here = data.part(task=task)
        fall = here.situated_home - here.situated_foreign
        rest = [fall[here.evolved == level] - fall[here.evolved == level].mean() for level in here.levels]
        every = np.concatenate(rest)
        out.append(every / every.std())
    return out


class Envelope(NamedTuple):
    """Shares of studies in which (d) is found over levels 0, 1 and 2 and over all of the arm's: at the step
    of .05/12, and at .05."""

    arm: str
    rho: float
    planned: float
    every: float
    planned_alone: float
    every_alone: float


def envelope(arm: Arm, data: Crossed, *, studies: int = STUDIES, seed: int = 2027) -> list[Envelope]:
    """A row for each true correlation, over all the arm's levels, of fall and level's root.

    Units are a random factor: each calibration unit has a slope, their mean is tested by Student's t.
    """
    draw, rows = np.random.default_rng(seed), []
    level = np.repeat(list(arm.runs), list(arm.runs.values()))
    unit, sets = np.concatenate([home_units(runs) for runs in arm.runs.values()], axis=1)
    x = (np.sqrt(level) - np.sqrt(level).mean()) / np.sqrt(level).std()
    tested = (np.isin(level, PLANNED), np.ones(len(level), bool))
    for rho in CORRELATIONS:
        slope = (rho + SLOPE_SPREAD * draw.standard_normal((studies, UNITS)))[:, unit]
        fall = []
        for pool in falls(data)[: arm.tasks]:
            noise = math.sqrt(1 - rho**2) * draw.choice(pool, (studies, len(x)))
            fall.append(slope * x + noise + UNIT_SPREAD * draw.standard_normal((studies, UNITS))[:, unit])
        found = []
        for keep in tested:
            t, *signs = (_student(fall, x, unit, keep & of) for of in (sets >= 0, sets == 0, sets == 1))
            agreed = (signs[0] < 0) & (signs[1] < 0)
            found.append([float((agreed & (t < -limit)).mean()) for limit in (T_STEP, T_ALONE)])
        (first, alone), (every, every_alone) = found
        rows.append(Envelope(arm.name, rho, first, every, alone, every_alone))
    return rows


def _student(fall: list[Floats], x: Floats, unit: Whole, keep: NDArray[np.bool_]) -> Floats:
    """Student's t [studies] over units of the slope, the tasks' mean, of some controllers' fall over x."""
    slopes = []
    for mine in (keep & (unit == k) for k in range(UNITS)):
        away = x[mine] - x[mine].mean()
        slopes.append(np.mean([one[:, mine] @ away for one in fall], axis=0) / (away @ away))
    each = np.array(slopes)
    return np.asarray(each.mean(axis=0) / (each.std(axis=0, ddof=1) / math.sqrt(UNITS)))


T_STEP, T_ALONE = 3.375, 2.131
"""Student's t of 15 degrees of freedom, two-sided, at the step of .05/12 and at .05."""


def _two_sided(z: Floats) -> Floats:
    return np.array([math.erfc(abs(one) / math.sqrt(2)) for one in z])


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def tables() -> str:
    """Both tables of the plan, as Markdown."""
    data = {arm.study: read_results(DATA / arm.study).data for arm in ARMS}
    lines = ["| arm | what is worse in the second group | ranks | means | failures | half a point excluded |"]
    lines.append("|---" * 6 + "|")
    for arm in ARMS:
        for row in levels_compared(arm, data[arm.study]):
            lines.append("| " + " | ".join([row.arm, row.what, *map(_percent, row[2:])]) + " |")
    lines += ["", "| arm | true correlation | over 0, 1, 2 | over all levels | over 0, 1, 2, at .05 | "
              "over all levels, at .05 |", "|---" * 6 + "|"]  # fmt: skip
    for arm in ARMS:
        for one in envelope(arm, data[arm.study]):
            lines.append("| " + " | ".join([one.arm, f"{one.rho:g}", *map(_percent, one[2:])]) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(tables())
