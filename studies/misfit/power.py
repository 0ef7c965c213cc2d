"""What the plan's primary tests can find, by simulation (the tables of plan.md): python power.py.

The pilots' single scores were not kept: their failures and rank correlations were. Failures are drawn with
the shares that the smaller pilot found at misfit 3.7, fitness with the deviation that the first pilot's
correlation implies and the slope of the smaller one's; both fall to no trend at misfit 0.4, linearly in the
logarithm. Units differ in their trends as well.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from pathlib import Path

import numpy as np
from scipy import stats
from trend import CONTRAST, PLAN, against, interaction

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import markdown

ARMS = tomllib.loads(Path(__file__).with_name("arms.toml").read_text("utf-8"))
LEVELS = np.array(ARMS["design"]["evolved"])
MISFITS = {
    "K": [0.0, 3.7, 3.35],
    "E": [0.4, 1.3, 4.3, 3.0, 3.7, 3.7],
    "T": [0.8, 4.5, 8.0, 4.0, 8.0, 8.0],
}
"""Of each simulation, from the trials and former studies; another unit's are guesses."""
PILOTS = {
    "the first pilot's": ((10, 21, 25, 38), 80, -0.27),
    "the smaller pilot's": ((13, 12, 15, 19), 60, -0.14),
}
FITNESS = 0.556, 0.491
"""Mean fitness at levels 0 and 4 in the first pilot, whose correlation was −.27."""
TESTS = 6
SPREAD = 0.5
"""Deviation of units' trends, as a share of the smaller pilot's trend at misfit 3.7."""


def slopes(failed: tuple[int, ...], of: int, rho: float) -> tuple[float, float, float]:
    """Per root of level: share of failures, fitness; and the deviation of fitness."""
    root = np.sqrt(LEVELS)
    first = abs(np.polyfit(root, np.linspace(*FITNESS, 4), 1)[0])
    sigma = first * root.std() / 0.27
    return float(np.polyfit(root, np.array(failed) / of, 1)[0]), rho * sigma / root.std(), float(sigma)


def chances(arm: str, pilot: str | None, share: float, studies: int) -> tuple[list[float], list[float]]:
    """Shares of studies that find the trend of failures and of fitness, and that exclude what counts."""
    draw = np.random.default_rng(31170)
    rise, fall, sigma = slopes(*PILOTS[pilot or "the smaller pilot's"])
    rise0, fall0, _ = slopes(*PILOTS["the smaller pilot's"])
    size = share if pilot else 0.0
    misfit = np.array(MISFITS[arm])
    runs = ARMS["arm"][arm]["runs"]
    worse = (against(misfit) - np.log2(0.4)) / (np.log2(3.7) - np.log2(0.4))
    units = 16 if arm != "K" else 6
    made: list[np.ndarray] = []
    sets = np.repeat([1, 2], units // 2)
    for unit in range(units):
        n = runs if arm != "K" else runs[unit]
        which, level = (part.ravel() for part in np.meshgrid(np.repeat(np.arange(len(misfit)), n), LEVELS))
        root, own = np.sqrt(level), worse[which]
        differ = SPREAD * draw.standard_normal((studies, 1)) * (arm != "K")
        share_failed = (
            0.17 * np.clip(own, 0.03, 1.3) + (size * rise + differ * rise0) * np.clip(own, 0, 1.3) * root
        )
        failed = draw.random((studies, len(root))) < np.clip(share_failed, 0.005, 0.95)
        fitness = (size * fall + differ * fall0) * own * root + sigma * draw.standard_normal(
            (studies, len(root))
        )
        made.append(
            np.stack([interaction(level, misfit[which], which, y.astype(float)) for y in (failed, fitness)])
        )
    every = CONTRAST * np.stack(made, -1)  # [2, studies, units]
    # Arm K's realities are weighted by runs; the error is that of runs, from the spread over studies.
    weight = np.ones(units) if arm != "K" else np.array(runs) / np.sum(runs)
    mean = (every * weight).sum(-1) / weight.sum()
    if arm == "K":
        error = np.broadcast_to(mean.std(1, keepdims=True), mean.shape)
        agrees = np.ones(mean.shape, bool)
        half = float(stats.norm.isf(0.05)) * error
        p = 2 * stats.norm.sf(np.abs(mean) / error)
    else:
        error = every.std(-1, ddof=1) / np.sqrt(units)
        agrees = every[..., sets == 1].mean(-1) * every[..., sets == 2].mean(-1) > 0
        half = float(stats.t.isf(0.05, units - 1)) * error
        p = 2 * stats.t.sf(np.abs(mean) / error, units - 1)
    least = np.array([claim["least"] for claim in PLAN["claim"][:2]])[:, None]
    found = (p < PLAN["alpha"] / TESTS) & agrees
    return found.mean(1).tolist(), (np.abs(mean) + half < least).mean(1).tolist()


def table(studies: int) -> str:
    """A row for each arm and size of what there is."""
    rows = []
    for arm in MISFITS:
        for what, pilot, share in (
            ("nothing", None, 0.0), ("half the smaller pilot's", "the smaller pilot's", 0.5),
            ("the smaller pilot's", "the smaller pilot's", 1.0),
            ("the first pilot's", "the first pilot's", 1.0),
        ):  # fmt: skip
            found, absent = chances(arm, pilot, share, studies)
            rows.append([arm, what, *(f"{100 * one:.0f} %" for one in (*found, *absent))])
    head = ["arm", "trend", "failures found", "fitness found", "failures excluded", "fitness excluded"]
    return markdown(head, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=2000, help="simulated studies a row")
    print(table(parser.parse_args().studies))
