"""A score without a camera: distances of what was read and done, and the orders that measures make."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from realitygap import Simulation, load_profile, load_task
from realitygap.controller.handmade import constant
from realitygap.controller.layout import Layout
from realitygap.controller.network import decode
from realitygap.transfer.apart import _Replayer, apart
from realitygap.transfer.order import order_of

TASK, PROFILE = load_task("obstacle-avoidance"), load_profile("paper")
PARTS = ("readings", "commands", "speeds")


@pytest.fixture(scope="module")
def lived():
    """A simulated trial of a robot that turns."""
    networks = decode(constant(4, 6, Layout())[None], Layout())
    return Simulation(TASK, PROFILE, 1.0).trajectory(networks, stream=3, seconds=5.0)[0]


def recorded(lived, **changes):
    """The same trial as a robot's recording."""
    there = {"proximity": lived.proximity, "ambient": lived.ambient, "commands": lived.commands,
             "speeds": lived.wheels}  # fmt: skip
    return SimpleNamespace(**{**there, **changes})


def test_a_trial_is_not_apart_from_itself_in_any_order(lived):
    """Distances of equal distributions are 0, whatever came when."""
    assert set(apart(lived, recorded(lived), PROFILE, TASK).values()) == {0.0}
    turned = recorded(lived, proximity=lived.proximity[::-1])
    assert apart(lived, turned, PROFILE, TASK)["readings"] == 0.0


def test_distances_are_those_of_sorted_values_in_their_units(lived):
    """Of as many values the distance is the mean of sorted differences, in input ranges and top commands."""
    draw = np.random.default_rng(1)
    other = recorded(
        lived, proximity=draw.uniform(0, 1023, lived.proximity.shape), speeds=lived.wheels + 1.5,
        commands=-lived.commands,
    )  # fmt: skip
    found = apart(lived, other, PROFILE, TASK)
    low, high = PROFILE.infrared.bands
    far = np.abs(np.sort(lived.proximity, axis=0) - np.sort(other.proximity, axis=0)).mean() / (high - low)
    assert found["readings"] == pytest.approx(far)
    assert found["speeds"] == pytest.approx(0.15)
    assert found["commands"] == pytest.approx((0.8 + 1.2) / 2)


def test_what_a_robot_does_not_tell_is_not_compared(lived):
    """Without measured speeds there is no distance of speeds; the others stand."""
    found = apart(lived, recorded(lived, speeds=np.full((len(lived.t), 2), np.nan)), PROFILE, TASK)
    assert np.isnan(found["speeds"]) and found["readings"] == 0.0


def test_replayed_commands_come_back_as_the_outputs_that_they_were():
    """A robot with other units than −10 … 10 is replayed by the outputs that its commands were made of."""
    fast = replace(PROFILE, wheels=replace(PROFILE.wheels, top_command=8.0))
    outputs = np.array([[-10, 10], [0, 5]])
    given = np.array([[fast.wheels.command(int(v)) for v in row] for row in outputs])
    replayer = _Replayer(given, fast)
    assert [replayer.decide(()).left for _ in given] == [-10, 0]


def columns(controllers: int, **given):
    names = ("readings", "commands", "speeds", "correspondence", "replay_cm", "fitness_simulated",
             "fitness_situated", "fitness_pseudo")  # fmt: skip
    return {name: np.full(controllers, np.nan) for name in names} | given


def test_one_order_is_a_substitute_and_chance_is_none():
    """A distance that falls as the score rises may stand for it; one that has nothing to do with it not."""
    draw = np.random.default_rng(0)
    score = draw.uniform(0, 10, (40, 3))
    same = order_of(("t", "champion", "twin"), 1 - score / 10, score, columns(40))
    assert same.rho == pytest.approx(1) and same.verdict == "a substitute" and same.units == 3
    other = order_of(("t", "champion", "twin"), draw.uniform(0, 1, (40, 3)), score, columns(40))
    assert abs(other.rho) < 0.5 and other.low < other.rho < other.high
    assert other.verdict == "no substitute"


def test_units_with_controllers_of_their_own_are_drawn_with_them():
    """The interval lies about rho though each controller drove few units, each of which says little."""
    draw, home = np.random.default_rng(1), np.repeat(np.arange(16), 20)
    true, score = draw.normal(size=320), np.full((320, 16), np.nan)
    drove = (home[:, None] + np.arange(4)) % 16
    np.put_along_axis(score, drove, true[:, None] + draw.normal(size=(320, 4)), axis=1)
    far = np.where(np.isfinite(score), -true[:, None] + draw.normal(size=(320, 16)), np.nan)
    own, crossed = (order_of(("t", "champion", "twin"), far, score, columns(320), h) for h in (home, None))
    assert own.low < own.rho - 0.01 and own.rho + 0.01 < own.high
    assert crossed.low + crossed.high < own.low + own.high  # units drawn among a controller's own few blur it


def test_too_few_controllers_have_no_order():
    """Of two controllers, or without a camera's score, nothing is said."""
    few = order_of(("t", "champion", "twin"), np.ones((2, 1)), np.ones((2, 1)), columns(2))
    assert np.isnan(few.rho) and few.verdict == "open"
    unseen = order_of(("t", "champion", "robot"), np.ones((9, 1)), np.full((9, 1), np.nan), columns(9))
    assert np.isnan(unseen.rho) and np.isnan(unseen.fitness)


def test_pseudo_realities_and_fitness_are_held_against_the_robot():
    """Fitness in simulation and in pseudo-realities are ranked against situated fitness."""
    true = np.arange(8.0)
    made = order_of(
        ("t", "champion", "twin"), np.ones((8, 1)), np.ones((8, 1)),
        columns(8, fitness_situated=true, fitness_simulated=2 * true + 1, fitness_pseudo=-true),
    )  # fmt: skip
    assert made.fitness == pytest.approx(1) and made.simulated == pytest.approx(1)
    assert made.pseudo == pytest.approx(-1)
