"""What the planned tests find of what may be there, by simulation on the first studies' scores.

`python studies/noise-level-2/power.py` prints the two tables of plan.md, in ten seconds.

(b): two groups draw their scores, task by task, from those of the first study most like the arm, spread over
sixteen units and two seed sets; the second group is made worse, and three statistics look for it. (d): the
fall of fitness is drawn from the same study, with a slope over the level's root, by which units differ too.
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import pandas as pd
from common import markdown, table
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]
UNITS = 16
STEP = 0.05 / 12
"""The hardest step of Holm's correction over an arm's twelve comparisons."""
BOUND, FAILED = 0.5, 6.0
CORRELATIONS = (0.0, -0.1, -0.2, -0.3)
SLOPE_SPREAD, UNIT_SPREAD = 0.1, 0.5
"""Standard deviations over units: of the correlation, and of the fall itself, in those of the fall."""
FULL = {0.0: 160, 0.5: 80, 1.0: 160, 2.0: 160, 4.0: 80}
ARMS = {
    "E": (1, FULL, "default"),
    "T": (2, FULL, "default"),
    "E5": (1, dict.fromkeys((0.0, 1.0, 2.0), 160), "evaluations-5000"),
    "T5": (2, dict.fromkeys((0.0, 1.0, 2.0), 80), "evaluations-5000"),
    "T2": (2, dict.fromkeys((0.0, 0.5, 1.0, 2.0), 80), "twin-noise-2"),
}
"""Tasks, runs of a task by level, and the first study whose scores and falls stand for the arm's own."""


def read(study: str) -> pd.DataFrame:
    """A first study's controllers: score at level 1, and fall of fitness to the foreign units."""
    key = ["task", "seed_set", "run", "evolved_level"]
    who, cells = (table(f"noise-level/{study}/{name}.csv") for name in ("controllers", "cells"))
    at_one = cells[cells["comparison_level"] == 1.0].set_index(key)["score"]
    fitness = who.filter(regex=r"^fitness_situated_unit_\d+$")
    fitness.columns = [int(name.rsplit("_", 1)[1]) for name in fitness]
    own = np.array([fitness.at[k, home] for k, home in who["home_unit"].items()])
    fall = own - (fitness.sum(axis=1) - own) / (fitness.shape[1] - 1)
    return who[key].assign(score=at_one.loc[pd.MultiIndex.from_frame(who[key])].to_numpy(), fall=fall)


def home_units(runs: int) -> tuple[Whole, Whole]:
    """Calibration unit and seed set [runs]: half in each set, the units in turn."""
    return np.tile(np.arange(runs // 2) % UNITS, 2), np.repeat([0, 1], runs // 2)


def by_ranks(first: Floats, second: Floats, strata: Whole) -> tuple[Floats, Floats]:
    """Sum of ranks in favour of the first and p, of many studies [studies, n], within strata."""
    excess, spread = np.zeros(len(first)), np.zeros(len(first))
    for k in np.unique(strata):
        x, y = first[:, strata == k], second[:, strata == k]
        n, both = x.shape[1], np.concatenate([x, y], axis=1)
        total = both.shape[1]
        ranks = stats.rankdata(both, axis=1)
        excess += ranks[:, :n].sum(axis=1) - n * (total + 1) / 2
        tied = ((both[:, :, None] == both[:, None, :]).sum(axis=2) ** 2 - 1).sum(axis=1)
        spread += n * (total - n) / 12 * (total + 1 - tied / (total * (total - 1)))
    return excess, two_sided(np.maximum(np.abs(excess) - 0.5, 0.0) / np.sqrt(spread))


def by_means(first: Floats, second: Floats, strata: Whole) -> tuple[Floats, Floats, Floats]:
    """Difference of means, its p by the stratified permutation test (the normal limit), standard error."""
    gap, null, error = np.zeros(len(first)), np.zeros(len(first)), np.zeros(len(first))
    for k in np.unique(strata):
        x, y = first[:, strata == k], second[:, strata == k]
        share, n, m = np.mean(strata == k), x.shape[1], y.shape[1]
        gap += share * (x.mean(axis=1) - y.mean(axis=1))
        null += share**2 * np.concatenate([x, y], axis=1).var(axis=1, ddof=1) * (1 / n + 1 / m)
        error += share**2 * (x.var(axis=1, ddof=1) / n + y.var(axis=1, ddof=1) / m)
    return gap, two_sided(gap / np.sqrt(null)), np.sqrt(error)


def by_failures(first: Floats, second: Floats, strata: Whole) -> tuple[Floats, Floats]:
    """Excess of failures in the first, and its p by Cochran, Mantel and Haenszel's test."""
    excess, spread = np.zeros(len(first)), np.zeros(len(first))
    for k in np.unique(strata):
        x, y = first[:, strata == k] < FAILED, second[:, strata == k] < FAILED
        n, total, failed = x.shape[1], x.shape[1] + y.shape[1], x.sum(axis=1) + y.sum(axis=1)
        excess += x.sum(axis=1) - n * failed / total
        spread += n * (total - n) * failed * (total - failed) / (total**2 * (total - 1))
    return excess, two_sided(np.maximum(np.abs(excess) - 0.5, 0.0) / np.sqrt(np.maximum(spread, 1e-12)))


def two_sided(z: Floats) -> Floats:
    """p of a normal deviate."""
    return 2 * stats.norm.sf(np.abs(z))


def levels_compared(name: str, studies: int) -> Iterator[tuple[str, ...]]:
    """A row for each difference that there may be between two levels of an arm."""
    tasks, runs, study = ARMS[name]
    draw, most = np.random.default_rng(2026), runs[1.0]
    pools = [part["score"].to_numpy() for _, part in read(study).groupby("task", sort=False)][:tasks]
    unit, one_set = home_units(most)
    strata = np.concatenate([UNITS * t + unit for t in range(tasks)])
    sets = np.tile(one_set, tasks)

    def drawn() -> Floats:
        return np.concatenate([draw.choice(pool, (studies, most)) for pool in pools], axis=1)

    first, plain = drawn(), drawn()
    lower = np.minimum(plain, drawn())
    some = np.where(draw.random(plain.shape) < 0.6, lower, plain)
    failing = []
    for pool in pools:
        low, high = pool[pool < FAILED], pool[pool >= FAILED]
        fails = draw.random((studies, most)) < len(low) / len(pool) + 0.1
        failing.append(np.where(fails, draw.choice(low, fails.shape), draw.choice(high, fails.shape)))
    worse = {
        "nothing": plain,
        "60 % score the lower of two draws": some,
        "all do": lower,
        "a tenth more failures": np.concatenate(failing, axis=1),
    }
    for what, second in worse.items():
        found = [_found(test, first, second, strata, sets) for test in (by_ranks, by_means, by_failures)]
        gap, _, error = by_means(first, second, strata)
        yield name, what, *map(percent, (*found, float((np.abs(gap) + 1.6449 * error < BOUND).mean())))


def _found(test: Callable[..., tuple], first: Floats, second: Floats, strata: Whole, sets: Whole) -> float:
    """Share of studies in which p is below the step, and the effect has one sign in both seed sets."""
    p = test(first, second, strata)[1]
    signs = [np.sign(test(first[:, at], second[:, at], strata[at])[0]) for at in (sets == 0, sets == 1)]
    return float(((p < STEP) & (signs[0] * signs[1] > 0)).mean())


def envelope(name: str, studies: int) -> Iterator[tuple[str, ...]]:
    """A row for each true correlation of fall and level's root, over all the arm's levels."""
    tasks, runs, study = ARMS[name]
    draw, level = np.random.default_rng(2027), np.repeat(list(runs), list(runs.values()))
    unit, sets = np.concatenate([home_units(count) for count in runs.values()], axis=1)
    x = (np.sqrt(level) - np.sqrt(level).mean()) / np.sqrt(level).std()
    pools = []
    for _, part in read(study).groupby("task", sort=False):
        rest = [one["fall"] - one["fall"].mean() for _, one in part.groupby("evolved_level")]
        pools.append(np.concatenate(rest) / np.concatenate(rest).std())
    limits = stats.t.isf(np.array([STEP, 0.05]) / 2, UNITS - 1)
    for rho in CORRELATIONS:
        slope = (rho + SLOPE_SPREAD * draw.standard_normal((studies, UNITS)))[:, unit]
        fall = []
        for pool in pools[:tasks]:
            noise = np.sqrt(1 - rho**2) * draw.choice(pool, (studies, len(x)))
            fall.append(slope * x + noise + UNIT_SPREAD * draw.standard_normal((studies, UNITS))[:, unit])
        shares = []
        for keep in (np.isin(level, (0.0, 1.0, 2.0)), np.ones(len(level), bool)):
            t, *signs = (_student(fall, x, unit, keep & of) for of in (sets >= 0, sets == 0, sets == 1))
            agreed = (signs[0] < 0) & (signs[1] < 0)
            shares.append([float((agreed & (t < -limit)).mean()) for limit in limits])
        yield name, f"{rho:g}", *map(percent, np.array(shares).T.ravel())


def _student(fall: list[Floats], x: Floats, unit: Whole, keep: NDArray[np.bool_]) -> Floats:
    """Student's t [studies] over units of the slope, the tasks' mean, of some controllers' fall over x."""
    slopes = []
    for mine in (keep & (unit == k) for k in range(UNITS)):
        away = x[mine] - x[mine].mean()
        slopes.append(np.mean([one[:, mine] @ away for one in fall], axis=0) / (away @ away))
    return np.mean(slopes, axis=0) / stats.sem(slopes, axis=0)


def percent(share: float) -> str:
    """A share as printed."""
    return f"{100 * share:.0f} %"


def tables(studies: int) -> str:
    """Both tables of the plan."""
    head = ["arm", "what is worse in the second group", "ranks", "means", "failures", "half a point excluded"]
    first = markdown(head, [row for name in ARMS for row in levels_compared(name, studies)])
    head = ["arm", "true correlation", "over 0, 1, 2", "over all levels", "over 0, 1, 2, at .05"]
    rows = [row for name in ARMS for row in envelope(name, studies)]
    return f"{first}\n\n{markdown([*head, 'over all levels, at .05'], rows)}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=2000, help="simulated studies a row")
    print(tables(parser.parse_args().studies))
