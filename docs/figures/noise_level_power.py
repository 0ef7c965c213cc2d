"""What the planned rank test finds of what may be there: power at 80 controllers against 80, by simulation.

`python docs/figures/noise_level_power.py` prints the table of docs/noise-level.md. Two groups of as many
controllers of each task and home unit as in the default study draw their scores from those that its
controllers had against the simulation at the robot's level; then the second group is made worse. Found is
what the test of claims (b) and (c) puts below Holm's step of .05/4, where the eight comparisons of (a)
and of one other claim have passed before.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.experiments.noise.crossed import Crossed
from realitygap.report.noise.facts import FAILED
from realitygap.report.noise.results import read_results

DATA = Path(__file__).resolve().parent.parent / "noise-level" / "default"
STUDIES = 4000
STEP = 0.05 / 4
SHARES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
"""Of the second group: who scores the lower of two draws. All of them make a delta of a third."""
MORE = 0.1
"""A tenth more failures: scores below 6."""

Floats = NDArray[np.float64]


class Power(NamedTuple):
    """How often a difference is found; and how often both seed sets agree in sign besides, as is planned."""

    what: str
    delta: float
    found: float
    agreed: float


def powers(data: Crossed, *, studies: int = STUDIES, seed: int = 1995) -> list[Power]:
    """A row for each difference that there may be."""
    draw = np.random.default_rng(seed)
    strata, sets, pools = _design(data)
    rows = []
    for share in SHARES:
        first, second = _drawn(draw, pools, studies), _drawn(draw, pools, studies)
        worse = draw.random(second.shape) < share
        second = np.where(worse, np.minimum(second, _drawn(draw, pools, studies)), second)
        what = f"{share:.0%} score the lower of two draws".replace("%", " %") if share else "nothing"
        rows.append(_power(what, first, second, strata, sets))
    first, second = _drawn(draw, pools, studies), _failing(draw, pools, studies)
    return [*rows, _power("a tenth more failures", first, second, strata, sets)]


def least_delta(rows: list[Power], power: float = 0.8) -> float:
    """The delta that is found so often, between the rows that score the lower of two draws."""
    graded = rows[: len(SHARES)]
    return float(np.interp(power, [row.found for row in graded], [row.delta for row in graded]))


def _design(data: Crossed) -> tuple[NDArray[np.int64], NDArray[np.int64], list[Floats]]:
    """Stratum and seed set of each controller evolved at the robot's level; its task's scores in (b)."""
    rows = np.flatnonzero(data.evolved == data.robot)
    keys = list(zip(data.task[rows].tolist(), data.home[rows].tolist(), strict=True))
    number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    scores = data.at(data.robot)
    pools = [scores[data.task == task] for task in data.task[rows]]
    return np.array([number[key] for key in keys]), data.seed_set[rows], pools


def _drawn(draw: np.random.Generator, pools: list[Floats], studies: int) -> Floats:
    """Scores [studies, n]."""
    return np.column_stack([draw.choice(pool, studies) for pool in pools])


def _failing(draw: np.random.Generator, pools: list[Floats], studies: int) -> Floats:
    """The same, with a tenth more that fail."""
    columns = []
    for pool in pools:
        low, high = pool[pool < FAILED], pool[pool >= FAILED]
        fails = draw.random(studies) < len(low) / len(pool) + MORE
        columns.append(np.where(fails, draw.choice(low, studies), draw.choice(high, studies)))
    return np.column_stack(columns)


def _power(
    what: str, first: Floats, second: Floats, strata: NDArray[np.int64], sets: NDArray[np.int64]
) -> Power:
    delta, p = rank_tests(first, second, strata)
    each = [sets == number for number in set(sets.tolist())]
    alone = [rank_tests(first[:, one], second[:, one], strata[one])[0] for one in each]
    found, signs = p < STEP, np.sign(alone)
    agreed = found & (signs == signs[0]).all(axis=0)
    return Power(what, float(delta.mean()), float(found.mean()), float(agreed.mean()))


def rank_tests(first: Floats, second: Floats, strata: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Cliff's delta and p of many studies [studies, n] at once: what `contrasts.unpaired` says of each."""
    excess, spread, pairs = np.zeros(len(first)), np.zeros(len(first)), 0
    for k in set(strata.tolist()):
        x, y = first[:, strata == k], second[:, strata == k]
        (n, m), both = (x.shape[1], y.shape[1]), np.concatenate([x, y], axis=1)
        excess += np.sign(x[:, :, None] - y[:, None, :]).sum(axis=(1, 2))
        same = (both[:, :, None] == both[:, None, :]).sum(axis=2)
        tied = (same**2 - 1).sum(axis=1)  # a group of t ties counts t (t² − 1)
        spread += n * m / 12 * (n + m + 1 - tied / ((n + m) * (n + m - 1)))
        pairs += n * m
    z = np.maximum(np.abs(excess) / 2 - 0.5, 0.0) / np.sqrt(spread)
    return excess / pairs, np.array([math.erfc(one / math.sqrt(2)) for one in z])


def table(rows: list[Power]) -> str:
    """The rows as Markdown."""
    lines = ["| what is worse in the second group | Cliff's delta | found | and both seed sets agree |"]
    lines += ["|---" * 4 + "|"]
    for row in rows:
        shares = f"{100 * row.found:.1f} % | {100 * row.agreed:.1f} %"
        lines.append(f"| {row.what} | {abs(row.delta):.2f} | {shares} |")
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    rows = powers(read_results(DATA).data)
    print(table(rows))
    print(f"\nA delta of {least_delta(rows):.2f} is found in four studies of five.")


if __name__ == "__main__":
    main()
