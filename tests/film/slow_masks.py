"""The tracker's masks and correlation in NumPy: the judge of the compiled ones."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from realitygap.film.finder import _maxima
from realitygap.film.pattern import HIDDEN, Pattern
from realitygap.film.window import Aim

Picture = NDArray[np.float32]


def peak(response: Picture, column: int, row: int) -> tuple[float, float] | None:
    """The top of the quadratic through the 3 × 3 values about (column, row), px; None if it has none.

    Least squares over the nine values, so that it is exact for any quadratic.
    """
    height, width = response.shape
    if not (1 <= column < width - 1 and 1 <= row < height - 1):
        return None
    v = response[row - 1 : row + 2, column - 1 : column + 2].astype(np.float64)
    dx, dy = (v[:, 2] - v[:, 0]).sum() / 6, (v[2] - v[0]).sum() / 6
    dxx = (v[:, 2] - 2 * v[:, 1] + v[:, 0]).sum() / 3
    dyy = (v[2] - 2 * v[1] + v[0]).sum() / 3
    dxy = (v[2, 2] - v[2, 0] - v[0, 2] + v[0, 0]) / 4
    bend = dxx * dyy - dxy * dxy
    if dxx >= 0 or bend <= 0:
        return None
    x, y = (dxy * dy - dyy * dx) / bend, (dxy * dx - dxx * dy) / bend
    if abs(x) > 1 or abs(y) > 1:
        return None
    return column + x, row + y


def correlation(seen: NDArray[np.float64], pattern: Pattern) -> float:
    """How much what is seen at the pattern's places looks like the disk, 0 to 1.

    The correlation is taken for the centre patch and for the front patch with their surroundings
    apart, and the worse one counts: a lone white spot is no robot. Of the black face the brightest
    quarter is left out, whatever it is, so that a hand or a cable may lie there. Light that grows
    evenly across the disk, as a lamp's reflection does, is taken away first.
    """
    use = _unhidden(seen, pattern)
    terms = np.column_stack([np.ones(int(use.sum())), pattern.white[use], pattern.places[use]])
    slope = np.linalg.solve(terms.T @ terms, terms.T @ seen[use])[2:]
    seen = seen - pattern.places @ slope
    use = _unhidden(seen, pattern)
    worst = 1.0
    for part in (pattern.inner & use, ~pattern.inner & use):
        a, b = seen[part] - seen[part].mean(), pattern.white[part] - pattern.white[part].mean()
        strength = math.sqrt(float(a @ a) * float(b @ b))
        worst = min(worst, float(a @ b) / strength if strength > 0 else 0.0)
    return max(worst, 0.0)


def _unhidden(seen: NDArray[np.float64], pattern: Pattern) -> NDArray[np.bool_]:
    """Places that are compared: not the brightest of the black face."""
    limit = np.quantile(seen[pattern.black], 1 - HIDDEN)
    return np.asarray(~pattern.black | (seen <= limit))


def _tops(response: Picture, half: int, reach: float, count: int) -> list[tuple[int, int]]:
    """The highest maxima (row, column) within `reach` steps of the square's middle."""
    low, high = max(half - math.ceil(reach), 1), half + math.ceil(reach) + 1
    inner = response[low - 1 : high + 1, low - 1 : high + 1]
    places = _maxima(inner, 1, 4 * count) + (low - 1)
    near = np.hypot(places[:, 0] - half, places[:, 1] - half) <= reach
    return [(int(row), int(column)) for row, column in places[near][:count]]


def sightings(for_centre: Picture, for_front: Picture, aim: Aim, count: int) -> list[tuple[float, ...]]:
    """Centre and front patches of likely disks, the likeliest first."""
    found = []
    for row, column in _tops(for_centre, aim.half, aim.reach, count):
        centre = peak(for_centre, column, row)
        front = None if centre is None else _front(for_front, aim, centre)
        if centre is not None and front is not None:
            found.append((*centre, *front))
    return found


def _front(response: Picture, aim: Aim, centre: tuple[float, float]) -> tuple[float, float] | None:
    """The front patch on its ring about the centre, in steps."""
    places = np.rint(np.array(centre) + aim.ring * aim.round).astype(int)
    places = places.clip(0, response.shape[0] - 1)
    column, row = places[int(response[places[:, 1], places[:, 0]].argmax())]
    for _ in range(6):  # uphill to the top of the mask's response
        left, up = max(column - 1, 0), max(row - 1, 0)
        around = response[up : row + 2, left : column + 2]
        dy, dx = np.unravel_index(int(around.argmax()), around.shape)
        if (up + dy, left + dx) == (row, column):
            break
        row, column = int(up + dy), int(left + dx)
    front = peak(response, int(column), int(row))
    if front is None or abs(math.dist(front, centre) - aim.ring) > aim.slack:
        return None
    return front
