"""The claims' tests on studies made under known truths, and their statistics against SciPy's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from realitygap.errors import UsageError
from realitygap.experiments.noise.claims import (
    CLAIMS,
    VERDICTS,
    Finding,
    coarse_levels,
    judge_claims,
    judge_home,
    split_diagonal,
)
from realitygap.experiments.noise.contrasts import crossing, holm, interval, paired, peak, unpaired
from realitygap.experiments.noise.crossed import robot_level
from tests.experiments.crosses import LEVELS, comparison, evolution, flat, study

PAPER = {
    0.0: [8, 7, 5, 7, 4, 4, 6, 8, 4, 6],
    1.0: [8, 9, 7, 9, 7, 8, 6, 9, 6, 10],
    2.0: [8, 8, 5, 6, 7, 2, 6, 7, 6, 6],
}


def verdicts(findings: tuple[Finding, ...]) -> dict[str, str]:
    return {f.claim.key: f.verdict for f in findings}


def test_a_peak_at_the_robots_comparison_level_supports_a_and_c_but_not_b() -> None:
    """Claims (a) and (c) see it, claim (b) does not: the crossed design tells them apart."""
    found = judge_claims(study(comparison(1.0)), resamples=200)
    assert verdicts(found) == {"a": "supported", "b": "not supported", "c": "supported"}
    for contrast in found[0].contrasts:
        assert contrast.effect.difference_interval is not None
        low, high = contrast.effect.difference_interval
        assert low < contrast.effect.difference < high
        assert low > 0


def test_a_peak_at_the_robots_evolved_level_supports_b_and_c_but_not_a() -> None:
    """The other way round likewise."""
    found = judge_claims(study(evolution(1.0)), resamples=0)
    assert verdicts(found) == {"a": "not supported", "b": "supported", "c": "supported"}


@pytest.mark.parametrize(("truth", "evolved"), [(comparison(1.0), False), (evolution(1.0), True)])
def test_the_diagonal_is_split_into_what_made_it(truth, evolved) -> None:
    """Means of both orders add up; all of the difference lies with the level that has an effect."""
    for split in split_diagonal(study(truth, runs=40, levels=(0.0, 1.0, 4.0)), resamples=100):
        parts = (split.evolved_first, split.comparison_after, split.evolved_after, split.comparison_first)
        first, after, later, before = (part.difference for part in parts)
        assert first + after == pytest.approx(split.diagonal.difference)
        assert before + later == pytest.approx(split.diagonal.difference)
        for part, made in zip(parts, (evolved, not evolved) * 2, strict=True):
            assert (part.difference > 0.75) == (part.delta > 0.35) == made
            assert abs(part.difference) < 0.4 or made
            assert part.difference_interval is not None
            low, high = part.difference_interval
            assert low < part.difference < high


def test_the_home_unit_is_judged_by_its_own_scores() -> None:
    """Scores of other units do not matter to it; levels that have none are left out."""
    data = study(flat)
    assert judge_home(data) == ()
    home = study(evolution(1.0)).score
    kept = np.where((data.evolved == 4.0)[:, None], np.nan, home)
    found = judge_home(replace(data, home_score=kept), resamples=200)
    assert [(c.other, c.found) for c in found] == [(0.0, "above"), (0.5, "above"), (2.0, "above")]
    own = home[np.arange(len(data)), np.searchsorted(data.levels, data.evolved)]
    assert found[0].means[1] == pytest.approx(own[data.evolved == 0.0].mean())


def test_an_opposite_effect_is_reported_as_opposite() -> None:
    """Where the robot's level is the worst, all three claims are opposite."""
    turned = judge_claims(study(comparison(1.0, by=-1.5)), resamples=0)
    assert verdicts(turned)["a"] == verdicts(turned)["c"] == "opposite"
    assert verdicts(judge_claims(study(evolution(1.0, by=-1.5)), resamples=0))["b"] == "opposite"


def test_a_peak_elsewhere_is_reported_as_elsewhere() -> None:
    """Where double noise resembles the robot best, the claim is not called supported in part."""
    assert verdicts(judge_claims(study(comparison(2.0)), resamples=0))["a"] == "elsewhere"


def test_on_a_robot_twice_as_noisy_the_claim_is_about_level_two() -> None:
    """With the twin's noise at 2 a peak at 2 supports, a peak at 1 does not."""
    assert verdicts(judge_claims(study(comparison(2.0), robot=2.0), resamples=0))["a"] == "supported"
    assert verdicts(judge_claims(study(comparison(1.0), robot=2.0), resamples=0))["a"] in (
        "elsewhere",
        "opposite",
    )


def test_without_an_effect_no_verdict_but_not_supported() -> None:
    """Of 200 studies without any effect fewer than one in ten has a claim with another verdict."""
    alarms = 0
    for seed in range(200):
        found = judge_claims(study(flat, seed=seed, runs=6), resamples=0)
        alarms += any(f.verdict != "not supported" for f in found)
    assert alarms < 20


def test_an_effect_on_one_claim_raises_no_alarm_about_another() -> None:
    """Where only (a) and (c) are true, (b) is not called anything else in one study of twenty."""
    alarms = 0
    for seed in range(100):
        found = judge_claims(study(comparison(1.0), seed=seed, runs=6, levels=(0.0, 1.0, 2.0)), resamples=0)
        alarms += found[1].verdict != "not supported"
    assert alarms <= 8


def test_seed_sets_that_disagree_support_nothing() -> None:
    """An effect in one set alone is not called supported, however small the p of both together."""
    data = study(comparison(1.0, by=3.0))
    still = data.seed_set == 2
    score = data.score.copy()
    score[still] = study(comparison(1.0, by=-0.3)).score[still]
    found = judge_claims(replace(data, score=score), resamples=0)
    assert found[0].verdict == "not supported"
    assert max(c.effect.p for c in found[0].contrasts) < 0.001


def test_a_seed_set_that_shows_nothing_supports_nothing() -> None:
    """Where one set has nobody to be held against, the other alone is not called supported."""
    data = study(evolution(1.0, by=4.0), levels=(0.0, 1.0, 2.0))
    alone = (data.seed_set == 2) & (data.evolved != 1.0)
    contrasts = judge_claims(replace(data, home=np.where(alone, 9, data.home)), resamples=0)[1].contrasts
    assert max(c.p_holm for c in contrasts) < 0.001
    assert {c.found for c in contrasts} == {"open"}


def test_ranks_agree_with_scipy() -> None:
    """Both tests give SciPy's p on data with ties; Cliff's delta is its U, rescaled."""
    draw = np.random.default_rng(4)
    x, y = draw.integers(0, 11, 25).astype(float), draw.integers(2, 11, 31).astype(float)
    whole = stats.mannwhitneyu(x, y, method="asymptotic", use_continuity=True)
    made = unpaired(x, y)
    assert made.p == pytest.approx(whole.pvalue)
    assert made.delta == pytest.approx(2 * whole.statistic / (25 * 31) - 1)
    z = y[:25]
    signed = stats.wilcoxon(x, z, zero_method="pratt", correction=True, method="approx")
    assert paired(x, z).p == pytest.approx(signed.pvalue, abs=1e-4)


def test_strata_are_not_held_against_each_other() -> None:
    """Two tasks of different difficulty, unevenly filled, make no effect; without strata they would."""
    draw = np.random.default_rng(1)
    x = np.concatenate([draw.normal(0, 1, 30), draw.normal(20, 1, 10)])
    y = np.concatenate([draw.normal(0, 1, 10), draw.normal(20, 1, 30)])
    strata = ([0] * 30 + [1] * 10, [0] * 10 + [1] * 30)
    assert unpaired(x, y, strata=strata).p > 0.05
    assert unpaired(x, y).p < 0.01


def test_intervals_hold_the_truth() -> None:
    """A 95 % interval covers the true difference in 94.4 of 100 studies of 20 runs, whatever the seed sets.

    Runs drawn again in cells of 20 spread by a root of 19/20 too little. A study in ten thousand whose
    intervals are right is doubted; intervals a fifth shorter, or a quarter longer, are.
    """
    data = study(flat, runs=20, levels=(0.0, 1.0), tasks=("light-seeking",))
    weights = data.resamples(1000)
    assert weights is not None
    draw = np.random.default_rng(7)
    far, half = [], []
    for _ in range(1000):
        found = paired(draw.normal(size=len(data)) + 3.0 * data.seed_set, 4.5 + 0.0 * data.run, weights)
        assert found.difference_interval is not None
        low, high = found.difference_interval
        far.append(abs(low + high) / 2)
        half.append((high - low) / 2)
    law = 2 * stats.norm.cdf(1.96 * np.sqrt(19 / 20)) - 1

    def doubted(size: float) -> bool:
        covered = int((np.array(far) <= size * np.array(half)).sum())
        return stats.binomtest(covered, len(far), law).pvalue < 1e-4

    assert [doubted(size) for size in (0.8, 1.0, 1.25)] == [True, False, True]


def test_seed_sets_are_drawn_again_each_for_itself() -> None:
    """Where runs of a set are alike and the sets differ, resampling finds nothing to be unsure of."""
    data = study(flat, runs=6, levels=(0.0, 1.0))
    score = np.where(data.seed_set[:, None] == 1, 2.0, 8.0) + np.array([0.0, 1.0])
    for finding in judge_claims(replace(data, score=score), resamples=200):
        effect = finding.contrasts[0].effect
        assert effect.difference_interval == (effect.difference, effect.difference)


def test_controllers_of_different_home_units_are_not_held_against_each_other() -> None:
    """Units on which all score high, and who was evolved there more often, make no effect of a level."""
    data = study(flat, runs=20, levels=(0.0, 1.0))
    often = np.where(data.evolved == 1.0, 1, 3)
    home = np.where(data.run % 4 == 0, 1 + data.run % 3, often)
    easy = replace(data, home=home, score=data.score - 1.5 * home[:, None])
    b = judge_claims(easy, resamples=0)[1].contrasts[0]
    assert b.found == "open" and abs(b.effect.delta) < 0.3
    alike = judge_claims(replace(easy, home=np.ones_like(home)), resamples=0)[1].contrasts[0]
    assert alike.found == "above" and alike.effect.delta > 0.5, "without units it would be one"


def test_the_papers_own_marks() -> None:
    """In the paper observed noise beats zero (p = .016) and double (.023), which do not differ (.70)."""
    found = {(a, b): unpaired(PAPER[a], PAPER[b]).p for a, b in ((1.0, 0.0), (1.0, 2.0), (0.0, 2.0))}
    assert found == pytest.approx({(1.0, 0.0): 0.0157, (1.0, 2.0): 0.0225, (0.0, 2.0): 0.699}, abs=5e-4)


def test_holm_and_interval() -> None:
    """Holm's steps never fall; nan is left out of an interval; an empty one says nan."""
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert interval([np.nan, 1.0, 1.0]) == (1.0, 1.0)
    assert np.isnan(interval([])).all()


def test_peaks_and_crossings() -> None:
    """A parabola's top is found where it is; ends stay ends; a curve crosses zero once, or nowhere."""
    root = np.sqrt(LEVELS)
    top = peak(LEVELS, [-((root - 1.2) ** 2), root, -root])
    assert top == pytest.approx([1.44, 4.0, 0.0])
    crossed = crossing(LEVELS, [1.2 - root, np.ones(5)])
    assert crossed[0] == pytest.approx(1.44)
    assert np.isnan(crossed[1])


def test_levels_that_decide() -> None:
    """Zero and double of the robot's level; the nearest where a study has neither."""
    assert coarse_levels(LEVELS, 1.0) == (0.0, 2.0)
    assert coarse_levels(LEVELS, 2.0) == (0.0, 4.0)
    assert coarse_levels((0.5, 1.0, 3.0), 1.0) == (0.5, 3.0)
    assert (robot_level(LEVELS), robot_level((0, 0.4, 1.5))) == (1.0, 1.5)
    with pytest.raises(UsageError, match="expected two or more"):
        robot_level([1.0])


def test_the_claims_stand_in_the_page() -> None:
    """The texts that the report shows are those of the page written beforehand."""
    page = (Path(__file__).parents[2] / "docs" / "noise-level.md").read_text("utf-8")
    for claim in CLAIMS:
        assert claim.text in page
    for word, meaning in VERDICTS.items():
        assert f"| {word} | {meaning} |" in page
