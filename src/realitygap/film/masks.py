"""Difference-of-Gaussians centre-surround masks, and what they find (§6, footnote 3 of the paper).

"A three dimensional mask constructed from the rotation of the difference between two Gaussian
curves, of appropriate widths, around the vertical axis": both curves have the volume 1, so that
even light gives no response. The widths are in units of the patch's radius.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.film.disk import Disk
from realitygap.film.pattern import Pattern

__all__ = ["INNER", "OUTER", "blurred", "pattern_of", "responses"]

Grey = NDArray[np.uint8]
Picture = NDArray[np.float32]

INNER = 0.56
OUTER = 0.90
"""Widths (standard deviations) of the two Gaussian curves in radii of the patch: their difference
responds most to a disc of just that radius (a Laplacian of width r / √2 does)."""

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


def _soft_disc(distance: NDArray[np.float64], radius: float, sigma: float) -> NDArray[np.float64]:
    """A white disc under a Gaussian curve, by numbers: rings summed over their angle."""
    angles = (np.arange(64) + 0.5) * (math.tau / 64)
    rings = (np.arange(40) + 0.5) * (radius / 40)
    px, py = np.outer(rings, np.cos(angles)).ravel(), np.outer(rings, np.sin(angles)).ravel()
    area = np.repeat(rings, 64) * (radius / 40) * (math.tau / 64) / (math.tau * sigma**2)
    known = np.linspace(0, float(distance.max()) + 1e-9, 200)
    soft = [float((area * np.exp(-((d - px) ** 2 + py**2) / (2 * sigma**2))).sum()) for d in known]
    return np.asarray(np.interp(distance, known, soft))
