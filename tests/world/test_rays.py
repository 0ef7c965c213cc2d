"""Directions of sensors and of their rays."""

from __future__ import annotations

import numpy as np
import pytest

from realitygap.kernels.types import EYES, RAYS
from realitygap.world.sensors import fan, ray_angles, ray_weights, side_by_side


@pytest.mark.parametrize("number", [RAYS, 27, 50])
def test_a_fan_is_its_pairs(number: int) -> None:
    """Each pair of mirror-image rays is there once, a middle ray with half its weight: nothing is lost."""
    made = fan(ray_angles(number), ray_weights(2.0, number=number))
    angles = np.radians(ray_angles(number))
    np.testing.assert_allclose(2 * made[2].sum(), (np.cos(angles) ** 2).sum(), rtol=1e-6)
    half = angles[: made.shape[1]]
    np.testing.assert_allclose(made[:2], [np.cos(half), np.sin(half)], atol=1e-7)
    assert made.dtype == np.float32


def test_sensors_side_by_side_fill_whole_blocks() -> None:
    """The last sensor is repeated; no sensors are no block."""
    blocks = side_by_side(range(11), range(11, 22))
    assert blocks.shape == (2, 2, EYES) and blocks.flags.c_contiguous
    assert blocks[:, 0].ravel().tolist() == [*range(11), *[10] * 5]
    assert side_by_side([], []).shape == (0, 2, EYES)
