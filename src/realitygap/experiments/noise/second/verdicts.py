"""The second study's twelve comparisons, the peak, and the verdicts on its claims, in one arm."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.experiments.noise.contrasts import holm, interval, peak
from realitygap.experiments.noise.crossed import Crossed
from realitygap.experiments.noise.second import stratified
from realitygap.experiments.noise.second.stratified import Groups, Tested

__all__ = ["CLAIMS", "PLAN", "Comparison", "Judgement", "Peak", "Plan", "StatedClaim", "Verdict", "judge"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What decides, as `claims.toml` has it."""

    robot: float
    against: tuple[float, ...]
    alpha: float
    failed: float
    bound: float
    share: float
    peak_share: float
    peak_between: tuple[float, float]
    permutations: int
    resamples: int
    seed: int
    misfit: float
    agree: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class StatedClaim:
    """A claim by one statistic, with a verdict of its own."""

    key: str
    by: str
    title: str
    text: str


_STATED: dict[str, Any] = tomllib.loads(Path(__file__).with_name("claims.toml").read_text("utf-8"))
CLAIMS = tuple(StatedClaim(**one) for one in _STATED.pop("claim"))
_DECIDES: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in _STATED.items()}
PLAN = Plan(**_DECIDES)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One of an arm's twelve; or one shown beside them, whose `p_holm` is nan.

    Attributes:
        against: the level that level 1 is held against; for (d) the levels that slopes are over.
        tested: by the claim's statistic; above zero is in its favour.
        sets: the sign of the statistic in each seed set.
        difference: of means, with its 90 % interval; nan for failures and (d).
        found: for, against, absent, or open.
    """

    key: str
    by: str
    against: str
    tested: Tested
    sets: tuple[int, ...]
    difference: tuple[float, float, float]
    p_holm: float = math.nan
    found: str = "open"


@dataclass(frozen=True, kw_only=True)
class Peak:
    """The level at which tracks agree best, with its interval; the means [L] that it is the peak of."""

    levels: Floats
    means: Floats
    spans: tuple[tuple[float, float], ...]
    value: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The word on a claim: supported, in part, reversed, absent or open."""

    claim: StatedClaim
    word: str
    comparisons: tuple[Comparison, ...]


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """All that is planned of one arm; `beside` are (c)'s means, which are not corrected."""

    verdicts: tuple[Verdict, ...]
    peak: Peak
    beside: tuple[Comparison, ...]


def judge(data: Crossed, plan: Plan = PLAN) -> Judgement:
    """The planned analysis of one arm, whatever came out."""
    every = [_compared(data, plan, *one) for one in _planned(data, plan)]
    twelve, beside = [c for c in every if c.by != "beside"], [c for c in every if c.by == "beside"]
    corrected = holm([c.tested.p for c in twelve])
    told = [_found(c, p, plan) for c, p in zip(twelve, corrected, strict=True)]
    top, verdicts = _peak(data, plan), []
    for claim in CLAIMS:
        own = tuple(c for c in told if (c.key, c.by) == (claim.key, claim.by))
        word = _estimate(top, plan) if claim.key == "e" else _word([c.found for c in own])
        verdicts.append(Verdict(claim=claim, word=word, comparisons=own))
    return Judgement(verdicts=tuple(verdicts), peak=top, beside=tuple(beside))


_Run = Callable[[Crossed, bool], Tested]
"""Tests an arm, or one seed set of it, of which the sign alone is asked for."""
_Gap = Callable[[Crossed], tuple[float, float, float]]


def _planned(data: Crossed, plan: Plan) -> list[tuple[str, str, str, _Run, _Gap | None]]:
    """Key, statistic, against what, the test, and the difference of means, of each comparison."""
    made: list[tuple[str, str, str, _Run, _Gap | None]] = []
    for other in plan.against:
        to = f"{other:g}"
        twice, gap = partial(_twice, plan, other), partial(_paired_gap, plan, other)
        made.append(("a", "signed ranks", to, twice, gap))
        for key, values in (("b", _common), ("c", _diagonal)):
            means = partial(_gap, plan, values, other)
            tests = {"ranks": _ranks, "means": _means, "failures": _failures} if key == "b" else {
                "ranks": _ranks, "beside": _means}  # fmt: skip
            for by, test in tests.items():
                made.append(
                    (key, by, to, partial(test, plan, values, other), None if by == "failures" else means)
                )
    some = tuple(sorted({plan.robot, *plan.against}))
    there = tuple(sorted(set(data.evolved.tolist())))
    for levels, words in ((some, ", ".join(f"{level:g}" for level in some)), (there, "all levels")):
        made.append(("d", "slopes", words, partial(_slopes, levels), None))
    return made


def _compared(
    data: Crossed, plan: Plan, key: str, by: str, against: str, run: _Run, gap: _Gap | None
) -> Comparison:
    alone = [run(data.part(seed_set=number), False).statistic for number in data.sets]
    return Comparison(
        key=key, by=by, against=against, tested=run(data, True), sets=tuple(int(np.sign(s)) for s in alone),
        difference=gap(data) if gap else (math.nan, math.nan, math.nan),
    )  # fmt: skip


def _found(one: Comparison, p: float, plan: Plan) -> Comparison:
    signs = {int(np.sign(one.tested.statistic)), *one.sets}
    word = "open"
    if p < plan.alpha and len(one.sets) > 1 and signs in ({1}, {-1}):
        word = "for" if signs == {1} else "against"
    elif (one.key, one.by) in (("b", "means"), ("c", "ranks")):
        _, low, high = one.difference
        word = "absent" if -plan.bound < low and high < plan.bound else "open"
    return replace(one, p_holm=p, found=word)


def _word(found: Sequence[str]) -> str:
    """The word on a claim by what its comparisons found."""
    if "for" in found:
        return "supported" if set(found) == {"for"} else "in part"
    if "against" in found:
        return "reversed"
    return "absent" if set(found) == {"absent"} else "open"


def _estimate(top: Peak, plan: Plan) -> str:
    """The word on (e): the peak's interval lies within the bounds, outside them, or neither."""
    low, high = plan.peak_between
    if low < top.low and top.high < high:
        return "supported"
    return "reversed" if top.high < low or top.low > high else "open"


def _common(data: Crossed, plan: Plan) -> Floats:
    """(b): against one and the same simulation."""
    return data.at(plan.robot)


def _diagonal(data: Crossed, plan: Plan) -> Floats:
    """(c): against the very simulation that each was evolved in."""
    return data.own(home=True)


_Values = Callable[[Crossed, Plan], Floats]


def _groups(plan: Plan, values: _Values, other: float, data: Crossed, least: int) -> Groups:
    mine, theirs = data.evolved == plan.robot, data.evolved == other
    strata, scores = list(zip(data.task.tolist(), data.home.tolist(), strict=True)), values(data, plan)
    keys = [[strata[i] for i in np.flatnonzero(rows)] for rows in (mine, theirs)]
    return stratified.groups(scores[mine], scores[theirs], (keys[0], keys[1]), least=least)


def _ranks(plan: Plan, values: _Values, other: float, data: Crossed, whole: bool) -> Tested:
    return stratified.by_ranks(_groups(plan, values, other, data, 1 + whole))


def _means(plan: Plan, values: _Values, other: float, data: Crossed, whole: bool) -> Tested:
    pairs = _groups(plan, values, other, data, 1 + whole)
    return stratified.by_means(pairs, permutations=plan.permutations * whole, seed=plan.seed)


def _failures(plan: Plan, values: _Values, other: float, data: Crossed, whole: bool) -> Tested:
    return stratified.by_failures(_groups(plan, values, other, data, 1 + whole), plan.failed)


def _gap(plan: Plan, values: _Values, other: float, data: Crossed) -> tuple[float, float, float]:
    pairs = _groups(plan, values, other, data, 2)
    gap = stratified.by_means(pairs, permutations=0, seed=0).effect
    return (gap, *stratified.mean_interval(pairs, plan.share))


def _twice(plan: Plan, other: float, data: Crossed, whole: bool) -> Tested:
    return stratified.by_signed_ranks(data.at(plan.robot), data.at(other))


def _paired_gap(plan: Plan, other: float, data: Crossed) -> tuple[float, float, float]:
    """The mean gap of the same controllers twice, with Student's interval."""
    gap = data.at(plan.robot) - data.at(other)
    pairs = [(gap, np.zeros(2))]
    return (float(gap.mean()), *stratified.mean_interval(pairs, plan.share))


def _slopes(levels: tuple[float, ...], data: Crossed, whole: bool) -> Tested:
    fall = data.situated_home - data.situated_foreign
    data, fall = data.only(keep := np.isin(data.evolved, levels) & np.isfinite(fall)), fall[keep]
    return stratified.by_slopes(np.sqrt(data.evolved), fall, data.home, data.task)


def _peak(data: Crossed, plan: Plan) -> Peak:
    """The peak of (a)'s curve; units are drawn again, and of each its controllers, cell by cell."""
    draw, homes = np.random.default_rng(plan.seed), sorted(set(data.home.tolist()))
    chosen = draw.multinomial(len(homes), np.full(len(homes), 1 / len(homes)), size=plan.resamples)
    weights = np.zeros((plan.resamples, len(data)))
    for k, home in enumerate(homes):
        own = np.flatnonzero(data.home == home)
        for rows in (own[cell] for cell in data.only(data.home == home).cells()):
            weights[:, rows] = draw.multinomial(len(rows) * chosen[:, k], np.full(len(rows), 1 / len(rows)))
    means = data.score.mean(axis=0)
    drawn = weights @ data.score / weights.sum(axis=1, keepdims=True)
    low, high = interval(peak(data.levels, drawn), plan.peak_share)
    return Peak(
        levels=data.levels, means=means, value=float(peak(data.levels, means)[0]), low=low, high=high,
        spans=tuple(interval(drawn[:, k], plan.peak_share) for k in range(len(means))),
    )  # fmt: skip
