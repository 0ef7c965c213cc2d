"""Directions: unit vectors of sensors and of the rays that leave them (§3.2.3, §3.3).

Cosines are rounded to 15 decimals: mirror-image sensors get mirror-image rays to the last bit,
and C libraries that differ in a cosine's last bit give the same robot.
"""

import math
from collections.abc import Sequence
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from realitygap.kernels.params import LANES, RAYS

__all__ = ["FAN", "RAY_ANGLES_DEG", "fan_weights", "ray_weights", "rays", "unit"]

FAN = (-1.0, -0.75, -0.5, -0.25, 0.0, 0.0, 0.25, 0.5, 0.75, 1.0)
"""Where the rays of a measured sensor lie, in shares of its aperture: the middle is there twice."""

DECIMALS, SPLIT = 1e15, 2.0**27 + 1.0
HIGH = SPLIT * DECIMALS - (SPLIT * DECIMALS - DECIMALS)
LOW = DECIMALS - HIGH
"""`DECIMALS` as a sum of two numbers of 26 bits."""


@cache
def ray_angles(number: int) -> tuple[float, ...]:
    """Middles of this many equal parts of 180°, degrees from the sensor's direction."""
    return tuple(180.0 / number * (i + 0.5) - 90.0 for i in range(number))


RAY_ANGLES_DEG = ray_angles(RAYS)
"""β of each ray, −81 … +81: the middles of ten equal parts of 180° (a reading of §3.2.3)."""


def unit(direction_deg: float) -> tuple[float, float]:
    """Unit vector (x, y) of a direction in degrees."""
    turned = math.radians(180.0 - (180.0 - direction_deg) % 360.0)
    return round(math.cos(turned), 15) + 0.0, round(math.sin(turned), 15) + 0.0


def rays(
    directions_deg: list[float], number: int = RAYS, *, aperture_deg: float = 0.0
) -> NDArray[np.float64]:
    """Unit vectors [n, 2, LANES] of `number` rays for each sensor, or of a FAN of some aperture; pad lanes
    point along the sensor."""
    return _fans(tuple(directions_deg), number, aperture_deg).copy()


@lru_cache(maxsize=256)  # a fit asks for the same directions again and again
def _fans(directions_deg: tuple[float, ...], number: int, aperture_deg: float) -> NDArray[np.float64]:
    """As `rays`: `unit` of each, to the last bit."""
    turned = [share * aperture_deg for share in FAN] if aperture_deg else ray_angles(number)
    angles = np.array([*turned, *[0.0] * (LANES - len(turned))])
    degrees = np.reshape(directions_deg, (-1, 1)) + angles
    at = np.radians(180.0 - (180.0 - degrees) % 360.0).ravel().tolist()
    both = _rounded(np.array([*map(math.cos, at), *map(math.sin, at)])) + 0.0
    return np.moveaxis(both.reshape(2, -1, LANES), 0, 1)


def _rounded(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Numbers from −1 to 1 to 15 decimals, as `round` does: with the product's error (Dekker 1971)."""
    product, shifted = numbers * DECIMALS, numbers * SPLIT
    high = shifted - (shifted - numbers)
    low = numbers - high
    error = ((high * HIGH - product) + high * LOW + low * HIGH) + low * LOW
    whole = np.rint(product)
    off = (product - whole) + error
    return np.asarray((whole + (off > 0.5) - (off < -0.5)) / DECIMALS)


def ray_weights(
    sensors: int, exponent: float, factor: float = 1.0, shift_deg: float = 0.0, number: int = RAYS
) -> NDArray[np.float64]:
    """factor · cos^m β of each ray [sensors, LANES] of a fan turned by a shift; 0 in the pad lanes.

    Args:
        sensors: how many.
        exponent: m.
        factor: of all weights.
        shift_deg: of the fan.
        number: of its rays.
    """
    angles = [beta + shift_deg for beta in ray_angles(number)]
    row = [factor * round(math.cos(math.radians(beta)) ** exponent, 15) for beta in angles]
    return np.tile(np.array(row + [0.0] * (LANES - number)), (sensors, 1))


def fan_weights(sensors: int, lobe: Sequence[float]) -> NDArray[np.float64]:
    """The rays' weights [sensors, LANES] in a FAN: each share of a lobe belongs to two rays."""
    halves = [share / 2 for share in lobe]
    return np.tile(np.array([*halves[::-1], *halves, *(0.0,) * (LANES - RAYS)]), (sensors, 1))
