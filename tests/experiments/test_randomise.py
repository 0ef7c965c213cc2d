"""Measure or randomise: the plan's conditions crossed, its comparisons, and the whole of it made small."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from realitygap import load_profile
from realitygap.calibration.recordings.recording import SensorRecording
from realitygap.calibration.share import thinned
from realitygap.calibration.unit_folder import PROFILE
from realitygap.cli import realitygap
from realitygap.cli.experiment import _told
from realitygap.errors import ConfigError, StudyError
from realitygap.experiments.randomise.plan import (
    KNOWN,
    LOOKUP,
    Profiles,
    RandomiseConfig,
    Spread,
    calibrated_folder,
    conditions,
    controllers,
    evolution,
    spread_of,
)
from realitygap.experiments.randomise.results import OUTCOMES, compared, outcomes
from realitygap.experiments.randomise.run import measure_or_randomise

PAPER = load_profile("paper")
SMALL = RandomiseConfig(robot="twin", units=2, first_unit=3, runs=1, starts=2, evaluations=70, seconds=2.0)
"""One unit has a run of each condition, the other is the other unit."""


def scaled(gain: float, wheels: float = 1.0):
    """The paper's robot with other sensitivities and wheels."""
    sensors = tuple(replace(s, a=s.a * gain) for s in PAPER.infrared.sensors)
    speeds = tuple(v * wheels for v in PAPER.wheels.speed_per_unit_cm_s)
    return replace(
        PAPER, infrared=replace(PAPER.infrared, sensors=sensors),
        wheels=replace(PAPER.wheels, speed_per_unit_cm_s=speeds),
    )  # fmt: skip


def test_the_design_is_the_plans():
    """Five states of knowledge, with and without drawn constants, and a look-up table that has none, at two
    noises; 20 runs on 16 units."""
    config = RandomiseConfig()
    every = controllers(config)
    assert len(conditions()) == 22 and len(every) == 440
    assert {one.randomised for one in conditions() if one.known == LOOKUP} == {False}
    assert {one.unit for one in every} == set(range(101, 117)) and config.starts == 4
    for condition in conditions():
        mine = [one for one in every if one.condition == condition]
        assert sorted(one.run for one in mine) == list(range(1, 21))


def test_states_of_knowledge_share_seeds_and_only_the_randomised_are_drawn():
    """What evolves for a unit differs by its profile alone; half of its conditions have the spread."""
    made = {known: evolution(SMALL, 3, known, "paper", Spread(0.3, 0.02)) for known in KNOWN}
    assert len({study.seed for study, _ in made.values()}) == 1
    study, names = made["own, 5 %"]
    drawn = [(c.noise, c.spread, c.spread_wheels) for c in study.conditions]
    assert drawn == [(0.0, 0.0, None), (1.0, 0.0, None), (0.0, 0.3, 0.02), (1.0, 0.3, 0.02)]
    assert len(set(names.values())) == len(names) == 4


def test_another_unit_is_the_next_and_never_the_own(tmp_path):
    """Units lend each other their calibrations in a circle."""
    profiles = Profiles(tmp_path, SMALL)
    for unit, other in ((3, 4), (4, 3)):
        assert profiles.file(unit, "another unit") == profiles.file(other, "own, all")
    assert profiles.file(3, "paper") == "paper"


def test_the_spread_is_that_of_the_units():
    """Equal units have the least spread; sensors and wheels are told apart."""
    assert spread_of([PAPER, PAPER]) == Spread(0.01, 0.01)
    found = spread_of([scaled(0.9), scaled(1.0), scaled(1.1)])
    assert found.infrared == pytest.approx(0.1 * np.sqrt(3), abs=0.04) and found.wheels == 0.01
    assert spread_of([scaled(1.0, 0.9), scaled(1.0), scaled(1.0, 1.1)]).wheels > 0.1


def recording(places: int) -> SensorRecording:
    distance = np.repeat(np.linspace(0.5, 5, places), 10)
    return SensorRecording(
        kind="infrared", object="wall", distance_cm=distance, bearing_deg=np.zeros(len(distance)),
        repeat=np.tile(np.arange(10), places), counts=np.ones((len(distance), 8)),
    )  # fmt: skip


def test_a_smaller_share_is_part_of_a_larger_one():
    """Shares keep whole places, as many as they say, each inside the next."""
    whole = recording(192)
    few, more = (thinned(whole, share, 7) for share in (0.05, 0.2))
    assert len(few.repeat) == 100 and len(more.repeat) == 380
    assert set(few.distance_cm) < set(more.distance_cm)
    assert len(thinned(recording(3), 0.05, 7).repeat) == 10


def given(differences: dict[str, float]):
    """[16 units] of each condition: an own 5 % that is better than the paper's by so much."""
    draw = np.random.default_rng(0)
    base = {condition: draw.normal(5, 0.1, 16) for condition in conditions()}
    return {
        name: {c: v + differences[name] * (c.known == "own, 5 %") for c, v in base.items()}
        for name in OUTCOMES
    }


def test_planned_comparisons_find_what_is_there_and_nothing_else():
    """Four comparisons under one Holm correction: a shift of one outcome is found there alone."""
    found = compared(given({"correspondence": 1.0, "fitness_situated": 0.0}))
    assert [one.found for one in found] == ["above", "open", "open", "open"]
    assert found[0].low < 1.0 < found[0].high and found[0].p_holm >= found[0].p
    assert compared(given({"correspondence": -1.0, "fitness_situated": 0.0}))[0].found == "below"
    nothing = compared({name: {c: np.ones(16) for c in conditions()} for name in OUTCOMES})
    assert [one.p for one in nothing] == [1.0] * 4


def test_one_unit_gives_no_test_and_no_p():
    """Nor do several of which only one has a value; the other outcome's tests stand beside it."""
    units = given({"correspondence": 1.0, "fitness_situated": 1.0})
    units["correspondence"] = {c: np.array([v[0], np.nan]) for c, v in units["correspondence"].items()}
    found = compared(units)
    assert [one.found for one in found] == ["no test", "no test", "above", "open"]
    assert np.isnan([one.p for one in found[:2]]).all() and np.isnan([one.p_holm for one in found[:2]]).all()
    told = list(_told([], found))[1:]
    assert ["no test with fewer than two units" in line for line in told] == [True, True, False, False]


def test_means_are_over_units_and_leave_out_those_without_runs():
    """The interval is Student's over units that have a value."""
    (one,) = outcomes("correspondence", {conditions()[0]: np.array([1.0, 2.0, 3.0, np.nan])})
    assert (one.mean, one.units) == (2.0, 3)
    assert one.high - one.mean == pytest.approx(4.3027 / np.sqrt(3), rel=1e-4)


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory) -> Path:
    """A folder whose units are calibrated already: any profiles will do."""
    folder = tmp_path_factory.mktemp("randomise") / "made"
    for unit, gain in ((3, 1.0), (4, 1.1)):
        for known in (known for known, share in KNOWN.items() if share):
            place = calibrated_folder(folder, unit, known)
            place.mkdir(parents=True)
            (place / PROFILE).write_text(scaled(gain).to_toml(), encoding="utf-8")
    return folder


def test_an_experiment_goes_on_to_the_same_bits(calibrated, tmp_path, monkeypatch):
    """What lacks a trial is made anew as it was; tables and picture are those of every condition."""
    monkeypatch.setattr("realitygap.experiments.folder.refuse_strangers", lambda *_: None)
    results = measure_or_randomise(calibrated, SMALL, workers=1)
    tables = {file.name: file.read_bytes() for file in results.glob("*.csv")}
    assert len(tables["controllers.csv"].splitlines()) == 23
    assert len(tables["conditions.csv"].splitlines()) == 45
    lost = sorted(calibrated.glob("trials/*/*.npz"))[7]
    content = lost.read_bytes()
    lost.unlink()
    with pytest.raises(StudyError, match="already holds"):
        measure_or_randomise(calibrated, SMALL, workers=1)
    with pytest.raises(StudyError, match="runs"):
        measure_or_randomise(calibrated, replace(SMALL, runs=2), workers=1, resume=True)
    words = ["experiment", "measure-or-randomise", "--out", str(calibrated), "--resume", "--workers", "1"]
    told = CliRunner().invoke(realitygap, words)
    assert told.exit_code == 0, told.output
    assert (
        lost.read_bytes() == content and "correspondence: own, 5 % against paper, randomised" in told.output
    )
    assert {file.name: file.read_bytes() for file in results.glob("*.csv")} == tables
    assert (results / "outcomes.svg").is_file()


@pytest.mark.parametrize(
    ("change", "says"),
    [({"robot": "enki:epuck"}, "robot"), ({"units": 1}, "units"), ({"starts": 1}, "starts"),
     ({"seconds": 1.0}, "seconds"), ({"twin_noise": 11.0}, "twin_noise")],
)  # fmt: skip
def test_a_design_that_cannot_be_is_refused(change, says):
    """Each names its key."""
    with pytest.raises(ConfigError, match=says):
        RandomiseConfig(**change)
