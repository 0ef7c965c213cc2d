"""Directions: unit vectors of sensors and of the rays that leave them (§3.2.3, §3.3).

Cosines are rounded to 15 decimals: mirror-image sensors get mirror-image rays to the last bit,
and C libraries that differ in a cosine's last bit give the same robot.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from realitygap.kernels.params import LANES, RAYS

__all__ = ["RAY_ANGLES_DEG", "ray_weights", "rays", "unit"]


def ray_angles(number: int) -> tuple[float, ...]:
    """Middles of so many equal parts of 180°, degrees from the sensor's direction."""
    return tuple(180.0 / number * (i + 0.5) - 90.0 for i in range(number))


RAY_ANGLES_DEG = ray_angles(RAYS)
"""β of each ray, −81 … +81: the middles of ten equal parts of 180° (a reading of §3.2.3)."""


def unit(direction_deg: float) -> tuple[float, float]:
    """Unit vector (x, y) of a direction in degrees."""
    turned = math.radians(180.0 - (180.0 - direction_deg) % 360.0)
    return round(math.cos(turned), 15) + 0.0, round(math.sin(turned), 15) + 0.0


def rays(directions_deg: list[float], number: int = RAYS) -> NDArray[np.float64]:
    """Unit vectors [n, 2, LANES] of `number` rays for each sensor; pad lanes point along the sensor."""
    angles = (*ray_angles(number), *(0.0,) * (LANES - number))
    out = np.empty((len(directions_deg), 2, LANES))
    for i, direction in enumerate(directions_deg):
        out[i] = np.array([unit(direction + beta) for beta in angles]).T
    return out


def ray_weights(
    sensors: int, exponent: float, factor: float = 1.0, shift_deg: float = 0.0, number: int = RAYS
) -> NDArray[np.float64]:
    """factor · cos^m β of each ray [sensors, LANES] of a fan turned by a shift; 0 in the pad lanes."""
    angles = [beta + shift_deg for beta in ray_angles(number)]
    row = [factor * round(math.cos(math.radians(beta)) ** exponent, 15) for beta in angles]
    return np.tile(np.array(row + [0.0] * (LANES - number)), (sensors, 1))
