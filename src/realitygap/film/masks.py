"""Difference-of-Gaussians centre-surround masks, and what they find (§6, footnote 3 of the paper).

"A three dimensional mask constructed from the rotation of the difference between two Gaussian
curves, of appropriate widths, around the vertical axis": both curves have the volume 1, so that
even light gives no response. The widths are in units of the patch's radius.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.film.disk import Disk

__all__ = ["INNER", "OUTER", "Pattern", "blurred", "correlation", "pattern_of", "peak", "responses"]

Grey = NDArray[np.uint8]
Picture = NDArray[np.float32]

INNER = 0.56
OUTER = 0.90
"""Widths (standard deviations) of the two Gaussian curves in radii of the patch: their difference
responds most to a disc of just that radius (a Laplacian of width r / √2 does)."""

_HIDDEN = 0.25
"""Part of the disk's black face that may be hidden by something bright."""

_RIM, _GRAIN = 1.0, 0.25
"""In radii of the front patch: how much of the disk's rim, into which the floor blurs, is not compared,
and how far apart compared places are."""


class Pattern(NamedTuple):
    """The disk as a correlation judges it: places on it (disk's axes, cm) and how white they are."""

    places: NDArray[np.float64]
    white: NDArray[np.float64]
    inner: NDArray[np.bool_]
    black: NDArray[np.bool_]


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


def pattern_of(disk: Disk) -> Pattern:
    """What the disk looks like under the front mask's inner curve, without its rim."""
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
    return Pattern(np.stack([x, y], 1), white, np.hypot(x, y) < between, white < 0.15)


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
    limit = _quantile(seen[pattern.black], 1 - _HIDDEN)
    return np.asarray(~pattern.black | (seen <= limit))


def _quantile(values: NDArray[np.float64], share: float) -> float:
    """As `numpy.quantile`, to the last bit, without its overhead."""
    place = (len(values) - 1) * share
    below = math.floor(place)
    above = min(below + 1, len(values) - 1)
    ranked = np.partition(values, (below, above))
    low, high, part = float(ranked[below]), float(ranked[above]), place - below
    return low + (high - low) * part if part < 0.5 else high - (high - low) * (1 - part)


def _soft_disc(distance: NDArray[np.float64], radius: float, sigma: float) -> NDArray[np.float64]:
    """A white disc under a Gaussian curve, by numbers: rings summed over their angle."""
    angles = (np.arange(64) + 0.5) * (math.tau / 64)
    rings = (np.arange(40) + 0.5) * (radius / 40)
    px, py = np.outer(rings, np.cos(angles)).ravel(), np.outer(rings, np.sin(angles)).ravel()
    area = np.repeat(rings, 64) * (radius / 40) * (math.tau / 64) / (math.tau * sigma**2)
    known = np.linspace(0, float(distance.max()) + 1e-9, 200)
    soft = [float((area * np.exp(-((d - px) ** 2 + py**2) / (2 * sigma**2))).sum()) for d in known]
    return np.asarray(np.interp(distance, known, soft))
