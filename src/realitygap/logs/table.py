"""Reads tables that other programs wrote: any separator, decimal commas, comments, names that do not fit."""

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite, nan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import RecordingError
from realitygap.files import read_text
from realitygap.logs.cuts import many
from realitygap.values import Floats

__all__ = ["Log", "read_log"]

SEPARATORS = {",": "commas", ";": "semicolons", "|": "bars", "\t": "tabs", " ": "blanks"}
COMMENT = ("#", "%", "//")
SAMPLE, FEWEST = 400, 3
"""Lines by which the separator is found; rows of a log at least."""


@dataclass(frozen=True, eq=False)
class Log:
    """A table of numbers in a text file: values [n, c], NaN where a cell is no number, cells as texts, lines
    [n] of the file; the separator in words, the line of the names, 0 without; what was left out."""

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
    path, notes = Path(path), list[str]()
    lines = read_text(path, RecordingError, "Give a text file; export others as CSV.").splitlines()
    body = [k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(COMMENT)]
    some = [lines[k] for k in body[len(body) // 10 :][:SAMPLE]]
    share, wide, sign = max((*_fit(some, sign), sign) for sign in SEPARATORS)
    split = {k: _split(lines[k], sign) for k in body}
    numbers = {k: [*map(_number, row)] for k, row in split.items() if len(row) == wide}
    values = {k: row for k, row in numbers.items() if not np.isnan(row).all()}
    if share < 0.5 or wide < 2 or len(values) < FEWEST:
        raise RecordingError(
            f"{path}: expected a table of numbers, a row a time, separated by "
            f"{', '.join(SEPARATORS.values())}; found none. Export it as CSV first."
        )
    first = next(iter(values))
    left = [k + 1 for k in body if k > first and k not in values]
    if left:
        rest = " …" if len(left) > 3 else ""
        where = ", ".join(map(str, left[:3]))
        notes.append(f"{many(len(left), 'line')} left out: no rows of {wide} values (line {where}{rest})")
    names, head = [str(k + 1) for k in range(wide)], 0
    for k in range(first - 1, -1, -1):  # a comment or not, the last that holds no numbers
        found = _split(lines[k].strip().lstrip("#%/").strip(), sign)
        if len(found) > 1 and np.isnan([*map(_number, found)]).all():
            head, given = k + 1, found + names[len(found) :]
            names = [o if not n or given.count(n) > 1 else n for n, o in zip(given, names, strict=False)]
            break
    at, texts = np.array(list(values), np.int64) + 1, [split[k] for k in values]
    table = np.array(list(values.values()))
    closed = bool(np.isnan(table[:, -1]).all())  # rows may end with a separator, names without
    if head and not wide - closed <= len(found) <= wide:
        notes.append(f"line {head} has {len(found)} names for {wide} values: taken from the left; check them")
    return Log(path, tuple(names), table, texts, at, SEPARATORS[sign], head, tuple(notes))


def _split(line: str, sign: str) -> list[str]:
    """A line's cells."""
    if sign == " ":
        return line.split()
    cells = next(csv.reader([line], delimiter=sign)) if '"' in line else line.split(sign)
    return [cell.strip() for cell in cells]


def _fit(lines: Sequence[str], sign: str) -> tuple[float, int]:
    """Share of cells that are numbers, or empty, in rows of the commonest width, and that width."""
    split = [_split(line, sign) for line in lines]
    ((wide, _),) = Counter(map(len, split)).most_common(1) or [(0, 0)]
    cells = [cell for row in split if len(row) == wide for cell in row]
    good = sum(not cell or isfinite(_number(cell)) for cell in cells)
    return good / max(sum(map(len, split)), 1) * (wide > 1), wide


def _number(cell: str) -> float:
    """NaN where there is none; a decimal comma is a point."""
    try:
        found = float(cell.replace(",", "."))
    except ValueError:
        return nan
    return found if isfinite(found) else nan
