"""What the second study's planned tests find of what may be there, by simulation on the first study's scores.

`python docs/figures/noise_level_2_power.py` prints the tables of docs/noise-level-2.md (a minute).

Claims (b) and (c): two groups of controllers draw their scores from those that the default study's had
against the simulation at the robot's level, task by task, spread over sixteen calibration units; then the
second group is made worse, and three statistics look for it. Claim (d): controllers draw their fall of
fitness, from calibration unit to foreign units, from a first study's; a slope over the noise that they
evolved under is put in, and units differ besides.
"""

from __future__ import annotations

import math
import sys
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
RUNS = (40, 80, 160)
"""Of a task and a level."""
CORRELATIONS = (0.0, -0.1, -0.2, -0.3)
"""Of the fall of fitness with the root of the level, in the mean unit."""
SLOPE_SPREAD, UNIT_SPREAD = 0.1, 0.5
"""Standard deviations over units: of that correlation, and of the fall itself, in those of the fall."""

Floats = NDArray[np.float64]


class Found(NamedTuple):
    """Shares of studies: found by ranks, by means, by failures; and a difference of half a point excluded."""

    what: str
    runs: int
    ranks: float
    means: float
    failures: float
    excluded: float


def by_means(first: Floats, second: Floats, strata: NDArray[np.int64]) -> tuple[Floats, Floats, Floats]:
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


def by_failures(first: Floats, second: Floats, strata: NDArray[np.int64]) -> Floats:
    """p of the share of failures: Cochran, Mantel and Haenszel's test."""
    excess, spread = np.zeros(len(first)), np.zeros(len(first))
    for k in set(strata.tolist()):
        x, y = first[:, strata == k] < FAILED, second[:, strata == k] < FAILED
        n, m, failed = x.shape[1], y.shape[1], x.sum(axis=1) + y.sum(axis=1)
        total = n + m
        excess += x.sum(axis=1) - n * failed / total
        spread += n * m * failed * (total - failed) / (total**2 * (total - 1))
    return _two_sided(np.maximum(np.abs(excess) - 0.5, 0.0) / np.sqrt(np.maximum(spread, 1e-12)))


def levels_compared(data: Crossed, *, studies: int = STUDIES, seed: int = 2026) -> list[Found]:
    """A row for each difference that there may be, and each number of runs."""
    draw, rows = np.random.default_rng(seed), []
    scores = data.at(data.robot)
    pools = [scores[data.task == task] for task in data.tasks]
    for runs in RUNS:
        strata = np.concatenate([UNITS * t + np.arange(runs) % UNITS for t in range(len(pools))])
        first = _drawn(draw, pools, runs, studies)
        for what, second in _worse(draw, pools, runs, studies):
            _, ranks = rank_tests(first, second, strata)
            gap, means, error = by_means(first, second, strata)
            inside = np.abs(gap) + 1.6449 * error < BOUND
            failures = by_failures(first, second, strata)
            shares = [float((p < STEP).mean()) for p in (ranks, means, failures)]
            rows.append(Found(what, runs, *shares, float(inside.mean())))
    return rows


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


def envelope(
    data: Crossed, *, studies: int = STUDIES, seed: int = 2027
) -> list[tuple[int, float, float, float]]:
    """Runs, true correlation of fall and level's root, and how often it is found: at the step, and at .05.

    Units are a random factor: each calibration unit has a slope, their mean is tested by Student's t.
    """
    draw, rows = np.random.default_rng(seed), []
    pools, root = falls(data), np.sqrt(data.levels)
    about = (root - root.mean()) / root.std()
    for runs in RUNS:
        level = np.repeat(np.arange(len(root)), runs)
        unit = np.tile(np.arange(runs) % UNITS, len(root))
        x = about[level]
        for rho in CORRELATIONS:
            slope = rho + SLOPE_SPREAD * draw.standard_normal((studies, UNITS))
            slopes = []
            for pool in pools:
                noise = math.sqrt(1 - rho**2) * draw.choice(pool, (studies, len(x)))
                fall = (
                    slope[:, unit] * x + noise + UNIT_SPREAD * draw.standard_normal((studies, UNITS))[:, unit]
                )
                for mine in (unit == k for k in range(UNITS)):
                    away = x[mine] - x[mine].mean()
                    slopes.append(fall[:, mine] @ away / (away @ away))
            each = np.array(slopes).reshape(len(pools), UNITS, studies).mean(axis=0)
            t = each.mean(axis=0) / (each.std(axis=0, ddof=1) / math.sqrt(UNITS))
            found = t < -T_STEP
            rows.append((runs, rho, float(found.mean()), float((t < -T_ALONE).mean())))
    return rows


T_STEP, T_ALONE = 3.375, 2.131
"""Student's t of 15 degrees of freedom, two-sided, at the step of .05/12 and at .05."""


def _two_sided(z: Floats) -> Floats:
    return np.array([math.erfc(abs(one) / math.sqrt(2)) for one in z])


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def main() -> None:
    """Print the tables."""
    data = read_results(DATA / "default").data
    head = "what is worse in the second group | runs of a task and level | ranks | means | failures"
    print(f"| {head} | half a point excluded |")
    print("|---" * 6 + "|")
    for row in levels_compared(data):
        print("| " + " | ".join([row.what, str(row.runs), *map(_percent, row[2:])]) + " |")
    longer = read_results(DATA / "evaluations-5000").data
    print("\n| runs of a task and level | true correlation | found at .05/12 | found at .05 |")
    print("|---" * 4 + "|")
    for runs, rho, first, alone in envelope(longer):
        print(f"| {runs} | {rho:g} | {_percent(first)} | {_percent(alone)} |")


if __name__ == "__main__":
    main()
