"""The crossed design of the first study: every controller, evolved at one level, compared at every level.

SciPy and statsmodels do the tests; the rank test within strata, the bootstrap over runs and the top of a
parabola are written here, since no library has them.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats
from statsmodels.stats.multitest import multipletests

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import archive, estimate, table

Floats = NDArray[np.float64]
Rows = NDArray[np.bool_]

BOTH = "both tasks"
AVOIDANCE, LIGHT = "obstacle-avoidance", "light-seeking"
UNITS = {AVOIDANCE: ("Obstacle avoidance", 1.0, 3), LIGHT: ("Light seeking, 10⁻⁶ cm⁻²", 1e-6, 2)}
"""Heading of each task's fitness, what it is divided by, and the decimals printed."""
PAPER = {
    AVOIDANCE: {0: (8, 7, 5, 7, 4), 1: (8, 9, 7, 9, 7), 2: (8, 8, 5, 6, 7)},
    LIGHT: {0: (4, 6, 8, 4, 6), 1: (8, 6, 9, 6, 10), 2: (2, 6, 7, 6, 6)},
}
"""The paper's correspondence scores, five controllers a noise level (tables 1 and 2)."""
ALPHA, RESAMPLES = 0.05, 2000


class Span(NamedTuple):
    """A value with its 95 % interval; NaN where there is none."""

    value: float
    low: float = np.nan
    high: float = np.nan

    def text(self, places: int = 2, *, signed: bool = False, scale: float = 1.0) -> str:
        return estimate(*(end / scale for end in self), places, signed=signed)


class Effect(NamedTuple):
    """Excess of one group of scores over another: Cliff's delta, difference of means, p (two-sided)."""

    delta: Span
    difference: Span
    p: float
    means: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Study:
    """The controllers of one making, or some of them.

    Attributes:
        controllers: [n] rows: task, seed_set, evolved_level, home_unit, name; fitness `simulated`, `situated`
            (mean over units), `at_home` (calibration unit) and `elsewhere` (mean of the others).
        score: [n, levels], correspondence score (0 to 10) against the simulation at each level.
        home_score: the same on the calibration unit alone; NaN if it was not kept.
        noisiness: [n, levels], above 0 where the twin is noisier than the simulation.
        robot: the robot's own level.
        resamples: how many the bootstrap makes; 0: no intervals.
    """

    controllers: pd.DataFrame
    score: pd.DataFrame
    home_score: pd.DataFrame
    noisiness: pd.DataFrame
    robot: float = 1.0
    resamples: int = RESAMPLES

    @property
    def levels(self) -> list[float]:
        return list(self.score.columns)

    @property
    def others(self) -> list[float]:
        return [level for level in self.levels if level != self.robot]

    @property
    def evolved(self) -> Floats:
        return self.controllers["evolved_level"].to_numpy()

    def only(self, keep: Rows) -> "Study":
        """The controllers that are marked [n]."""
        names = ("controllers", "score", "home_score", "noisiness")
        return replace(self, **{name: getattr(self, name)[keep].reset_index(drop=True) for name in names})

    def of_task(self, task: str) -> "Study":
        return self if task == BOTH else self.only((self.controllers["task"] == task).to_numpy())

    def at(self, level: float) -> Floats:
        """Scores [n] against the simulation at one level."""
        return self.score[level].to_numpy()

    def diagonal(self, *, home: bool = False) -> Floats:
        """Scores [n], each against the simulations at the level that the controller evolved at."""
        scores = (self.home_score if home else self.score).to_numpy()
        return scores[np.arange(len(scores)), np.searchsorted(self.levels, self.evolved)]

    @cached_property
    def weights(self) -> Floats:
        """How often each run is drawn in each resample [B, n], within task, seed set and evolved level."""
        draw, weights = np.random.default_rng(0), np.zeros((self.resamples, len(self.controllers)))
        cells = self.controllers.groupby(["task", "seed_set", "evolved_level"], sort=False).indices
        for rows in cells.values():
            weights[:, rows] = draw.multinomial(
                len(rows), np.full(len(rows), 1 / len(rows)), size=self.resamples
            )
        return weights


@cache
def load(name: str) -> Study:
    """An archived making."""
    key = ["task", "seed_set", "run", "evolved_level"]
    folder = f"noise-level/{name}"
    controllers = table(f"{folder}/controllers.csv")
    cells = table(f"{folder}/cells.csv").merge(controllers[[*key, "home_unit"]], on=key)
    units = sorted(int(c.rpartition("_")[2]) for c in controllers if c.startswith("fitness_situated_unit_"))
    fitness = controllers[[f"fitness_situated_unit_{unit}" for unit in units]].to_numpy()
    home = controllers["home_unit"].to_numpy()[:, None] == units
    controllers["simulated"] = controllers.pop("fitness_simulated")
    controllers["situated"] = controllers.pop("fitness_situated")
    controllers["at_home"] = fitness[home]
    controllers["elsewhere"] = fitness[~home].reshape(len(fitness), -1).mean(axis=1)
    if "score_unit_1" in cells:
        cells["home_score"] = np.select(
            [cells["home_unit"] == unit for unit in units], [cells[f"score_unit_{unit}"] for unit in units]
        )
    elif f"{folder}/home.csv" in archive():  # made again afterwards, by the original code and seeds
        home_scores = table(f"{folder}/home.csv").rename(columns={"score": "home_score"})
        cells = cells.merge(home_scores, on=[*key, "comparison_level"])
    else:
        cells["home_score"] = np.nan
    cells = cells.pivot(index=key, columns="comparison_level")
    cells = cells.loc[pd.MultiIndex.from_frame(controllers[key])].reset_index(drop=True)
    parts = {part: cells[part] for part in ("score", "home_score", "noisiness")}
    study = Study(controllers=controllers, **parts)
    if len(study.score) != len(controllers) or not np.isfinite(study.score.to_numpy()).all():
        raise ValueError(f"{folder}: expected a score of every controller at every level.")
    return study


# Effects -------------------------------------------------------------------------------------------------


def interval(values: Floats) -> tuple[float, float]:
    """The middle 95 % of resampled values."""
    if not values.size:
        return np.nan, np.nan
    low, high = np.nanquantile(values, [0.025, 0.975])
    return float(low), float(high)


def mean(values: Floats, weights: Floats) -> Span:
    """Mean of values [n] with its bootstrap interval; weights [B, n]."""
    return Span(float(values.mean()), *interval(weights @ values / weights.sum(axis=1)))


def paired(first: Floats, second: Floats, weights: Floats) -> Effect:
    """Two scores of the same controllers [n]: Wilcoxon's signed-rank test with Pratt's zeros."""
    gap = first - second
    p = stats.wilcoxon(gap, zero_method="pratt", correction=True, method="asymptotic").pvalue
    return Effect(mean(np.sign(gap), weights), mean(gap, weights), p, (first.mean(), second.mean()))


def unpaired(study: Study, values: Floats, first: Rows, second: Rows) -> Effect:
    """Values [n] of two groups of controllers, by Mann and Whitney's test within task and calibration unit.

    U less its expectation is summed over strata, and so is its variance under the null hypothesis, corrected
    for ties; then the normal approximation with correction for continuity.
    """
    stratum = study.controllers.groupby(["task", "home_unit"]).ngroup().to_numpy()
    x, y, a, b = values[first], values[second], stratum[first], stratum[second]
    same = (a[:, None] == b[None, :]).astype(float)
    sign = np.sign(x[:, None] - y[None, :]) * same
    variance = 0.0
    for k in np.union1d(a, b):
        n, m = (a == k).sum(), (b == k).sum()
        pooled = np.concatenate([x[a == k], y[b == k]])
        variance += n * m * (n + m + 1) / 12 * stats.tiecorrect(stats.rankdata(pooled))
    z = max(abs(sign.sum() / 2) - 0.5, 0.0) / np.sqrt(variance)
    u, v = study.weights[:, first], study.weights[:, second]
    with np.errstate(invalid="ignore"):
        deltas = ((u @ sign) * v).sum(axis=1) / ((u @ same) * v).sum(axis=1)
    gaps = u @ x / u.sum(axis=1) - v @ y / v.sum(axis=1)
    delta = Span(sign.sum() / same.sum(), *interval(deltas))
    difference = Span(float(x.mean() - y.mean()), *interval(gaps))
    return Effect(delta, difference, float(2 * stats.norm.sf(z)), (float(x.mean()), float(y.mean())))


def compare(study: Study, claim: str, other: float, among: Rows | None = None) -> Effect:
    """The robot's level against another for claim a, b or c, or for c on the calibration unit ("home")."""
    among = np.ones(len(study.score), bool) if among is None else among
    if claim == "a":
        return paired(study.at(study.robot)[among], study.at(other)[among], study.weights[:, among])
    values = study.at(study.robot) if claim == "b" else study.diagonal(home=claim == "home")
    return evolved(study, values, other, among)


def evolved(study: Study, values: Floats, other: float, among: Rows | None = None) -> Effect:
    """Controllers evolved at the robot's level against those evolved at another, by values [n]."""
    among = np.ones(len(study.score), bool) if among is None else among
    return unpaired(study, values, among & (study.evolved == study.robot), among & (study.evolved == other))


def contrasts(study: Study, claims: Sequence[str] = "abc") -> pd.DataFrame:
    """A row for each claim and each other level, with Holm's correction over all of them.

    Found is above if Cliff's delta is positive in every seed set alone and the corrected p is below .05,
    below if negative, else open.
    """
    rows = []
    sets, quick = study.controllers["seed_set"].to_numpy(), replace(study, resamples=0)
    for claim, other in product(claims, study.others):
        whole = compare(study, claim, other)
        alone = [compare(quick, claim, other, sets == one).delta.value for one in np.unique(sets)]
        rows.append({"claim": claim, "other": other, **whole._asdict(), "sets": alone})
    frame = pd.DataFrame(rows)
    frame["p_holm"] = multipletests(frame["p"], method="holm")[1]
    signs = [set(np.sign(alone)) for alone in frame["sets"]]
    words = ["above" if sign == {1.0} else "below" if sign == {-1.0} else "open" for sign in signs]
    frame["found"] = np.where(frame["p_holm"] < ALPHA, words, "open")
    return frame


def verdict(study: Study, rows: pd.DataFrame) -> str:
    """The planned verdict on one claim, from its contrasts: the first of plan.md's table that applies."""
    deciding = rows.loc[rows["other"].isin([0.0, 2 * study.robot]), "found"].tolist()
    if "below" in deciding and "above" not in deciding:
        return "opposite"
    if (rows["found"] == "below").any():
        return "elsewhere"
    above = deciding.count("above")
    return "not supported" if not above else "supported" if above == len(deciding) else "in part"


@cache
def judged(name: str, scope: str) -> pd.DataFrame:
    """Contrasts of a making, of both tasks or one."""
    return contrasts(scopes(name)[scope])


@cache
def scopes(name: str) -> dict[str, Study]:
    """Both tasks together and each alone."""
    return {scope: load(name).of_task(scope) for scope in (BOTH, AVOIDANCE, LIGHT)}


def verdicts(study: Study, judgements: pd.DataFrame) -> list[str]:
    """On claims a, b and c."""
    return [verdict(study, rows) for _, rows in judgements.groupby("claim")]


# Curves over levels ---------------------------------------------------------------------------------------


def column_means(values: Floats, weights: Floats) -> Floats:
    """Means [B, levels] of the known values [n, levels] of each column, weighted [B, n]."""
    known = np.isfinite(values)
    return (weights @ np.where(known, values, 0.0)) / (weights @ known.astype(float))


def curve(study: Study, claim: str) -> tuple[list[Span], Span]:
    """A claim's mean scores by level and the peak; for "noisiness" the level at which it passes zero."""
    if claim in ("a", "noisiness"):
        values = (study.score if claim == "a" else study.noisiness).to_numpy()
    else:  # one value a controller, in its own level's column
        score = study.at(study.robot) if claim == "b" else study.diagonal()
        values = np.where(study.evolved[:, None] == study.levels, score[:, None], np.nan)
    means = column_means(values, np.ones((1, len(values))))
    drawn = column_means(values, study.weights)
    find = crossings if claim == "noisiness" else peaks
    top = Span(float(find(study.levels, means)[0]), *interval(find(study.levels, drawn)))
    return [Span(m, *interval(drawn[:, k])) for k, m in enumerate(means[0])], top


def peaks(levels: Sequence[float], curves: Floats) -> Floats:
    """Levels [B] at which curves [B, L] are highest: the top of a parabola over the level's root.

    It passes through the highest value and its neighbours; if an end is highest, that is the peak.
    """
    root, top = np.sqrt(levels), curves.argmax(axis=1)
    inner = np.clip(top, 1, len(root) - 2)
    around = inner[:, None] + np.array([-1, 0, 1])
    x = root[around] - root[inner][:, None]
    y = np.take_along_axis(curves, around, axis=1)
    y = y - y[:, 1:2]
    bend = (y[:, 2] / x[:, 2] - y[:, 0] / x[:, 0]) / (x[:, 2] - x[:, 0])
    with np.errstate(invalid="ignore", divide="ignore"):
        shift = -(y[:, 0] / x[:, 0] - bend * x[:, 0]) / (2 * bend)
    return (root[top] + np.where((top == inner) & (bend < 0), shift, 0.0)) ** 2


def crossings(levels: Sequence[float], curves: Floats) -> Floats:
    """Levels [B] at which falling curves [B, L] first pass zero, linear in the level's root; else NaN."""
    root = np.sqrt(levels)
    passes = (curves[:, :-1] > 0) & (curves[:, 1:] <= 0)
    rows, at = np.arange(len(curves)), passes.argmax(axis=1)
    before, after = curves[rows, at], curves[rows, at + 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        found = (root[at] + before / (before - after) * (root[at + 1] - root[at])) ** 2
    return np.where(passes.any(axis=1), found, np.nan)


def correlation(x: Floats, y: Floats) -> Span:
    """Pearson's r of two values [n], with its interval over 1000 resamples of controllers."""
    rows = np.random.default_rng(0).integers(0, len(x), (1000, len(x)))
    dx, dy = (values[rows] - values[rows].mean(axis=1, keepdims=True) for values in (x, y))
    drawn = (dx * dy).sum(axis=1) / np.sqrt((dx**2).sum(axis=1) * (dy**2).sum(axis=1))
    return Span(float(stats.pearsonr(x, y).statistic), *interval(drawn))


def spearman(x: Floats, y: Floats) -> Span:
    """Spearman's rho of two values [n], with Fieller's interval."""
    rho = stats.spearmanr(x, y).statistic
    half = 1.96 * np.sqrt(1.06 / (len(x) - 3))
    return Span(float(rho), *(float(np.tanh(np.arctanh(rho) + side * half)) for side in (-1, 1)))


def fitness_spans(study: Study, rows: Rows, *columns: str) -> list[Span]:
    """Mean fitness of some controllers in two columns, and of their difference."""
    first, second = (study.controllers[column].to_numpy() for column in columns)
    return [mean(values[rows], study.weights[:, rows]) for values in (first, second, first - second)]
