"""The second study's twelve comparisons, the peak, and the verdicts on its claims, in one arm.

Claims (b) and (d) also have mixed models, by statsmodels.
"""

import importlib.util
import math
import tomllib
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.experiments.noise.contrasts import holm, interval, peak
from realitygap.experiments.noise.crossed import Crossed
from realitygap.experiments.noise.second import stratified
from realitygap.experiments.noise.second.stratified import Groups, Tested
from realitygap.values import Floats

__all__ = [
    "CLAIMS", "PLAN", "Comparison", "Judgement", "Peak", "Plan", "StatedClaim", "Verdict",
    "by_mixed_models", "judge", "peak_of",
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The planned thresholds, as in `claims.toml`."""

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
    """A claim with one statistic, and a verdict of its own."""

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
    """One of an arm's twelve; or an additional one, whose `p_holm` is nan.

    Attributes:
        against: the level that level 1 is compared with; for (d) the levels that slopes are over.
        tested: by the claim's statistic; positive favours the claim.
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


NO_GAP = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, kw_only=True)
class Peak:
    """The level at which tracks agree best, with its interval; and the means [L] behind it."""

    levels: Floats
    means: Floats
    spans: tuple[tuple[float, float], ...]
    value: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The verdict on a claim: supported, in part, reversed, absent or open."""

    claim: StatedClaim
    word: str
    comparisons: tuple[Comparison, ...]


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """The planned analysis of one arm; `beside` are (c)'s means, which are not corrected."""

    verdicts: tuple[Verdict, ...]
    peak: Peak
    beside: tuple[Comparison, ...]


def judge(data: Crossed, plan: Plan = PLAN) -> Judgement:
    """The planned analysis of one arm."""
    whole, gaps = _tests(data, plan, plan.permutations, least=2), _gaps(data, plan)
    alone = [_tests(data.part(seed_set=number), plan, 0, least=1) for number in data.sets]
    every = [
        Comparison(
            key=key, by=by, against=against, tested=tested,
            sets=tuple(int(np.sign(one[key, by, against].statistic)) for one in alone),
            difference=gaps.get((key, against), NO_GAP) if by != "failures" else NO_GAP,
        )
        for (key, by, against), tested in whole.items()
    ]  # fmt: skip
    stated = {(claim.key, claim.by) for claim in CLAIMS}
    twelve = [c for c in every if (c.key, c.by) in stated]
    corrected = holm([c.tested.p for c in twelve])
    told = [_found(c, p, plan) for c, p in zip(twelve, corrected, strict=True)]
    top, verdicts = peak_of(data, plan), []
    for claim in CLAIMS:
        own = tuple(c for c in told if (c.key, c.by) == (claim.key, claim.by))
        word = _estimate(top, plan) if claim.key == "e" else _word([c.found for c in own])
        verdicts.append(Verdict(claim=claim, word=word, comparisons=own))
    beside = tuple(c for c in every if (c.key, c.by) not in stated)
    return Judgement(verdicts=tuple(verdicts), peak=top, beside=beside)


def _tests(data: Crossed, plan: Plan, permutations: int, *, least: int) -> dict[tuple[str, str, str], Tested]:
    """Tests by key, statistic and comparison level of level 1; also (c)'s means, as additional ones."""
    made = {}
    for other in plan.against:
        to = f"{other:g}"
        made["a", "signed ranks", to] = stratified.by_signed_ranks(data.at(plan.robot), data.at(other))
        for key, values in _values(data, plan).items():
            pairs = stratified.groups(data, values, (plan.robot, other), least)
            made[key, "ranks", to] = stratified.by_ranks(pairs)
            made[key, "means", to] = stratified.by_means(pairs, permutations=permutations, seed=plan.seed)
            if key == "b":
                made[key, "failures", to] = stratified.by_failures(pairs, plan.failed)
    for words, part, fall in _falls(data, plan):
        made["d", "slopes", words] = stratified.by_slopes(np.sqrt(part.evolved), fall, part.home, part.task)
    return made


def _falls(data: Crossed, plan: Plan) -> Iterator[tuple[str, Crossed, Floats]]:
    """Cases of (d): levels in words, the controllers evolved at them, and the fall of each one's fitness [n]
    from its calibration unit to the others."""
    some = sorted({plan.robot, *plan.against})
    fall = data.situated_home - data.situated_foreign
    for words, of in ((", ".join(f"{level:g}" for level in some), np.isin(data.evolved, some)),
                      ("all levels", np.ones(len(data), bool))):  # fmt: skip
        keep = of & np.isfinite(fall)
        yield words, data.only(keep), fall[keep]


def _gaps(data: Crossed, plan: Plan) -> dict[tuple[str, str], tuple[float, float, float]]:
    """Difference of means with its interval, by key and level: within strata, or of the same controllers."""
    found = {}
    for other in plan.against:
        paired = [(data.at(plan.robot) - data.at(other), np.zeros(2))]  # one sample: Student's interval
        every: dict[str, Groups] = {"a": paired}
        for key, values in _values(data, plan).items():
            every[key] = stratified.groups(data, values, (plan.robot, other), 2)
        for key, pairs in every.items():
            gap = stratified.by_means(pairs, permutations=0, seed=0).effect
            found[key, f"{other:g}"] = (gap, *stratified.mean_interval(pairs, plan.share))
    return found


def _values(data: Crossed, plan: Plan) -> dict[str, Floats]:
    """Scores [n] of (b), all in one simulation, and of (c), in that in which each controller evolved."""
    return {"b": data.at(plan.robot), "c": data.own(home=True)}


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
    """The verdict on a claim from its comparisons."""
    if "for" in found:
        return "supported" if set(found) == {"for"} else "in part"
    if "against" in found:
        return "reversed"
    return "absent" if set(found) == {"absent"} else "open"


def _estimate(top: Peak, plan: Plan) -> str:
    """The verdict on (e): the peak's interval lies within the bounds, outside them, or neither."""
    low, high = plan.peak_between
    if low < top.low and top.high < high:
        return "supported"
    return "reversed" if top.high < low or top.low > high else "open"


def peak_of(data: Crossed, plan: Plan = PLAN) -> Peak:
    """The peak of (a)'s curve; units are resampled, and their controllers cell by cell."""
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


def by_mixed_models(data: Crossed, plan: Plan = PLAN) -> dict[tuple[str, str], Tested]:
    """The level's coefficient, by claim and comparison level, named as in `Comparison.against`.

    For (b) in points, in favour of level 1; for (d) of the standardised fall of fitness over the level's
    standardised root: there the statistic is positive if it falls. Unit and run have random intercepts: each
    run has one champion, so its own deviation is the residual; runs with the same number at different levels
    share nothing else. These models decide nothing; without statsmodels, an optional extra, there are none.
    """
    if importlib.util.find_spec("statsmodels") is None:
        return {}
    found: dict[tuple[str, str], Tested | None] = {}
    for other in plan.against:
        part = data.only(np.isin(data.evolved, (plan.robot, other)))
        found["b", f"{other:g}"] = _fitted(part, part.at(plan.robot), part.evolved == plan.robot)
    for against, part, fall in _falls(data, plan):
        root = np.sqrt(part.evolved)
        for task in part.tasks:
            rows = part.task == task
            fall[rows] = (fall[rows] - fall[rows].mean()) / (fall[rows].std() or 1.0)
        made = _fitted(part, fall, (root - root.mean()) / (root.std() or 1.0))
        found["d", against] = made and made._replace(statistic=-made.statistic)
    return {key: made for key, made in found.items() if made is not None}


def _fitted(data: Crossed, values: Floats, level: NDArray[np.generic]) -> Tested | None:
    """The coefficient of `level` [n], with a constant for each task; None if the fit is impossible."""
    from statsmodels.regression.mixed_linear_model import VCSpec, MixedLM  # isort: skip

    tasks = np.array([data.task == task for task in data.tasks], np.float64)
    across = np.column_stack([level.astype(np.float64), tasks.T])
    units, sizes = np.unique(data.home, return_counts=True)
    intercepts = [np.ones((size, 1)) for size in sizes]  # a component may be zero; a group's variance may not
    spec = VCSpec(["unit"], [[["unit"] for _ in units]], [intercepts])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of variances at zero, where a random intercept has no effect
        try:
            fit = MixedLM(values, across, groups=data.home, exog_vc=spec).fit(reml=True)
        except np.linalg.LinAlgError:
            return None
    effect, p = float(fit.params[0]), float(fit.pvalues[0])
    return Tested(effect, effect, p if np.isfinite(p) else 1.0)
