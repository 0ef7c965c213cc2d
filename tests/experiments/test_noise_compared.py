"""What a controller is held against: each unit's own simulation, with the same draws at every level."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from realitygap.experiments.noise.plan import Pair, controllers, simulated_file, situated_file
from realitygap.experiments.noise.run import noise_study
from realitygap.experiments.noise.simulated import (
    LIVED,
    _simulated,
    compare_all,
    lived_apart,
    read_compared,
    to_json,
)
from realitygap.experiments.noise.situated import Lived, Situated, read_situated
from realitygap.experiments.noise.stage import Stage
from realitygap.simulation.simulation import Simulation
from tests.experiments.noise_parts import quick_units, tiny, unit_profile, wearing

HOMES = 2


@pytest.fixture(scope="module")
def stage(tmp_path_factory) -> Stage:
    """A finished tiny study of obstacle avoidance, whose files the tests make anew."""
    config = tiny(tasks=("obstacle-avoidance",), levels=(0.0, 1.0))
    folder = tmp_path_factory.mktemp("compared") / "study"
    with quick_units():
        noise_study(folder, config, workers=1)
    return Stage(folder, config)


def drive_as_simulated(stage: Stage, one, drawn_as: int | None = None) -> None:
    """Put paths of a twin on file that is each unit's simulation without noise, or one unit's throughout."""
    kept = read_situated(stage, one)
    networks = stage.networks(one)
    poses = np.empty_like(kept.poses)
    for u in range(1, HOMES + 1):
        robot = wearing(unit_profile(drawn_as or u), unit_profile(one.home))
        for k, start in enumerate(stage.starts(one.task, one.seed_set, 1)):
            path, _ = Simulation(stage.task(one.task), robot, 0.0).trajectory(networks, stream=0, pose=start)
            ends = [(path.x, path.end.x), (path.y, path.end.y), (path.heading, path.end.heading)]
            poses[u - 1, k] = np.column_stack([np.append(*both) for both in ends])
    np.savez(situated_file(stage.folder, one), poses=poses, streams=kept.streams)


@pytest.mark.parametrize("home", [1, 2])
def test_every_unit_is_compared_with_its_own_simulation(stage, home):
    """Paths of units that are their simulations score 10 without noise; those of one unit alone do not."""
    one = next(one for one in controllers(stage.config) if one.home == home)
    scores = []
    for drawn_as in (None, home):
        drive_as_simulated(stage, one, drawn_as)
        simulated_file(stage.folder, one).write_text(to_json(compare_all(stage, one)))
        scores.append(read_compared(stage, one)["cells"][0]["score"])
    assert scores[0] == 10.0 > scores[1]


def test_levels_of_comparison_differ_in_loudness_alone(stage, tmp_path):
    """At two levels that are as good as equal, a controller's simulated trials are the same to the bit."""
    folder = Path(shutil.copytree(stage.folder, tmp_path / "study"))
    alike = Stage(folder, replace(stage.config, levels=(1.0, 1.0 + 1e-12, 2.0)))
    for one in (one for one in controllers(stage.config) if one.level == 1.0):
        simulated_file(folder, one).write_text(to_json(compare_all(alike, one)))
        same, next_to, loud = (cell["fitness_simulated"] for cell in read_compared(alike, one)["cells"])
        assert same == pytest.approx(next_to, rel=1e-9)
        assert loud != pytest.approx(same, rel=1e-9)


def test_what_was_read_and_done_is_held_against_each_units_simulation(stage):
    """Robots that read and did what the simulation did are at no distance; a command more counts as one."""
    one = next(one for one in controllers(stage.config) if one.home == 1)
    pairs = [Pair(u, k) for u in (1, 2) for k in (1, 2, 3)]
    trajectories, _ = _simulated(stage, one, 1.0, pairs)
    top = stage.profile(1).wheels.top_command
    lived = [(t.proximity, np.rint(t.commands * top / 10), t.wheels) for t in trajectories.values()]
    poses = np.zeros((2, 3, len(lived[0][0]) + 1, 3))
    for (u, k), path in trajectories.items():
        ends = [(path.x, path.end.x), (path.y, path.end.y), (path.heading, path.end.heading)]
        poses[u - 1, k - 1] = np.column_stack([np.append(*both) for both in ends])
    readings, commands, speeds = (
        np.array(each).reshape(2, 3, -1, each[0].shape[-1]) for each in zip(*lived, strict=True)
    )
    commands[1, 0] += 1
    kept = Situated((1, 2), poses, np.zeros((2, 3), np.uint64), 0.1, Lived(readings, commands, speeds))
    found, pseudo = lived_apart(stage, one, kept, trajectories)
    assert all(found["1"][key] == 0.0 for key in LIVED[:4]) and 0.0 < found["1"]["replay_cm"] < 2.0
    assert found["2"]["commands"] == pytest.approx(1 / top / 3)
    assert found["2"]["distance"] == pytest.approx(found["2"]["commands"] / 3)
    assert found["2"]["readings"] == found["2"]["speeds"] == 0.0 and pseudo >= 0.0


def test_trials_of_an_earlier_version_have_no_readings(stage):
    """A file of paths alone is still read and compared; what robots read is not known then."""
    one = controllers(stage.config)[0]
    kept = read_situated(stage, one)
    np.savez(situated_file(stage.folder, one), poses=kept.poses, streams=kept.streams)
    assert read_situated(stage, one).lived is None
    assert "without_camera" not in compare_all(stage, one)
