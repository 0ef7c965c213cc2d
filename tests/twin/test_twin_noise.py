"""The twin's noise has the size it says, and the noise scale multiplies all of it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from realitygap.twin.body import TwinBody
from realitygap.twin.noise import AMBIENT_COUNTS, PROXIMITY_COUNTS, Slip
from tests.twin.slow_sensors import SlowNoise

LIT = {"size_cm": [100, 100], "lamps": [[100, 50]]}


def slip_over_100_ms(scale: float, speed_cm_s: float, steps: int = 2000) -> NDArray[np.float64]:
    """Mean slip of each 100 ms of wheels that roll over the floor at a speed."""
    slip, qpos, now = Slip(3, scale, (0.3, 2.0), 0.0265), np.zeros(9), np.zeros(2)
    qpos[3], rows = 1.0, []
    for k in range(steps * 20):
        way = speed_cm_s / 100 * k * 0.005
        qpos[:2] = way % 0.31 + 0.05, (way * 0.37) % 0.27 + 0.05
        slip.update(qpos, np.full(2, way / 0.008), now)
        rows.append(now.copy())
    return np.array(rows).reshape(steps, 20, 2).mean(axis=1)


def test_wheels_err_by_six_percent() -> None:
    """Over 100 ms a wheel carries the robot about 6 % more or less than it turns, times the noise scale."""
    for speed in (2.0, 6.0):
        assert 0.052 < slip_over_100_ms(1.0, speed).std() < 0.072
    once = slip_over_100_ms(1.0, 4.0, steps=100)
    for scale in (0.0, 0.5, 2.0):
        assert slip_over_100_ms(scale, 4.0, steps=100) == pytest.approx(scale * once, rel=1e-12)


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_wheels_of_the_driving_robot(scale: float) -> None:
    """The same measured on the ground, as a camera would: from true poses against pulses."""
    errors = []
    for unit in range(3):
        body = TwinBody({"size_cm": [300, 300]}, unit=unit, noise=scale, seed=8)
        body.place(20, 150, 0.0)
        body.set_speed(10, 10)
        body.advance(500)
        rows = []
        for _ in range(100):
            body.advance(100)
            rows.append([*body.truth(), *body.pulses()])
        x, y, heading, left, right = np.diff(np.array(rows), axis=0).T
        way, turn = np.hypot(x, y), heading * body.unit.track * 50
        for rolled, pulses in ((way - turn, left), (way + turn, right)):
            share = rolled / (pulses / 120)
            errors.append(share - share.mean())
    assert np.std(errors) == pytest.approx(0.06 * scale, rel=0.2)


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_sensors_err_as_the_real_ones(scale: float) -> None:
    """A lit proximity sensor varies by 21 counts, an ambient one by 4.5, times the noise scale."""
    body = TwinBody(LIT, unit=3, noise=scale)
    body.place(100 - 2.75 - 2.7, 50, 0.0)
    quiet = TwinBody(LIT, unit=3, noise=0.0)
    quiet.place(100 - 2.75 - 2.7, 50, 0.0)
    quiet.advance(30)
    middle = [k for k, v in enumerate(quiet.proximity()) if 100 * scale < v < 1023 - 100 * scale]
    assert middle, "some sensor is neither dark nor saturated"
    near, light = [], []
    for _ in range(500):
        body.advance(20)
        near.append(body.proximity())
        light.append(body.ambient())
    assert np.std(near, axis=0)[middle].mean() == pytest.approx(PROXIMITY_COUNTS * scale, rel=0.15)
    assert np.std(light, axis=0).mean() == pytest.approx(AMBIENT_COUNTS * scale, rel=0.15)


def test_tails_are_heavier_than_normal_and_part_is_slow() -> None:
    """Kurtosis lies well above the normal's 3; neighbouring readings keep about a tenth in common."""
    noise = SlowNoise(seed=11, purpose=1)
    rows = np.array([noise.at(t, np.full(8, t)) for t in range(0, 400_000, 100)])
    assert rows.std() == pytest.approx(1.0, abs=0.04)
    white = np.array([noise.white(np.full(8, t)) for t in range(4000)]).ravel()
    normal = np.random.default_rng(0).standard_normal(white.size)
    kurtosis = [float((v**4).mean() / (v**2).mean() ** 2) for v in (white, normal)]
    assert kurtosis[0] > 4.0 > 3.3 > kurtosis[1]
    near = float((rows[1:] * rows[:-1]).mean())
    far = float((rows[300:] * rows[:-300]).mean())
    assert 0.06 < near < 0.14
    assert abs(far) < 0.04
