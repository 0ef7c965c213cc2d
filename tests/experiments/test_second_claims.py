"""The second study's statistics are what theory says; its verdicts find what was put in."""

from __future__ import annotations

import itertools
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from realitygap.experiments.noise.crossed import Crossed
from realitygap.experiments.noise.second import stratified
from realitygap.experiments.noise.second.verdicts import (
    CLAIMS,
    PLAN,
    Judgement,
    by_mixed_models,
    judge,
    peak_of,
)
from tests.experiments.crosses import comparison, evolution
from tests.experiments.second import arm

TEXT = (Path(__file__).parents[2] / "docs" / "noise-level-2.md").read_text("utf-8")
QUICK = replace(PLAN, permutations=1000, resamples=300)


def words(made: Judgement) -> dict[str, str]:
    return {f"{v.claim.key} {v.claim.by}": v.word for v in made.verdicts}


def pairs(draw: np.random.Generator, *sizes: tuple[int, int], by: float = 0.0) -> list:
    return [(draw.normal(by, 1, n), draw.normal(0, 1, m)) for n, m in sizes]


def test_what_decides_is_what_the_plan_says() -> None:
    """Levels, bounds and numbers of the claims' file stand in the plan."""
    plain = TEXT.replace(" ", " ")
    for said in (
        f"score below {PLAN.failed:g}", f"p below {PLAN.alpha:g}".replace("0.", "."),
        f"within ±{PLAN.bound:g} points", f"the {PLAN.share:.0%} interval".replace("%", " %"),
        f"the {PLAN.peak_share:.0%} interval of the peak".replace("%", " %"), "Compared are levels 0 and 2",
        f"Permutations: {PLAN.permutations:,}".replace(",", " "), f"{PLAN.resamples} times sixteen units",
        "({:.2f} to {:.2f})".format(*PLAN.peak_between), "on more than half of its units",
        "needs the arms T and E to agree", "The robot's level is 1",
    ):  # fmt: skip
        assert said in plain, said
    assert (PLAN.against, PLAN.robot, PLAN.misfit, PLAN.agree) == ((0.0, 2.0), 1.0, 0.5, ("T", "E"))
    made = judge(arm(runs=16), QUICK)
    planned = [c for v in made.verdicts for c in v.comparisons]
    assert len(planned) == 12 and all(0 <= c.p_holm <= 1 for c in planned)
    assert [v.claim for v in made.verdicts] == list(CLAIMS)
    assert re.findall(r"^\| \*\*(.)\*\* \|", TEXT, re.M) == sorted({claim.key for claim in CLAIMS})


def test_permuted_means_are_those_of_every_permutation() -> None:
    """Drawn at random, p is that of all 10 · 6 ways to deal the controllers within two strata."""
    groups = pairs(np.random.default_rng(2), (2, 3), (2, 2), by=0.8)
    gap, total = stratified.by_means(groups, permutations=0, seed=0).effect, 0
    dealt = [
        [(list(c), np.concatenate(pair)) for c in itertools.combinations(range(len(x) + len(y)), len(x))]
        for x, y in groups for pair in [(x, y)]
    ]  # fmt: skip
    beyond = 0
    for both in itertools.product(*dealt):
        drawn = sum(
            len(every) / 9 * (every[mine].mean() - np.delete(every, mine).mean()) for mine, every in both
        )
        beyond, total = beyond + (abs(drawn) >= abs(gap) - 1e-9), total + 1
    p = stratified.by_means(groups, permutations=20000, seed=1).p
    assert total == 60 and p == pytest.approx(beyond / total, abs=0.015)


def test_one_stratum_is_the_textbooks() -> None:
    """Without strata: Mann and Whitney's, Student's and Welch's tests and interval, as SciPy has them."""
    ((x, y),) = groups = pairs(np.random.default_rng(4), (40, 50), by=0.4)
    assert stratified.by_ranks(groups).p == pytest.approx(
        stats.mannwhitneyu(x, y, method="asymptotic").pvalue
    )
    made = stratified.by_means(groups, permutations=20000, seed=3)
    assert made.p == pytest.approx(stats.ttest_ind(x, y).pvalue, rel=0.1)
    wanted = stats.ttest_ind(x, y, equal_var=False).confidence_interval(0.9)
    assert stratified.mean_interval(groups, 0.9) == pytest.approx(tuple(wanted))
    twice = stats.wilcoxon(x, y[:40], zero_method="pratt", correction=True, method="asymptotic")
    assert stratified.by_signed_ranks(x, y[:40]).p == pytest.approx(twice.pvalue)
    biserial = stratified.by_signed_ranks(np.array([3.0, 2.0, -1.0]), np.zeros(3))
    assert (biserial.effect, biserial.statistic) == pytest.approx((4 / 6, 4))


def test_failures_are_counted_as_by_cochran_mantel_and_haenszel() -> None:
    """p is statsmodels' of the same tables; one table alone is Yates's, but for n against n − 1."""
    tables = pytest.importorskip("statsmodels.stats.contingency_tables")
    groups = pairs(np.random.default_rng(6), (12, 14), (20, 18), (9, 9), by=0.5)
    counts = [np.array([[(g < 0).sum(), (g >= 0).sum()] for g in pair], float) for pair in groups]
    made = stratified.by_failures(groups, 0.0)
    wanted = tables.StratifiedTable(counts).test_null_odds(correction=True)
    assert made.p == pytest.approx(float(wanted.pvalue)) and made.effect > 0 and made.statistic > 0
    gaps = [(y < 0).mean() - (x < 0).mean() for x, y in groups]
    assert made.effect == pytest.approx(np.average(gaps, weights=[26, 38, 18]))


def test_slopes_are_units_and_found_by_student() -> None:
    """With one task: polyfit unit by unit, standardised, then SciPy's t; only falling is in favour."""
    draw = np.random.default_rng(8)
    units, x = np.repeat(np.arange(6), 20), np.tile(np.sqrt([0.0, 0.5, 1.0, 2.0]), 30)
    y, task = draw.normal(size=120) + units - 0.4 * x, np.full(120, "one")
    across, up = (x - x.mean()) / x.std(), (y - y.mean()) / y.std()
    slopes = [np.polyfit(across[units == u], up[units == u], 1)[0] for u in range(6)]
    made = stratified.by_slopes(x, y, units, task)
    assert made.effect == pytest.approx(np.mean(slopes)) and made.statistic == -made.effect
    assert made.p == pytest.approx(stats.ttest_1samp(slopes, 0).pvalue)
    both = stratified.by_slopes(np.tile(x, 2), np.concatenate([y, 7 * y + 3]), np.tile(units, 2),
                                np.repeat(["one", "two"], 120))  # fmt: skip
    assert both == pytest.approx(made)


@pytest.mark.parametrize("test", ["ranks", "means", "failures", "slopes"])
def test_nothing_is_found_one_time_in_twenty(test: str) -> None:
    """Where there is no difference p is below .05 in 5 % of 400 studies (three deviations: 1.7 to 8.3 %)."""
    draw, sizes = np.random.default_rng(10), [(6, 6)] * 8
    x, unit = np.tile(np.sqrt([0.0, 1.0, 2.0]), 32), np.repeat(np.arange(8), 12)
    tests = {
        "ranks": lambda: stratified.by_ranks(pairs(draw, *sizes)),
        "means": lambda: stratified.by_means(pairs(draw, *sizes), permutations=200, seed=1),
        "failures": lambda: stratified.by_failures(pairs(draw, *sizes), -0.5),
        "slopes": lambda: stratified.by_slopes(x, draw.normal(size=96) + unit, unit, np.full(96, "one")),
    }
    share = np.mean([tests[test]().p < 0.05 for _ in range(400)])
    assert (0.004 if test == "failures" else 0.017) < share < 0.083  # Yates's correction is careful


def test_what_was_put_in_is_found_and_nothing_else() -> None:
    """An effect of comparison, of evolution, on the fall; and none."""
    made = words(judge(arm(comparison(1.0, by=2.0), runs=32), QUICK))
    assert made["a signed ranks"] == made["c ranks"] == made["e interval"] == "supported"
    assert made["b ranks"] == made["d slopes"] == "open"
    made = words(judge(arm(evolution(1.0, by=2.5), runs=48), QUICK))
    assert made["b ranks"] == made["b means"] == made["c ranks"] == "supported"
    assert made["a signed ranks"] == made["d slopes"] == "open"
    made = words(judge(arm(runs=80, fall=0.3), QUICK))
    assert made["d slopes"] == "supported" and made["b means"] == made["c ranks"] == "absent"
    assert words(judge(arm(runs=80, fall=-0.3), QUICK))["d slopes"] == "reversed"
    made = words(judge(arm(runs=80, failing=0.3, seed=3), QUICK))
    assert made["b failures"] == made["b means"] == "supported"
    assert words(judge(arm(comparison(4.0, by=2.0), runs=16), QUICK))["e interval"] == "reversed"


def test_both_seed_sets_must_agree() -> None:
    """What one seed set alone shows, however clearly, is not found; nor is anything by one set alone."""
    better, flat = arm(evolution(1.0, by=4.0), runs=64), arm(evolution(1.0, by=-1.0), runs=64)
    first = better.seed_set == 1
    mixed = {name: np.where(first[:, None], getattr(better, name), getattr(flat, name))
             for name in ("score", "home_score")}  # fmt: skip
    one = judge(replace(better, **mixed), QUICK)
    by_ranks = next(v for v in one.verdicts if (v.claim.key, v.claim.by) == ("b", "ranks"))
    assert [c.sets for c in by_ranks.comparisons] == [(1, -1), (1, -1)]
    assert by_ranks.comparisons[0].p_holm < 0.05 and by_ranks.word == "open"
    assert "supported" not in list(words(judge(better.only(first), QUICK)).values())[:6]


def test_absent_is_said_only_where_half_a_point_is_excluded() -> None:
    """With few runs the same nothing is open; and it is never said of ranks or failures."""
    few, many = (words(judge(arm(runs=runs, seed=2), QUICK)) for runs in (16, 96))
    assert (few["b means"], many["b means"], many["c ranks"]) == ("open", "absent", "absent")
    assert many["b ranks"] == many["b failures"] == "open"


def test_the_peaks_interval_holds_the_truth() -> None:
    """Over made-up arms whose units differ, a 95 % interval holds the true means' peak in 88 to 100 %."""
    levels, held = np.array([0.0, 0.5, 1.0, 2.0, 4.0]), 0
    truth = 8 - 2 * (np.sqrt(levels) - 1.0) ** 2
    for seed in range(60):
        data, draw = (
            arm(lambda _, c: 8 - 2 * (np.sqrt(c) - 1.0) ** 2, seed=seed, runs=16),
            np.random.default_rng(seed),
        )
        tilt = draw.normal(0, 0.5, 200)[data.home, None] * (np.sqrt(levels) - 1.0)
        top = peak_of(replace(data, score=data.score + tilt), QUICK)
        held += top.low <= float(levels[truth.argmax()]) <= top.high
    assert 53 <= held <= 60
    judged = judge(data, replace(QUICK, permutations=0)).peak  # which holds this very interval
    told = peak_of(data, QUICK)
    assert (judged.value, judged.low, judged.high) == (told.value, told.low, told.high)


def test_mixed_models_are_those_of_the_formula() -> None:
    """Coefficient and p are those that statsmodels' formula interface gives of units that differ; they find
    what was put in, and runs of one number at different levels are different runs."""
    mixed = pytest.importorskip("statsmodels.formula.api")
    pandas = pytest.importorskip("pandas")
    data = arm(evolution(1.0, by=1.0), runs=32, fall=0.3)
    units = np.random.default_rng(1).normal(0, 1.5, 200)
    data = replace(data, score=data.score + units[data.home, None])
    part: Crossed = data.only(np.isin(data.evolved, (1.0, 2.0)))
    frame = pandas.DataFrame({
        "score": part.at(1.0), "level": (part.evolved == 1) * 1.0, "task": part.task, "unit": part.home,
    })  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = mixed.mixedlm("score ~ level + task", frame, groups="unit").fit()
    made = by_mixed_models(data)
    assert made["b", "2"].effect == pytest.approx(fit.params["level"], abs=1e-3)
    assert made["b", "2"].p == pytest.approx(fit.pvalues["level"], rel=0.02)
    assert by_mixed_models(replace(data, run=np.arange(len(data)))) == made
    assert set(made) == {("b", "0"), ("b", "2"), ("d", "0, 1, 2"), ("d", "all levels")}
    assert made["d", "all levels"].effect < -0.1 and made["d", "all levels"].statistic > 0.1
