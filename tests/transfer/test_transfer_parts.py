"""What a transfer is made of: inputs as in the simulation, paths, scores, the chosen runs."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from realitygap.control.genotype import Genotype
from realitygap.simulation.simulation import Simulation
from realitygap.tasks import load_task
from realitygap.track import Track, read_track
from realitygap.transfer.camera import known_poses
from realitygap.transfer.paths import of_counters, of_track, score
from realitygap.transfer.run import _in_order
from realitygap.values import Pose
from realitygap.world.arena import load_arena
from realitygap.world.robot import load_profile

PAPER = load_profile("paper")


@pytest.mark.parametrize("name", ["obstacle-avoidance", "light-seeking"])
def test_a_simulated_robot_was_fed_the_same(name):
    """Inputs made of a simulated trial's readings are the inputs that its network was fed."""
    task = load_task(name)
    simulation = Simulation(task, PAPER, 2.0)
    networks = Genotype.braitenberg(task.feeds).networks()
    trajectory, _ = simulation.trajectory(networks, stream=3)
    readings = trajectory.proximity if task.feeds == "proximity" else trajectory.ambient
    made = [PAPER.inputs(row, task.feeds, task.of(PAPER).sensors) for row in readings]
    assert made == trajectory.inputs.tolist()


@pytest.mark.parametrize("name", ["obstacle-avoidance", "light-seeking"])
def test_a_path_scores_as_the_trial_did(name):
    """The score taken from a simulated trial's path is the trial's own."""
    task = load_task(name)
    networks = Genotype.braitenberg(task.feeds).networks()
    trajectory, own = Simulation(task, PAPER, 1.0).trajectory(networks, stream=4)
    assert score(trajectory.track, task, PAPER) == pytest.approx(own, rel=1e-6)


def test_counters_tell_straight_ways_and_circles():
    """Equal counts go straight ahead; unequal ones go round a circle and come back."""
    pulses = np.linspace(0, 1200, 11)
    table = of_counters(np.stack([pulses, pulses], 1), Pose(x=5, y=5, heading=math.pi / 2),
                        cm_per_pulse=(1 / 120, 1 / 120), axle_cm=5.3)  # fmt: skip
    assert (table.x[-1], table.y[-1]) == pytest.approx((5, 15))
    round_it = 2 * math.pi * 10 * np.linspace(0, 1, 41)
    wheels = np.stack([round_it * (1 - 0.265), round_it * (1 + 0.265)], 1) * 120
    wheels[7] = np.nan  # nothing was read in that step
    table = of_counters(wheels, Pose(x=0, y=0, heading=0), cm_per_pulse=(1 / 120, 1 / 120), axle_cm=5.3)
    assert (table.x[20], table.y[20]) == pytest.approx((0, 20), abs=0.1)
    assert (table.x[-1], table.y[-1]) == pytest.approx((0, 0), abs=0.1)


def track_of(t, quality, heading=0.0) -> Track:
    """Straight ahead at 10 cm/s, lost where `quality` is 0."""
    lost = np.where(quality > 0, 1.0, np.nan)
    return Track.from_degrees(t, 10 * t * lost, 5 + 0 * t, heading + 0 * t, quality=quality)


def test_a_track_is_brought_to_the_steps():
    """25 frames/s become 10 rows/s, headings across ±180°; beside a lost frame is a gap."""
    t = np.arange(26) / 25
    heading = (170 + 20 * t + 180) % 360 - 180
    table = of_track(track_of(t, np.where((t > 0.3) & (t < 0.5), 0.0, 1.0), heading), 10)
    lost = [4]  # 0.40 s: that frame is lost; 0.3 s lies between 0.28 and 0.32, and 0.32 is lost too
    lost += [3, 5]
    known = np.setdiff1d(np.arange(11), lost)
    assert np.isnan(table.x[lost]).all() and table.lost == 3
    assert table.x[known] == pytest.approx(known.astype(float))
    assert table.heading_deg[-1] == pytest.approx(-170)
    late = of_track(track_of(t, np.ones(26)), 5, 0.52)
    assert late.x[:5] == pytest.approx(5.2 + np.arange(5)) and np.isnan(late.x[5])
    assert late.t[0] == 0.0
    assert of_track(track_of(t, np.zeros(26)), 10).lost == 11
    sparse = of_track(track_of(np.array([0.0, 0.1, 0.9, 1.0]), np.ones(4)), 10)
    assert np.isfinite(sparse.x).nonzero()[0].tolist() == [0, 1, 9, 10]


def test_gaps_are_written_as_gaps_and_scored_if_short(tmp_path):
    """Empty fields in the file; a score goes straight across half a second, else there is none."""
    task, t = load_task("obstacle-avoidance"), np.arange(41) / 10
    whole = of_track(track_of(t, np.ones(41)), 40)
    for gap, scored in ((5, True), (6, False)):
        quality = np.ones(41)
        quality[10 : 10 + gap] = 0
        path = of_track(track_of(t, quality), 40)
        value = score(path, task, PAPER)
        assert math.isfinite(value) is scored
        assert not scored or value == pytest.approx(score(whole, task, PAPER))
        path.write_csv(tmp_path / "path.csv")
        assert (tmp_path / "path.csv").read_text().splitlines()[11] == "1.0,,,"
        assert read_track(tmp_path / "path.csv").lost == gap
    for end in (0, 40):
        quality = np.ones(41)
        quality[end] = 0
        assert math.isnan(score(of_track(track_of(t, quality), 40), task, PAPER))


@pytest.mark.parametrize("name", ["obstacle-avoidance", "light-seeking"])
def test_a_camera_is_calibrated_all_over_the_floor(name):
    """Sixteen known poses or more, free of everything, to the corners, no two headings alike."""
    arena = load_arena(name)
    poses = known_poses(arena, 2.9)
    assert len(poses) >= 16
    assert all(arena.obstacle_at(pose.x, pose.y, 2.9) is None for pose in poses)
    assert max(pose.x for pose in poses) > arena.size_cm[0] - 4 and min(pose.y for pose in poses) < 4
    assert len({round(pose.heading_deg, 3) for pose in poses}) == len(poses)


def test_films_stand_among_the_other_trials() -> None:
    """All trials are in order once, no film among the last half, no two films side by side."""
    kinds = ["film"] * 6 + ["camera"] * 42
    todo = [
        SimpleNamespace(film=kind == "film", source=kind, seconds=20 + k % 3) for k, kind in enumerate(kinds)
    ]
    order = _in_order(todo)
    assert sorted(map(id, order)) == sorted(map(id, todo))
    films = [k for k, one in enumerate(order) if one.film]
    assert films[0] == 0 and films[-1] < len(order) / 2 and min(np.diff(films)) > 1
    assert [one.film for one in _in_order(todo[:3])] == [True] * 3
