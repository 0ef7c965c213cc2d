"""Calibrates the overhead camera from frames in which the robot's pose is known: a folder of pictures and
a table of poses.

The marker is first looked for without any camera. Its points in every frame (a disk's two patches, a tag's
corners) then have known places, and a camera is fitted to them; with that camera the frames are looked at
again, closely, and it is fitted once more.

The fit begins with a homography that most points agree on (RANSAC), so that one mistyped pose spoils nothing;
then its eight numbers and the lens's two radial terms are fitted to all points that agree (least squares).
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
from realitygap.film.disk import DiskFinder, Grey, first_look
from realitygap.film.tag import FOUND_ANEW, Marker, Tag, TagFinder, finder_of, on_floor, seen_in, why_not
from realitygap.values import Floats, Pose

__all__ = ["Calibration", "KnownFrame", "Residual", "calibrate_camera", "read_frames"]

FLOOR_CM = 3.0
"""Poses on a floor reach farther than that: a robot's radius."""

LEAST_FRAMES, LEAST_FOR_RADIAL = 4, 6
"""Frames needed for a homography, and to fit how the lens bends."""

_LEAST_SPREAD = 0.15
"""Spread that the poses need across their longest direction, as a share of it."""

_TOLERANCE_CM, _TOLERANCE_DEG = 0.6, 15.0
"""A pose farther off than this from what the others say is left out."""

USUAL_DEG = (12.0, 150.0)
"""From corner to corner, what lenses above a floor see: from a long one at a hall's ceiling to a fish-eye."""

_PRIOR_PX = 0.2
"""Radial terms of size 1 cost as much as one point being this far off: only points can call for them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownFrame:
    """A picture [height, width] in which the robot stood at a known pose."""

    name: str
    picture: NDArray[np.uint8]
    pose: Pose


@dataclass(frozen=True, kw_only=True)
class Residual:
    """How far the tracked pose is from the given one: mm and degrees; None where the marker was not found.
    `used` says whether the frame took part in the fit."""

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
        field = _field_deg(self.camera)
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
    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
    frames: list[KnownFrame] = []
    table = read_table(poses, FilmError, needs=("frame", "x_cm", "y_cm", "heading_deg"))
    columns = (table.numbers(name) for name in ("x_cm", "y_cm", "heading_deg"))
    for line, name, *pose in zip(table.lines, table.texts("frame"), *columns, strict=True):
        found = [path for path in files if path.name == name] or [path for path in files if path.stem == name]
        if len(found) != 1:
            raise FilmError(
                f"{poses}, line {line}: frame {name!r}: there is no such picture in {folder}, or several. "
                "Give the picture's file name."
            )
        data = np.fromfile(found[0], np.uint8)
        picture = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
        if picture is None:
            raise FilmError(f"{found[0]}: not a picture. Give frames as PNG or JPEG.")
        known = np.asarray(picture, np.uint8)
        frames.append(KnownFrame(name=found[0].name, picture=known, pose=Pose.from_degrees(*pose)))
    reach = max((abs(value) for one in frames for value in (one.pose.x, one.pose.y)), default=FLOOR_CM)
    if reach < FLOOR_CM:
        raise FilmError(
            f"{poses}: expected poses all over the floor in cm, got x and y of {reach:.2g} cm at most. "
            "Are they in metres?"
        )
    return frames


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
    sizes = {frame.picture.shape: frame.name for frame in frames}
    if len(sizes) > 1:
        told = ", ".join(f"{name} has {width} × {height}" for (height, width), name in sizes.items())
        raise FilmError(f"pictures of different sizes: {told} pixels. Take all frames with one camera.")
    _check_spread([frame.pose for frame in frames], "poses")
    report, count = on_progress or (lambda done, total: None), len(frames)
    seen = _without_camera([f.picture for f in frames], marker, lambda done: report(done, 3 * count))
    camera = _fitted(frames, seen, marker, None)
    for turn in (2, 3):
        finder = finder_of(camera, marker)
        seen = [_closely(finder, frame) for frame in frames]
        camera = _fitted(frames, seen, marker, camera)
        report(turn * count, 3 * count)
    residuals = tuple(_residual(camera, marker, frame, one) for frame, one in zip(frames, seen, strict=True))
    if lens_height_cm is not None:
        camera = replace(camera, lens_cm=lens_place(camera, lens_height_cm))
    return Calibration(camera=camera, residuals=residuals)


def _check_spread(poses: list[Pose], what: str) -> None:
    """Refuse poses that lie in one place or in a line: they say nothing across it."""
    places = np.array([(pose.x, pose.y) for pose in poses])
    _, (long, broad), _ = np.linalg.svd(places - places.mean(0), full_matrices=False)
    if long / math.sqrt(len(poses)) < 1.0 or broad < _LEAST_SPREAD * long:
        raise FilmError(f"the {what} all lie at one place or in a line. Put the robot all over the floor.")


def _without_camera(
    pictures: list[Grey], marker: Marker, report: Callable[[int], None]
) -> list[Floats | None]:
    """Where the marker's points are in each picture, [n, 2] px; `report` is given the pictures done."""
    if not isinstance(marker, Tag):
        return first_look(pictures, marker, report)
    looks: list[Floats | None] = []
    for done, picture in enumerate(pictures):
        seen = seen_in(picture, marker) or seen_in(picture, marker, 4)
        looks.append(seen[0][0] if len(seen) == 1 and seen[0][1] >= FOUND_ANEW else None)
        report(done + 1)
    return looks


def _closely(finder: DiskFinder | TagFinder, frame: KnownFrame) -> Floats | None:
    """The marker of a frame, in pixels, where the first camera expects it, or wherever it is."""
    seen = finder.near(frame.picture, np.array([frame.pose.x, frame.pose.y]))
    if seen is None or seen.quality < finder.known_again:
        seen = finder.anywhere(frame.picture)
    if seen is None or seen.quality < finder.known_again:
        return None
    return finder.camera.to_pixels(seen.points)


def _fitted(
    frames: list[KnownFrame], seen: list[Floats | None], marker: Marker, before: CameraModel | None
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
    camera = _fit_camera(
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


def _residual(camera: CameraModel, marker: Marker, frame: KnownFrame, pixels: Floats | None) -> Residual:
    """How far off the marker of a frame is seen through a camera."""
    if pixels is None:
        return Residual(frame=frame.name, x_mm=None, y_mm=None, heading_deg=None, used=False)
    pose, true = marker.pose_of(camera.to_floor(pixels)), frame.pose
    x, y = 10 * (pose.x - true.x), 10 * (pose.y - true.y)
    heading = Pose(x=0, y=0, heading=pose.heading - true.heading).heading_deg
    used = math.hypot(x, y) <= 10 * _TOLERANCE_CM and abs(heading) <= _TOLERANCE_DEG
    return Residual(frame=frame.name, x_mm=x, y_mm=y, heading_deg=heading, used=used)


def _fit_camera(
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
        places, pixels: on the marker's plane, and where they were seen.
        size: width and height of the picture, px.
        plane_cm: the plane's height.
        radial: whether to fit the lens's two terms.
        tolerance_px: points farther off do not count in the vote.
    """
    from scipy.optimize import least_squares

    middle, half = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2]), math.hypot(*size) / 2
    about, spread = places.mean(0), max(float(places.std()), 1e-9)
    p, q = (places - about) / spread, (pixels - middle) / half  # of size 1, as a good fit needs them
    start, votes = cv2.findHomography(p, q, cv2.RANSAC, tolerance_px / half, maxIters=5000)
    if start is None or votes.sum() < 4:
        return None

    def shown(values: Floats) -> Floats:
        h, (k1, k2) = np.append(values[:8], 1.0).reshape(3, 3), (*values[8:], 0.0, 0.0)[:2]
        ideal = (p @ h[:2, :2].T + h[:2, 2]) / (p @ h[2, :2] + h[2, 2])[:, None]
        square = (ideal**2).sum(1, keepdims=True)
        return np.asarray(ideal * (1 + k1 * square + k2 * square * square))

    def misses(values: Floats) -> Floats:
        """How far off each point that agrees is (px), and what the radial terms cost."""
        return np.append((shown(values) - q)[agree].ravel() * half, _PRIOR_PX * values[8:])

    agree = votes.ravel() > 0
    values = np.append(start.ravel()[:8] / start[2, 2], [0.0, 0.0] if radial else [])
    for _ in range(3):  # the lens's bend may have kept good points out of the vote
        values = least_squares(misses, values, method="lm", xtol=1e-12, ftol=1e-12).x
        far = np.hypot(*(shown(values) - q).T) * half
        agree = far <= max(tolerance_px / 3, 4 * float(np.median(far)))
    back = np.array([[half, 0, middle[0]], [0, half, middle[1]], [0, 0, 1.0]])
    onto = np.array([[1 / spread, 0, -about[0] / spread], [0, 1 / spread, -about[1] / spread], [0, 0, 1]])
    return CameraModel(
        width_px=size[0],
        height_px=size[1],
        homography=back @ np.append(values[:8], 1.0).reshape(3, 3) @ onto,
        radial=(float(values[8]), float(values[9])) if radial else (0.0, 0.0),
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


def _field_deg(camera: CameraModel) -> float:
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
