"""What a report says first: honest for every outcome."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.stats import tukey_hsd

from realitygap.report.answer import Answer, answer_figure, answer_of, caveats
from realitygap.report.scores import PAPER_ROWS, score_tables
from tests.report.scenes import EQUAL, LEVELS, table
from tests.report.test_scores import AVOID, marks

NEAR = {0.0: [7.4, 8.1, 7.6, 7.2, 8.2], 1.0: [9.0, 9.4, 9.2, 8.9, 9.5], 2.0: [9.0, 7.6, 9.6, 7.1, 9.2]}
"""Observed noise is clearly above zero, not above double."""


def said(values: dict[float, list[float]], part: object = None) -> str:
    """The whole sentence about correspondence scores."""
    tables = score_tables(AVOID, list(values), marks(values))
    answer = answer_of(part or table(EQUAL, EQUAL), tables)
    assert answer.where == "on the twin"
    return f"{answer.found}: {answer.detail}"


def test_the_best_level_is_named_with_its_test() -> None:
    """As in the paper; the p values are Games and Howell's, of the best level against each other one."""
    text = said(NEAR)
    assert text.startswith("Observed noise came out best: correspondence score on the twin 9.2 ± 0.3")
    assert "against 7.7 at zero and 8.5 at double noise, as in the paper; with five runs a level" in text
    p = tukey_hsd(*NEAR.values(), equal_var=False).pvalue[1]
    assert p[0] < 0.05 < p[2]
    assert "difference from double noise is not significant, the one from zero noise is" in text
    assert f"p = {p[0]:.2g} against zero and p = {p[2]:.2g} against double" in text


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({0.0: [3.0, 3.1, 3.2], 1.0: [9.0, 9.1, 9.2], 2.0: [5.0, 5.1, 5.2]}, "the difference is significant"),
        ({0.0: [3.0, 8.1], 1.0: [4.0, 9.1], 2.0: [5.0, 5.1]}, "with two runs a level the difference is not"),
        ({0.0: [9.1, 9.2], 1.0: [3.0, 3.1]}, "(in the paper observed noise did best); with two runs"),
        ({0.0: [9.0, 9.0], 1.0: [9.0, 9.0]}, "some without any spread, no test is possible"),
        ({0.0: [9.1], 1.0: [3.0]}, "score on the twin 9.1 ± 1.0, against 3.0 at observed noise"),
        ({0.0: [9.1], 1.0: [3.0], 2.0: [4.0]}, "with one run a level chance may have chosen the order"),
        ({0.0: [9.0, 9.1, 9.3], 1.0: [3.0, 3.2]}, "with 2 to 3 runs a level"),
        ({1.0: [9.1, 9.2]}, "The champions evolved at observed noise: correspondence score 9.1 ± 0.6"),
        ({1.0: [9.1]}, "(one run, ± its 95 % interval; the paper’s runs: 8.0). No other level has a score"),
    ],
)  # fmt: skip
def test_every_outcome_has_its_words(values: dict[float, list[float]], words: str) -> None:
    """Significant, not, another order, no spread, single runs, unequal numbers, one level."""
    assert words in said(values)


def test_many_levels_are_summed_up() -> None:
    """A sentence does not list eight levels one by one."""
    values = {0.25 * k: [9.5 - k, 9.7 - k, 9.6 - k, 9.4 - k] for k in range(6)}
    text = said({**values, 0.0: [9.4, 8.7, 9.9, 9.2]})
    assert "against 4.5 to 8.5 at the five other levels; with four runs a level" in text
    assert re.search(r"significant from 4 of these 5 \(Games–Howell test: p < 0.001 to p = 0\.\d+\)", text)


def test_equal_levels_are_not_ordered() -> None:
    """Nor is the paper's order found again."""
    text = said({0.0: [9.01, 8.0], 1.0: [9.03, 8.0], 2.0: [2.0, 1.0]})
    assert text.startswith("Zero and observed noise came out alike: ") and "as in the paper" not in text


def test_without_transfers_test_scores_are_compared() -> None:
    """In the task's unit; a task that is not the paper's is not compared with the paper."""
    part = table(EQUAL, {level: [v + level for v in of] for level, of in EQUAL.items()}, scale=1e-6)
    part.task.fitness_unit = "10⁻⁶ cm⁻²"
    answer = answer_of(part, score_tables(AVOID, list(LEVELS), ()))
    assert answer.found == "Double noise came out best"
    assert answer.detail.startswith("test score in simulation at observed noise (2.547 ± 0.125) × 10⁻⁶ cm⁻²")
    assert "paper" not in answer.detail
    nothing = answer_of(table({1.0: []}, {1.0: []}), ())
    assert (nothing.found, nothing.detail) == ("There is no score yet", "no run has finished.")


def test_the_plot_shows_runs_means_intervals_and_the_paper() -> None:
    """Of each level in its look; an interval ends where the scale does."""
    values = {0.0: [4.0, 5.0], 1.0: [9.9, 10.0, 8.0]}
    paper = {level: PAPER_ROWS["obstacle-avoidance"][level] for level in values}
    names = {level: LEVELS[level] for level in values}
    common = {"what": "correspondence score", "where": "on the twin", "unit": "", "places": 1}
    answer = Answer(**common, names=names, values=values, own={}, paper=paper)
    (ax,) = answer_figure(answer, tuple(LEVELS)).axes
    drawn = [np.asarray(line.get_xdata(), float).tolist() for line in ax.lines]
    assert [4.0, 5.0] in drawn and [8.0, 9.9, 10.0] in drawn and [4.5] in drawn
    assert max(max(x) for x in drawn) == 10.0
    assert [8.0] in drawn and sum(line.get_marker() == "*" for line in ax.lines) == 2
    assert len({line.get_linestyle() for line in ax.lines if len(line.get_xdata()) == 2}) >= 2


def test_the_caveat_says_what_was_driven() -> None:
    """A twin is no robot; one unit is one unit; few starts are few; nothing at all is said once."""
    assert caveats([], 0, 0) == [
        "No robot was driven: all scores are of the simulation, and say nothing about a robot."
    ]
    text = " ".join(caveats(["twin"], 1, 4))
    assert text.startswith("No robot was driven") and "one unit" in text and "four starts" in text
    assert caveats(["robot"], 2, 8) == []
