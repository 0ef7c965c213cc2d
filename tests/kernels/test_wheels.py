"""Wheels under PID control and the arc they drive (§3.2.2)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from realitygap.kernels.motion import drive_arc
from tests.kernels.calls import turn
from tests.kernels.reference.motion import Wheel, arc
from tests.kernels.scenes import PAPER

NO_FRICTION = replace(PAPER, wheels=replace(PAPER.wheels, friction_cm_s2=0.0))


def speeds(profile, targets, drags=None, slips=None) -> np.ndarray:
    """The kernel's speeds of one wheel that starts at rest, cm/s."""
    drags = np.ones(len(targets)) if drags is None else np.array(drags, float)
    slips = np.zeros(len(targets)) if slips is None else np.array(slips, float)
    got = np.zeros(len(targets))
    turn(profile.to_kernel(), np.zeros(9), np.array(targets, float), drags, slips, got)
    return got


def test_unit_step_response():
    """A step of one unit, friction aside, gives 0.92, 1.155, 1.186, 1.163, 1.131, 0.943, 0.893."""
    got = speeds(NO_FRICTION, np.ones(7))
    assert got.round(3).tolist() == [0.92, 1.155, 1.186, 1.163, 1.131, 0.943, 0.893]


def test_one_unit_starts_on_its_second_step():
    """I is 8 on the first step, below 12, and 16 on the second: so a resting wheel starts then."""
    got = speeds(PAPER, np.full(3, 0.8))
    assert got[0] == 0.0
    # It starts with the errors of both steps in I, and no last change.
    assert got[1] == pytest.approx((3800 * 8 + 800 * 16) / 50000, rel=1e-12)


@pytest.mark.parametrize(("command", "moves"), [(1.19, False), (1.21, True), (-1.19, False), (-1.21, True)])
def test_friction_threshold(command, moves):
    """A resting wheel moves at once where |I| = |V|/0.1 is above 12 cm/s²."""
    assert (speeds(PAPER, [command])[0] != 0) == moves


def test_agrees_with_the_reference():
    """Any wheels follow the slow reference through any targets, friction and slip included."""
    random = np.random.default_rng(5)
    rested = 0
    for _ in range(300):
        law = replace(
            PAPER.wheels, kp=random.uniform(2000, 4000), ki=random.uniform(200, 900),
            lag=random.choice([0.0, 0.4]), play_cm=random.choice([0.0, 0.1]),
            kd=random.uniform(0, 900),
            rest_speed_cm_s=random.uniform(0, 0.5), friction_cm_s2=random.uniform(0, 30),
        )  # fmt: skip
        profile = replace(PAPER, wheels=law)
        targets = np.repeat(random.choice([0.0, 0.8, -0.8, 4.0, random.uniform(-8, 8)], 10), 6)
        drags, slips = random.normal(1, 0.5, 60), random.normal(0, 0.1, 60)
        reference = Wheel(profile)
        expected = [reference.turn(*step) for step in zip(targets, drags, slips, strict=True)]
        np.testing.assert_allclose(speeds(profile, targets, drags, slips), expected, rtol=1e-9, atol=1e-10)
        rested += expected.count(0.0)
    assert rested > 100, "friction held no wheel: nothing was judged"


def test_turning_round_loses_the_play_and_nothing_else_does():
    """Half the play at the first start, all of it at each turning round, with or without a rest."""
    law = replace(NO_FRICTION.wheels, kp=5000, ki=0, kd=0, play_cm=0.09)
    made = replace(NO_FRICTION, wheels=law)
    targets = np.repeat([4.0, 2.0, 0.0, 2.0, 0.0, -4.0, 4.0], 40)
    missing = (targets - speeds(made, targets)).reshape(7, 40).sum(axis=1) * 0.1
    np.testing.assert_allclose(missing, [0.045, 0, 0, 0, 0, -0.09, 0.09], atol=2e-3)


def test_arc_is_exact():
    """The body's movement is the arc about the centre of the wheels' circle, however sharp."""
    random = np.random.default_rng(6)
    for _ in range(2000):
        left, right = random.uniform(-12, 12, 2)
        if random.random() < 0.2:
            right = -left
        heading = random.uniform(-10, 10)
        dx, dy, turn, *_ = drive_arc(5.3, left, right, math.cos(heading), math.sin(heading))
        np.testing.assert_allclose((dx, dy, turn), arc(5.3, left, right, heading), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("bend", [0.0, 1e-12, 1e-9, 1e-6, 1e-5, 1e-4])
def test_nearly_straight_arc(bend):
    """A nearly straight arc is as exact: its chord is v·dt·(1 − h²/6), h half the turn."""
    left, right = 8.0 - bend, 8.0 + bend
    dx, dy, turn, *_ = drive_arc(5.3, left, right, 1.0, 0.0)
    half = (right - left) * 0.05 / 5.3
    assert turn == pytest.approx(2 * half, rel=1e-12)
    assert math.hypot(dx, dy) == pytest.approx(0.8 * (1 - half**2 / 6), rel=1e-14)
    assert dy == pytest.approx(0.8 * half, rel=1e-9, abs=1e-18)
