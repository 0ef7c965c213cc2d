"""CSV tables of poses, in and out; whatever is wrong is said with file and line."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from realitygap.errors import FilmError
from realitygap.text import read_text, refuse_separator

__all__ = ["number", "read_table"]


def read_table(path: str | Path, columns: Sequence[str]) -> list[tuple[int, dict[str, str]]]:
    """The rows of a CSV file with their line numbers, as text by column; other columns are left out.

    Args:
        path: the file; its first line names the columns, in any order.
        columns: those that it must have.

    Raises:
        FilmError: unreadable file, a column that is missing, a row with too few values.
    """
    text = read_text(path, FilmError, f"Give a CSV file with columns {', '.join(columns)}.")
    refuse_separator(path, text.partition("\n")[0], FilmError)
    reader = csv.reader(text.splitlines())
    try:
        lines = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(row)]
    except csv.Error as error:
        raise FilmError(f"{path}, line {reader.line_num}: not CSV: {error}. Correct that line.") from None
    if not lines:
        raise FilmError(f"{path}: empty. Its first line must name the columns: {', '.join(columns)}.")
    (first, head), rows = lines[0], lines[1:]
    missing = [name for name in columns if name not in head]
    if missing:
        raise FilmError(
            f"{path}, line {first}: expected columns {', '.join(columns)}, got {', '.join(head)}. "
            f"Add {', '.join(missing)}; columns are separated by commas."
        )
    for line, row in rows:
        if len(row) != len(head):
            what = f"expected {len(head)} values, got {len(row)}"
            raise FilmError(f"{path}, line {line}: {what}. Correct that line.")
    return [(line, {name: row[head.index(name)] for name in columns}) for line, row in rows]


def number(path: str | Path, line: int, name: str, text: str) -> float:
    """A cell as a finite number.

    Raises:
        FilmError: anything else; names file, line and column.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FilmError(f"{path}, line {line}: {name}: expected a number, got {text!r}. Correct that line.")
    return value
