"""The study's statistics: how the trend over evolved noise changes with the model's misfit.

Noise enters as the root of its level, misfit as its logarithm to base 2, between a floor and a ceiling. The
interaction of a unit (or a reality) is the least-squares coefficient of their product beside a constant for
each of its simulations and a slope over noise; units are random: Student's t over their interactions.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]
PLAN = tomllib.loads(Path(__file__).with_name("claims.toml").read_text("utf-8"))
CONTRAST = float(np.diff(np.sqrt(PLAN["over"]))[0] * np.diff(np.log2(PLAN["between"]))[0])
"""An interaction times this is the contrast: what noise from one end of `over` to the other does at the worse
misfit of `between`, less what it does at the better one."""


class Trend(NamedTuple):
    """A contrast, its interval, p of its being none, two-sided, and the contrast in each seed set alone."""

    contrast: float
    low: float
    high: float
    p: float
    sets: tuple[float, float]

    @property
    def agrees(self) -> bool:
        """Whether it has one sign in both sets."""
        return self.sets[0] * self.sets[1] > 0

    def absent(self, least: float) -> bool:
        """Whether its interval excludes what counts, either way."""
        return -least < self.low and self.high < least


def against(misfit: Floats) -> Floats:
    """Logarithms of misfits (to base 2), between floor and ceiling."""
    return np.log2(np.clip(misfit, PLAN["floor"], PLAN["ceiling"]))


def interaction(level: Floats, misfit: Floats, simulation: NDArray, y: Floats) -> Floats:
    """[...] interactions of outcomes y [..., n] of one unit's controllers, all else [n]."""
    root, worse = np.sqrt(level), against(misfit)
    fixed = (simulation[:, None] == np.unique(simulation)).astype(float)
    design = np.column_stack([fixed, root, root * worse])
    return y @ np.linalg.pinv(design)[-1]


def over_units(slopes: Floats, sets: NDArray[np.int64]) -> Trend:
    """Student's t over units' interactions [U], which are of set 1 or 2 [U]."""
    here = slopes * CONTRAST
    mean, error = float(here.mean()), float(stats.sem(here))
    half = error * float(stats.t.isf((1 - PLAN["share"]) / 2, len(here) - 1))
    p = float(2 * stats.t.sf(abs(mean) / error, len(here) - 1)) if error else float(mean == 0)
    one, two = (float(here[sets == k].mean()) for k in (1, 2))
    return Trend(mean, mean - half, mean + half, p, (one, two))


def over_runs(level: Floats, misfit: Floats, stratum: NDArray, y: Floats, sets: NDArray[np.int64]) -> Trend:
    """The same where there are too few realities for units: runs [n] are what is drawn, within strata of
    reality and simulation. p by permuting levels within strata; the interval by resampling runs of a stratum
    and level."""
    draw = np.random.default_rng(PLAN["seed"])
    known = np.isfinite(y)
    level, misfit, stratum, y, sets = (part[known] for part in (level, misfit, stratum, y, sets))

    def found(some: NDArray, values: Floats = y) -> Floats:
        return CONTRAST * interaction(level[some], misfit[some], stratum[some], values[..., some])

    every = np.arange(len(y))
    here = float(found(every))
    groups = [np.flatnonzero(stratum == name) for name in np.unique(stratum)]
    beyond = 0
    for _ in range(PLAN["permutations"] // PLAN["resamples"]):
        mixed = np.tile(y, (PLAN["resamples"], 1))
        for rows in groups:
            mixed[:, rows] = draw.permuted(mixed[:, rows], axis=1)
        beyond += int((np.abs(found(every, mixed)) >= abs(here) - 1e-12).sum())
    p = (1 + beyond) / (1 + PLAN["permutations"])
    cells = [rows[level[rows] == one] for rows in groups for one in np.unique(level[rows])]
    drawn = np.tile(y, (PLAN["resamples"], 1))
    for rows in cells:
        drawn[:, rows] = draw.choice(y[rows], (len(drawn), len(rows)))
    tail = 100 * (1 - PLAN["share"]) / 2
    low, high = np.percentile(found(every, drawn), [tail, 100 - tail])
    one, two = (float(found(np.flatnonzero(sets == k))) for k in (1, 2))
    return Trend(here, float(low), float(high), p, (one, two))


def holm(values: list[float]) -> list[float]:
    """Holm's corrected p, in the order given."""
    order, worst, made = np.argsort(values, kind="stable"), 0.0, [0.0] * len(values)
    for k, i in enumerate(order.tolist()):
        worst = max(worst, min(1.0, (len(values) - k) * values[i]))
        made[i] = worst
    return made
