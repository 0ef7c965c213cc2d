"""ArUco and AprilTag markers: squares of black and white cells that anybody prints, as OpenCV knows them.

OpenCV finds a marker and reads its number. Where it lies is then taken from all its cells: the marker's own
picture is moved over the film's until the two correlate best (Evangelidis and Psarakis 2008).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.film.camera import CameraModel
from realitygap.film.finder import REACH_CM, Look, Sighting
from realitygap.film.likeness import cells_seen, fitted, likeliest
from realitygap.film.pattern import Grey
from realitygap.text import refuse_unknown
from realitygap.values import Floats, Pose

__all__ = ["BELIEVED", "Tag", "TagFinder", "on_floor", "seen_in", "why_not"]

USUAL = {"aruco": "4x4_50", "apriltag": "36h11"}
"""The families, and the dictionary that is meant if none is named."""

SETTINGS = {"size": 1.0, "x": -1e4, "y": -1e4, "angle": -1e4, "height": 0.0}
LARGEST = 1e4
"""The least and the largest of each setting, mm or degrees."""

BELIEVED, SIZE_TOLERANCE = 0.8, 0.08
"""Correlation with its own picture from which on a marker is believed, and by how much, as a share, it may
seem larger or smaller than it was described."""

KNOWN_AGAIN, CELLS = 0.7, 0.8
"""Correlation from which on a marker is believed near its last place, and of its cells' brightness where its
number was not read: 0.84 or more of a marker in a film compressed with crf 48, 0.52 at most of another number
(measured on rendered pictures)."""

_LEAST_PX, _FINE_PX = 1.5, 6.0
"""Pixels along a cell: that a film needs; with less, pictures are enlarged to be read."""


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
        FilmError: a marker that there is not, a length that cannot be.
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
    def parse(cls, text: str) -> Tag:
        """A marker as a person writes it: "aruco:4x4_50:7,size=40,x=-5,y=0,angle=90,height=32".

        All but the family may be left out.

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


class TagFinder:
    """Looks for one marker through one camera, as `Finder` does for the disk.

    Args:
        camera: its pictures are 8 bits grey, [height, width].
        tag: what to look for.

    Raises:
        FilmError: a camera that cannot correct for the marker's height, or shows it too small.
    """

    known_again, found_anew = KNOWN_AGAIN, BELIEVED

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
        self._enlarged = math.ceil(_FINE_PX / cell)

    def near(self, picture: Grey | Look, place: Floats, reach_cm: float = REACH_CM) -> Sighting | None:
        """The marker of a robot whose centre lies within `reach_cm` of a place (cm), or None."""
        reach = reach_cm + 1.5 * self.tag.radius_cm
        square = place + reach * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
        pixels = self.camera.to_pixels(square, self.tag.height_cm)
        pixels = pixels.clip(0, (self.camera.width_px - 1, self.camera.height_px - 1))
        left, top = np.floor(pixels.min(0)).astype(int).tolist()
        right, bottom = np.ceil(pixels.max(0)).astype(int).tolist()
        window = slice(top, bottom + 1), slice(left, right + 1)
        shown = picture(window) if callable(picture) else picture
        corner = np.array([left, top])

        def within(seen: Iterable[Sighting]) -> list[Sighting]:
            return [one for one in seen if math.dist((one.pose.x, one.pose.y), place) <= reach_cm]

        read = _read(shown[window], self.tag, self._enlarged)
        mine = [corners for number, corners in read if number == self.tag.number]
        seen = within(self._sightings(shown[window], corner, mine))
        if seen or len(mine) < len(read):  # another number stands there
            return _only(seen)
        rough = likeliest(shown[window], corner, self.camera, self.tag, (place, reach_cm))
        alike = within(self._sightings(shown[window], corner, rough, CELLS))
        return max(alike, key=lambda one: one.quality, default=None)

    def anywhere(self, picture: Grey) -> Sighting | None:
        """The marker in the whole picture, or None: of two alike neither is believed."""
        whole = np.zeros(2)
        for bold, cells in ((False, -1.0), (True, CELLS)):  # misread cells are told by their brightness
            read = _read(picture, self.tag, self._enlarged, bold=bold)
            mine = [corners for number, corners in read if number == self.tag.number]
            if seen := list(self._sightings(picture, whole, mine, cells)):
                return _only(seen)
        return None

    def why_not(self, picture: Grey) -> str:
        """Why the marker is not found in a picture, if that can be told, in words; else nothing."""
        return why_not(picture, self.tag, self.camera)

    def _sightings(
        self, picture: Grey, corner: Floats, rough: list[Floats], cells: float = -1.0
    ) -> Iterator[Sighting]:
        """What is of its size, and its cells; `corner` is where the picture begins in the whole one, px."""
        for pixels, quality in fitted(picture, self.tag, rough):
            points = self.camera.to_floor(pixels + corner, self.tag.height_cm)
            alike = cells < 0 or cells_seen(picture, self.tag, pixels) >= cells
            if alike and abs(_size(points) / self.tag.size - 1) <= SIZE_TOLERANCE:
                yield Sighting(points, self.tag.pose_of(points), quality)


def on_floor(points: Floats, pose: Pose) -> Floats:
    """Where points [n, 2] (cm ahead and to the left of a robot's centre) are if it has a pose, [n, 2] cm."""
    c, s = math.cos(pose.heading), math.sin(pose.heading)
    ahead, left = points.T
    return np.stack([pose.x + (c * ahead - s * left), pose.y + (s * ahead + c * left)], 1)


def seen_in(picture: Grey, tag: Tag, enlarged: int) -> list[tuple[Floats, float]]:
    """Corners [4, 2] px, and correlation up to 1, of all markers of the tag's number in a picture.

    `enlarged` is by how much the picture is enlarged to be read.
    """
    read = _read(picture, tag, enlarged)
    return list(fitted(picture, tag, [corners for number, corners in read if number == tag.number]))


def why_not(picture: Grey, tag: Tag, camera: CameraModel | None = None) -> str:
    """Why a marker is not found in a picture, if that can be told, in words; else nothing."""
    there = _read(picture, tag, 2)
    mine = [corners for number, corners in there if number == tag.number]
    if len(mine) > 1:
        return f"Marker {tag} is seen {len(mine)} times in one picture: cover all but the robot's."
    if mine:
        size = tag.size if camera is None else _size(camera.to_floor(mine[0], tag.height_cm))
        cure = "Give its size and height as measured, and the camera that filmed it."
        off = abs(size / tag.size - 1) > SIZE_TOLERANCE
        return f"Marker {tag} is seen {size:.3g} mm wide, not {tag.size:g} mm. {cure}" if off else ""
    if there:
        numbers = ", ".join(str(number) for number in sorted({number for number, _ in there}))
        return (
            f"What is seen is number {numbers} of {tag.dictionary}: give the number that the robot carries."
        )
    if any(number == tag.number for number, _ in _read(picture[:, ::-1], tag, 2)):
        return (
            f"Marker {tag} is seen as in a mirror: turn off the camera's mirroring; film and calibrate anew."
        )
    return ""


def _read(picture: Grey, tag: Tag, enlarged: int, *, bold: bool = False) -> list[tuple[int, Floats]]:
    """Numbers and rough corners [4, 2] px of all markers of the tag's dictionary; `bold`: with as many cells
    misread as lie between two numbers."""
    larger = cv2.resize(picture, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_CUBIC)
    how = cv2.aruco.DetectorParameters()
    how.errorCorrectionRate = 1.0 if bold else how.errorCorrectionRate
    found, numbers, _ = cv2.aruco.ArucoDetector(tag.known, how).detectMarkers(larger)
    pixels = [(corners[0].astype(float) + 0.5) / enlarged - 0.5 for corners in found]
    return list(zip([] if numbers is None else numbers.ravel().tolist(), pixels, strict=True))


def _only(seen: list[Sighting]) -> Sighting | None:
    return seen[0] if len(seen) == 1 else None


def _size(points: Floats) -> float:
    """The side of a square of which these are the corners (cm), mm."""
    return 10 * float(np.hypot(*(points - np.roll(points, 1, 0)).T).mean())
