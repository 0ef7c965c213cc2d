"""Where a robot was, however it was seen: one value, radians inside, degrees in its CSV.

    track = read_track("track.csv")
    track.x[track.found], track.heading_deg

A CSV file has columns t_s, x_cm, y_cm, heading_deg (−180 < h ≤ 180), and quality from a tracker;
where the robot was lost the fields of place and heading are empty. Columns start (or trial) and unit split it
into several tracks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from realitygap.errors import TrackError, UsageError
from realitygap.files import Table, atomic_write, read_table, to_csv
from realitygap.values import Floats, Pose, shown

__all__ = ["COLUMNS", "Track", "Trajectory", "read_track", "read_tracks", "settled"]

LATE_S = 0.015
"""How far from a tenth of a second a step's row is still written as that."""
COLUMNS = ("t_s", "x_cm", "y_cm", "heading_deg")
STEP_S = 0.1
"""A step of the simulation, as in `kernels.types`."""


def settled(heading: ArrayLike, *, wrapped: bool = True) -> Floats:
    """Headings (rad) once to degrees and back, which may move their last bit: −π < h ≤ π if `wrapped`.

    Scores are taken from such headings, those that were kept are: so they stay the same to the bit.
    """
    return np.radians(_degrees(heading) if wrapped else np.degrees(heading))


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """Where a robot was, a row a time, arrays [n]; where it was lost, place or heading is NaN.

    Attributes:
        t: time, s.
        x, y: the robot's centre, cm.
        heading: where it faces, rad, counter-clockwise from +x; any number of turns.
        quality: how much what a tracker saw looked like the disk, 0 (lost) to 1; None: no tracker.
        seen_by: "simulation", "camera", "film", "counters" (the wheels' own), "truth" (the twin's); "" if
            unknown.

    Raises:
        UsageError: columns of several lengths, or of no numbers.
    """

    t: Floats
    x: Floats
    y: Floats
    heading: Floats
    quality: Floats | None = None
    seen_by: str = ""

    def __post_init__(self) -> None:
        for name in self._names:
            column = getattr(self, name)
            try:
                object.__setattr__(self, name, np.asarray(column, np.float64))
            except (TypeError, ValueError):
                raise UsageError(f"track: expected {name} as numbers, got {shown(column)}.") from None
        shapes = [getattr(self, name).shape for name in self._names]
        if set(shapes) != {(self.t.size,)}:
            sizes = ", ".join(
                f"{name} {list(shape)}" for name, shape in zip(self._names, shapes, strict=True)
            )
            raise UsageError(f"track: expected columns [n] of one length, got {sizes}.")

    @property
    def _names(self) -> tuple[str, ...]:
        """Of its columns."""
        return ("t", "x", "y", "heading", *(() if self.quality is None else ("quality",)))

    @classmethod
    def from_degrees(
        cls,
        t_s: ArrayLike,
        x_cm: ArrayLike,
        y_cm: ArrayLike,
        heading_deg: ArrayLike,
        *,
        quality: ArrayLike | None = None,
        seen_by: str = "",
    ) -> Self:
        """A track from columns as in files; a row without place, heading or quality is lost altogether.

        Args:
            t_s, x_cm, y_cm, heading_deg: columns [n], NaN where there is nothing.
            quality: [n], 0 where it was lost.
            seen_by: who saw it.

        Raises:
            UsageError: columns of several lengths, or of no numbers.
        """
        told: dict[str, Any] = {"t": t_s, "x": x_cm, "y": y_cm, "heading": heading_deg, "quality": quality}
        track = cls(**told, seen_by=seen_by)
        lost = np.isnan(track.x) | np.isnan(track.y) | np.isnan(track.heading)
        if track.quality is not None:
            lost |= ~(track.quality > 0)
        columns = (track.x, track.y, np.radians(track.heading))
        x, y, heading = (np.where(lost, np.nan, column) for column in columns)
        sure = None if track.quality is None else np.where(lost, 0.0, track.quality)
        return replace(track, x=x, y=y, heading=heading, quality=sure)

    def __len__(self) -> int:
        return len(self.t)

    @property
    def heading_deg(self) -> Floats:
        """[n] degrees, −180 < h ≤ 180."""
        return _degrees(self.heading)

    @property
    def found(self) -> NDArray[np.bool_]:
        """In which rows the robot was seen, [n]."""
        return np.isfinite(self.x) & np.isfinite(self.y) & np.isfinite(self.heading)

    @property
    def lost(self) -> int:
        """In how many rows it was not."""
        return int((~self.found).sum())

    @property
    def end(self) -> Pose:
        """The last pose.

        Raises:
            UsageError: it has no rows.
        """
        if not len(self):
            raise UsageError("track: expected at least one row, got none.")
        return Pose.reached(float(self.x[-1]), float(self.y[-1]), float(self.heading[-1]))

    def gaps(self) -> list[tuple[float, float]]:
        """When it was lost: first and last time of each stretch, s."""
        edges = np.flatnonzero(np.diff(np.concatenate([[0], ~self.found, [0]]).astype(int)))
        return [
            (float(self.t[a]), float(self.t[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)
        ]

    def only(self, rows: NDArray[Any]) -> Self:
        """Some of its rows: their numbers, or a mask [n].

        Raises:
            UsageError: it has no such rows.
        """
        try:
            return replace(self, **{name: getattr(self, name)[rows] for name in self._names})
        except IndexError:
            expected = f"numbers of its {len(self)} rows, or a mask of them"
            raise UsageError(f"rows: expected {expected}, got {rows!r}.") from None

    def to_dict(self) -> dict[str, list[float]]:
        """Its columns by their names in the file, in cm and degrees; NaN where it was lost."""
        columns = (self.t, self.x, self.y, self.heading_deg, self.quality)
        names = (*COLUMNS, "quality")
        return {name: c.tolist() for name, c in zip(names, columns, strict=True) if c is not None}

    def write_csv(self, path: str | Path) -> None:
        """Write it: frames with their quality as a tracker tells them, without as rows of steps."""
        columns = self.to_dict()
        place, turn = (".6f", ".6f") if self.quality is None else (".4f", ".3f")
        # A step's rows are tenths of a second, a little late or not; with another period they are not.
        tenths = self.quality is None and (np.abs(self.t - np.round(self.t, 1)) < LATE_S).all()
        time = ".1f" if tenths else ".4f"
        rows: list[Sequence[str]] = [tuple(columns)]
        for found, t, x, y, heading, *quality in zip(self.found, *columns.values(), strict=True):
            told = (f"{x:{place}}", f"{y:{place}}", f"{heading:{turn}}") if found else ("", "", "")
            rows.append((f"{t:{time}}", *told, *(f"{q:.3f}" if found else "0" for q in quality)))
        atomic_write(path, to_csv(rows))


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """One recorded trial, a row a step; row k holds what the robot read and decided at
    `t[k]`, where it stood then, and what its wheels did in the step that follows.

    Shapes: t, x, y, heading, contact [n]; proximity [n, P]; ambient [n, A]; inputs [n, I]; left and right
    commands (−10 … 10 of the top command), wheels (the robot's units) [n, 2]. `end` is the last pose,
    `period_s` a step's time.
    """

    t: Floats
    x: Floats
    y: Floats
    heading: Floats
    proximity: Floats
    ambient: Floats
    inputs: NDArray[np.int64]
    commands: NDArray[np.int64]
    wheels: Floats
    contact: NDArray[np.bool_]
    end: Pose
    period_s: float = STEP_S

    @property
    def heading_deg(self) -> Floats:
        """[n] degrees, in as many turns as it made."""
        return np.degrees(self.heading)

    @property
    def track(self) -> Track:
        """Where it was, [n + 1]: its end is the last row."""
        end = self.end
        return Track(
            t=np.append(self.t, len(self.t) * self.period_s),
            x=np.append(self.x, end.x),
            y=np.append(self.y, end.y),
            heading=np.append(self.heading, end.heading),
            seen_by="simulation",
        )

    def to_dict(self) -> dict[str, Any]:
        """The trajectory in the units people read (cm, degrees), ready for JSON."""
        kept = ("proximity", "ambient", "inputs", "commands", "wheels", "contact")
        return {
            "t_s": self.t.round(6).tolist(),
            "x_cm": self.x.tolist(),
            "y_cm": self.y.tolist(),
            "heading_deg": self.heading_deg.tolist(),
            **{name: getattr(self, name).tolist() for name in kept},
            "end": self.end.to_dict(),
        }


def read_track(
    path: str | Path, *, seen_by: str = "", error: type[UsageError] = TrackError, cure: str = ""
) -> Track:
    """The track of a CSV file; columns that split it into several are ignored.

    Args:
        path: the file.
        seen_by: who saw it.
        error: what to raise.
        cure: what to do about a broken file, where it can be made again.

    Raises:
        UsageError: of the class `error`: no such table; names file and line.
    """
    return _track(read_table(path, error, needs=COLUMNS, cure=cure), seen_by)


def read_tracks(path: str | Path, *, start: str = "1", unit: str = "") -> dict[tuple[str, str], Track]:
    """The tracks of a CSV file by start and unit, in its order.

    Args:
        path: the file.
        start, unit: of all rows, where it has no such column.

    Raises:
        TrackError: no such table, or a row without a start; names file and line.
    """
    table = read_table(path, TrackError, needs=COLUMNS)
    every = _track(table, "")
    named = "start" if "start" in table.columns else "trial"  # as recordings of wheels have it
    starts, units = (
        table.texts(column) if column in table.columns else [said] * len(every)
        for column, said in ((named, start), ("unit", unit))
    )
    table.refuse(np.array([not name for name in starts], bool), named, "a name or number", starts)
    rows: dict[tuple[str, str], list[int]] = {}
    for k, key in enumerate(zip(starts, units, strict=True)):
        rows.setdefault(key, []).append(k)
    return {key: every.only(np.array(some)) for key, some in rows.items()}


def _track(table: Table, seen_by: str) -> Track:
    """All of a table's rows."""
    place = (table.numbers(name, empty=name != "t_s") for name in COLUMNS)
    quality = table.numbers("quality", empty=True) if "quality" in table.columns else None
    return Track.from_degrees(*place, quality=quality, seen_by=seen_by)


def _degrees(heading: ArrayLike) -> Floats:
    """−180 < h ≤ 180."""
    degrees: Floats = 180.0 - (180.0 - np.degrees(heading)) % 360.0
    return degrees
