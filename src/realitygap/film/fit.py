"""Fits a camera to places on the disk's plane and where they are in the picture.

The homography comes from a vote (RANSAC), so that one mistyped pose spoils nothing; then its eight
numbers and the two radial terms are made to fit all points that agree, by Levenberg and
Marquardt's steps.
"""

import math
from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.film.camera import CameraModel
from realitygap.values import Floats

__all__ = ["USUAL_DEG", "field_deg", "fit_camera", "lens_place"]

USUAL_DEG = (12.0, 150.0)
"""From corner to corner, what lenses above a floor see: from a long one at a hall's ceiling to a fish-eye."""

_PRIOR_PX = 0.2
"""Radial terms of size 1 cost as much as one point being this far off: only points can call for them."""


def fit_camera(
    places: Floats,
    pixels: Floats,
    size: tuple[int, int],
    *,
    plane_cm: float,
    radial: bool,
    tolerance_px: float,
) -> CameraModel | None:
    """The camera that takes places [n, 2] (cm) to pixels [n, 2]; None if there is none.

    Args:
        places, pixels: on the disk's plane, and where they were seen.
        size: width and height of the picture, px.
        plane_cm: the plane's height.
        radial: whether to fit the lens's two terms.
        tolerance_px: points farther off do not count in the vote.
    """
    middle, half = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2]), math.hypot(*size) / 2
    about, spread = places.mean(0), max(float(places.std()), 1e-9)
    p, q = (places - about) / spread, (pixels - middle) / half
    start, agree = _vote(p, q, tolerance_px / half)
    if agree.sum() < 4:
        return None
    agreeing = np.append(start, [0.0, 0.0] if radial else [])
    for _ in range(3):  # the lens's bend may have kept good points out of the vote
        agreeing = _least_squares(partial(_misses, p=p[agree], q=q[agree], half=half), agreeing)
        far = np.hypot(*(_seen(agreeing, p) - q).T) * half
        agree = far <= max(tolerance_px / 3, 4 * float(np.median(far)))
    back = np.array([[half, 0, middle[0]], [0, half, middle[1]], [0, 0, 1.0]])
    onto = np.array([[1 / spread, 0, -about[0] / spread], [0, 1 / spread, -about[1] / spread], [0, 0, 1]])
    matrix, k1, k2 = _parts(agreeing)
    return CameraModel(
        width_px=size[0],
        height_px=size[1],
        homography=back @ matrix @ onto,
        radial=(k1, k2),
        plane_cm=plane_cm,
    )


def lens_place(camera: CameraModel, height_cm: float) -> tuple[float, float, float]:
    """Where the lens of a camera is that stands so high above the floor, (x, y, height) in cm.

    Square pixels and an optical axis through the picture's middle are assumed; then the height
    says the focal length, and that the place.
    """
    low, high = (math.log(f * camera.half_diagonal) for f in (0.05, 100.0))
    for _ in range(80):
        half = (low + high) / 2
        too_high = _pinhole(camera, math.exp(half))[2] + camera.plane_cm > height_cm
        low, high = (low, half) if too_high else (half, high)
    x, y, _ = _pinhole(camera, math.exp(half))
    return float(x), float(y), float(height_cm)


def field_deg(camera: CameraModel) -> float:
    """The angle from corner to corner that a picture shows; NaN while the lens's place is unknown."""
    if camera.lens_cm is None:
        return math.nan
    share = 0.2  # of the way to the corners: there a bent picture is straight, and no horizon is near
    sides = np.array([camera.width_px, camera.height_px]) / 2
    floor = camera.to_floor(camera.middle + share * np.array([-sides, sides]))
    one, other = np.column_stack([floor, [camera.plane_cm] * 2]) - camera.lens_cm
    between = math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))
    return math.degrees(2 * math.atan(math.tan(between / 2) / share))


def _pinhole(camera: CameraModel, focal: float) -> Floats:
    """The lens above the plane, if the focal length (px) is this."""
    middle = np.array([[focal, 0, camera.middle[0]], [0, focal, camera.middle[1]], [0, 0, 1.0]])
    a = np.linalg.solve(middle, camera.homography)
    a *= 2 / (np.linalg.norm(a[:, 0]) + np.linalg.norm(a[:, 1]))
    u, _, v = np.linalg.svd(np.column_stack([a[:, 0], a[:, 1], np.cross(a[:, 0], a[:, 1])]))
    turn = u @ v
    place = -turn.T @ a[:, 2]
    return np.array([place[0], place[1], abs(place[2])])


def _vote(p: Floats, q: Floats, tolerance: float) -> tuple[Floats, NDArray[np.bool_]]:
    """The first eight numbers of the homography that most points agree on, and which do; maybe none."""
    cv2.setRNGSeed(1)
    matrix, votes = cv2.findHomography(p, q, cv2.RANSAC, tolerance, maxIters=5000)
    if matrix is None:
        return np.zeros(8), np.zeros(len(p), bool)
    return np.asarray(matrix, float).ravel()[:8] / matrix[2, 2], votes.ravel() > 0


def _parts(values: Floats) -> tuple[Floats, float, float]:
    """Homography and radial terms, which are 0 where they are not fitted."""
    k1, k2 = [*values[8:].tolist(), 0.0, 0.0][:2]
    return np.append(values[:8], 1.0).reshape(3, 3), k1, k2


def _seen(values: Floats, p: Floats) -> Floats:
    """Where the places are in the picture, both in the units of the fit."""
    h, k1, k2 = _parts(values)
    ideal = (p @ h[:2, :2].T + h[:2, 2]) / (p @ h[2, :2] + h[2, 2])[:, None]
    square = (ideal**2).sum(1, keepdims=True)
    return np.asarray(ideal * (1 + k1 * square + k2 * square * square))


def _misses(values: Floats, p: Floats, q: Floats, half: float) -> Floats:
    """How far off each point is (px), and what the radial terms cost."""
    return np.append((_seen(values, p) - q).ravel() * half, _PRIOR_PX * values[8:])


def _least_squares(misses: Callable[[Floats], Floats], values: Floats, rounds: int = 60) -> Floats:
    """The values whose misses have the least sum of squares (Levenberg 1944, Marquardt 1963)."""
    damping, off = 1e-3, misses(values)
    for _ in range(rounds):
        steps = 1e-6 * np.maximum(np.abs(values), 1e-2)
        rows = [misses(values + step) - misses(values - step) for step in np.diag(steps)]
        jacobian = np.stack(rows, 1) / (2 * steps)
        normal, slope = jacobian.T @ jacobian, jacobian.T @ off
        trial = values - np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), slope)
        tried = misses(trial)
        gain = float(off @ off) - float(tried @ tried)
        if gain > 0:
            values, off, damping = trial, tried, damping / 5
            if gain < 1e-10 * float(off @ off) + 1e-18:
                break
        else:
            damping *= 8
        if damping > 1e12:
            break
    return values
