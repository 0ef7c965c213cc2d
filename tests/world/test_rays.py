"""Directions of sensors and of their rays."""

from __future__ import annotations

import numpy as np
import pytest

from realitygap.kernels.params import LANES, RAYS
from realitygap.world.sensors import FAN, ray_angles, rays, unit


@pytest.mark.parametrize(("number", "aperture_deg"), [(RAYS, 0.0), (9, 0.0), (8, 0.0), (RAYS, 15.0)])
def test_rays_are_units(number: int, aperture_deg: float) -> None:
    """Each ray is the unit vector of its own direction, to the last bit; the lanes beyond repeat the
    sensor's."""
    directions = [*np.random.default_rng(0).uniform(-360, 360, 300).tolist(), -90.0, 0.0, 45.0, 90.0, 180.0]
    turned = [share * aperture_deg for share in FAN] if aperture_deg else ray_angles(number)
    pads = [0.0] * (LANES - len(turned))
    expected = np.array([[unit(one + beta) for beta in (*turned, *pads)] for one in directions])
    made = rays(directions, number, aperture_deg=aperture_deg)
    assert made.tobytes() == np.moveaxis(expected, 2, 1).tobytes()


def test_what_is_kept_is_not_lent() -> None:
    """Writing into rays changes nobody else's."""
    rays([10.0])[:] = 0.0
    assert rays([10.0]).any()
