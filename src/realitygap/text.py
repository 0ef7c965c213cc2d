"""Small files that people write, read; whatever is wrong with them is said in one line."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from os import PathLike
from pathlib import Path
from types import UnionType
from typing import Any

from realitygap.errors import UsageError

__all__ = [
    "Table",
    "as_path",
    "must_be",
    "read_json",
    "read_table",
    "read_text",
    "reason",
    "refuse_odd_values",
    "refuse_separator",
    "refuse_unknown",
    "to_csv",
]

DEEPEST, LARGEST = 32, 2**63 - 1
"""Tables in tables, and whole numbers, beyond which no file of this project goes."""
LONGEST = 60
"""Characters of a key that a message shows."""


def as_path(value: object, what: str) -> Path:
    """A path from what a Python caller gives for one; a study stands for its folder.

    Raises:
        UsageError: something else.
    """
    if not isinstance(value, str | PathLike):
        raise UsageError(f"{what}: expected a path, got {value!r}.")
    return Path(value)


def must_be(value: object, kind: type | UnionType, what: str, cure: str) -> None:
    """Refuse a Python caller's value of another kind.

    Raises:
        UsageError: says what was expected, what came, and the cure.
    """
    if not isinstance(value, kind):
        raise UsageError(f"{what}: expected a {getattr(kind, '__name__', kind)}, got {value!r}. {cure}")


def read_text(path: str | Path, error: type[UsageError], cure: str) -> str:
    """The text of a file in UTF-8.

    Args:
        path: the file.
        error: what to raise.
        cure: what to do if there is none, such as "Give the path of a disk's .toml file."

    Raises:
        UsageError: of the class `error`: no such file, no right to read it, or no text.
    """
    try:
        return Path(path).read_text("utf-8-sig")
    except FileNotFoundError:
        raise error(f"{path}: no such file. {cure}") from None
    except UnicodeDecodeError:
        raise error(f"{path}: not a text file in UTF-8. {cure}") from None
    except OSError as why:
        raise error(f"{path}: cannot be read ({why.strerror}). Check the path and its rights.") from None
    except ValueError:  # a NUL character
        raise error(f"{str(path)!r}: no path of a file. {cure}") from None


def read_json(path: str | Path, error: type[UsageError], cure: str) -> Any:
    """What a JSON file holds.

    Raises:
        UsageError: of the class `error`: as of `read_text`, or broken JSON, with its line.
    """
    text = read_text(path, error, cure)
    try:
        data = json.loads(text)
        refuse_odd_values(data)
    except (ValueError, RecursionError) as why:
        raise error(f"{path}: not a JSON file: {reason(why)}. {cure}") from None
    return data


@dataclass(frozen=True, kw_only=True)
class Table:
    """A CSV file's columns as text, and its rows' line numbers; how to say what is wrong with it."""

    path: str | Path
    lines: list[int]
    cells: dict[str, list[str]]
    error: type[UsageError]
    cure: str

    def numbers(self, name: str, *, gaps: bool = False) -> list[float]:
        """A column's finite numbers; with `gaps`, NaN where a field is empty or says so.

        Raises:
            UsageError: of the table's class: names file, line and column.
        """
        found = [_number(cell) for cell in self.cells[name]]
        for line, cell, value in zip(self.lines, self.cells[name], found, strict=True):
            if math.isinf(value) or (math.isnan(value) and not gaps):
                raise self.wrong(line, f"{name}: expected a number, got {cell!r}")
        return found

    def wrong(self, line: int, what: str, cure: str = "Correct that line.") -> UsageError:
        """What to raise for a line."""
        return self.error(f"{self.path}, line {line}: {what}. {self.cure or cure}")


def read_table(
    path: str | Path,
    columns: Sequence[str],
    error: type[UsageError],
    *,
    optional: Sequence[str] = (),
    cure: str = "",
) -> Table:
    """A CSV file's columns; those that nobody asks for are left out.

    Args:
        path: the file; its first line names the columns, in any order.
        columns: those that it must have.
        error: what to raise.
        optional: those that are read where they are.
        cure: what to do about a broken file, where it can be made again.

    Raises:
        UsageError: of the class `error`: as of `read_text`, a column that is missing, a row with too few
            values; names the line.
    """
    wanted = ", ".join(columns)
    text = read_text(path, error, cure or f"Give a CSV file with columns {wanted}.")
    refuse_separator(path, text.partition("\n")[0], error)
    table = Table(path=path, lines=[], cells={}, error=error, cure=cure)
    reader = csv.reader(text.splitlines())
    try:
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(row)]
    except csv.Error as why:
        raise table.wrong(reader.line_num, f"not CSV: {why}") from None
    if not rows:
        raise error(f"{path}: empty. Its first line must name the columns: {wanted}. {cure}".rstrip())
    (first, head), *rows = rows
    missing = ", ".join(name for name in columns if name not in head)
    if missing:
        told = f"expected columns {wanted}, got {', '.join(head)}"
        raise table.wrong(first, told, f"Add {missing}; columns are separated by commas.")
    for line, row in rows:
        if len(row) != len(head):
            raise table.wrong(line, f"expected {len(head)} values, got {len(row)}")
    kept = {name: head.index(name) for name in (*columns, *optional) if name in head}
    cells = {name: [row[k] for _, row in rows] for name, k in kept.items()}
    return replace(table, lines=[line for line, _ in rows], cells=cells)


def _number(cell: str) -> float:
    """NaN where there is nothing; infinite what is no number."""
    try:
        return float(cell or "nan")
    except ValueError:
        return math.inf


def refuse_separator(path: str | Path, head: str, error: type[UsageError]) -> None:
    """Refuse a table whose first line has no commas but semicolons or tabs, as some programs write.

    Raises:
        UsageError: of the class `error`.
    """
    for sign, name in ((";", "semicolons"), ("\t", "tabs")):
        if sign in head and "," not in head:
            raise error(
                f"{path}, line 1: expected values separated by commas, got {name}. Save the table "
                "with commas (and with points in its numbers)."
            )


def reason(why: Exception) -> str:
    """Why a parser gave up, in words that fit a sentence."""
    if isinstance(why, RecursionError):
        return f"tables or lists nested more than {DEEPEST} deep"
    if "integer string conversion" in str(why):
        return "a whole number of thousands of digits"
    said = str(why).rstrip(".")
    return said if len(said) <= 4 * LONGEST else f"{said[: 2 * LONGEST]}…{said[-LONGEST:]}"


def refuse_odd_values(data: Any, depth: int = 0) -> None:
    """Refuse what no reader is prepared for.

    Raises:
        ValueError: whole numbers beyond 64 bits.
        RecursionError: tables in tables in tables …
    """
    if depth > DEEPEST:
        raise RecursionError
    if isinstance(data, int) and abs(data) > LARGEST:
        raise ValueError("a whole number beyond 64 bits")
    if isinstance(data, Mapping | list):
        for inner in data.values() if isinstance(data, Mapping) else data:
            refuse_odd_values(inner, depth + 1)


def refuse_unknown(
    table: Iterable[str], known: Iterable[str], error: type[UsageError], *, where: str = "", cure: str = ""
) -> None:
    """Refuse a key that nothing reads.

    Args:
        table: its keys.
        known: those that mean something.
        error: what to raise.
        where: the file, for the message.
        cure: where else to put it, said beside the known keys.

    Raises:
        UsageError: of the class `error`; names the nearest known key, or all.
    """
    names = list(known)
    for key in table:
        if key not in names:
            near = get_close_matches(key[:LONGEST], names, n=1)
            said = f"Did you mean {near[0]!r}?" if near else f"Known keys: {', '.join(names)}. {cure}".strip()
            shown = key if len(key) <= LONGEST else key[: LONGEST - 1] + "…"
            raise error(f"{where + ': ' if where else ''}{shown}: unknown key. {said}")


def to_csv(rows: Iterable[Iterable[object]], *, end: str = "\n") -> str:
    """Rows, the head first, as the text of a CSV file; `end` closes each line."""
    out = io.StringIO()
    csv.writer(out, lineterminator=end).writerows(rows)
    return out.getvalue()
