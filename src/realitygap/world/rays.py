"""Directions: unit vectors of sensors, and the rays that leave them (§3.2.3, §3.3).

Cosines are rounded to 15 decimals: mirror-image sensors get mirror-image rays to the last bit,
and C libraries that differ in a cosine's last bit give the same robot.
"""

import math
from collections.abc import Iterable, Sequence
from functools import cache

import numpy as np

from realitygap.kernels.params import EYES, F32, RAYS

__all__ = ["FAN", "RAY_ANGLES_DEG", "fan", "fan_weights", "ray_angles", "ray_weights", "side_by_side", "unit"]

FAN = (-1.0, -0.75, -0.5, -0.25, 0.0, 0.0, 0.25, 0.5, 0.75, 1.0)
"""Where the rays of a measured sensor lie, in shares of its aperture: the middle is there twice."""


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


def fan(angles_deg: Sequence[float], weights: Sequence[float]) -> F32:
    """Rays [3, n] at angles off a sensor's direction, that one of each mirror-image pair which comes first:
    cosines, sines, weights; one that is its own image has half its weight."""
    pairs, odd = (len(angles_deg) + 1) // 2, len(angles_deg) % 2
    rows = np.array([*zip(*map(unit, angles_deg[:pairs]), strict=True), weights[:pairs]], np.float32)
    rows[2, -1] *= 0.5 if odd else 1.0
    return rows


def ray_weights(exponent: float, factor: float = 1.0, number: int = RAYS) -> list[float]:
    """factor · cos^m β of each of `number` rays, m being the exponent."""
    return [factor * round(math.cos(math.radians(beta)) ** exponent, 15) for beta in ray_angles(number)]


def fan_weights(lobe: Sequence[float]) -> list[float]:
    """The rays' weights in a FAN: each share of a lobe belongs to two rays."""
    halves = [share / 2 for share in lobe]
    return [*halves[::-1], *halves]


def side_by_side(*columns: Iterable[float]) -> F32:
    """Blocks [n, constants, EYES] of constants of sensors; the last sensor is repeated to a whole block."""
    rows = np.array([list(column) for column in columns], np.float32)
    rows = np.concatenate([rows, np.repeat(rows[:, -1:], -rows.shape[1] % EYES, axis=1)], axis=1)
    return np.ascontiguousarray(np.moveaxis(rows.reshape(len(rows), -1, EYES), 0, 1))
