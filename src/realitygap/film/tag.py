"""What the robot wears under the camera in the disk's place: an ArUco or AprilTag marker, a square of black
and white cells that anybody can print; and what finds it in a picture.

OpenCV finds a marker and reads its number. Where it lies is then taken from all its cells: the marker's own
picture is moved over the film's until the two correlate best (Evangelidis and Psarakis 2008).
"""

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.files import refuse_unknown
from realitygap.film.camera import CameraModel
from realitygap.film.disk import REACH_CM, Disk, DiskFinder, Grey, Sighting, load_disk
from realitygap.values import Floats, Pose

__all__ = ["Marker", "Tag", "TagFinder", "finder_of", "load_marker", "on_floor", "seen_in", "why_not"]

USUAL = {"aruco": "4x4_50", "apriltag": "36h11"}
"""The families, and the default dictionary of each."""

SETTINGS = {"size": 1.0, "x": -1e4, "y": -1e4, "angle": -1e4, "height": 0.0}
LARGEST = 1e4
"""The least and the largest of each setting, mm or degrees."""

KNOWN_AGAIN, FOUND_ANEW = 0.7, 0.8
"""Correlation with its own picture from which a marker is believed near its last place, and anywhere."""

SIZE_TOLERANCE = 0.08
"""By how much, as a share, a marker may seem larger or smaller than it was described."""

_LEAST_PX, _FINE_PX = 1.5, 6.0
"""Pixels along a cell: that a film needs, and that pictures are enlarged to, to be read."""
_ENLARGED = 2
"""By how much pictures are enlarged at least: OpenCV's corners are finer then."""
_CELL_PX = 8
"""Pixels along a cell of the tag's own picture."""


@dataclass(frozen=True, kw_only=True)
class Tag:
    """A square marker on a robot; lengths in mm, as a person measures them.

    Attributes:
        family, dictionary: "aruco" or "apriltag", and by OpenCV's name "4x4_50", "36h11" …
        number: which of the dictionary's markers.
        size: side of the black square.
        x, y: its middle, ahead and to the left of the robot's centre.
        angle: how far its upper side is turned from straight ahead, degrees counter-clockwise.
        height: above the floor.

    Raises:
        FilmError: an unknown marker, an impossible length.
    """

    name = "marker"
    family: str = "aruco"
    dictionary: str = "4x4_50"
    number: int = 0
    size: float = 30.0
    x: float = 0.0
    y: float = 0.0
    angle: float = 0.0
    height: float = 30.0

    def __post_init__(self) -> None:
        if self.family not in USUAL or not hasattr(cv2.aruco, self._constant):
            known = "4x4_50, 5x5_100 … 7x7_1000 of aruco; 16h5, 25h9, 36h10, 36h11 of apriltag"
            raise FilmError(f"marker: expected one of {known}; got {self.dictionary} of {self.family}.")
        last = len(self.known.bytesList) - 1
        if not 0 <= self.number <= last:
            raise FilmError(f"marker: {self.dictionary} has the numbers 0 to {last}, got {self.number}.")
        for key, least in SETTINGS.items():
            if not least <= getattr(self, key) <= LARGEST:
                expected = f"{least:g} to {LARGEST:g} {'degrees' if key == 'angle' else 'mm'}"
                raise FilmError(f"marker: {key}: expected {expected}, got {getattr(self, key):g}.")

    @classmethod
    def parse(cls, text: str) -> Self:
        """A marker as a person writes it: "aruco:4x4_50:7,size=40,x=-5,y=0,angle=90,height=32".

        Everything but the family may be omitted.

        Raises:
            FilmError: says what was expected.
        """
        names, *settings = text.split(",")
        family, *which = names.split(":")
        try:
            dictionary, number = (*which, *("", "0")[len(which) :])
            what = {"dictionary": dictionary.lower() or USUAL[family], "number": int(number)}
            values = {key.strip(): float(value) for key, value in (one.split("=") for one in settings)}
        except (ValueError, KeyError):
            raise FilmError(
                "marker: expected disk, aruco:DICTIONARY:NUMBER or apriltag:FAMILY:NUMBER, and after it any "
                f"of ,size=MM ,x=MM ,y=MM ,angle=DEGREES ,height=MM; got {text!r}."
            ) from None
        refuse_unknown(values, SETTINGS, FilmError, where="marker")
        return cls(family=family, **what, **values)  # type: ignore[arg-type]

    def __str__(self) -> str:
        changed = [f.name for f in fields(self) if f.name in SETTINGS and getattr(self, f.name) != f.default]
        settings = [f",{key}={getattr(self, key):.10g}" for key in changed]
        return f"{self.family}:{self.dictionary}:{self.number}{''.join(settings)}"

    @property
    def known(self) -> Any:
        """OpenCV's dictionary."""
        return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self._constant))

    @property
    def cells(self) -> NDArray[np.uint8]:
        """Its cells from the upper left one on, the black rim included, [n, n]: 1 where one is white."""
        side = self.known.markerSize + 2
        return np.asarray(cv2.aruco.generateImageMarker(self.known, self.number, side) // 255, np.uint8)

    @property
    def height_cm(self) -> float:
        """Of its face above the floor."""
        return self.height / 10

    @property
    def radius_cm(self) -> float:
        """How far from the robot's centre it reaches."""
        return float(np.hypot(*self.points.T).max())

    @property
    def points(self) -> Floats:
        """Its corners, clockwise from the upper left one, [4, 2] cm ahead and to the left of the centre."""
        corners = self.size / 20 * np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
        return on_floor(corners, Pose.from_degrees(self.x / 10, self.y / 10, self.angle))

    def pose_of(self, points: Floats) -> Pose:
        """The pose of a robot whose marker's corners are seen at these places, [4, 2] cm (least squares)."""
        mine, middle = self.points, self.points.mean(0)
        (ax, ay), (bx, by) = (mine - middle).T, (points - points.mean(0)).T
        turn = math.atan2((ax * by - ay * bx).sum(), (ax * bx + ay * by).sum())
        x, y = points.mean(0) - on_floor(middle[None], Pose(x=0.0, y=0.0, heading=turn))[0]
        return Pose(x=float(x), y=float(y), heading=turn)

    @property
    def _constant(self) -> str:
        return f"DICT_{'APRILTAG_' if self.family == 'apriltag' else ''}{self.dictionary.upper()}"


Marker = Disk | Tag


def load_marker(marker: str | None = None, disk: str | Path | None = None) -> Marker:
    """The marker that a person names: "disk", a disk's own FILE.toml (or `disk`), or a tag (`Tag.parse`).

    Raises:
        FilmError: no such marker, an invalid file, or a disk's file with a tag.
    """
    if marker is None or marker == "disk":
        return load_disk(disk)
    if disk is not None:
        raise FilmError(f"disk: expected no disk with --marker {marker}. Leave one of them out.")
    return load_disk(marker) if marker.endswith(".toml") else Tag.parse(marker)


def on_floor(points: Floats, pose: Pose) -> Floats:
    """Where points [n, 2] (cm ahead and to the left of a robot's centre) are if it has a pose, [n, 2] cm."""
    c, s = math.cos(pose.heading), math.sin(pose.heading)
    ahead, left = points.T
    return np.stack([pose.x + (c * ahead - s * left), pose.y + (s * ahead + c * left)], 1)


class TagFinder:
    """Looks for one marker through one camera, as `DiskFinder` does for the disk.

    Args:
        camera: its pictures are 8 bits grey, [height, width].
        tag: what to look for.

    Raises:
        FilmError: a camera that cannot correct for the marker's height, or shows it too small.
    """

    known_again, found_anew = KNOWN_AGAIN, FOUND_ANEW

    def __init__(self, camera: CameraModel, tag: Tag) -> None:
        camera.check_height(tag.height_cm)
        self.camera, self.tag = camera, tag
        scale = camera.pixels_per_cm(camera.to_floor(camera.middle, tag.height_cm), tag.height_cm)
        cell = scale * tag.size / 10 / len(tag.cells)
        if not _LEAST_PX <= cell <= camera.width_px:
            raise FilmError(
                f"marker {tag}: size: its cells are {cell:.3g} pixels wide in this camera's pictures; "
                f"expected {_LEAST_PX:g} or more, and less than the picture. Give mm, or print it larger."
            )
        self._enlarged = max(_ENLARGED, math.ceil(_FINE_PX / cell))
        self._least_px = (
            2 * cell * len(tag.cells)
        )  # half of its perimeter: a noisy picture has many small ones

    def near(self, picture: Grey, place: Floats, reach_cm: float = REACH_CM) -> Sighting | None:
        """The marker of a robot whose centre lies within `reach_cm` of a place (cm), or None."""
        reach = reach_cm + 1.5 * self.tag.radius_cm
        square = place + reach * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
        pixels = self.camera.to_pixels(square, self.tag.height_cm)
        pixels = pixels.clip(0, (self.camera.width_px - 1, self.camera.height_px - 1))
        left, top = np.floor(pixels.min(0)).astype(int).tolist()
        right, bottom = np.ceil(pixels.max(0)).astype(int).tolist()
        seen = self._sightings(picture[top : bottom + 1, left : right + 1], (left, top))
        return _only([one for one in seen if math.dist((one.pose.x, one.pose.y), place) <= reach_cm])

    def anywhere(self, picture: Grey) -> Sighting | None:
        """The marker in the whole picture, or None: of two alike neither is believed."""
        return _only(self._sightings(picture, (0, 0)))

    def why_not(self, picture: Grey) -> str:
        """Why the marker is not found in a picture, in words, if known; else nothing."""
        return why_not(picture, self.tag, self.camera)

    def _sightings(self, picture: Grey, corner: tuple[int, int]) -> list[Sighting]:
        """Markers of its number and size; `corner` is where the picture begins in the whole one, px."""
        seen = []
        for pixels, quality in seen_in(picture, self.tag, self._enlarged, self._least_px):
            points = self.camera.to_floor(pixels + corner, self.tag.height_cm)
            if abs(_size(points) / self.tag.size - 1) <= SIZE_TOLERANCE:
                seen.append(Sighting(points, self.tag.pose_of(points), quality))
        return seen


def finder_of(camera: CameraModel, marker: Marker) -> DiskFinder | TagFinder:
    """What looks for a marker through a camera.

    Raises:
        FilmError: a camera that does not fit the marker.
    """
    return DiskFinder(camera, marker) if isinstance(marker, Disk) else TagFinder(camera, marker)


def seen_in(
    picture: Grey, tag: Tag, enlarged: int = _ENLARGED, least_px: float = 0.0
) -> list[tuple[Floats, float]]:
    """Corners [4, 2] px, and correlation up to 1, of all markers of the tag's number in a picture.

    The tag's own picture is moved over the film's, from where OpenCV saw it, until the two are most alike.

    Args:
        picture: grey, [height, width].
        tag: what to look for.
        enlarged: by how much the picture is enlarged to be read.
        least_px: perimeter below which nothing is read, px.
    """
    card = np.pad(tag.cells, 1, constant_values=1).astype(np.float32)
    own = np.kron(card, np.full((_CELL_PX, _CELL_PX), 255, np.float32))
    low, high = _CELL_PX - 0.5, len(own) - _CELL_PX - 0.5
    square = np.array([(low, low, 1), (high, low, 1), (high, high, 1), (low, high, 1)])
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-5)
    seen = []
    for corners in _read(picture, tag, enlarged, least_px)[0]:
        onto = np.linalg.lstsq(square, corners, rcond=None)[0].T.astype(np.float32, order="C")
        try:
            light = picture.astype(np.float32)
            quality, onto = cv2.findTransformECC(own, light, onto, cv2.MOTION_AFFINE, stop, None, 1)
        except cv2.error:  # it does not converge
            continue
        seen.append((square @ onto.T.astype(float), float(quality)))
    return seen


def why_not(picture: Grey, tag: Tag, camera: CameraModel | None = None) -> str:
    """Why a marker is not found in a picture, in words, if known; else nothing."""
    mine, others = _read(picture, tag)
    if len(mine) > 1:
        return f"Marker {tag} is seen {len(mine)} times in one picture: cover all but the robot's."
    if mine:
        size = tag.size if camera is None else _size(camera.to_floor(mine[0], tag.height_cm))
        cure = "Give its size and height as measured, and the camera that filmed it."
        off = abs(size / tag.size - 1) > SIZE_TOLERANCE
        return f"Marker {tag} is seen {size:.3g} mm wide, not {tag.size:g} mm. {cure}" if off else ""
    if others:
        numbers = ", ".join(map(str, sorted(set(others))))
        return f"What is seen is number {numbers} of {tag.dictionary}: give the robot's number."
    if _read(picture[:, ::-1], tag)[0]:
        return (
            f"Marker {tag} is seen as in a mirror: turn off the camera's mirroring; film and calibrate again."
        )
    return ""


def _read(
    picture: Grey, tag: Tag, enlarged: int = _ENLARGED, least_px: float = 0.0
) -> tuple[list[Floats], list[int]]:
    """Corners [4, 2] px of all markers of the tag's number, and which others of its dictionary are seen."""
    larger = cv2.resize(picture, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_CUBIC)
    how = cv2.aruco.DetectorParameters()
    how.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    how.minMarkerPerimeterRate = max(how.minMarkerPerimeterRate, least_px / max(picture.shape))
    found, ids, _ = cv2.aruco.ArucoDetector(tag.known, how).detectMarkers(larger)
    numbers = [] if ids is None else ids.ravel().tolist()
    mine = [one[0] for number, one in zip(numbers, found, strict=True) if number == tag.number]
    others = [number for number in numbers if number != tag.number]
    return [(corners.astype(float) + 0.5) / enlarged - 0.5 for corners in mine], others


def _only(seen: list[Sighting]) -> Sighting | None:
    return seen[0] if len(seen) == 1 else None


def _size(points: Floats) -> float:
    """The side of a square of which these are the corners (cm), mm."""
    return 10 * float(np.hypot(*(points - np.roll(points, 1, 0)).T).mean())
