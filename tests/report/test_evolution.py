"""Curves, tables and statistics follow from the data alone."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest
from scipy.stats import ttest_ind

from realitygap.report.evolution import (
    NoiseClass,
    TaskPart,
    decimals,
    difference,
    mean_curve,
    mean_of,
    running_best,
    table_csv,
)
from realitygap.report.style import number
from tests.report.scenes import APART, EQUAL, LEVELS, made_up, table


def test_a_mean_has_students_interval() -> None:
    """The 95 % interval of a mean of five holds the true mean in about 95 of 100 cases, not in 80."""
    random = np.random.default_rng(1)
    held = []
    for _ in range(400):
        values = random.normal(3.0, 1.0, (5, 1))
        mean, half = mean_curve(values)
        held.append(abs(mean[0] - 3.0) <= half[0])
        assert half[0] == pytest.approx(mean_of(values[:, 0]).half)
    assert 0.92 <= np.mean(held) <= 0.98
    assert mean_of([]) is None and math.isnan(mean_of([2.0]).half)


@pytest.mark.parametrize("second", [[3.0, 5.0], [2.0, 2.5, 2.0, 3.0, 1.0]])
def test_a_difference_has_welchs_interval(second: list[float]) -> None:
    """With degrees of freedom that are no whole number, for as few as two against two."""
    gap = difference([1.0, 2.0], second)
    interval = ttest_ind([1.0, 2.0], second, equal_var=False).confidence_interval(0.95)
    assert (gap.value - gap.half, gap.value + gap.half) == pytest.approx(tuple(interval))
    assert difference([1.0], second) is None and difference([2.0, 2.0], [1.0, 1.0]).half == 0


def test_a_curve_goes_as_far_as_all_runs_do() -> None:
    """Runs of an unfinished study are averaged over the evaluations that all of them have."""
    mean, half = mean_curve([np.arange(10.0), np.arange(7.0)])
    assert mean == pytest.approx(np.arange(7.0)) and half == pytest.approx(np.zeros(7))
    assert running_best([1, 3, 2, 4]).tolist() == [1, 3, 3, 4]


def test_the_csv_holds_every_run_and_every_average() -> None:
    """A row a run and one a noise class, unscaled, with counts; a study that has just begun has its head."""
    rows = list(csv.DictReader(table_csv(table(EQUAL, APART, scale=1e-6)).splitlines()))
    assert [row["row"] for row in rows] == ["1", "2", "3", "average"] * 3
    assert float(rows[0]["fittest_zero_mean"]) == pytest.approx(0.5e-6)
    assert float(rows[7]["champion_double_mean"]) == pytest.approx(0.91e-6)
    assert rows[0]["fittest_observed_n"] == "2" and rows[3]["fittest_observed_n"] == "3"
    condition = NoiseClass(level=1.0, name="observed", rows=())
    empty = TaskPart(task=made_up(), levels=LEVELS, conditions=(condition,))
    assert len(table_csv(empty).splitlines()) == 2 and empty.show(None) == ("–", "")


def test_numbers_show_three_significant_digits_and_a_true_minus() -> None:
    """Of the largest value of a table; nothing is never "−0.00"."""
    assert [decimals(v) for v in (0.6, 1.5, 25.0, 1500.0, 0.0)] == [3, 2, 1, 0, 2]
    assert number(-0.5, 2) == "−0.50" and number(-0.0, 2) == number(-0.001, 2) == "0.00"
