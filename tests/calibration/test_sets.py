"""Units, days and starts: what differs between recordings of the same places, and noise by the reading."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from realitygap.api import load_recordings
from realitygap.calibration.between import between_recordings, between_table
from realitygap.calibration.calibrate import calibrate
from realitygap.calibration.judge import judge, judge_all
from realitygap.calibration.load import load_recording
from realitygap.calibration.model import TURN, proximity, rigs_of, scene_of
from realitygap.calibration.noise import Yardstick, lit_ratio, misfits
from realitygap.calibration.recordings import SensorRecording
from realitygap.control.genotype import Genotype
from realitygap.simulation.simulation import Simulation
from realitygap.tasks import load_task
from realitygap.values import Pose
from realitygap.world.robot import load_profile
from tests.calibration.written import save_recording

PAPER, EPUCK = load_profile("paper"), load_profile("e-puck")


@pytest.fixture(scope="module")
def edinburgh() -> Path:
    """Readings of a real Khepera II on five days."""
    beside = Path(__file__).parents[3] / "shared" / "data" / "logs" / "khepera2-edinburgh"
    folder = Path(os.environ.get("REALITYGAP_EDINBURGH", beside))
    if not folder.is_dir():
        pytest.skip(f"no real readings in {folder}; set REALITYGAP_EDINBURGH to the folder of fitD and heldD")
    return folder


def test_days_of_a_real_robot_are_covered(edinburgh):
    """Three days fitted, two judged: the stated noise, within and between days, covers 90 to 99 % of them; no
    turn is fitted to one bearing; without contact it errs as a table of the days' means does, 21 counts."""
    made = calibrate(load_recordings([str(edinburgh / "fitD")]), load_profile("khepera"), form="measured")
    assert made.infrared is not None and 15 < made.infrared.between < 40 and not made.infrared.measured
    found = judge_all(load_recordings([str(edinburgh / "heldD")]), made.profile)
    many = [np.isfinite(one.counts).sum() for one in found]
    assert 0.90 <= np.average([one.covered for one in found], weights=many) <= 0.99
    assert {(one.turn_deg, one.gain) for one in found} == {(0.0, 1.0)}
    found = judge_all(load_recordings([str(edinburgh / "heldN")]), made.profile)
    off = np.concatenate([(one.model - one.counts)[np.isfinite(one.counts)] for one in found])
    assert np.sqrt(np.mean(off**2)) < 24
    other = judge_all(load_recordings([str(edinburgh / "heldD")]), load_profile("khepera"))
    assert {round(one.gain, 1) for one in other} == {0.3}  # another unit, and named


def test_empty_cells_of_a_real_robot_are_read(edinburgh):
    """Each row has one sensor's reading: all 240 count, and none of the others is a 0."""
    read = load_recording(edinburgh / "cells_fit")
    assert isinstance(read, SensorRecording)
    assert np.isfinite(read.counts).sum() == 240 and (np.isfinite(read.counts).sum(axis=1) <= 2).all()
    told = misfits(read.counts, np.nan_to_num(read.counts) + 5.0, read.place(), Yardstick(
        kind="infrared", top=1023.0, deviation=87.0,
    ))  # fmt: skip
    assert [one.sensor for one in told] == list(range(8)) and all(abs(one.bias - 5) < 1e-9 for one in told)
    assert np.isnan(lit_ratio(told))  # too little is lit to say


@pytest.mark.parametrize("gain", [0.5, 1.8])
def test_another_unit_is_named_with_its_gain(recorded, robot, gain, tmp_path):
    """Of a set that is so many times as sensitive, in a check and among the recordings of a fit."""
    wall = recorded("wall")
    drawn = np.random.default_rng(8).normal(size=wall.counts.shape)
    clean = proximity(robot, scene_of(replace(wall, gain=gain)))
    counts = np.clip(np.rint(np.where(clean > 0, clean + 21.0 * drawn, 0.0)), 0, 1023)
    other = replace(wall, counts=counts, source="other/wall")
    told = judge(other, robot)
    assert told.gain == pytest.approx(gain, rel=0.05) and told.rmse < 15 < 50 < told.plain
    assert f"another unit, or another surface, {told.gain:.2g} times as sensitive" in told.fitted_out[-1]
    assert judge(wall, robot).gain == 1.0
    made = calibrate([wall, other], PAPER, form="extended", beside=False)
    assert made.infrared is not None
    assert float(made.infrared.fit.values["gain_1"][0]) == pytest.approx(gain, rel=0.05)
    assert any("other/wall: another unit" in warning for warning in made.warnings)
    assert made.infrared.between < 10  # its gain is no noise
    save_recording(tmp_path / "said", replace(other, facts={"gain": gain}))
    said = judge(load_recording(tmp_path / "said"), robot)
    assert said.gain == 1.0 and said.rmse < 25


def test_the_spread_between_recordings_is_found(recorded):
    """Six days at the same places, each sensor off by a deviation of 30 counts a day, noise 10."""
    plain = recorded("wall", noise=0.0)
    random, days = np.random.default_rng(2), []
    lit = plain.counts > 30
    for _ in range(6):
        shift = 30.0 * random.normal(size=8) + 10.0 * random.normal(size=plain.counts.shape)
        days.append(replace(plain, counts=plain.counts + np.where(lit, shift, 0.0)))
    sample = between_recordings(days, [np.zeros_like(plain.counts)] * 6)
    keep = np.abs(sample.level[:, 0] - 500) < 300
    means = np.array(
        [[day.counts[4 * k : 4 * k + 4].mean(axis=0) for k in range(len(plain.counts) // 4)] for day in days]
    )
    slow = means.std(axis=0, ddof=1)[np.abs(means.mean(axis=0) - 500) < 300]
    assert np.sqrt(np.mean(sample.z[keep] ** 2)) == pytest.approx(np.sqrt(np.mean(slow**2)), rel=0.02)
    table, _ = between_table(sample, np.full(9, 5.0), 1023.0)
    assert table[2:7] == pytest.approx(30.0, rel=0.3)


def test_a_turn_needs_several_bearings_of_a_sensor(recorded):
    """One bearing of each sensor tells none; recordings that only together have several share one."""
    wall = recorded("wall")
    one = [
        replace(wall, bearing_deg=np.full(len(wall.counts), b), source=f"made/{b}") for b in (0.0, 10.0, 20.0)
    ]
    assert rigs_of([wall]) == ["turn_0_deg"] and rigs_of(one[:1]) == [""] and rigs_of(one[:2]) == ["", ""]
    assert rigs_of([*one, wall]) == [TURN, TURN, TURN, "turn_3_deg"]


def size(reading: np.ndarray) -> np.ndarray:
    """Noise like a real e-puck2's: 2.5 counts up to a reading of 140, 143 at the top."""
    return 2.5 + 140.5 * np.clip((reading - 140.0) / (EPUCK.infrared.top - 140.0), 0.0, 1.0)


@pytest.mark.parametrize("form", ["paper", "extended"])
def test_a_loop_where_noise_is_small_has_small_noise(form):
    """A simulated e-puck that stands where it reads 140 counts has the step noise of readings there, within a
    factor of two: one figure for all readings, 19 counts, had stood for 2.5."""
    distance, bearing, repeat = (x.ravel() for x in np.meshgrid(
        [0.3, 0.6, 1, 1.5, 2, 2.5, 3, 4, 5, 6], np.arange(-160, 181, 20.0), np.arange(8), indexing="ij"
    ))  # fmt: skip
    blank = SensorRecording(
        kind="infrared", object="wall", distance_cm=distance, bearing_deg=bearing, repeat=repeat.astype(int),
        counts=np.zeros((len(distance), 8)), body_radius_cm=EPUCK.body.radius_cm, source="made",
    )  # fmt: skip
    clean = proximity(EPUCK, scene_of(blank))
    noisy = clean + size(clean) * np.random.default_rng(1).normal(size=clean.shape)
    top = EPUCK.infrared.top
    made = calibrate([replace(blank, counts=np.clip(np.rint(noisy), 0, top))], EPUCK, form=form, beside=False)
    room = replace(load_task("avoidance").arena, size_cm=(60.0, 60.0), cylinders=())
    task, still = replace(load_task("avoidance"), arena=room), Genotype.constant(0, 0).networks()
    places = [Pose(x=60 - EPUCK.body.radius_cm - d, y=30.0, heading=0.0) for d in np.linspace(1.0, 6.0, 100)]
    read = [Simulation(task, made.profile, 0).probe(at)[0][0, 0] for at in places]
    at = places[int(np.abs(np.array(read) - 140.0).argmin())]
    path, _ = Simulation(task, made.profile, 1).trajectory(still, stream=3, pose=at)
    assert 1.25 < np.std(np.diff(path.proximity[:, 0])) / np.sqrt(2) < 5.0
