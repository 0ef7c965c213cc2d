"""The disk in frames of a camera that nobody knows yet: it is looked for at every scale."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.film.camera import CameraModel
from realitygap.film.disk import Disk
from realitygap.film.finder import KNOWN_AGAIN, Finder, Sighting
from realitygap.film.frames import KnownFrame

__all__ = ["LEAST_FRAMES", "first_look", "pixels_of"]

Picture = NDArray[np.uint8]

LEAST_FRAMES = 4
"""Frames needed for a homography."""

_SCALES = 1.1
_LEAST_FRONT_PX = 1.4
"""Step between the scales that are tried, and the smallest front patch's radius worth trying."""

_LOOSE = 0.6
"""Slack of the front patch's ring (radii of the patch) while the scale is known only roughly."""


def first_look(
    frames: list[KnownFrame], disk: Disk, report: Callable[[int], None]
) -> list[NDArray[Any] | None]:
    """Both patches of every frame in pixels [2, 2], found without knowing the camera."""
    height, width = frames[0].picture.shape
    scale, largest = _LEAST_FRONT_PX / disk.front_radius_cm, min(height, width) / (4 * disk.radius_cm)
    scales = []
    while scale < largest:
        scales.append(scale)
        scale *= _SCALES
    few = [frames[i].picture for i in np.unique(np.linspace(0, len(frames) - 1, 4).astype(int))]
    sums = [sum(q**4 for q, _ in _at_scale(few, disk, scale)) for scale in scales]
    best = int(np.argmax(sums)) if sums else 0
    pictures = [frame.picture for frame in frames]
    looks = [_at_scale(pictures, disk, scale, report) for scale in scales[max(best - 1, 0) : best + 2]]
    chosen = [max(looks_at_one, key=lambda look: look[0]) for looks_at_one in zip(*looks, strict=True)]
    seen = [pixels if quality >= KNOWN_AGAIN else None for quality, pixels in chosen]
    if sum(one is not None for one in seen) < LEAST_FRAMES:
        raise FilmError(
            f"the disk is seen in {sum(one is not None for one in seen)} of {len(frames)} frames, "
            f"{LEAST_FRAMES} are needed. Check that the robot carries the disk, and the disk's sizes."
        )
    return seen


def _at_scale(
    pictures: list[Picture], disk: Disk, scale: float, report: Callable[[int], None] = lambda done: None
) -> list[tuple[float, NDArray[Any] | None]]:
    """The best disk of each picture at a scale (px/cm): quality and both patches in pixels."""
    height, width = pictures[0].shape
    flat = CameraModel(
        width_px=width, height_px=height, homography=np.diag([scale, scale, 1.0]), plane_cm=disk.height_cm
    )
    finder = Finder(flat, disk, slack=_LOOSE)
    looks: list[tuple[float, NDArray[Any] | None]] = []
    for done, picture in enumerate(pictures):
        seen = finder.anywhere(picture)
        looks.append((0.0, None) if seen is None else (seen.quality, pixels_of(flat, seen)))
        report(done + 1)
    return looks


def pixels_of(camera: CameraModel, seen: Sighting) -> NDArray[Any]:
    """Both patches in the picture, [2, 2] px."""
    return camera.to_pixels([seen.centre, seen.front])
