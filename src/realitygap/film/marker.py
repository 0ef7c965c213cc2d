"""What the robot wears under the camera: the paper's disk, or an ArUco or AprilTag marker."""

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.files import refuse_unknown
from realitygap.film.disk import Disk, load_disk
from realitygap.values import Floats, Pose

__all__ = ["Marker", "Tag", "load_marker", "on_floor"]

USUAL = {"aruco": "4x4_50", "apriltag": "36h11"}
"""The families, and the default dictionary of each."""

SETTINGS = {"size": 1.0, "x": -1e4, "y": -1e4, "angle": -1e4, "height": 0.0}
LARGEST = 1e4
"""The least and the largest of each setting, mm or degrees."""


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
    """The marker that a person names: "disk", or a tag as `Tag.parse` reads it; `disk` is a disk's own file.

    Raises:
        FilmError: no such marker, an invalid file, or a disk's file with a tag.
    """
    if marker is None or marker == "disk":
        return load_disk(disk)
    if disk is not None:
        raise FilmError(f"disk: expected no disk with --marker {marker}. Leave one of them out.")
    return Tag.parse(marker)


def on_floor(points: Floats, pose: Pose) -> Floats:
    """Where points [n, 2] (cm ahead and to the left of a robot's centre) are if it has a pose, [n, 2] cm."""
    c, s = math.cos(pose.heading), math.sin(pose.heading)
    ahead, left = points.T
    return np.stack([pose.x + (c * ahead - s * left), pose.y + (s * ahead + c * left)], 1)
