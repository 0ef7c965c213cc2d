"""Files: text, TOML and CSV tables read with clear errors, and written whole or not at all."""

import csv
import inspect
import io
import json
import math
import os
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from difflib import get_close_matches
from functools import wraps
from os import PathLike
from pathlib import Path
from types import UnionType
from typing import Any, NamedTuple, ParamSpec, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import UsageError

__all__ = [
    "LARGEST_TABLE", "Table", "as_path", "atomic_path", "atomic_write", "move_whole", "must_be",
    "names_its_arguments", "naming_errors", "parse_toml", "read_json", "read_table", "read_text",
    "read_toml", "refuse_separator", "refuse_unknown", "to_csv", "to_toml", "written_together",
]  # fmt: skip

Array = NDArray[np.float64]
Given = ParamSpec("Given")
Returned = TypeVar("Returned")

LARGEST_TABLE = 10**9
"""Largest number in a table."""


def as_path(value: object, what: str) -> Path:
    """A path from what a Python caller gives for one; a study stands for its folder.

    Raises:
        UsageError: something else.
    """
    if not isinstance(value, str | PathLike) or "\0" in str(value):
        raise UsageError(f"{what}: expected a path, got {value!r}.")
    return Path(value)


def must_be(value: object, kind: type | UnionType, what: str, cure: str) -> None:
    """Refuse a Python caller's value of another kind; `what` names it, `cure` says what to do.

    Raises:
        UsageError: it is of another kind.
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


def read_json(path: str | Path, error: type[UsageError], cure: str) -> Any:
    """What a JSON file holds.

    Raises:
        UsageError: of the class `error`: as of `read_text`, or broken JSON, with its line.
    """
    text = read_text(path, error, cure)
    try:
        return _checked(json.loads(text))
    except (ValueError, RecursionError) as why:
        raise error(f"{path}: not a JSON file: {_reason(why)}. {cure}") from None


def refuse_separator(path: str | Path, lines: Sequence[str], error: type[UsageError]) -> None:
    """Refuse a table whose first line has more semicolons or tabs than commas, as some programs write."""
    number, head = next(((k, line) for k, line in enumerate(lines, 1) if line.strip()), (1, ""))
    for sign, name in ((";", "semicolons"), ("\t", "tabs")):
        if head.count(sign) > head.count(","):
            raise error(
                f"{path}, line {number}: expected values separated by commas, got {name}. Save the table "
                "with commas (and with decimal points)."
            )


def _reason(why: Exception) -> str:
    """Why a parser gave up, in words that fit a sentence."""
    return "tables or lists nested too deep" if isinstance(why, RecursionError) else str(why).rstrip(".")


def _checked(data: Any) -> Any:
    """The same data, if its whole numbers have 64 bits, beyond which nothing here is prepared for them."""
    if isinstance(data, int) and abs(data) >= 2**63:
        raise ValueError("a whole number beyond 64 bits")
    if isinstance(data, Mapping | list):
        for inner in data.values() if isinstance(data, Mapping) else data:
            _checked(inner)
    return data


def refuse_unknown(
    table: Iterable[str], known: Iterable[str], error: type[UsageError], *, where: str = "", cure: str = ""
) -> None:
    """Refuse a key that nothing reads: in the file `where`; known keys and `cure` end the message.

    Raises:
        UsageError: of the class `error`; names the nearest known key, or all.
    """
    names = list(known)
    for key in table:
        if key not in names:
            near = get_close_matches(key, names, n=1)
            said = f"Did you mean {near[0]!r}?" if near else f"Known keys: {', '.join(names)}. {cure}".strip()
            raise error(f"{where + ': ' if where else ''}{key}: unknown key. {said}")


def names_its_arguments(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """The same function, which refuses an unknown argument by naming the nearest that it has."""
    names = tuple(inspect.signature(function).parameters)

    @wraps(function)
    def called(*args: Given.args, **given: Given.kwargs) -> Returned:
        for name in given:
            if name not in names:
                near = get_close_matches(name, names, n=1)
                said = f"Did you mean {near[0]!r}?" if near else f"It has {', '.join(names)}."
                raise UsageError(f"{function.__name__}: {name}: unknown argument. {said}")
        return function(*args, **given)

    return called


def to_csv(rows: Iterable[Iterable[object]], *, end: str = "\n") -> str:
    """Rows, the head first, as the text of a CSV file; `end` closes each line."""
    out = io.StringIO()
    csv.writer(out, lineterminator=end).writerows(rows)
    return out.getvalue()


def read_toml(
    path: str | Path, error: type[UsageError], cure: str, *, broken: str = "Correct that line."
) -> dict[str, Any]:
    """The table of a TOML file; `cure` is what to do if there is none, `broken` if it is not TOML.

    Raises:
        UsageError: of the class `error`: as of `read_text`, or broken TOML, with its line.
    """
    text = read_text(path, error, cure)
    try:
        return parse_toml(text)
    except ValueError as why:
        raise error(f"{path}: not a TOML file: {why}. {broken}") from None


def parse_toml(text: str) -> dict[str, Any]:
    """The table of a TOML text.

    Raises:
        ValueError: broken TOML.
    """
    try:
        table: dict[str, Any] = _checked(tomllib.loads(text))
        return table
    except (ValueError, RecursionError) as why:
        raise ValueError(_reason(why)) from None


def to_toml(facts: Mapping[str, Any]) -> str:
    """TOML text of a table: plain keys first, then tables; None is left out.

    Arrays are written as lists, anything else that TOML lacks as its text.
    """
    import tomlkit  # only a command that writes waits for it

    return tomlkit.dumps(_plain(facts))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return value if isinstance(value, str | bool | int | float) else str(value)


_together: ContextVar[Path | None] = ContextVar("together", default=None)


def atomic_write(path: str | Path, content: str | bytes) -> None:
    """Write a file whole; text in UTF-8, its line ends as they are.

    Raises:
        OSError: it cannot be written; names the file, and leaves what was there.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    with atomic_path(path) as spare:
        spare.write_bytes(data)


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A path to write to, of the same ending, which becomes `path` at the end, or nothing if that fails.

    What is no plain file (a terminal, /dev/null) is written to directly.

    Raises:
        OSError: it cannot be written; names the file, and leaves what was there.
    """
    path = Path(path)
    with naming_errors(path):
        if path.exists() and not path.is_file():
            yield path
            return
        target = Path(os.path.realpath(path))  # a link stays a link
        if target.exists() and not os.access(target, os.W_OK):
            raise PermissionError(13, "Permission denied")
        spare = target.with_name(f".part-{os.getpid()}-{target.name}")
        try:
            yield spare
            move_whole(spare, target)
        finally:
            with suppress(OSError):
                spare.unlink(missing_ok=True)


@contextmanager
def written_together(folder: Path) -> Iterator[None]:
    """Within it files of this folder do not go to the disk one by one: `move_whole` brings it there."""
    before = _together.set(folder.resolve())
    try:
        yield
    finally:
        _together.reset(before)


def move_whole(made: Path, path: Path) -> None:
    """Give a finished file or folder its name, once all of it is on the disk."""
    later = _together.get()
    if later is not None and path.is_relative_to(later):
        os.replace(made, path)
        return
    for part in (*made.rglob("*"), made):
        if part.is_file() or part.is_dir():
            _sync(part)
    os.replace(made, path)
    with suppress(OSError):  # some file systems do not sync folders
        _sync(path.parent)


@contextmanager
def naming_errors(path: str | Path) -> Iterator[Path]:
    """Let what the system says about a file name it, which writing to a full disk does not do."""
    try:
        yield Path(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def _sync(path: Path) -> None:
    """Wait until a file or a folder is on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


class Table(NamedTuple):
    """A CSV file: its columns, its rows as texts, the line of the columns' names and of each row, in words
    where these are of several files; what to raise, and the cure."""

    path: Path
    columns: tuple[str, ...]
    rows: list[list[str]]
    top: int
    lines: Sequence[int | str]
    error: type[UsageError]
    cure: str

    def at(self, k: int) -> str:
        """Where row k is."""
        line = self.lines[k]
        return line if isinstance(line, str) else f"{self.path}, line {line}"

    @property
    def head(self) -> str:
        """Where the names of the columns are."""
        return f"{self.path}, line {self.top}" if self.top else str(self.path)

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
        wrong = ~(np.abs(out) <= LARGEST_TABLE) & ~(empty & np.isnan(out))
        if wrong.any():
            limits = (
                f" from -{LARGEST_TABLE:g} to {LARGEST_TABLE:g}" if np.isfinite(out[wrong.argmax()]) else ""
            )
            self.refuse(wrong, name, f"a number{limits}", texts)
        return out

    def whole(self, name: str) -> NDArray[np.int64]:
        """A column of whole numbers from 0 on."""
        values = self.numbers(name)
        wrong = (values != np.rint(values)) | (values < 0)
        self.refuse(wrong, name, f"a whole number from 0 to {LARGEST_TABLE}", values)
        return values.astype(np.int64)

    def refuse(self, wrong: NDArray[np.bool_], name: str, expected: str, got: Any, cure: str = "") -> None:
        """Raise for the first row that is wrong [rows], with what came there, `got` [rows]; `cure` is what to
        do, if it is not the table's."""
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
