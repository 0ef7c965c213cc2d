"""Measure or randomise: analyse.py remakes what the archive's own tables and tables.md say."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

STUDY = Path(__file__).resolve().parents[2] / "studies" / "measure-or-randomise"


@pytest.fixture(scope="module")
def analyse():
    """The study's analysis, as a module."""
    spec = importlib.util.spec_from_file_location("measure_or_randomise", STUDY / "analyse.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("robot", ["E", "T"])
def test_the_planned_comparisons_are_those_that_were_kept(analyse, robot):
    """Differences, intervals, p, Holm's p and words agree with the archived tables of the run itself."""
    kept, made = analyse.table(f"measure-or-randomise/{robot}/comparisons.csv"), analyse.planned(robot)
    assert made["found"].tolist() == kept["found"].tolist()
    assert made["first"].map(analyse.words_of).tolist() == kept["first"].tolist()
    for column in ("difference", "low", "high"):
        assert made[column].to_numpy() == pytest.approx(kept[column].to_numpy(), abs=2e-5, rel=1e-4)
    for column in ("p", "p_holm"):
        assert made[column].to_numpy() == pytest.approx(kept[column].to_numpy(), rel=2e-4)


@pytest.mark.parametrize("robot", ["E", "T"])
def test_the_conditions_are_those_that_were_kept(analyse, robot):
    """So do all conditions' means and intervals."""
    kept = analyse.table(f"measure-or-randomise/{robot}/conditions.csv")
    for outcome in analyse.OUTCOMES:
        units = analyse.by_unit(robot, outcome)
        for one in kept[kept.outcome == outcome].itertuples():
            found = analyse.interval(units[one.known, one.randomised, one.noise])
            assert found == pytest.approx((one.mean, one.low, one.high), abs=2e-4, rel=1e-4)
            assert one.units == np.isfinite(units[one.known, one.randomised, one.noise]).sum() == 16


def test_the_tables_are_the_analysis(analyse):
    """tables.md is what analyse.py prints."""
    assert (STUDY / "tables.md").read_text("utf-8") == analyse.tables()
