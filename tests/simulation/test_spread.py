"""Constants drawn anew for each trial: by its stream, within the spread, however it is carried out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from realitygap import Genotype, SimulatedBody, Simulation, drive_simulated, load_task
from realitygap.errors import ConfigError
from realitygap.simulation.simulation import drawn
from realitygap.study.config import Condition, StudyConfig
from realitygap.study.load import load_study
from realitygap.study.runner import run_study
from realitygap.world.robot import load_profile

PAPER = load_profile("paper")
TASK = replace(load_task("avoidance"), seconds=5.0)
GENOTYPE = Genotype.braitenberg("proximity")


def test_factors_fill_the_spread_and_nothing_else():
    """Over many trials each factor is uniform in 1 ± 0.2 and no two are alike; other constants stay."""
    robot = PAPER.to_kernel()
    made = [drawn(robot, stream, 0.2) for stream in range(400)]

    def constants(one):
        return np.hstack([one.proximity.a, one.ambient.gain, one.wheels.speed_per_unit, one.wheels.track])

    factors = np.array([constants(one) / constants(robot) for one in made])
    assert ((factors > 0.8) & (factors < 1.2)).all() and factors.shape == (400, 19)
    assert (abs(factors.mean(0) - 1) < 0.03).all() and (abs(factors.std(0) - 0.4 / 12**0.5) < 0.01).all()
    assert abs(np.corrcoef(factors.T) - np.eye(19)).max() < 0.25
    far = np.sqrt(made[0].proximity.a / -robot.proximity.b) - robot.proximity.offset
    np.testing.assert_allclose(made[0].proximity.reach, far)
    assert made[0].radius == robot.radius and (made[0].proximity.b == robot.proximity.b).all()


def test_a_trial_is_its_streams_however_it_is_carried_out():
    """In a batch, alone, in full and step by step: one score; without a spread another one."""
    spread = Simulation(replace(TASK, spread=0.2), PAPER)
    networks, streams = GENOTYPE.networks(), np.arange(70, dtype=np.uint64)[np.newaxis]
    scores = spread.scores(networks, streams)[0]
    assert (spread.scores(networks, streams[:, ::-1])[0][::-1] == scores).all()
    for stream in (3, 69):
        trajectory, score = spread.trajectory(networks, stream=stream)
        assert score == scores[stream]
        network = GENOTYPE.controller()
        network_like = type("Passing", (), {"reset": network.reset, "decide": network.decide})()
        steps, again = drive_simulated(spread, network_like, stream=stream)
        assert again == score and (steps.wheels == trajectory.wheels).all()
    plain = Simulation(TASK, PAPER).scores(networks, streams)[0]
    assert (plain != scores).all() and scores.std() > plain.std()


def test_a_body_draws_its_constants_with_each_reset():
    """Another stream is another robot; the same one the same."""
    body, tracks = SimulatedBody(Simulation(replace(TASK, spread=0.3), PAPER), stream=1), []
    for stream in (1, 2, 1):
        body.stream = stream
        body.reset()
        tracks.append(body._world.robot.wheels.track)
    assert tracks[0] == tracks[2] != tracks[1]


def test_the_wheels_may_have_a_share_of_their_own():
    """Sensors are drawn as without it, wheels and track within theirs; names and files tell it."""
    robot = load_profile("paper").to_kernel()
    both, apart = drawn(robot, 5, 0.4), drawn(robot, 5, 0.4, 0.02)
    assert np.array_equal(both.proximity.a, apart.proximity.a)
    factor = both.wheels.speed_per_unit / robot.wheels.speed_per_unit - 1
    assert np.allclose(apart.wheels.speed_per_unit / robot.wheels.speed_per_unit - 1, factor / 20)
    task = load_task("avoidance").under(0.4, 0.02)
    assert task.name == "obstacle-avoidance-spread-40-wheels-2" and task.plain_name == "obstacle-avoidance"
    again = task.under(0.1)
    assert (again.name, again.title) == (
        "obstacle-avoidance-spread-10-wheels-2",
        "Obstacle avoidance, constants drawn within ±10 %, the wheels' ±2 %",
    )
    assert task.under(None) is task and task.under(0.0) == load_task("avoidance")
    condition = Condition(task="avoidance", spread=0.4, spread_wheels=0.02)
    assert Condition(**condition.to_dict()) == condition
    with pytest.raises(ConfigError, match="spread_wheels"):
        Condition(task="avoidance", spread_wheels=0.02)


def test_conditions_of_a_study(tmp_path):
    """A spread makes a condition of its own, recorded in the store, with streams of its own."""
    conditions = tuple(Condition(task="avoidance", noise=0.0, spread=share) for share in (0.0, 0.125))
    config = StudyConfig(conditions=conditions, runs=1, evaluations=3, fresh_trials=2, retest_trials=2)
    config = config.with_settings(["task.seconds=1", "evolution.algorithm=random", "evolution.size=2"])
    study = run_study(tmp_path / "study", config, workers=1)
    named = "obstacle-avoidance-spread-12-5"
    assert [run.name for run in study.runs] == ["obstacle-avoidance/zero/1", f"{named}/zero/1"]
    again = load_study(tmp_path / "study")
    assert again.facts(named)["spread"] == again.task(named).spread == 0.125
    assert "spread" not in again.facts("obstacle-avoidance")
    assert again.task(named).title == "Obstacle avoidance, constants drawn within ±12.5 %"
    assert (study.genotypes(1) != study.genotypes(2)).any()
    best = again.runs[1]
    streams = np.array([[7]], np.uint64)
    networks = again.networks(named, best.champion)
    scores = [Simulation(again.task(one.task), "paper", 0).scores(networks, streams) for one in again.runs]
    assert scores[0] != scores[1]
