"""Reads CSV tables: an error names its line."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import UsageError
from realitygap.text import read_text, refuse_separator

__all__ = ["LARGEST", "Table", "read_table"]

Array = NDArray[np.float64]

LARGEST = 10**9
"""Largest number in a table."""


class Table(NamedTuple):
    """A CSV file: its columns, its rows as texts, the line of the columns' names and of each row; what to
    raise, and the cure."""

    path: Path
    columns: tuple[str, ...]
    rows: list[list[str]]
    top: int
    lines: list[int]
    error: type[UsageError]
    cure: str

    def at(self, k: int) -> str:
        """Where row k is."""
        return f"{self.path}, line {self.lines[k]}"

    @property
    def head(self) -> str:
        """Where the names of the columns are."""
        return f"{self.path}, line {self.top}"

    def texts(self, name: str) -> list[str]:
        column = self.columns.index(name)
        return [row[column] for row in self.rows]

    def numbers(self, name: str, *, empty: bool = False) -> Array:
        """A column as numbers; with `empty`, NaN where there is nothing, or that word.

        Raises:
            UsageError: of the table's class: a value is not a number.
        """
        texts = self.texts(name)
        try:
            out = np.array(list(map(float, texts)), np.float64)
        except ValueError:  # something is empty, or wrong
            out = np.array([_number(text) for text in texts], np.float64)
        wrong = ~(np.abs(out) <= LARGEST) & ~(empty & np.isnan(out))
        if wrong.any():
            limits = f" from -{LARGEST:g} to {LARGEST:g}" if np.isfinite(out[wrong.argmax()]) else ""
            self.refuse(wrong, name, f"a number{limits}", texts)
        return out

    def whole(self, name: str) -> NDArray[np.int64]:
        """A column of whole numbers from 0 on."""
        values = self.numbers(name)
        wrong = (values != np.rint(values)) | (values < 0)
        self.refuse(wrong, name, f"a whole number from 0 to {LARGEST}", values)
        return values.astype(np.int64)

    def refuse(self, wrong: NDArray[np.bool_], name: str, expected: str, got: Any, cure: str = "") -> None:
        """Raise for the first row that is wrong.

        Args:
            wrong: [rows] which are.
            name: the column's.
            expected: what, in words.
            got: [rows] what came.
            cure: what to do, if it is not the table's.
        """
        if wrong.any():
            k = int(wrong.argmax())
            shown = f"{got[k]:g}" if isinstance(got[k], float) else repr(str(got[k]))
            tail = cure or self.cure or "Correct that line."
            raise self.error(f"{self.at(k)}: {name}: expected {expected}, got {shown}. {tail}")

    def need(self, names: Sequence[str]) -> None:
        """Refuse a table that lacks one of these columns."""
        missing = ", ".join(name for name in names if name not in self.columns)
        if missing:
            told = f"expected columns {', '.join(names)}, got {', '.join(self.columns)}."
            cure = self.cure or f"Add {missing}; columns are separated by commas."
            raise self.error(f"{self.head}: {told} {cure}")


def read_table(
    path: str | Path, error: type[UsageError], *, needs: Sequence[str] = (), cure: str = ""
) -> Table:
    """The table of a CSV file, its cells without blanks round them.

    Args:
        path: the file; its first line that is no comment (`# …`) names the columns, in any order, in capitals
            or not.
        error: what to raise.
        needs: columns that it must have.
        cure: what to do about a broken file, where it can be made again.

    Raises:
        UsageError: of the class `error`: no such file, no text, a missing column, a row of another
            length; names the line.
    """
    columns = f" with columns {', '.join(needs)}" if needs else ""
    lines = read_text(path, error, cure or f"Give a CSV file{columns}.").splitlines()
    lines = ["" if line.startswith("#") else line for line in lines]
    refuse_separator(path, lines, error)
    reader = csv.reader(lines)
    try:
        found = [(reader.line_num, list(map(str.strip, row))) for row in reader]
    except csv.Error as why:
        raise error(
            f"{path}, line {reader.line_num}: not CSV: {why}. {cure or 'Correct that line.'}"
        ) from None
    found = [(line, row) for line, row in found if any(row)]
    if not found:
        raise error(f"{path}: empty: expected a line of column names{columns}. {cure}".rstrip())
    (top, head), *rows = found
    names, places = tuple(name.lower() for name in head), [line for line, _ in rows]
    table = Table(Path(path), names, [row for _, row in rows], top, places, error, cure)
    table.need(needs)
    for name in needs:
        if names.count(name) > 1:
            told = f"{table.head}: expected one column {name}, got {names.count(name)}."
            raise error(f"{told} {cure or 'Leave one of them out.'}")
    for k, row in enumerate(table.rows):
        if len(row) != len(head):
            told = f"{table.at(k)}: expected {len(head)} values, got {len(row)}."
            raise error(f"{told} {cure or 'Correct that line.'}")
    return table


def _number(text: str) -> float:
    """NaN where there is nothing; infinite what is no number."""
    try:
        return float(text or "nan")
    except ValueError:
        return math.inf
