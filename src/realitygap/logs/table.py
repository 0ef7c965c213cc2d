"""Reads tables that other programs wrote: any separator, decimal commas, comments, names that do not fit."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from math import nan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import RecordingError
from realitygap.logs.cuts import many
from realitygap.values import Floats

__all__ = ["Log", "read_log"]

SEPARATORS = {",": "commas", ";": "semicolons", "|": "bars", "\t": "tabs", " ": "blanks"}
COMMENT = ("#", "%", "//")
SAMPLE = 400
"""Lines by which the separator is found."""
FEWEST = 3
"""Rows of a log at least."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Log:
    """A table of numbers in a text file.

    Attributes:
        names: [c] of the columns, their numbers from 1 on where the file has none.
        values: [n, c] NaN where a cell is no number; dates are seconds.
        cells: [n][c] the same as texts.
        lines: [n] of the file.
        separator: in words; head: the line of the names, 0 without.
        notes: what was guessed or left out, in words.
    """

    path: Path
    names: tuple[str, ...]
    values: Floats = field(repr=False)
    cells: Sequence[Sequence[str]] = field(repr=False)
    lines: NDArray[np.int64] = field(repr=False)
    separator: str
    head: int
    notes: tuple[str, ...]


def read_log(path: str | Path) -> Log:
    """The table of a text file.

    Raises:
        RecordingError: no such file, no text, or no table of numbers in it.
    """
    path, notes = Path(path), []
    try:
        data = path.read_bytes()
    except OSError as why:
        raise RecordingError(f"{path}: cannot be read ({why.strerror}). Give a text file.") from None
    if b"\0" in data:
        raise RecordingError(f"{path}: expected a text file, got binary data. Export it as CSV first.")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    lines = text.splitlines()
    body = [k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(COMMENT)]
    middle = body[len(body) // 10 :][:SAMPLE]
    share, wide, sign = max((*_fit(lines, middle, sign), sign) for sign in SEPARATORS)
    closed = all(not _split(lines[k], sign)[-1] for k in middle) and sign != " "
    rows: dict[int, list[str]] = {}
    for k in body:
        row = _split(lines[k], sign)
        if len(row) == wide and _numeric(row):
            rows[k] = row[:-1] if closed else row
    wide -= closed
    if share < 0.5 or wide < 2 or len(rows) < FEWEST:
        raise RecordingError(
            f"{path}: expected a table of numbers, a row a time, separated by "
            f"{', '.join(SEPARATORS.values())}; found none. Export it as CSV first."
        )
    first = next(iter(rows))
    left = [k for k in body if k > first and k not in rows]
    if left:
        some = ", ".join(str(k + 1) for k in left[:3]) + (" …" if len(left) > 3 else "")
        notes.append(f"{many(len(left), 'line')} left out: no rows of {wide} values (line {some})")
    cells = list(rows.values())
    values = np.stack([_numbers(column) for column in zip(*cells, strict=True)], 1)
    head, names = _names(lines, first, sign, wide, values, notes)
    return Log(
        path=path, names=names, values=values, cells=cells, lines=np.array(list(rows), np.int64) + 1,
        separator=SEPARATORS[sign], head=head, notes=tuple(notes),
    )  # fmt: skip


def _split(line: str, sign: str) -> list[str]:
    """A line's cells."""
    if sign == " ":
        return line.split()
    cells = next(csv.reader([line], delimiter=sign)) if '"' in line else line.split(sign)
    return [cell.strip() for cell in cells]


def _fit(lines: Sequence[str], some: Sequence[int], sign: str) -> tuple[float, int]:
    """Share of cells that are numbers in rows of the commonest width, and that width."""
    split = [_split(lines[k], sign) for k in some]
    ((wide, _),) = Counter(map(len, split)).most_common(1) or [(0, 0)]
    cells = [cell for row in split if len(row) == wide for cell in row]
    good = sum(not np.isnan(_number(cell)) or not cell or bool(_date(cell)) for cell in cells)
    share = good / max(sum(map(len, split)), 1)
    return (share if wide > 1 else 0.0), wide


def _numeric(cells: Sequence[str]) -> bool:
    return any(not np.isnan(_number(cell)) for cell in cells)


def _number(cell: str) -> float:
    """NaN where there is none; a decimal comma is a point."""
    try:
        return float(cell)
    except ValueError:
        pass
    try:
        return float(cell.replace(",", ".")) if cell.count(",") == 1 else nan
    except ValueError:
        return nan


def _date(cell: str) -> float:
    """Seconds of an ISO date and time; 0 of anything else."""
    try:
        return datetime.fromisoformat(cell).timestamp() if len(cell) > 12 and cell[4] == "-" else 0.0
    except ValueError:
        return 0.0


def _numbers(column: Sequence[str]) -> Floats:
    found = np.array([_number(cell) for cell in column])
    if np.isnan(found).all() and _date(column[0]):
        return np.array([_date(cell) or nan for cell in column])
    return np.where(np.isfinite(found), found, nan)


def _names(
    lines: Sequence[str], first: int, sign: str, wide: int, values: Floats, notes: list[str]
) -> tuple[int, tuple[str, ...]]:
    """The line of the columns' names, 0 without one, and the names: the last line above the rows that holds
    about as many words as they have values, a comment or not."""
    numbers = [str(k + 1) for k in range(wide)]
    for k in range(first - 1, -1, -1):
        text = lines[k].lstrip().lstrip("#%/").strip()
        found = _split(text, sign)
        found = found[:-1] if len(found) == wide + 1 and not found[-1] else found
        if sign == " " and len(found) != wide:  # names may hold single blanks
            wider = re.split(r"\s{2,}|\t", text)
            found = wider if len(wider) == wide else found
        if len(found) < 2 or _numeric(found):
            continue
        if len(found) == wide - 1 and (np.diff(values[:, 0]) == 1).all() and values[0, 0] in (0, 1):
            notes.append(f"line {k + 1} names all columns but the first, which numbers the rows")
            found = ["row", *found]
        elif len(found) != wide:
            notes.append(
                f"line {k + 1} has {len(found)} names for {wide} values: taken from the left; check them"
            )
        named = [name or number for name, number in zip(found, numbers, strict=False)]
        return k + 1, tuple(_told_apart([*named, *numbers[len(named) :]]))
    notes.append("no line of names: columns are named by their numbers")
    return 0, tuple(numbers)


def _told_apart(names: Sequence[str]) -> list[str]:
    """Names that stand there twice, by number."""
    return [name if names.count(name) == 1 else str(k + 1) for k, name in enumerate(names)]
