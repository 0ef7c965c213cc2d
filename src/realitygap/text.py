"""Reads small files that people write; an error in one ends in one line."""

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from os import PathLike
from pathlib import Path
from types import UnionType
from typing import Any, get_args

from realitygap.errors import UsageError

__all__ = [
    "as_path", "must_be", "read_json", "read_text", "reason", "refuse_odd_values", "refuse_separator",
    "refuse_unknown", "to_csv",
]  # fmt: skip

DEEPEST, LARGEST = 32, 2**63 - 1
"""Tables in tables, and whole numbers, beyond which no file of this project goes."""
LONGEST = 60
"""Characters of a key that a message shows."""


def as_path(value: object, what: str) -> Path:
    """A path from what a Python caller gives for one; a study stands for its folder.

    Raises:
        UsageError: something else.
    """
    if not isinstance(value, str | PathLike) or "\0" in str(value):
        raise UsageError(f"{what}: expected a path, got {value!r}.")
    return Path(value)


def must_be(value: object, kind: type | UnionType, what: str, cure: str) -> None:
    """Refuse a Python caller's value of another kind; `what` is its name in the message.

    Args:
        value: what came.
        kind: the class that was expected.
        what: its name in the message.
        cure: what to do.

    Raises:
        UsageError: says what was expected, what came, and the cure.
    """
    if not isinstance(value, kind):
        named = " or ".join(one.__name__ for one in get_args(kind) or (kind,))
        raise UsageError(f"{what}: expected a {named}, got {value!r}. {cure}")


def read_text(path: str | Path, error: type[UsageError], cure: str) -> str:
    """The text of a file in UTF-8; `cure` is what to do if there is none.

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
        raise error(f"{path}: cannot be read ({why.strerror}). Check the path and its permissions.") from None
    except ValueError:  # a NUL character
        raise error(f"{str(path)!r}: not a file's path. {cure}") from None


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


def refuse_separator(path: str | Path, lines: Sequence[str], error: type[UsageError]) -> None:
    """Refuse a table whose first line that is not empty has more semicolons or tabs than commas, as some
    programs write.

    Raises:
        UsageError: of the class `error`.
    """
    number, head = next(((k, line) for k, line in enumerate(lines, 1) if line.strip()), (1, ""))
    for sign, name in ((";", "semicolons"), ("\t", "tabs")):
        if head.count(sign) > head.count(","):
            raise error(
                f"{path}, line {number}: expected values separated by commas, got {name}. Save the table "
                "with commas (and with decimal points)."
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
