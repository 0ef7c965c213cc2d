"""How far a model is from readings: its sign, and the noise that is not the model's."""

from dataclasses import replace

import numpy as np
import pytest

from realitygap.calibration.judge import judge
from realitygap.calibration.noise import Yardstick, misfits


@pytest.mark.parametrize("off", [0.0, 10.0])
def test_noise_is_no_error_of_the_model(off):
    """Of 4 readings a place with noise of 21 counts, a model that is off by 10 has an error of 10, not of
    14.5 as the places' means have; a right one none that would show beside the noise."""
    random, place = np.random.default_rng(1), np.repeat(np.arange(3000), 4)
    true = np.repeat(random.uniform(200, 800, 3000), 4)[:, None]
    counts = true + 21 * random.normal(size=true.shape)
    (made,) = misfits(counts, true + off, place, Yardstick(kind="infrared", top=1023.0, deviation=21.0))
    assert made.error == pytest.approx(off, abs=0.5 if off else 2.1)
    assert made.ratio == pytest.approx(made.error / 21) and made.lit_ratio == pytest.approx(made.ratio)
    assert made.bias == pytest.approx(off, abs=0.8)


def test_bias_is_model_minus_measured(recorded, robot):
    """A model that reads more than was measured has a positive bias, in all as for each sensor."""
    table = recorded("wall")
    told = judge(replace(table, counts=np.rint(0.8 * table.counts)), robot)
    assert told.bias > 10
    assert told.bias == pytest.approx(np.mean([one.bias for one in told.per_sensor]))


@pytest.mark.parametrize("seen", ["near", "far", "driving"])
def test_noise_by_the_reading_is_judged_at_the_readings(recorded, robot, seen):
    """A profile whose noise rises with the reading, and with the wheels' speed, fits readings with that very
    noise, bright ones or faint ones; `[noise]`, which such a profile does not use, says nothing."""
    sensors = tuple(replace(s, noise=(5.0, 85.0), noise_rise=0.25) for s in robot.infrared.sensors)
    robot = replace(robot, infrared=replace(robot.infrared, sensors=sensors))
    table, speed = recorded("wall", noise=0.0), 4.0 if seen == "driving" else 0.0
    size = (5.0 + 80.0 * table.counts / 1023.0) * (1.0 + 0.25 * speed)
    counts = table.counts + size * np.random.default_rng(6).normal(size=size.shape)
    rows = table.distance_cm > 1.8 if seen == "far" else table.distance_cm < 1.2
    there = replace(
        table, distance_cm=table.distance_cm[rows], bearing_deg=table.bearing_deg[rows],
        repeat=table.repeat[rows], counts=np.clip(np.rint(counts), 0, 1023)[rows],
        speed_cm_s=np.full(rows.sum(), speed) if speed else None,
    )  # fmt: skip
    told = [judge(there, replace(robot, noise=replace(robot.noise, proximity=p))) for p in (1.0, 200.0)]
    for measured, stated in (one.noise["proximity"] for one in told):
        assert stated == pytest.approx(measured, rel=0.1)
