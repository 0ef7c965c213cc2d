"""A track: where the robot was in each frame of a film, and where nobody knows."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap import whole
from realitygap.errors import FilmError
from realitygap.film.tables import number, read_table

__all__ = ["COLUMNS", "Track", "read_track"]

Array = NDArray[np.float64]

COLUMNS = ("t_s", "x_cm", "y_cm", "heading_deg", "quality")


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """One row a frame, arrays [n]; where the robot was lost, place and heading are NaN and quality 0.

    Attributes:
        t_s: time after the film's first frame, s.
        x_cm, y_cm: the disk's centre, cm.
        heading_deg: where it looks, counter-clockwise from +x, −180 < h ≤ 180.
        quality: how much it looked like the disk (a correlation), 0 to 1.
    """

    t_s: Array
    x_cm: Array
    y_cm: Array
    heading_deg: Array
    quality: Array

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def found(self) -> NDArray[np.bool_]:
        """In which frames the robot was found, [n]."""
        return np.asarray(self.quality > 0)

    @property
    def lost(self) -> int:
        """In how many frames it was not."""
        return int((~self.found).sum())

    def gaps(self) -> list[tuple[float, float]]:
        """When it was lost: first and last time of each stretch, s."""
        edges = np.flatnonzero(np.diff(np.concatenate([[0], ~self.found, [0]]).astype(int)))
        return [
            (float(self.t_s[a]), float(self.t_s[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)
        ]

    def to_dict(self) -> dict[str, Any]:
        """The track as lists by column; NaN where it was lost."""
        return {name: getattr(self, name).tolist() for name in COLUMNS}

    def write_csv(self, path: str | Path) -> None:
        """Write the track, lost frames with empty values."""
        with whole.new(path) as spare, spare.open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(COLUMNS)
            for t, x, y, heading, quality in zip(*(getattr(self, name) for name in COLUMNS), strict=True):
                place = (f"{x:.4f}", f"{y:.4f}", f"{heading:.3f}") if quality > 0 else ("", "", "")
                rows.writerow((f"{t:.4f}", *place, f"{quality:.3f}" if quality > 0 else "0"))


def read_track(path: str | Path) -> Track:
    """The track of a CSV file.

    Raises:
        FilmError: a column that is missing or a value that is no number; names file and line.
    """
    table: list[list[float]] = []
    for line, row in read_table(path, COLUMNS):
        quality = number(path, line, "quality", row["quality"])
        lost = quality <= 0
        if lost and any(row[name] for name in COLUMNS[1:4]):
            raise FilmError(f"{path}, line {line}: quality is 0, so place and heading must be empty.")
        place = [np.nan if lost else number(path, line, name, row[name]) for name in COLUMNS[1:4]]
        table.append([number(path, line, "t_s", row["t_s"]), *place, max(quality, 0.0)])
    columns = np.array(table, dtype=np.float64).reshape(-1, len(COLUMNS)).T
    return Track(**dict(zip(COLUMNS, columns, strict=True)))
