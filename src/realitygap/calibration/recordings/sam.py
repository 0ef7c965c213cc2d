"""`.sam` tables of the Khepera community: readings at 180 bearings and many distances, in plain text.

The first line is `sensors bearings distances first_mm step_mm`; then for each distance a line `TURN k` and a
line of readings for each bearing, 2 degrees apart and clockwise from the front; at the end `END`.
"""

import hashlib
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from realitygap.calibration.recordings.checks import FARTHEST_CM, doubt_object
from realitygap.calibration.recordings.objects import check_object
from realitygap.calibration.recordings.recording import BODY_RADIUS_CM, SensorRecording
from realitygap.errors import RecordingError
from realitygap.files import read_text
from realitygap.values import Floats

__all__ = ["LIGHT_STEP", "read_sam"]

SENSORS, FULL = 8, 1023
"""The tables are a Khepera's: eight sensors and a 10-bit converter."""
LIGHT_SCALE, LIGHT_STEP = 500.0, 10.24
"""A light table is inverted and scaled: V = 500·(1 − x/1024), x in steps of 10.24. The 500 is an
assumption of the tables' keepers."""
NEAREST_MM, FARTHEST_MM = 1.0, 10.0 * FARTHEST_CM
"""Limits of distances in millimetres."""


class Header(NamedTuple):
    """The table's first line."""

    sensors: int
    bearings: int
    distances: int
    first_mm: float
    step_mm: float


def read_sam(path: str | Path, *, object: str | None = None, kind: str | None = None) -> SensorRecording:
    """A table as a recording.

    Its object is "wall", "cylinder:RADIUS_CM" or "lamp"; by default a wall, or a lamp if the readings lie on
    the steps of light tables. Its kind, "infrared" or "ambient", follows from the object.

    Raises:
        RecordingError: names file and line, what was expected and what came.
    """
    path = Path(path)
    lines = _lines(path)
    header = _header(path, lines)
    table = _table(path, lines, header)
    light = _looks_like_light(table)
    said = object or ("lamp" if kind == "ambient" or (kind is None and light) else "wall")
    kind = kind or ("ambient" if said == "lamp" else "infrared")
    check_object(kind, said, str(path))
    _refuse_other_kind(path, kind, light, table)
    distance = (header.first_mm + header.step_mm * np.arange(header.distances)) / 10.0
    bearing = -360.0 / header.bearings * np.arange(header.bearings)
    guessed = () if object else (f"{path}: its object is not said; taken for a {said} (--object says it)",)
    return SensorRecording(
        kind=kind,
        object=said,
        distance_cm=np.repeat(distance, header.bearings),
        bearing_deg=np.tile(180.0 - (180.0 - bearing) % 360.0, header.distances),
        repeat=np.zeros(len(table), np.int64),
        counts=LIGHT_SCALE * (1.0 - table / 1024.0) if kind == "ambient" else table,
        body_radius_cm=BODY_RADIUS_CM,
        full_scale=FULL,
        reflectance=math.nan if said.startswith("cylinder") else 1.0,  # the table says nothing of its surface
        source=str(path),
        hash=hashlib.sha256(path.read_bytes()).hexdigest(),
        notes=f"a .sam table, {header.distances} distances and {header.bearings} bearings, one reading each",
        warnings=(*guessed, *doubt_object(said, path)),
    )


def _lines(path: Path) -> list[str]:
    text = read_text(path, RecordingError, "Give the path of a .sam table.")
    lines = [line.strip() for line in text.splitlines()]
    while lines and not lines[-1]:
        lines.pop()
    if not lines:
        raise RecordingError(f"{path}: empty: expected a table that begins `8 180 20 5 2`.")
    return lines


def _header(path: Path, lines: list[str]) -> Header:
    words = lines[0].split()
    expected = "`sensors bearings distances first_mm step_mm`, as in `8 180 20 5 2`"
    try:
        counts, ways = [int(word) for word in words[:3]], [float(word) for word in words[3:]]
    except ValueError:
        raise RecordingError(f"{path}, line 1: expected {expected}, got {lines[0]!r}.") from None
    if len(words) != 5:
        raise RecordingError(f"{path}, line 1: expected five numbers {expected}, got {len(words)}.")
    header = Header(*counts, *ways)
    if header.sensors != SENSORS:
        raise RecordingError(
            f"{path}, line 1: sensors: expected {SENSORS}, as a Khepera has, got {header.sensors}."
        )
    for name, value, low in (("bearings", header.bearings, 8), ("distances", header.distances, 3)):
        if value < low:
            raise RecordingError(f"{path}, line 1: {name}: expected {low} or more, got {value}.")
    if not header.first_mm >= 0:
        raise RecordingError(f"{path}, line 1: first_mm: expected 0 or more, got {header.first_mm:g}.")
    if not header.step_mm > 0:
        raise RecordingError(f"{path}, line 1: step_mm: expected more than 0, got {header.step_mm:g}.")
    last = header.first_mm + header.step_mm * (header.distances - 1)
    if not NEAREST_MM <= last <= FARTHEST_MM or header.step_mm < 0.1:
        raise RecordingError(
            f"{path}, line 1: the distances reach from {header.first_mm:g} to {last:g} mm, which no table of "
            "a Khepera does. Are these millimetres?"
        )
    return header


def _table(path: Path, lines: list[str], header: Header) -> Floats:
    """[distances · bearings, sensors] the table's readings, unscaled."""
    out: list[list[int]] = []
    many, expected = header.distances * header.bearings, header.bearings + 1
    for number, line in enumerate(lines[1:], 2):
        block, place = divmod(number - 2, expected)
        if block == header.distances:
            if line.upper() != "END" or number != len(lines):
                raise RecordingError(
                    f"{path}, line {number}: expected END and nothing after it, got {line[:40]!r}."
                )
            return np.array(out, float)
        if place == 0:
            words = line.split()  # the number itself is wrong in some otherwise valid tables
            if len(words) != 2 or words[0].upper() != "TURN" or not words[1].isdigit():
                raise RecordingError(f"{path}, line {number}: expected `TURN {block}`, got {line[:40]!r}.")
            continue
        out.append(_readings(path, number, line, header.sensors))
    raise RecordingError(
        f"{path}, line {len(lines)}: the table ends here, after {len(out)} of {many} rows of readings"
        + ("; END is missing" if len(out) == many else "")
        + ". It is cut short: fetch it again."
    )


def _readings(path: Path, number: int, line: str, sensors: int) -> list[int]:
    words = line.split()
    if len(words) != sensors:
        raise RecordingError(
            f"{path}, line {number}: expected {sensors} readings, got {len(words)}: {line[:40]!r}."
        )
    out = []
    for k, word in enumerate(words):
        try:
            value = int(word)
        except ValueError:
            value = -1
        if not 0 <= value <= FULL:
            raise RecordingError(
                f"{path}, line {number}: sensor {k}: expected a whole number from 0 to {FULL}, got {word!r}."
            )
        out.append(value)
    return out


def _looks_like_light(table: Floats) -> bool:
    """Whether every reading lies on the steps of light tables, truncated to integers."""
    steps = np.rint(table / LIGHT_STEP) * LIGHT_STEP
    return bool((np.abs(table - steps) < 1.0).all() and len(np.unique(table)) > 3)


def _refuse_other_kind(path: Path, kind: str, light: bool, table: Floats) -> None:
    if kind == "infrared" and light:
        raise RecordingError(
            f"{path}: every reading lies on a step of {LIGHT_STEP}, as in tables of ambient light. "
            "Give --object lamp."
        )
    ends = ((table >= FULL) | (table < LIGHT_STEP)).mean()
    if kind == "ambient" and not light and ends > 0.5:
        raise RecordingError(
            f"{path}: {ends:.0%} of the readings lie at the ends 0 and {FULL}, as in tables of proximity. "
            "Give --object wall or cylinder:RADIUS_CM."
        )
