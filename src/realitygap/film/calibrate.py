"""Calibrates the overhead camera from frames in which the robot's pose is known: a folder of pictures and
a table of poses.

The marker is first looked for without any camera. Its points in every frame (a disk's two patches, a tag's
corners) then have known places, and a camera is fitted to them; with that camera the frames are looked at
again, closely, and it is fitted once more.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.files import read_table
from realitygap.film.camera import CameraModel
from realitygap.film.finder import Finder, first_look
from realitygap.film.fit import USUAL_DEG, field_deg, fit_camera, lens_place
from realitygap.film.marker import Marker, Tag, on_floor
from realitygap.film.pattern import Grey
from realitygap.film.tag import BELIEVED, TagFinder, finder_of, seen_in, why_not
from realitygap.values import Pose

__all__ = ["Calibration", "KnownFrame", "Residual", "calibrate_camera", "read_frames"]

LEAST_FRAMES, LEAST_FOR_RADIAL = 4, 6
"""Frames needed for a homography, and to fit how the lens bends."""

_LEAST_SPREAD = 0.15
"""Spread that the poses need across their longest direction, as a share of it."""

_TOLERANCE_CM, _TOLERANCE_DEG = 0.6, 15.0
"""A pose farther off than this from what the others say is left out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownFrame:
    """A picture [height, width] in which the robot stood at a known pose."""

    name: str
    picture: NDArray[np.uint8]
    pose: Pose


@dataclass(frozen=True, kw_only=True)
class Residual:
    """How far the tracked pose is from the given one: mm and degrees; None where the disk was not
    found. `used` says whether the frame took part in the fit."""

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

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should know: a disk seen in a mirror is a disk, and a table may be the mirror; and no
        frame contradicts a wrong height of the lens, but few lenses see so little or so much."""
        mirror = (
            "the pictures show the floor as in a mirror. Unless the camera mirrors them, and the film too, "
            "correct the poses: x to the right and y up as seen from above, headings counter-clockwise."
        )
        field = field_deg(self.camera)
        lens = (
            f"lens height: from there the pictures show {field:.3g}° from corner to corner; expected "
            f"{USUAL_DEG[0]:g} to {USUAL_DEG[1]:g}. Is it in another unit than cm?"
        )
        return (mirror,) * self.camera.mirrored + (lens,) * (field < USUAL_DEG[0] or field > USUAL_DEG[1])

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
            "warnings": self.warnings,
            "residuals": [vars(r) | {"distance_mm": r.distance_mm} for r in self.residuals],
        }


def read_frames(folder: str | Path, poses: str | Path) -> list[KnownFrame]:
    """The frames that a table of poses names, from a folder of pictures (PNG, JPEG or the like).

    The table is a CSV file with columns frame (a picture's name, its ending may be left out), x_cm, y_cm and
    heading_deg.

    Raises:
        FilmError: whatever is missing or wrong, with file and line.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FilmError(f"{folder}: no such folder. Give the folder that holds the frames.")
    known: dict[str, int] = {}
    frames: list[KnownFrame] = []
    table = read_table(poses, FilmError, needs=("frame", "x_cm", "y_cm", "heading_deg"))
    columns = (table.numbers(name) for name in ("x_cm", "y_cm", "heading_deg"))
    for line, frame, *pose in zip(table.lines, table.texts("frame"), *columns, strict=True):
        path = _picture_file(folder, frame, f"{poses}, line {line}")
        if path.name in known:
            raise FilmError(
                f"{poses}, line {line}: {path.name} was already given in line {known[path.name]}. "
                "Leave one of them out."
            )
        known[path.name] = line
        frames.append(KnownFrame(name=path.name, picture=_read(path), pose=Pose.from_degrees(*pose)))
    return frames


def _picture_file(folder: Path, name: str, where: str) -> Path:
    if name and (folder / name).is_file():
        return folder / name
    alike = [path for path in sorted(folder.iterdir()) if path.stem == name and path.is_file()]
    if len(alike) != 1:
        what = f"{len(alike)} pictures have this name" if alike else f"there is no such picture in {folder}"
        raise FilmError(f"{where}: frame {name!r}: {what}. Give the picture's file name.")
    return alike[0]


def _read(path: Path) -> NDArray[np.uint8]:
    data = np.fromfile(path, np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
    if picture is None:
        raise FilmError(f"{path}: not a picture. Give frames as PNG or JPEG.")
    return np.asarray(picture, np.uint8)


def calibrate_camera(
    frames: list[KnownFrame],
    marker: Marker,
    *,
    lens_height_cm: float | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> Calibration:
    """The camera that took the frames; its plane is the marker's.

    Args:
        frames: at least 4, better 12 or more, all over the floor.
        marker: what the robot carried.
        lens_height_cm: the lens above the floor, if measured: then the camera can also be used
            with markers of another height.
        on_progress: called with frames done and frames in all.

    Raises:
        FilmError: too few frames or poses in a line, frames of different sizes, no marker found,
            poses that no camera explains.
    """
    _check(frames, marker, lens_height_cm)
    report = on_progress or (lambda done, total: None)
    total = 2 * len(frames)
    seen = _without_camera([frame.picture for frame in frames], marker, lambda done: report(done, total))
    camera = _fitted(frames, seen, marker, None)
    for turn in range(2):
        finder = finder_of(camera, marker)
        seen = []
        for done, frame in enumerate(frames):
            seen.append(_closely(finder, frame))
            report(len(frames) + (turn * len(frames) + done + 1) // 2, total)
        camera = _fitted(frames, seen, marker, camera)
    residuals = tuple(_residual(camera, marker, frame, one) for frame, one in zip(frames, seen, strict=True))
    if lens_height_cm is not None:
        camera = replace(camera, lens_cm=lens_place(camera, lens_height_cm))
    return Calibration(camera=camera, residuals=residuals)


def _check(frames: list[KnownFrame], marker: Marker, lens_height_cm: float | None) -> None:
    if len(frames) < LEAST_FRAMES:
        raise FilmError(
            f"expected at least {LEAST_FRAMES} frames with known poses (better 12 or more, all over the "
            f"floor), got {len(frames)}. Film the robot at more places."
        )
    if lens_height_cm is not None and not lens_height_cm > marker.height_cm + 1:
        raise FilmError(
            f"lens height: expected well above the {marker.name} at {marker.height_cm:g} cm, "
            f"got {lens_height_cm:g} cm."
        )
    first = frames[0]
    for frame in frames:
        if frame.picture.shape != first.picture.shape:
            raise FilmError(
                f"{frame.name}: {frame.picture.shape[1]} × {frame.picture.shape[0]} pixels, but {first.name} "
                f"has {first.picture.shape[1]} × {first.picture.shape[0]}. Take all frames with one camera."
            )
    _check_spread([frame.pose for frame in frames], "poses")


def _check_spread(poses: list[Pose], what: str) -> None:
    """Refuse poses that lie in one place or in a line: they say nothing across it."""
    places = np.array([(pose.x, pose.y) for pose in poses])
    _, (long, broad), _ = np.linalg.svd(places - places.mean(0), full_matrices=False)
    if long / math.sqrt(len(poses)) < 1.0:
        raise FilmError(f"the {what} all lie at one place. Put the robot all over the floor.")
    if broad < _LEAST_SPREAD * long:
        raise FilmError(
            f"the {what} lie in a line: nothing is known beside it. Put the robot all over the floor."
        )


def _without_camera(
    pictures: list[Grey], marker: Marker, report: Callable[[int], None]
) -> list[NDArray[Any] | None]:
    """Where the marker's points are in each picture, [n, 2] px; `report` is given the pictures done."""
    if not isinstance(marker, Tag):
        return first_look(pictures, marker, report)
    looks: list[NDArray[Any] | None] = []
    for done, picture in enumerate(pictures):
        seen = seen_in(picture, marker, 1) or seen_in(picture, marker, 3)
        looks.append(seen[0][0] if len(seen) == 1 and seen[0][1] >= BELIEVED else None)
        report(done + 1)
    return looks


def _closely(finder: Finder | TagFinder, frame: KnownFrame) -> NDArray[Any] | None:
    """The marker of a frame, in pixels, where the first camera expects it, or wherever it is."""
    seen = finder.near(frame.picture, np.array([frame.pose.x, frame.pose.y]))
    if seen is None or seen.quality < finder.known_again:
        seen = finder.anywhere(frame.picture)
    if seen is None or seen.quality < finder.known_again:
        return None
    return finder.camera.to_pixels(seen.points)


def _fitted(
    frames: list[KnownFrame], seen: list[NDArray[Any] | None], marker: Marker, before: CameraModel | None
) -> CameraModel:
    """The camera that explains what was seen, maybe through the camera before it."""
    pairs = [(frame, pixels) for frame, pixels in zip(frames, seen, strict=True) if pixels is not None]
    if len(pairs) < LEAST_FRAMES:
        unseen = next(frame.picture for frame, one in zip(frames, seen, strict=True) if one is None)
        doubt = why_not(unseen, marker, before) if isinstance(marker, Tag) else ""
        cure = f"Check that the robot carries the {marker.name}, and its sizes, or take more frames."
        few = f"the {marker.name} is seen in {len(pairs)} of {len(frames)} frames, {LEAST_FRAMES} are needed."
        raise FilmError(f"{few} {doubt or cure}")
    used = [frame.pose for frame, _ in pairs]
    _check_spread(used, f"poses of the frames in which the {marker.name} is seen")
    scale = np.median([math.dist(*pixels[:2]) for _, pixels in pairs]) / math.dist(*marker.points[:2])
    height, width = frames[0].picture.shape
    camera = fit_camera(
        np.concatenate([on_floor(marker.points, pose) for pose in used]),
        np.concatenate([pixels for _, pixels in pairs]),
        (width, height),
        plane_cm=marker.height_cm,
        radial=len(pairs) >= LEAST_FOR_RADIAL,
        tolerance_px=(_TOLERANCE_CM if before else 2 * _TOLERANCE_CM) * float(scale),
    )
    if camera is not None:
        near = [_residual(camera, marker, frame, one).used for frame, one in pairs]
        if sum(near) >= max(LEAST_FRAMES, len(near) / 2):
            return camera
    raise FilmError(
        "no camera explains these poses: what is seen does not match the table. Check that every "
        "pose belongs to its frame, x to the right and y up as seen from above, headings in degrees "
        "counter-clockwise from +x."
    )


def _residual(
    camera: CameraModel, marker: Marker, frame: KnownFrame, pixels: NDArray[Any] | None
) -> Residual:
    """How far off the marker of a frame is seen through a camera."""
    if pixels is None:
        return Residual(frame=frame.name, x_mm=None, y_mm=None, heading_deg=None, used=False)
    pose, true = marker.pose_of(camera.to_floor(pixels)), frame.pose
    x, y = 10 * (pose.x - true.x), 10 * (pose.y - true.y)
    heading = Pose(x=0, y=0, heading=pose.heading - true.heading).heading_deg
    used = math.hypot(x, y) <= 10 * _TOLERANCE_CM and abs(heading) <= _TOLERANCE_DEG
    return Residual(frame=frame.name, x_mm=x, y_mm=y, heading_deg=heading, used=used)
