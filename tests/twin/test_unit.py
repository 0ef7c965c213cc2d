"""Units: a population of robots, each always the same."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest

from realitygap.twin.unit import TRACK, WHEEL_RADIUS, draw_unit

POPULATION = [draw_unit(k) for k in range(300)]


def test_a_number_is_a_robot() -> None:
    """The same number is the same robot; another number another, in every constant."""
    assert draw_unit(7) == draw_unit(7)
    first, second = asdict(draw_unit(7)), asdict(draw_unit(8))
    assert all(first[key] != second[key] for key in first)
    json.dumps(first)


def test_the_population_spreads_as_real_robots_do() -> None:
    """Gains vary by 20 %, wheels by 0.4 %, about the values their sources give."""
    gains = np.array([u.proximity_gain for u in POPULATION])
    wheels = np.array([u.wheel_radius for u in POPULATION])
    assert gains.mean() == pytest.approx(1.0, abs=0.02)
    assert gains.std() == pytest.approx(0.2, abs=0.01)
    assert wheels.mean() == pytest.approx(WHEEL_RADIUS, rel=0.001)
    assert wheels.std() / WHEEL_RADIUS == pytest.approx(0.004, abs=0.0004)
    assert np.mean([u.track for u in POPULATION]) == pytest.approx(TRACK, rel=0.002)
    assert np.array([u.ambient_gain for u in POPULATION]).std() == pytest.approx(0.2, abs=0.01)
    assert gains.min() > 0.35
