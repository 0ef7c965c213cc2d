"""The form "lookup": what was recorded is replayed, judged on places held out, and never taken for a law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from realitygap.calibration.calibrate import calibrate
from realitygap.calibration.load import load_recording
from realitygap.calibration.lookup import replayed
from realitygap.calibration.model import scene_of
from realitygap.calibration.readings import Readings
from realitygap.calibration.recordings import SensorRecording
from realitygap.kernels.infrared import infrared
from realitygap.world.robot import load_profile
from tests.kernels.scenes import work_for

PAPER = load_profile("paper")


@pytest.fixture(scope="module")
def wall(recorded) -> SensorRecording:
    """Before a wall, four readings a place."""
    return recorded("wall")


@pytest.fixture(scope="module")
def made(wall, recorded):
    """The table of a wall and a cylinder."""
    return calibrate([wall, recorded("cylinder:4", seed=5)], PAPER, form="lookup")


def test_a_table_replays_what_it_was_made_of(made, wall):
    """At each recorded place the simulated robot reads the mean of what was read there."""
    place, scene = wall.place(), scene_of(wall)
    mean = np.stack([np.bincount(place, column) for column in wall.counts.T], 1) / 4
    np.testing.assert_allclose(made.infrared.model[: len(place)], mean[place], atol=1e-9)
    robot, work, out = made.profile.to_kernel(), work_for(made.profile), np.zeros(8)
    for (x, y, heading), expected in zip(scene.poses, mean, strict=True):
        work.state.pose[:] = x, y, heading, np.cos(heading), np.sin(heading)
        infrared(robot, scene.arena, work.state.pose, work.eyes, out)
        np.testing.assert_allclose(out, expected, atol=0.01)


def test_its_noise_is_the_scatter_that_was_recorded(made):
    """Readings in light scatter by their 21 counts; in the dark and at the top hardly."""
    for sensor in made.profile.infrared.sensors:
        assert max(sensor.noise[0], sensor.noise[-1]) < 15
        assert np.mean(sensor.noise[2:6]) == pytest.approx(21, rel=0.2)
    assert made.profile.noise.proximity == pytest.approx(21, rel=0.1)


def test_a_profile_with_a_table_reads_back(made, tmp_path):
    """What is written is read to an equal value; a profile without a table says nothing of one."""
    (tmp_path / "robot.toml").write_text(made.profile.to_toml(), encoding="utf-8")
    assert load_profile(tmp_path / "robot.toml") == made.profile
    assert "table" not in PAPER.to_toml()


def test_a_place_held_out_lies_on_the_line_between_its_neighbours(wall):
    """Readings that rise evenly with the distance and the bearing's place are foretold exactly."""
    rank = np.unique(wall.distance_cm, return_inverse=True)[1]
    even = replace(wall, counts=np.repeat(100.0 * (1 + rank)[:, None], 8, axis=1))
    rows = object.__new__(Readings)
    rows.recordings, rows.counts = [even], even.counts
    rows.distance, rows.bearing = even.distance_cm, even.bearing_deg
    out = (rank == 2) & (np.abs(even.bearing_deg) < 25)
    np.testing.assert_allclose(replayed(rows, ~out), even.counts, atol=1e-9)
    last = rank == rank.max()
    read = replayed(rows, ~last)
    np.testing.assert_allclose(read[last], even.counts[last] - 100.0)


def test_a_real_wall_as_a_table(tables):
    """Of a real Khepera the table finds the noise that laws find, and errs more where a patch is held out."""
    made = calibrate([load_recording(tables / "wall.sam", object="wall")], PAPER, form="lookup")
    assert made.infrared.deviation == pytest.approx(23.8, abs=0.5)
    assert 3.5 < made.infrared.ratio < 7.0
