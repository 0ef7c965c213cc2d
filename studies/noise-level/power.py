"""Power of the planned rank test at 80 controllers against 80, by simulation: the table of plan.md.

    python studies/noise-level/power.py

Two groups of as many controllers of each task and calibration unit as in the default study draw their scores
from those that its controllers had against the simulation at the robot's level; then the second group is
made worse. Found: the p of claims (b) and (c) is below .05/4, Holm's step where the eight comparisons of (a)
and of one other claim have passed before.
"""

import sys
from pathlib import Path

import numpy as np
from crossed import Floats, load
from numpy.typing import NDArray
from scipy import stats

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import markdown

STUDIES, SEED, STEP = 4000, 1995, 0.05 / 4
FAILED, MORE = 6.0, 0.1
"""Scores below the first fail; a tenth more of them."""
SHARES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
"""Share of the second group that scores the lower of two draws; all of them: a delta of a third."""


def rank_tests(first: Floats, second: Floats, stratum: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Cliff's delta and p of many studies [studies, n] at once, as `crossed.unpaired` gives of one."""
    excess, variance, pairs = np.zeros(len(first)), np.zeros(len(first)), 0
    for k in np.unique(stratum):
        x, y = first[:, stratum == k], second[:, stratum == k]
        (n, m), both = (x.shape[1], y.shape[1]), np.concatenate([x, y], axis=1)
        excess += np.sign(x[:, :, None] - y[:, None, :]).sum(axis=(1, 2))
        same = (both[:, :, None] == both[:, None, :]).sum(axis=2)
        tied = (same**2 - 1).sum(axis=1)  # a group of t ties counts t (t² − 1)
        variance += n * m / 12 * (n + m + 1 - tied / ((n + m) * (n + m - 1)))
        pairs += n * m
    z = np.maximum(np.abs(excess) / 2 - 0.5, 0.0) / np.sqrt(variance)
    return excess / pairs, 2 * stats.norm.sf(z)


def powers(studies: int = STUDIES) -> list[tuple[str, float, float, float]]:
    """What is worse, mean Cliff's delta, share found, share found with both seed sets of one sign."""
    study = load("default")
    own = study.controllers[study.evolved == study.robot]
    stratum = own.groupby(["task", "home_unit"], sort=False).ngroup().to_numpy()
    sets, scores = own["seed_set"].to_numpy(), study.at(study.robot)
    pools = [scores[study.controllers["task"] == task] for task in own["task"]]
    draw = np.random.default_rng(SEED)

    def drawn() -> Floats:
        return np.column_stack([draw.choice(pool, studies) for pool in pools])

    def failing() -> Floats:
        columns = []
        for pool in pools:
            low, high = pool[pool < FAILED], pool[pool >= FAILED]
            fails = draw.random(studies) < len(low) / len(pool) + MORE
            columns.append(np.where(fails, draw.choice(low, studies), draw.choice(high, studies)))
        return np.column_stack(columns)

    def row(what: str, first: Floats, second: Floats) -> tuple[str, float, float, float]:
        delta, p = rank_tests(first, second, stratum)
        alone = [rank_tests(first[:, sets == s], second[:, sets == s], stratum[sets == s])[0] for s in (1, 2)]
        found, agreed = p < STEP, np.sign(alone[0]) == np.sign(alone[1])
        return what, abs(float(delta.mean())), float(found.mean()), float((found & agreed).mean())

    rows = []
    for share in SHARES:
        first, second = drawn(), drawn()
        worse = draw.random(second.shape) < share
        second = np.where(worse, np.minimum(second, drawn()), second)
        rows.append(
            row(f"{100 * share:.0f} % score the lower of two draws" if share else "nothing", first, second)
        )
    first, second = drawn(), failing()
    return [*rows, row("a tenth more failures", first, second)]


def table(rows: list[tuple[str, float, float, float]]) -> str:
    """The rows as Markdown."""
    head = ("what is worse in the second group", "Cliff's delta", "found", "and both seed sets agree")
    return markdown(head, [(w, f"{d:.2f}", f"{100 * f:.1f} %", f"{100 * a:.1f} %") for w, d, f, a in rows])


if __name__ == "__main__":
    made = powers()
    graded = made[: len(SHARES)]
    delta = np.interp(0.8, [row[2] for row in graded], [row[1] for row in graded])
    sys.stdout.write(f"{table(made)}\n\nA delta of {delta:.2f} is found in four studies of five.\n")
