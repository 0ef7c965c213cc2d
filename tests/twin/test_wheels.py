"""The robot's own control of its wheels."""

from __future__ import annotations

import numpy as np
import pytest

from realitygap.twin.body import TwinBody
from tests.twin.rooms import OPEN


def test_speed_has_no_overshoot() -> None:
    """A step of the wanted speed is met within 0.3 s and never exceeded by more than a tenth."""
    body = TwinBody(OPEN, unit=0, noise=0.0)
    body.place(20, 100, 0.0)
    body.set_speed(10, 10)
    ways = []
    for _ in range(60):
        body.advance(10)
        ways.append(sum(body.pulses()) / 2)
    speeds = np.diff(ways)
    assert speeds.max() <= 11.0
    assert speeds[27:].mean() == pytest.approx(10.0, abs=0.3)


def test_reaches_a_position() -> None:
    """The position controller brings both counters to their targets and says so."""
    body = TwinBody(OPEN, unit=1)
    body.set_pulses(100, -50)
    assert body.pulses() == (100, -50)
    body.set_position(700, 550)
    body.advance(200)
    assert body.on_target() == (False, False)
    body.advance(4000)
    assert body.on_target() == (True, True)
    assert body.pulses() == pytest.approx((700, 550), abs=3)


def test_profile_limits_speed() -> None:
    """The profile's speed is not exceeded on the way to a position."""
    body = TwinBody(OPEN, unit=1)
    body.set_profile(8, 64, 8, 64)
    body.set_position(400, 400)
    fastest = 0
    for _ in range(100):
        body.advance(10)
        fastest = max(fastest, *body.speeds())
    assert 6 <= fastest <= 11


def test_pwm_pushes_uncontrolled() -> None:
    """A share of the voltage drives the wheels, the more the faster; none lets them come to rest."""
    body = TwinBody(OPEN, unit=1)
    body.place(20, 100, 0.0)
    speeds = []
    for share in (20, 40, 0):
        body.set_pwm(share, share)
        body.advance(1200)
        speeds.append(body.speeds()[0])
    assert 2 < speeds[0] < speeds[1]
    assert speeds[2] == 0
