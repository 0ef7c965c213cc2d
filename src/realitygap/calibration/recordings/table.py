"""The table of a recording: a CSV file whose every wrong value is named with its line."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import RecordingError
from realitygap.text import read_text, refuse_separator

__all__ = ["LARGEST", "Table", "need", "read_table"]

Array = NDArray[np.float64]

LARGEST = 10**9
"""No number of a recording goes further."""


class Table(NamedTuple):
    """A CSV file: its columns, its rows as texts, and the line of each row."""

    path: Path
    columns: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]

    def at(self, k: int) -> str:
        """Where row k stands."""
        return f"{self.path}, line {self.lines[k]}"

    def numbers(self, name: str, *, empty: bool = False) -> Array:
        """A column as numbers.

        Raises:
            RecordingError: a value that is no number; names file and line.
        """
        column = self.columns.index(name)
        out = np.full(len(self.rows), math.nan)
        for k, row in enumerate(self.rows):
            text = row[column].strip()
            if empty and not text:
                continue
            try:
                out[k] = float(text)
            except ValueError:
                out[k] = math.nan
            if not abs(out[k]) <= LARGEST:
                limits = f" from -{LARGEST:g} to {LARGEST:g}" if math.isfinite(out[k]) else ""
                raise RecordingError(f"{self.at(k)}: {name}: expected a number{limits}, got {text!r}.")
        return out

    def texts(self, name: str) -> NDArray[np.str_]:
        """A column as it is."""
        column = self.columns.index(name)
        return np.array([row[column].strip() for row in self.rows], dtype=str)

    def whole(self, name: str) -> NDArray[np.int64]:
        """A column of whole numbers from 0 on."""
        values = self.numbers(name)
        wrong = (values != np.rint(values)) | (values < 0) | (values > LARGEST)
        self.refuse(wrong, name, f"a whole number from 0 to {LARGEST}", values)
        return values.astype(np.int64)

    def refuse(self, wrong: NDArray[np.bool_], name: str, expected: str, got: Any, cure: str = "") -> None:
        """Raise for the first row that is wrong."""
        if wrong.any():
            k = int(np.flatnonzero(wrong)[0])
            value = got[k]
            shown = f"{value:g}" if isinstance(value, float) else repr(str(value))
            tail = f" {cure}" if cure else ""
            raise RecordingError(f"{self.at(k)}: {name}: expected {expected}, got {shown}.{tail}")


def read_table(path: Path, *, ends: bool) -> Table:
    """The table of a CSV file.

    Args:
        path: the file.
        ends: whether its last line must have an end, as a recorder's has.

    Raises:
        RecordingError: no such file, no text, an empty table, or a row of another length.
    """
    text = read_text(path, RecordingError, "It holds the table; record it again.")
    refuse_separator(path, text.partition("\n")[0], RecordingError)
    reader = csv.reader(text.splitlines())
    columns: tuple[str, ...] = ()
    rows, lines = [], []
    try:
        columns = tuple(name.strip() for name in next(reader, []))
        for row in reader:
            if not any(cell.strip() for cell in row):
                continue
            if len(row) != len(columns):
                where = f"{path}, line {reader.line_num}"
                raise RecordingError(f"{where}: expected {len(columns)} values, got {len(row)}.")
            rows.append(row)
            lines.append(reader.line_num)
    except csv.Error as error:
        raise RecordingError(f"{path}, line {reader.line_num}: not a line of a table: {error}.") from None
    if not rows:
        raise RecordingError(f"{path}: empty: expected a line of column names and a row for each reading.")
    if ends and not text.endswith("\n"):
        cure = "Go on with `realitygap record … --resume`."
        raise RecordingError(f"{path}, line {lines[-1]}: cut short. {cure}")
    return Table(path, columns, rows, lines)


def need(table: Table, names: Sequence[str]) -> None:
    """Refuse a table that lacks one of these columns, or has a column twice."""
    missing = [name for name in names if name not in table.columns]
    if missing:
        got = ", ".join(table.columns)
        raise RecordingError(f"{table.path}, line 1: expected a column {missing[0]!r}, got: {got}.")
    twice = [name for name in table.columns if table.columns.count(name) > 1]
    if twice:
        raise RecordingError(f"{table.path}, line 1: the column {twice[0]!r} stands there twice.")
