"""Trials from the files that a person has: CSV tables, JSON of `realitygap simulate`, folders of them."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

from realitygap.correspondence.trials import Trial, resampled
from realitygap.errors import TrackError
from realitygap.film.tables import read_table

__all__ = ["COLUMNS", "read_trials"]

COLUMNS = ("t_s", "x_cm", "y_cm", "heading_deg")
OPTIONAL = ("start", "unit", "quality")
Row = tuple[float, float, float, float]


def read_trials(path: str | Path) -> list[Trial]:
    """All trials of a file or a folder, in its order.

    A CSV file has columns t_s, x_cm, y_cm, heading_deg (empty or NaN where the robot was lost) and may
    have start (separates several trials), unit (which robot) and quality (0: lost), as `realitygap
    track` writes them. A JSON file is what `realitygap simulate --json` prints. In a folder every such
    file counts, its name is the start; folders in it are units.

    Raises:
        TrackError, FilmError: names the file, the line and the column.
    """
    place = Path(path)
    if not place.exists():
        raise TrackError(f"{path}: no such file or folder. Give a CSV file of tracks, or a folder of them.")
    if not place.is_dir():
        return _read_file(place, start="1", unit="")
    found = sorted(p for p in place.rglob("*") if p.suffix.lower() in (".csv", ".json") and _is_track(p))
    if not found:
        raise TrackError(
            f"{path}: expected CSV files with columns {', '.join(COLUMNS)} in this folder, got none."
        )
    trials = []
    for file in found:
        unit = str(file.parent.relative_to(place)) if file.parent != place else ""
        trials += _read_file(file, start=file.stem, unit=unit)
    return trials


def _is_track(path: Path) -> bool:
    if path.suffix.lower() == ".json":
        return isinstance(_json(path), dict) and all(name in _json(path) for name in COLUMNS)
    return all(name in _head(path) for name in COLUMNS)


def _read_file(path: Path, *, start: str, unit: str) -> list[Trial]:
    if path.suffix.lower() == ".json":
        return [_from_json(path, start, unit)]
    extra = [name for name in OPTIONAL if name in _head(path)]
    rows: dict[tuple[str, str], list[Row]] = {}
    for line, row in read_table(path, (*COLUMNS, *extra)):
        key = (row.get("start", start), row.get("unit", unit))
        if not key[0]:
            raise TrackError(f"{path}, line {line}: start: expected a name or number, got nothing.")
        lost = _number(path, line, "quality", row.get("quality", "1")) <= 0
        numbers = [_number(path, line, name, row[name]) for name in COLUMNS]
        if math.isnan(numbers[0]):
            raise TrackError(f"{path}, line {line}: t_s: expected a number, got {row['t_s']!r}.")
        place = (math.nan,) * 3 if lost else (numbers[1], numbers[2], numbers[3])
        rows.setdefault(key, []).append((numbers[0], *place))
    if not rows:
        raise TrackError(f"{path}: expected rows below its first line, got none. Film again.")
    made = []
    for (name, of), lines in rows.items():
        t, x, y, heading = zip(*lines, strict=True)
        made.append(resampled(t, x, y, heading, start=name, unit=of, source=str(path)))
    return made


def _from_json(path: Path, start: str, unit: str) -> Trial:
    data = _json(path)
    try:
        columns = [[math.nan if v is None else float(v) for v in data[name]] for name in COLUMNS]
    except (KeyError, TypeError, ValueError):
        raise TrackError(
            f"{path}: expected JSON with lists {', '.join(COLUMNS)}, as `realitygap simulate --json` prints."
        ) from None
    if len({len(column) for column in columns}) != 1:
        raise TrackError(f"{path}: expected lists of one length, got {[len(c) for c in columns]}.")
    return resampled(*columns, start=start, unit=unit, source=str(path))


def _json(path: Path) -> dict[str, list[float | None]]:
    try:
        data: dict[str, list[float | None]] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ValueError):
        return {}
    return data


def _head(path: Path) -> list[str]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return [cell.strip() for cell in next(csv.reader(file), [])]
    except (OSError, UnicodeDecodeError, csv.Error):
        return []


def _number(path: Path, line: int, name: str, text: str) -> float:
    """A cell; empty is NaN, where the robot was lost."""
    if not text:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        value = math.inf
    if math.isinf(value):
        raise TrackError(f"{path}, line {line}: {name}: expected a number, got {text!r}. Correct that line.")
    return value
