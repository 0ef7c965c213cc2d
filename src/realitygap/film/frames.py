"""Frames in which the robot's pose is known: a folder of pictures and a table of poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.table import read_table
from realitygap.values import Pose

__all__ = ["KnownFrame", "read_frames"]

Picture = NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownFrame:
    """A picture [height, width] in which the robot stood at a known pose."""

    name: str
    picture: Picture
    pose: Pose


def read_frames(folder: str | Path, poses: str | Path) -> list[KnownFrame]:
    """The frames that a table of poses names, from a folder of pictures.

    Args:
        folder: pictures, PNG, JPEG or the like.
        poses: CSV with columns frame (a picture's name, its ending may be left out), x_cm, y_cm
            and heading_deg.

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
    """The picture of that name, with or without its ending."""
    if name and (folder / name).is_file():
        return folder / name
    alike = [path for path in sorted(folder.iterdir()) if path.stem == name and path.is_file()]
    if len(alike) != 1:
        what = f"{len(alike)} pictures are called so" if alike else f"there is no such picture in {folder}"
        raise FilmError(f"{where}: frame {name!r}: {what}. Give the picture's file name.")
    return alike[0]


def _read(path: Path) -> Picture:
    """A picture in grey."""
    data = np.fromfile(path, np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
    if picture is None:
        raise FilmError(f"{path}: not a picture. Give frames as PNG or JPEG.")
    return np.asarray(picture, np.uint8)
