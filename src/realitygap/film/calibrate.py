"""Calibrates the overhead camera from frames in which the robot's pose is known.

The disk is first looked for without any camera, at every scale; the two patches of every frame are
then points whose places are known, and a camera is fitted to them; with that camera the frames are
looked at again, closely, and it is fitted once more.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.film.camera import CameraModel
from realitygap.film.disk import Disk
from realitygap.film.finder import KNOWN_AGAIN, Finder, Sighting
from realitygap.film.fit import fit_camera, lens_place
from realitygap.film.frames import KnownFrame
from realitygap.values import Pose

__all__ = ["Calibration", "Residual", "calibrate_camera"]

Picture = NDArray[np.uint8]

LEAST_FRAMES = 4
"""Frames needed for a homography."""

LEAST_FOR_RADIAL = 6
"""Frames needed to say how the lens bends."""

_LEAST_SPREAD = 0.15
"""How broad the poses must lie across their longest direction, as a part of it."""

_TOLERANCE_CM = 0.6
_TOLERANCE_DEG = 15.0
"""A pose farther off than this from what the others say is left out."""

_SCALES = 1.1
_LEAST_FRONT_PX = 1.4
"""Step between the scales that are tried, and the smallest front patch's radius worth trying."""

_LOOSE = 0.6
"""Slack of the front patch's ring (radii of the patch) while the scale is known only roughly."""


@dataclass(frozen=True, kw_only=True)
class Residual:
    """How far the tracked pose is from the given one: mm and degrees; None where the disk was not
    found. `used` says whether the frame had a part in the fit."""

    frame: str
    x_mm: float | None
    y_mm: float | None
    heading_deg: float | None
    used: bool

    @property
    def distance_mm(self) -> float | None:
        """How far the centre is off."""
        return None if self.x_mm is None or self.y_mm is None else math.hypot(self.x_mm, self.y_mm)


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """A calibrated camera and how well it explains its frames."""

    camera: CameraModel
    residuals: tuple[Residual, ...]

    def to_dict(self) -> dict[str, Any]:
        """Residuals and their summary, ready for JSON."""
        off = [r.distance_mm for r in self.residuals if r.used and r.distance_mm is not None]
        turned = [abs(r.heading_deg) for r in self.residuals if r.used and r.heading_deg is not None]
        return {
            "frames": len(self.residuals),
            "used": len(off),
            "mean_mm": float(np.mean(off)),
            "rms_mm": float(np.sqrt(np.mean(np.square(off)))),
            "worst_mm": float(np.max(off)),
            "mean_heading_deg": float(np.mean(turned)),
            "worst_heading_deg": float(np.max(turned)),
            "residuals": [vars(r) | {"distance_mm": r.distance_mm} for r in self.residuals],
        }


def calibrate_camera(
    frames: list[KnownFrame],
    disk: Disk,
    *,
    lens_height_cm: float | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> Calibration:
    """The camera that took the frames; its plane is the disk's.

    Args:
        frames: at least 4, better 12 or more, all over the floor.
        disk: what the robot carried.
        lens_height_cm: the lens above the floor, if measured: then the camera can also be used
            with disks of another height.
        on_progress: is called with the number of frames done and of all.

    Raises:
        FilmError: too few frames or poses in a line, frames of different sizes, no disk found,
            poses that no camera explains.
    """
    size = _checked(frames, disk, lens_height_cm)
    report = on_progress or (lambda done, total: None)
    seen = _first_look(frames, disk, lambda done: report(done, 2 * len(frames)))
    camera = _fitted(frames, seen, disk, size, None)
    for turn in range(2):
        finder = Finder(camera, disk)
        again = []
        for done, frame in enumerate(frames):
            again.append(_closely(finder, frame))
            report(len(frames) + (turn * len(frames) + done + 1) // 2, 2 * len(frames))
        seen = [None if one is None else _pixels_of(camera, one) for one in again]
        camera = _fitted(frames, seen, disk, size, camera)
    residuals = tuple(_residual(camera, frame, one) for frame, one in zip(frames, seen, strict=True))
    if lens_height_cm is not None:
        camera = replace(camera, lens_cm=lens_place(camera, lens_height_cm))
    return Calibration(camera=camera, residuals=residuals)


def _checked(frames: list[KnownFrame], disk: Disk, lens_height_cm: float | None) -> tuple[int, int]:
    """The size of the frames, if they can be calibrated with."""
    if len(frames) < LEAST_FRAMES:
        raise FilmError(
            f"expected at least {LEAST_FRAMES} frames with known poses (better 12 or more, all over the "
            f"floor), got {len(frames)}. Film the robot at more places."
        )
    if lens_height_cm is not None and not lens_height_cm > disk.height_cm + 1:
        raise FilmError(
            f"lens height: expected well above the disk at {disk.height_cm:g} cm, got {lens_height_cm:g} cm."
        )
    first = frames[0]
    for frame in frames:
        if frame.picture.shape != first.picture.shape:
            raise FilmError(
                f"{frame.name}: {frame.picture.shape[1]} × {frame.picture.shape[0]} pixels, but {first.name} "
                f"has {first.picture.shape[1]} × {first.picture.shape[0]}. Take all frames with one camera."
            )
    _check_spread([frame.pose for frame in frames], "poses")
    return first.picture.shape[1], first.picture.shape[0]


def _check_spread(poses: list[Pose], what: str) -> None:
    """Refuse poses that lie in one place or in a line: they say nothing across it."""
    places = np.array([(pose.x, pose.y) for pose in poses])
    _, (long, broad), _ = np.linalg.svd(places - places.mean(0), full_matrices=False)
    if long / math.sqrt(len(poses)) < 1.0:
        raise FilmError(f"the {what} all lie at one place. Put the robot all over the floor.")
    if broad < _LEAST_SPREAD * long:
        raise FilmError(
            f"the {what} lie in a line, which says nothing across it. Put the robot all over the floor."
        )


def _first_look(
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
    found = sum(one is not None for one in seen)
    if found < LEAST_FRAMES:
        raise FilmError(
            f"the disk is seen in {found} of {len(frames)} frames, "
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
        looks.append((0.0, None) if seen is None else (seen.quality, _pixels_of(flat, seen)))
        report(done + 1)
    return looks


def _pixels_of(camera: CameraModel, seen: Sighting) -> NDArray[Any]:
    """Both patches in the picture, [2, 2] px."""
    return camera.to_pixels([seen.centre, seen.front])


def _closely(finder: Finder, frame: KnownFrame) -> Sighting | None:
    """The disk of a frame where the first camera expects it, or wherever it is."""
    place = np.array([frame.pose.x, frame.pose.y])
    seen = finder.near(frame.picture, place)
    if seen is None or seen.quality < KNOWN_AGAIN:
        seen = finder.anywhere(frame.picture)
    return seen if seen is not None and seen.quality >= KNOWN_AGAIN else None


def _fitted(
    frames: list[KnownFrame],
    seen: list[NDArray[Any] | None],
    disk: Disk,
    size: tuple[int, int],
    before: CameraModel | None,
) -> CameraModel:
    """The camera that explains what was seen."""
    pairs = [(frame, pixels) for frame, pixels in zip(frames, seen, strict=True) if pixels is not None]
    if len(pairs) < LEAST_FRAMES:
        raise FilmError(
            f"the disk is seen in {len(pairs)} frames only, {LEAST_FRAMES} are needed. Take more frames."
        )
    _check_spread([frame.pose for frame, _ in pairs], "poses of the frames in which the disk is seen")
    places = np.concatenate([_patches(frame.pose, disk) for frame, _ in pairs])
    pixels = np.concatenate([pixels for _, pixels in pairs])
    px_per_cm = float(np.median([math.dist(*pixels) for _, pixels in pairs])) / disk.front_distance_cm
    camera = fit_camera(
        places,
        pixels,
        size,
        plane_cm=disk.height_cm,
        radial=len(pairs) >= LEAST_FOR_RADIAL,
        tolerance_px=(_TOLERANCE_CM if before is not None else 2 * _TOLERANCE_CM) * px_per_cm,
    )
    if camera is not None:
        near = [_residual(camera, frame, one).used for frame, one in pairs]
        if sum(near) >= max(LEAST_FRAMES, len(near) / 2):
            return camera
    raise FilmError(
        "no camera explains these poses: what is seen and what the table says do not fit. Check that every "
        "pose belongs to its frame, x to the right and y up as seen from above, headings in degrees "
        "counter-clockwise from +x."
    )


def _patches(pose: Pose, disk: Disk) -> NDArray[np.float64]:
    """Where both patches are, [2, 2] cm."""
    ahead = disk.front_distance_cm * np.array([math.cos(pose.heading), math.sin(pose.heading)])
    centre = np.array([pose.x, pose.y])
    return np.stack([centre, centre + ahead])


def _residual(camera: CameraModel, frame: KnownFrame, pixels: NDArray[Any] | None) -> Residual:
    """How far off the disk of a frame is seen through a camera."""
    if pixels is None:
        return Residual(frame=frame.name, x_mm=None, y_mm=None, heading_deg=None, used=False)
    centre, front = camera.to_floor(pixels)
    turned = math.atan2(front[1] - centre[1], front[0] - centre[0]) - frame.pose.heading
    heading = Pose(x=0, y=0, heading=turned).heading_deg
    x, y = 10 * (float(centre[0]) - frame.pose.x), 10 * (float(centre[1]) - frame.pose.y)
    return Residual(
        frame=frame.name,
        x_mm=x,
        y_mm=y,
        heading_deg=heading,
        used=math.hypot(x, y) <= 10 * _TOLERANCE_CM and abs(heading) <= _TOLERANCE_DEG,
    )
