"""Readings of one Thymio II sensor facing a wall: the tables of `resilient-swarms/thymio` (MIT licence).

A file is a series of one of the seven horizontal sensors, numbered in its name (`sensor02_light.csv`). A row
has one distance ("9cm") and the readings there, in time order.
"""

import csv
import hashlib
import re
from pathlib import Path

import numpy as np

from realitygap.calibration.recordings.checks import FARTHEST_CM, copies
from realitygap.calibration.recordings.recording import SensorRecording
from realitygap.errors import RecordingError
from realitygap.files import read_text, refuse_separator

__all__ = ["LIKE", "read_thymio", "sensor_of"]

NAME = re.compile(r"sensor0*([0-6])_.*\.csv", re.IGNORECASE)
LIKE = re.compile(r"sensor.*\.csv", re.IGNORECASE)
"""Names that are meant to be a series, valid or not."""
SENSORS = 7
STALE = 2
"""The first readings of a row may still belong to the distance before."""
DISTANCE = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*(cm|mm)", re.IGNORECASE)
SHOWN = 40
"""Characters of a line shown in a message."""


def sensor_of(path: Path, cure: str) -> int:
    """Number of a series' sensor, from the file's name.

    Raises:
        RecordingError: the name has none; with the cure.
    """
    named = NAME.fullmatch(path.name)
    if named is None:
        raise RecordingError(
            f"{path}: expected the name of a Thymio's series, as sensor02_light.csv, with the sensor's "
            f"number 0 to 6. {cure}"
        )
    return int(named[1])


def read_thymio(path: Path) -> SensorRecording:
    """A series as a recording of seven sensors, six of which are unknown (NaN).

    Raises:
        RecordingError: names file and line, what was expected and what came.
    """
    sensor = sensor_of(path, "Other tables are folders with a recording.toml.")
    distance, values, at = [], [], []
    told: dict[int, list[str]] = {}  # lines whose readings differ: silence repeats by itself
    lines = read_text(path, RecordingError, "Give the path of a Thymio's series.").splitlines()
    refuse_separator(path, lines, RecordingError)
    for number, line in enumerate(lines, 1):
        cells = _cells(line)
        if not any(cells):
            continue
        where = f"{path}, line {number}"
        away, counts = _row(cells, where, line)
        if len(set(counts)) > 1:
            told[number] = [cell for cell in cells if cell]
        at += [where] * len(counts)
        distance += [away] * len(counts)
        values += counts
    if not values:
        raise RecordingError(f"{path}: empty: expected a line for each distance.")
    table = np.full((len(values), SENSORS), np.nan)
    table[:, sensor] = values
    return SensorRecording(
        kind="infrared", object="wall", distance_cm=np.array(distance), bearing_deg=np.zeros(len(values)),
        repeat=np.arange(len(values)), counts=table, from_sensor=sensor, body_said=False, lines=at,
        source=str(path), hash=hashlib.sha256(path.read_bytes()).hexdigest(),
        warnings=tuple(copies(path, told, "leave them out")),
        notes=f"sensor {sensor} of a Thymio II before a wall, the first {STALE} readings of a row left out",
    )  # fmt: skip


def _cells(line: str) -> list[str]:
    """A line's cells without blanks and quotes."""
    try:
        return [cell.strip() for cell in next(csv.reader([line]), [])]
    except csv.Error:  # a cell of more than 128 KiB
        return [line]


def _row(cells: list[str], at: str, line: str) -> tuple[float, list[float]]:
    """A line's distance, cm, and its counts; an empty cell is a missing reading."""
    told = DISTANCE.fullmatch(cells[0])
    if told is None:
        raise RecordingError(f"{at}: expected a distance as in 9cm or 87.5mm, got {cells[0][:SHOWN]!r}.")
    away_cm = float(told[1]) / (10.0 if told[2].lower() == "mm" else 1.0)
    if away_cm > FARTHEST_CM:
        raise RecordingError(
            f"{at}: expected a distance of at most {FARTHEST_CM:g} cm, got {cells[0][:SHOWN]!r}. Leave the "
            "line out if nothing was near."
        )
    try:
        counts = [float(cell) for cell in cells[1 + STALE :] if cell]
    except ValueError:
        counts = []
    if not counts or not min(counts) >= 0 or not np.isfinite(counts).all():
        raise RecordingError(
            f"{at}: expected more than {STALE} readings, counts from 0 on, got {line[:SHOWN]!r}."
        )
    return away_cm, counts
