"""Tables and what is read out of them follow from the data alone."""

from __future__ import annotations

import csv

import pytest

from realitygap.report.reading import read_table
from realitygap.report.tables import NoiseClass, TaskPart, decimals, number, table_csv
from tests.report.scenes import LEVELS, made_up, table

EQUAL = {0.0: [0.5, 0.6, 0.55], 1.0: [0.56, 0.52, 0.58], 2.0: [0.54, 0.6, 0.5]}
APART = {0.0: [0.5, 0.51, 0.52], 1.0: [0.9, 0.91, 0.92], 2.0: [0.2, 0.21, 0.22]}


def test_the_csv_holds_every_run_and_every_average() -> None:
    """A row a run and one a noise class, unscaled, with counts."""
    rows = list(csv.DictReader(table_csv(table(EQUAL, APART, scale=1e-6)).splitlines()))
    assert [row["row"] for row in rows] == ["1", "2", "3", "average"] * 3
    assert float(rows[0]["fittest_zero_mean"]) == pytest.approx(0.5e-6)
    assert float(rows[7]["champion_double_mean"]) == pytest.approx(0.91e-6)
    assert rows[0]["fittest_observed_n"] == "2" and rows[3]["fittest_observed_n"] == "3"


def test_the_reading_says_which_noise_class_does_best_and_whether_that_is_sure() -> None:
    """Clear differences are called so; those within the spread are not."""
    clear = " ".join(read_table(table(APART, APART)))
    vague = " ".join(read_table(table(EQUAL, EQUAL)))
    assert (
        clear.index("observed noise 0.910")
        < clear.index("zero noise 0.510")
        < clear.index("double noise 0.210")
    )
    assert "more than the spread among 3 runs explains" in clear
    assert "does not tell them apart" in vague and "more than the spread" not in vague


def test_the_reading_says_how_far_stored_fitness_overrates() -> None:
    """0.7 stored against 0.54 on average over all fresh means, and the other way round."""
    assert "0.700 on average over 9 runs" in read_table(table(APART, APART))[0]
    assert "less (22%)" in read_table(table(APART, APART))[0]
    assert "more (" in read_table(table(APART, APART, stored=0.3))[0]


def test_a_zero_has_no_sign() -> None:
    """A difference of nothing, or of less than is shown, is never "−0.00"."""
    assert number(-0.0, 2) == number(-0.001, 2) == "0.00"
    alike = {level: [0.7] * 3 for level in LEVELS}
    assert "they score 0.700, 0.000 more (0%)." in read_table(table(alike, alike))[0]


def test_the_reading_says_in_how_many_runs_the_retest_finds_better_ones() -> None:
    """Each run is counted at the noise it evolved under."""
    sentence = next(s for s in read_table(table(EQUAL, APART)) if s.startswith("The retested champion"))
    assert "in 3 of 9 runs" in sentence


def test_an_empty_table_is_read_as_nothing() -> None:
    """A study that has just begun makes no sentences and a table without numbers."""
    condition = NoiseClass(level=1.0, name="observed", rows=())
    empty = TaskPart(task=made_up(), levels=LEVELS, conditions=(condition,))
    assert read_table(empty) == []
    assert len(table_csv(empty).splitlines()) == 2
    assert empty.show(None) == ("–", "")


def test_numbers_show_three_significant_digits_and_a_true_minus() -> None:
    """Of the largest value of a table."""
    assert [decimals(v) for v in (0.6, 1.5, 25.0, 1500.0, 0.0)] == [3, 2, 1, 0, 2]
    assert number(-0.5, 2) == "−0.50"
