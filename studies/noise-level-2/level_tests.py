"""The planned tests of the second study of the level of noise, on the champions of one arm.

Libraries have most of them. Here stand those that no library has (ranks and permuted means within strata, a
parabola's peak with a bootstrap by unit) and how the plan combines them into words. All tests are two-sided;
above zero favours level 1. A stratum is one task and calibration unit.
"""

import math
import tomllib
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import statsmodels.formula.api as smf
from numpy.typing import NDArray
from scipy import stats
from statsmodels.stats.contingency_tables import StratifiedTable
from statsmodels.stats.multitest import multipletests

Floats = NDArray[np.float64]
Groups = Sequence[tuple[Floats, Floats]]
"""The values of both groups in each stratum."""

PLAN: dict[str, Any] = tomllib.loads(Path(__file__).with_name("claims.toml").read_text("utf-8"))
CLAIMS: list[dict[str, str]] = PLAN["claim"]
ROBOT: float = PLAN["robot"]
AGAINST: list[float] = PLAN["against"]
PAPER_LEVELS = "0, 1, 2"
BATCH = 2000
"""Permutations in memory at once."""
HALVES = ((1, 2, 3), (2, 1, 3), (3, 1, 2))
"""The calibration unit with one foreign unit, against the other two: three ways to halve four units."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Controllers and what they scored.

    Attributes:
        who: a row for each controller: task, seed_set, run, evolved_level, home_unit, and fitness.
        score: [controllers, levels of comparison], correspondence score 0 to 10 over all units that it drove.
        home: the same on its calibration unit alone.
    """

    who: pd.DataFrame
    score: pd.DataFrame
    home: pd.DataFrame

    def keep(self, mask: Any) -> "Scores":
        """Only some controllers."""
        return Scores(self.who[mask], self.score[mask], self.home[mask])

    def at(self, level: float) -> Floats:
        """Scores against the simulation at one level."""
        return self.score[level].to_numpy()

    def own(self) -> Floats:
        """Scores on the calibration unit against the simulation of the level that each evolved at."""
        columns = self.home.columns.get_indexer(self.who["evolved_level"])
        return self.home.to_numpy()[np.arange(len(self.who)), columns]

    def fall(self) -> Floats:
        """Fall of fitness on the robot from the calibration unit to the foreign units."""
        return (self.who["fitness_situated_home"] - self.who["fitness_situated_foreign"]).to_numpy()


class Tested(NamedTuple):
    """An effect, the statistic whose sign counts, and p (1 if nothing can be concluded)."""

    effect: float
    statistic: float
    p: float


NOTHING = Tested(math.nan, 0.0, 1.0)


def strata(scores: Scores, values: Floats, levels: tuple[float, float], least: int = 2) -> Groups:
    """Values of the controllers evolved at either level, within strata that have `least` of each."""
    frame = scores.who.assign(value=values).dropna(subset="value")
    first, second = (
        {key: part.to_numpy() for key, part in of.groupby(["task", "home_unit"], sort=False)["value"]}
        for of in (frame[frame["evolved_level"] == level] for level in levels)
    )
    return [(x, second[k]) for k, x in first.items() if min(len(x), len(second.get(k, ()))) >= least]


def weights_of(pairs: Groups) -> Floats:
    """Each stratum's share of the controllers."""
    counts = np.array([len(x) + len(y) for x, y in pairs], np.float64)
    return counts / counts.sum()


def by_signed_ranks(first: Floats, second: Floats) -> Tested:
    """Wilcoxon's test with Pratt's zeros; the effect is the rank-biserial correlation."""
    gap = first - second
    ranks = stats.rankdata(np.abs(gap)) * np.sign(gap)
    excess, whole = float(ranks.sum()), float(np.abs(ranks).sum())
    if not whole:
        return Tested(0.0, 0.0, 1.0)
    test = stats.wilcoxon(gap, zero_method="pratt", correction=True, method="asymptotic")
    return Tested(excess / whole, excess, float(test.pvalue))


def by_ranks(pairs: Groups) -> Tested:
    """Mann and Whitney's test within strata, corrected for ties and continuity; effect: Cliff's delta.

    Statistics and null variances of the strata are summed (with one stratum it is scipy.stats.mannwhitneyu).
    """
    if not pairs:
        return NOTHING
    excess = variance = count = 0.0
    for x, y in pairs:
        n, m, both = len(x), len(y), np.concatenate([x, y])
        excess += stats.rankdata(both)[:n].sum() - n * (n + m + 1) / 2
        variance += n * m / 12 * (n + m + 1) * stats.tiecorrect(stats.rankdata(both))
        count += n * m
    delta = 2 * excess / count
    z = max(abs(excess) - 0.5, 0.0) / math.sqrt(variance) if variance > 0 else 0.0
    return Tested(delta, delta, 2 * float(stats.norm.sf(z)))


def by_means(pairs: Groups, permutations: int = 0) -> Tested:
    """Difference of means by permutation within strata; without permutations there is no p."""
    if not pairs:
        return NOTHING
    share = weights_of(pairs)
    gap = float(sum(w * (x.mean() - y.mean()) for w, (x, y) in zip(share, pairs, strict=True)))
    if not permutations:
        return Tested(gap, gap, math.nan)
    draw, beyond, slack = np.random.default_rng(PLAN["seed"]), 0, 1e-9 * max(1.0, abs(gap))
    for begin in range(0, permutations, BATCH):
        drawn = np.zeros(min(BATCH, permutations - begin))
        for w, (x, y) in zip(share, pairs, strict=True):
            every = np.tile(np.concatenate([x, y]), (len(drawn), 1))
            mine = draw.permuted(every, axis=1)[:, : len(x)].sum(axis=1)
            drawn += w * (mine / len(x) - (every[0].sum() - mine) / len(y))
        beyond += int((np.abs(drawn) >= abs(gap) - slack).sum())
    return Tested(gap, gap, (1 + beyond) / (1 + permutations))


def by_failures(pairs: Groups) -> Tested:
    """Scores below 6: Cochran, Mantel and Haenszel's test; the effect is the first group's smaller share."""
    if not pairs:
        return NOTHING
    tables, effect, fewer = [], 0.0, 0.0
    for w, (x, y) in zip(weights_of(pairs), pairs, strict=True):
        mine, theirs = (int((group < PLAN["failed"]).sum()) for group in (x, y))
        tables.append([[mine, len(x) - mine], [theirs, len(y) - theirs]])
        effect += w * (theirs / len(y) - mine / len(x))
        fewer += len(x) * (mine + theirs) / (len(x) + len(y)) - mine
    if abs(fewer) <= 0.5:  # the library would square what the correction for continuity turns negative
        failed = any(table[0][0] + table[1][0] for table in tables)
        return Tested(effect, fewer if failed else 0.0, 1.0)
    test = StratifiedTable(np.array(tables, np.float64).transpose(1, 2, 0)).test_null_odds(correction=True)
    return Tested(effect, fewer, float(test.pvalue))


def by_slopes(scores: Scores, fall: Floats) -> Tested:
    """(d): slopes of the fall over the level's root within units, both standardised within the task.

    One slope for each unit, the mean of its tasks'; Student's t over units. The effect is the mean slope, a
    correlation; the statistic is positive if the fall shrinks.
    """
    frame = scores.who[["task", "home_unit"]].assign(x=np.sqrt(scores.who["evolved_level"]), y=fall)
    for name in "xy":
        of_task = frame.groupby("task")[name]
        frame[name] = (frame[name] - of_task.transform("mean")) / of_task.transform("std", ddof=0)
    slopes = []
    for _, unit in frame.groupby("home_unit"):
        away = [(task["x"] - task["x"].mean(), task["y"]) for _, task in unit.groupby("task")]
        slopes.append(np.mean([(x @ y) / (x @ x) for x, y in away if x @ x > 0]))
    mean = float(np.mean(slopes))
    return Tested(mean, -mean, float(stats.ttest_1samp(slopes, 0.0).pvalue))


def welch(pairs: Groups, share: float = PLAN["share"]) -> tuple[float, float, float]:
    """Difference of means within strata, with Welch's interval over all of them."""
    if not pairs:
        return (math.nan, math.nan, math.nan)
    gap = by_means(pairs).effect
    parts = [
        (w**2 * group.var(ddof=1) / len(group), len(group) - 1)
        for w, pair in zip(weights_of(pairs), pairs, strict=True)
        for group in pair
    ]
    variance, spread = sum(v for v, _ in parts), sum(v**2 / free for v, free in parts)
    if variance <= 0:
        return (gap, gap, gap)
    half = float(stats.t.ppf((1 + share) / 2, variance**2 / spread)) * math.sqrt(variance)
    return (gap, gap - half, gap + half)


def student(gaps: Floats, share: float = PLAN["share"]) -> tuple[float, float, float]:
    """Mean of one sample with Student's interval."""
    mean, error = float(gaps.mean()), float(stats.sem(gaps))
    half = error * float(stats.t.ppf((1 + share) / 2, len(gaps) - 1)) if error else 0.0
    return (mean, mean - half, mean + half)


def over_units(scores: Scores, values: Floats, levels: tuple[float, float]) -> tuple[float, float, float]:
    """Difference of means with units as a random factor: Student's interval over the units' differences."""
    frame = scores.who.assign(value=values)
    means = frame.groupby(["home_unit", "task", "evolved_level"])["value"].mean().unstack()
    return student((means[levels[0]] - means[levels[1]]).groupby("home_unit").mean().to_numpy())


def falls(scores: Scores) -> Iterator[tuple[str, Scores, Floats]]:
    """Cases of (d): levels in words, the controllers evolved at them, and their falls."""
    fall = scores.fall()
    paper = scores.who["evolved_level"].isin([ROBOT, *AGAINST]).to_numpy()
    for words, of in ((PAPER_LEVELS, paper), ("all levels", np.ones(len(fall), bool))):
        keep = of & np.isfinite(fall)
        yield words, scores.keep(keep), fall[keep]


def _tests(scores: Scores, permutations: int, least: int) -> dict[tuple[str, str, str], Tested]:
    """Every test by claim, statistic and what level 1 is compared with; (c)'s means stand beside."""
    made = {}
    for other in AGAINST:
        to = f"{other:g}"
        made["a", "signed ranks", to] = by_signed_ranks(scores.at(ROBOT), scores.at(other))
        for key, values in (("b", scores.at(ROBOT)), ("c", scores.own())):
            pairs = strata(scores, values, (ROBOT, other), least)
            made[key, "ranks", to] = by_ranks(pairs)
            made[key, "means", to] = by_means(pairs, permutations)
            if key == "b":
                made[key, "failures", to] = by_failures(pairs)
    for words, part, fall in falls(scores):
        made["d", "slopes", words] = by_slopes(part, fall) if len(fall) else NOTHING
    return made


def judge(
    scores: Scores, *, permutations: int = PLAN["permutations"], bound: float = PLAN["bound"]
) -> pd.DataFrame:
    """The twelve planned comparisons of an arm, and (c)'s means beside them, uncorrected.

    Returns:
        A row each: claim, by, against, effect, statistic, p, p_holm, sets (the sign of the statistic in each
        seed set), difference, low, high (of means, 90 %), found: for, against, absent or open.
    """
    alone = [
        _tests(scores.keep((scores.who["seed_set"] == number).to_numpy()), 0, 1)
        for number in sorted(scores.who["seed_set"].unique())
    ]
    rows = []
    for (key, by, to), tested in _tests(scores, permutations, 2).items():
        gap = (math.nan, math.nan, math.nan)
        if key == "a":
            gap = student(scores.at(ROBOT) - scores.at(float(to)))
        elif key in "bc" and by != "failures":
            values = scores.at(ROBOT) if key == "b" else scores.own()
            gap = welch(strata(scores, values, (ROBOT, float(to))))
        sets = tuple(int(np.sign(one[key, by, to].statistic)) for one in alone)
        rows.append((key, by, to, *tested, sets, *gap))
    names = ["claim", "by", "against", "effect", "statistic", "p", "sets", "difference", "low", "high"]
    made = pd.DataFrame(rows, columns=names)
    place = {(claim["key"], claim["by"]): k for k, claim in enumerate(CLAIMS)}
    made["place"] = [place.get((row.claim, row.by), len(place)) for row in made.itertuples()]
    made = made.sort_values("place", kind="stable", ignore_index=True)
    planned = made["place"] < len(place)
    made.loc[planned, "p_holm"] = multipletests(made.loc[planned, "p"], method="holm")[1]
    made["found"] = [_found(row, bound) if row.place < len(place) else "–" for row in made.itertuples()]
    return made


def _found(row: Any, bound: float) -> str:
    signs = {int(np.sign(row.statistic)), *row.sets}
    if row.p_holm < PLAN["alpha"] and signs in ({1}, {-1}):
        return "for" if signs == {1} else "against"
    if (row.claim, row.by) in (("b", "means"), ("c", "ranks")) and -bound < row.low and row.high < bound:
        return "absent"
    return "open"


def verdict(found: Sequence[str]) -> str:
    """The verdict on a claim from the words of its comparisons."""
    if "for" in found:
        return "supported" if set(found) == {"for"} else "in part"
    if "against" in found:
        return "reversed"
    return "absent" if set(found) == {"absent"} else "open"


def tops(levels: Floats, curves: Floats) -> Floats:
    """Levels [B] at which curves [B, L] are highest.

    The top of a parabola over the level's root through the highest value and its neighbours; if an end is
    highest, it is the peak.
    """
    root, best = np.sqrt(levels), curves.argmax(axis=1)
    top = root[best]
    inner = np.flatnonzero((best > 0) & (best < len(root) - 1))
    i = best[inner]
    below, above = root[i - 1] - root[i], root[i + 1] - root[i]
    fall_below = curves[inner, i - 1] - curves[inner, i]
    fall_above = curves[inner, i + 1] - curves[inner, i]
    curvature = (fall_above / above - fall_below / below) / (above - below)
    slope = fall_below / below - curvature * below
    bent = curvature < 0
    top[inner[bent]] -= slope[bent] / (2 * curvature[bent])
    return top**2


@dataclass(frozen=True, eq=False)
class Peak:
    """The level at which tracks agree best, with its 95 % interval.

    Attributes:
        means: [L] over all champions; spans: [2, L] of their 95 % intervals.
        first: share of the resamples in which level 1 has the best mean.
    """

    value: float
    low: float
    high: float
    levels: Floats
    means: Floats
    spans: Floats
    first: float

    @property
    def word(self) -> str:
        """The verdict on (e)."""
        low, high = PLAN["peak_between"]
        if low < self.low and self.high < high:
            return "supported"
        return "reversed" if self.high < low or self.low > high else "open"


def cells_of(who: pd.DataFrame, mask: Any = slice(None)) -> list[NDArray[np.int64]]:
    """Rows of each task, seed set and evolved level, in order of appearance, as they are drawn."""
    rows = who.reset_index(drop=True)[mask].groupby(["task", "seed_set", "evolved_level"], sort=False)
    return [cell.index.to_numpy() for _, cell in rows]


def unit_weights(scores: Scores) -> Floats:
    """Resamples [B, n]: how often each controller is drawn.

    Sixteen units are drawn, and of each unit's controllers of a task, seed set and level as many as it has.
    """
    draw, homes = np.random.default_rng(PLAN["seed"]), scores.who["home_unit"].to_numpy()
    units = np.unique(homes)
    chosen = draw.multinomial(len(units), np.full(len(units), 1 / len(units)), size=PLAN["resamples"])
    weights = np.zeros((PLAN["resamples"], len(homes)))
    for k, unit in enumerate(units):
        for rows in cells_of(scores.who, homes == unit):
            weights[:, rows] = draw.multinomial(len(rows) * chosen[:, k], np.full(len(rows), 1 / len(rows)))
    return weights


def peak_of(scores: Scores, levels: Sequence[float] | None = None) -> Peak:
    """The peak of (a)'s curve, over all levels of comparison or only some."""
    curve = scores.score if levels is None else scores.score[list(levels)]
    at, weights = curve.columns.to_numpy(np.float64), unit_weights(scores)
    means, drawn = curve.to_numpy().mean(axis=0), weights @ curve.to_numpy()
    drawn /= weights.sum(axis=1, keepdims=True)
    ends = [(1 - PLAN["peak_share"]) / 2, (1 + PLAN["peak_share"]) / 2]
    low, high = np.quantile(tops(at, drawn), ends)
    return Peak(
        value=float(tops(at, means[None])[0]),
        low=float(low),
        high=float(high),
        levels=at,
        means=means,
        spans=np.quantile(drawn, ends, axis=0),
        first=float((at[drawn.argmax(axis=1)] == ROBOT).mean()),
    )


def by_mixed_models(scores: Scores) -> dict[tuple[str, str], Tested]:
    """The level's coefficient beside (b) by means and (d), by claim and what level 1 is compared with.

    A constant for each task and a random intercept for each unit; each run has one champion, so its own
    deviation is the residual. (d): of the standardised fall over the level's standardised root.
    """
    made = {}
    for other in AGAINST:
        part = scores.keep(scores.who["evolved_level"].isin([ROBOT, other]).to_numpy())
        level = (part.who["evolved_level"] == ROBOT).to_numpy(np.float64)
        made["b", f"{other:g}"] = _mixed(part, part.at(ROBOT), level)
    for words, part, fall in falls(scores):
        frame = part.who.assign(fall=fall).groupby("task")["fall"]
        scaled = (fall - frame.transform("mean")) / frame.transform("std", ddof=0)
        root = np.sqrt(part.who["evolved_level"].to_numpy())
        fit = _mixed(part, scaled.to_numpy(), (root - root.mean()) / root.std())
        made["d", words] = fit._replace(statistic=-fit.statistic)
    return made


def _mixed(scores: Scores, values: Floats, level: Floats) -> Tested:
    frame = scores.who[["task", "home_unit"]].assign(value=values, level=level)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a variance over units at zero, where the intercept has no effect
        model = smf.mixedlm(
            "value ~ level + C(task)",
            frame,
            groups="home_unit",
            re_formula="0",
            vc_formula={"unit": "1"},
        )
        fit = model.fit(reml=True)
    effect, p = float(fit.params["level"]), float(fit.pvalues["level"])
    return Tested(effect, effect, p if math.isfinite(p) else 1.0)


@dataclass(frozen=True)
class Part:
    """A difference between two groups: of means, and Cliff's delta; each with a 95 % bootstrap interval."""

    means: tuple[float, float, float]
    delta: tuple[float, float, float]


def diagonal_parts(scores: Scores) -> dict[float, dict[str, Part]]:
    """The diagonal's difference between level 1 and each other, in two steps, in both orders; by run.

    Returns:
        By level: the whole ("diagonal"); with the evolved level first "evolved_first" and "comparison_after";
        with the comparison level first "comparison_first" and "evolved_after".
    """
    scores = scores.keep(np.isfinite(scores.home.to_numpy()).all(axis=1))
    who, draw = scores.who.reset_index(drop=True), np.random.default_rng(0)
    weights = np.zeros((PLAN["resamples"], len(who)))
    for rows in cells_of(who):
        even = np.full(len(rows), 1 / len(rows))
        weights[:, rows] = draw.multinomial(len(rows), even, size=PLAN["resamples"])
    stratum = who["task"].astype(str) + who["home_unit"].astype(str)
    made: dict[float, dict[str, Part]] = {}
    mine = np.flatnonzero(who["evolved_level"] == ROBOT)
    for other in sorted(set(who["evolved_level"]) - {ROBOT}):
        theirs = np.flatnonzero(who["evolved_level"] == other)
        same = (stratum.to_numpy()[mine][:, None] == stratum.to_numpy()[theirs][None, :]).astype(np.float64)

        def between(values: Floats, theirs: Any = theirs, same: Floats = same) -> Part:
            return _unpaired(values[mine], values[theirs], same, weights[:, mine], weights[:, theirs])

        def within(rows: Any, other: float = other) -> Part:
            gap = (scores.home[ROBOT] - scores.home[other]).to_numpy()[rows]
            return _paired(gap, weights[:, rows])

        made[other] = {
            "diagonal": between(scores.own()),
            "evolved_first": between(scores.home[ROBOT].to_numpy()),
            "comparison_after": within(theirs),
            "evolved_after": between(scores.home[other].to_numpy()),
            "comparison_first": within(mine),
        }
    return made


def _paired(gap: Floats, weights: Floats) -> Part:
    drawn, sign = weights.sum(axis=1), np.sign(gap)
    means, deltas = (np.quantile(weights @ v / drawn, [0.025, 0.975]) for v in (gap, sign))
    return Part((float(gap.mean()), *means), (float(sign.mean()), *deltas))


def _unpaired(x: Floats, y: Floats, same: Floats, u: Floats, v: Floats) -> Part:
    sign = np.sign(x[:, None] - y[None, :]) * same
    deltas = ((u @ sign) * v).sum(axis=1) / ((u @ same) * v).sum(axis=1)
    gaps = u @ x / u.sum(axis=1) - v @ y / v.sum(axis=1)
    of_means, of_deltas = (np.nanquantile(values, [0.025, 0.975]) for values in (gaps, deltas))
    return Part((float(x.mean() - y.mean()), *of_means), (float(sign.sum() / same.sum()), *of_deltas))


def rho(first: Floats, second: Floats) -> float:
    """Spearman's rho of what is known of both."""
    both = np.isfinite(first) & np.isfinite(second)
    return float(np.corrcoef(stats.rankdata(first[both]), stats.rankdata(second[both]))[0, 1])


def reliability(grid: Floats) -> float:
    """Agreement of the camera's score with itself: half of a controller's units against the other half.

    Spearman's rho over champions, the mean of the three ways to halve four units, raised to the whole by
    Spearman and Brown's formula.

    Args:
        grid: [controllers, 4] score on each unit, calibration unit first.
    """
    whole = grid[np.isfinite(grid).all(axis=1)]
    rho = np.mean(
        [
            stats.spearmanr(whole[:, [0, a]].mean(axis=1), whole[:, [b, c]].mean(axis=1))[0]
            for a, b, c in HALVES
        ]
    )
    return float(2 * rho / (1 + rho))
