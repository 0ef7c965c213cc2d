"""How a lens bends straight lines: two radial terms (Brown 1966, without the tangential ones).

    bent = v (1 + k1 |v|² + k2 |v|⁴),   v from the picture's middle in half diagonals
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["bent", "straightened"]

Array = NDArray[np.float64]

_ROUNDS = 20


def bent(v: Array, k1: float, k2: float) -> Array:
    """Where the lens puts ideal points [..., 2]; NaN beyond where it would fold the picture back."""
    square = np.einsum("...i,...i->...", v, v)
    factor = 1 + k1 * square + k2 * square * square
    return np.asarray(v * np.where(square < _turning_point(k1, k2), factor, np.nan)[..., None])


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
    roots = np.roots([5 * k2, 3 * k1, 1.0]) if k2 else np.array([-1 / (3 * k1)] if k1 else [])
    real = [root.real for root in np.atleast_1d(roots) if abs(root.imag) < 1e-12 and root.real > 0]
    return float(min(real)) if real else math.inf
