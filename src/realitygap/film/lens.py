"""How a lens bends straight lines: two radial terms (Brown 1966, without the tangential ones).

bent = v (1 + k1 |v|² + k2 |v|⁴),   v from the picture's middle in half diagonals
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["bend", "straightened"]

Array = NDArray[np.float64]

_ROUNDS = 20


def bend(square: Array, k1: float, k2: float) -> Array:
    """What the lens multiplies points with whose squared distances these are; NaN beyond its fold."""
    factor = 1 + k1 * square + k2 * square * square
    limit = _turning_point(k1, k2)
    return np.asarray(factor if math.isinf(limit) else np.where(square < limit, factor, np.nan))


def straightened(v: Array, k1: float, k2: float) -> Array:
    """The ideal points that the lens puts at points [..., 2]: Newton's steps on the distance."""
    far = np.sqrt(np.einsum("...i,...i->...", v, v))
    limit = math.sqrt(min(_turning_point(k1, k2), 1e6))
    r = np.minimum(far, 0.999 * limit)
    for _ in range(_ROUNDS):
        square = r * r
        slope = np.maximum(1 + 3 * k1 * square + 5 * k2 * square * square, 0.05)
        r = np.clip(r - (r * (1 + k1 * square + k2 * square * square) - far) / slope, 0, limit)
    return np.asarray(v * np.where(far > 0, r / np.where(far > 0, far, 1.0), 1.0)[..., None])


def _turning_point(k1: float, k2: float) -> float:
    """The squared distance at which the lens would fold the picture back; infinite if it never does."""
    spread = 9 * k1 * k1 - 20 * k2  # of 1 + 3 k1 s + 5 k2 s², the slope of the bent distance
    if spread < 0:
        return math.inf
    below = (-3 * k1 + math.sqrt(spread), -3 * k1 - math.sqrt(spread))
    return min((2 / b for b in below if b > 1e-9), default=math.inf)
