"""What the robot wears under the camera: the paper's disk, or an ArUco or AprilTag marker."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.film.camera import CameraModel
from realitygap.film.disk import Disk, load_disk
from realitygap.film.finder import Finder, first_look
from realitygap.film.pattern import Grey
from realitygap.film.tag import BELIEVED, Tag, TagFinder, seen_in

__all__ = ["Marker", "finder_of", "load_marker", "without_camera"]

Marker = Disk | Tag


def load_marker(marker: str | None = None, disk: str | Path | None = None) -> Marker:
    """The marker that a person names: "disk", or a tag as `Tag.parse` reads it; `disk` is a disk's own file.

    Raises:
        FilmError: no such marker, a file that is none, or a disk's file beside a tag.
    """
    if marker is None or marker == "disk":
        return load_disk(disk)
    if disk is not None:
        raise FilmError(f"disk: expected no disk beside --marker {marker}. Leave one of them out.")
    return Tag.parse(marker)


def finder_of(camera: CameraModel, marker: Marker) -> Finder | TagFinder:
    """What looks for a marker through a camera.

    Raises:
        FilmError: a camera that does not fit the marker.
    """
    return Finder(camera, marker) if isinstance(marker, Disk) else TagFinder(camera, marker)


def without_camera(
    pictures: list[Grey], marker: Marker, report: Callable[[int], None]
) -> list[NDArray[np.float64] | None]:
    """Where the marker's points are in each picture, [n, 2] px; `report` is given the pictures done."""
    if isinstance(marker, Disk):
        return first_look(pictures, marker, report)
    looks: list[NDArray[np.float64] | None] = []
    for done, picture in enumerate(pictures):
        seen = seen_in(picture, marker, 1) or seen_in(picture, marker, 3)
        looks.append(seen[0][0] if len(seen) == 1 and seen[0][1] >= BELIEVED else None)
        report(done + 1)
    return looks
