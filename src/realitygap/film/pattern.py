"""The disk's pattern, the masks over a whole picture, and how much what is seen looks like it."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.film.disk import Disk
from realitygap.film.masks import INNER, OUTER, Picture, jit, step
from realitygap.values import Floats

__all__ = ["Pattern", "blurred", "correlation", "pattern_of", "responses", "spots"]

Grey = NDArray[np.uint8]

_RIM, _GRAIN = 1.0, 0.25
"""In radii of the front patch: how much of the disk's rim, into which the floor blurs, is not compared,
and how far apart compared places are."""


def blurred(picture: Picture, sigma_px: float) -> Picture:
    """The picture under a Gaussian curve."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE))


def responses(picture: Picture, disk: Disk, px_per_cm: float) -> tuple[Picture, Picture, Picture]:
    """Both masks' responses, to the centre patch and to the front patch, and the picture as the
    front mask's inner curve sees it."""
    centre, front = disk.centre_radius_cm * px_per_cm, disk.front_radius_cm * px_per_cm
    fine = blurred(picture, INNER * front)
    for_centre = blurred(picture, INNER * centre) - blurred(picture, OUTER * centre)
    return for_centre, fine - blurred(picture, OUTER * front), fine


def pattern_of(disk: Disk) -> Pattern:
    """What the disk looks like under the front mask's inner curve, without its rim."""
    pattern = _seen_of(disk)
    return pattern._replace(room=np.empty_like(pattern.room))


@lru_cache(maxsize=4)  # each tracker begins with it
def _seen_of(disk: Disk) -> Pattern:
    reach = disk.radius_cm - _RIM * disk.front_radius_cm
    step_cm = _GRAIN * disk.front_radius_cm
    count = math.ceil(reach / step_cm)
    axis = np.arange(-count, count + 1) * step_cm
    x, y = (side.ravel() for side in np.meshgrid(axis, axis))
    keep = np.hypot(x, y) <= reach
    x, y = x[keep], y[keep]
    sigma = INNER * disk.front_radius_cm
    white = _soft_disc(np.hypot(x, y), disk.centre_radius_cm, sigma)
    white += _soft_disc(np.hypot(x - disk.front_distance_cm, y), disk.front_radius_cm, sigma)
    between = (disk.centre_radius_cm + disk.front_distance_cm - disk.front_radius_cm) / 2
    return Pattern(np.stack([x, y], 1), white, np.hypot(x, y) < between, white < 0.15, np.empty((2, len(x))))


def _soft_disc(distance: Floats, radius: float, sigma: float) -> Floats:
    """A white disc under a Gaussian curve, by numbers: rings summed over their angle."""
    angles = (np.arange(64) + 0.5) * (math.tau / 64)
    rings = (np.arange(40) + 0.5) * (radius / 40)
    px, py = np.outer(rings, np.cos(angles)).ravel(), np.outer(rings, np.sin(angles)).ravel()
    area = np.repeat(rings, 64) * (radius / 40) * (math.tau / 64) / (math.tau * sigma**2)
    known = np.linspace(0, float(distance.max()) + 1e-9, 200)
    soft = [float((area * np.exp(-((d - px) ** 2 + py**2) / (2 * sigma**2))).sum()) for d in known]
    return np.asarray(np.interp(distance, known, soft))


HIDDEN = 0.25
"""Part of the disk's black face that may be hidden by something bright."""


class Pattern(NamedTuple):
    """The disk as a correlation judges it: places on it [n, 2] (disk's axes, cm) and how white they are;
    which of them are nearer to the centre patch than to the front one, and which are black; room [2, n]."""

    places: Floats
    white: Floats
    inner: NDArray[np.bool_]
    black: NDArray[np.bool_]
    room: Floats


@jit
def spots(pattern: Any, points: Any, step: float, columns: Any, rows: Any) -> None:
    """Where a disk's pattern is in a window.

    Args:
        pattern: the disk's.
        points: [4] columns and rows of its two patches.
        step: of the window, cm.
        columns, rows: [n, 1] into which they go.
    """
    dx, dy = points[2] - points[0], points[3] - points[1]
    length = math.sqrt(dx * dx + dy * dy) * step
    ahead_x, ahead_y = dx / length, dy / length
    for k in range(pattern.white.shape[0]):
        x, y = pattern.places[k, 0], pattern.places[k, 1]
        columns[k, 0] = x * ahead_x - y * ahead_y + points[0]
        rows[k, 0] = x * ahead_y + y * ahead_x + points[1]


@step
def _ranked(values: Any, count: int, rank: int) -> Any:
    """Puts the value of a rank where it belongs, none larger before it (Hoare 1961)."""
    low, high = 0, count - 1
    while low < high:
        middle, i, j = values[rank], low, high
        while i <= j:
            while values[i] < middle:
                i += 1
            while middle < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if j < rank:
            low = i
        if rank < i:
            high = j
    return values[rank]


@jit
def _limit(seen: Any, pattern: Any, room: Any) -> Any:
    """Up to here black places are compared: their quantile, as `numpy.quantile` takes it."""
    count = 0
    for k in range(seen.shape[0]):
        if pattern.black[k]:
            room[count] = seen[k]
            count += 1
    place = (count - 1) * (1 - HIDDEN)
    below = math.floor(place)
    low = _ranked(room, count, below)
    high = low if below + 1 >= count else np.inf
    for k in range(below + 1, count):
        high = min(high, room[k])
    part = place - below
    return low + (high - low) * part if part < 0.5 else high - (high - low) * (1 - part)


@step
def _light(seen: Any, pattern: Any, limit: float, sums: Any) -> None:
    """How light grows across what is compared: the slopes in the places' x and y, by least squares beside
    the pattern and a constant, into `sums[2:, 4]` of [4, 5] (Gauss, with pivots)."""
    sums[:, :] = 0.0
    for k in range(seen.shape[0]):
        if pattern.black[k] and seen[k] > limit:
            continue
        row = (1.0, pattern.white[k], pattern.places[k, 0], pattern.places[k, 1], seen[k])
        for i in range(4):
            for j in range(5):
                sums[i, j] += row[i] * row[j]
    for i in range(4):
        best = i
        for k in range(i + 1, 4):
            if abs(sums[k, i]) > abs(sums[best, i]):
                best = k
        for j in range(5):
            sums[i, j], sums[best, j] = sums[best, j], sums[i, j]
        for k in range(4):
            if k != i:
                share = sums[k, i] / sums[i, i]
                for j in range(i, 5):
                    sums[k, j] -= share * sums[i, j]
    for i in range(4):
        sums[i, 4] /= sums[i, i]


@jit
def correlation(seen: Any, pattern: Any, sums: Any) -> Any:
    """How much what is seen at the pattern's places looks like the disk, 0 to 1.

    The correlation is taken for the centre patch and for the front patch with their surroundings
    apart, and the worse one counts: a lone white spot is no robot. Of the black face the brightest
    quarter is left out, whatever it is, so that a hand or a cable may lie there. Light that grows
    evenly across the disk, as a lamp's reflection does, is taken away first.

    `seen` is [n], `sums` room for [4, 5].
    """
    even = pattern.room[1]
    _light(seen, pattern, _limit(seen, pattern, pattern.room[0]), sums)
    for k in range(seen.shape[0]):
        even[k] = seen[k] - (pattern.places[k, 0] * sums[2, 4] + pattern.places[k, 1] * sums[3, 4])
    limit, worst = _limit(even, pattern, pattern.room[0]), 1.0
    for part in range(2):
        count, mean_a, mean_b, aa, bb, ab = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for turn in range(2):
            for k in range(seen.shape[0]):
                if pattern.inner[k] != (part == 0) or (pattern.black[k] and even[k] > limit):
                    continue
                if turn == 0:
                    count, mean_a, mean_b = count + 1, mean_a + even[k], mean_b + pattern.white[k]
                else:
                    a, b = even[k] - mean_a, pattern.white[k] - mean_b
                    aa, bb, ab = aa + a * a, bb + b * b, ab + a * b
            if turn == 0:
                mean_a, mean_b = mean_a / count, mean_b / count
        strength = math.sqrt(aa * bb)
        worst = min(worst, ab / strength if strength > 0 else 0.0)
    return max(worst, 0.0)
