"""Trials in one file instead of a folder each: a SQLite archive.

Thousands of trials would otherwise be a hundred thousand small files. Trials are read through this module: a
folder takes precedence over packed files of its name. Tables are stored as columns, under another name.
"""

import sqlite3
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from itertools import chain
from pathlib import Path
from shutil import copy, copytree, ignore_patterns

from realitygap.errors import StudyError
from realitygap.study.store import database_errors
from realitygap.transfer.columns import columns_of, text_of
from realitygap.values import Closing

__all__ = ["MANY", "PACKED", "Packed", "content", "every", "placed", "unpacked"]

HOME, PACKED = "transfer", "trials.sqlar"
"""A study's folder of transfers, and the archive in it."""
MANY = 1000
"""From this many trials on they are packed by default."""

DEPTH = 4
"""Parts of a file's name from the folder of transfers: robot, run, start, file."""

COLUMNS = ".columns"
"""Suffix of the name of a table stored as columns (`columns.py`)."""

_MODE = 0o100644
_IN = "name >= ? AND name < ?"
_TABLE = "CREATE TABLE IF NOT EXISTS sqlar(name TEXT PRIMARY KEY, mode INT, mtime INT, sz INT, data BLOB)"
"""As in SQLite's own archives: `data` is zlib if it is shorter than `sz`."""


class Packed(Closing):
    """The archive of a folder of transfers, open for writing; one process writes (see `study.lock`)."""

    def __init__(self, home: Path) -> None:
        self._path = home / PACKED
        with database_errors(self._path):
            self._database = sqlite3.connect(self._path, isolation_level=None)
            self._database.execute("PRAGMA page_size = 512")
            self._database.execute(_TABLE)

    def keep(self, folder: str, files: Mapping[str, bytes]) -> None:
        """Store a trial's files by name, all or none; `folder` is relative to the folder of transfers."""
        rows = []
        for name, text in files.items():
            columns = columns_of(text) if name.endswith(".csv") else None
            member, data = (name, text) if columns is None else (name + COLUMNS, columns)
            rows.append((f"{folder}/{member}", _MODE, len(data), min(data, zlib.compress(data, 9), key=len)))
        with database_errors(self._path):
            self._database.execute("BEGIN IMMEDIATE")
            self._database.execute(f"DELETE FROM sqlar WHERE {_IN}", _in(folder))
            self._database.executemany("INSERT INTO sqlar VALUES (?, ?, 0, ?, ?)", rows)
            self._database.execute("COMMIT")

    def close(self) -> None:
        self._database.close()


def content(file: Path) -> bytes | None:
    """The content of a trial's file; None if there is none.

    Raises:
        StudyError: the archive is damaged.
    """
    with database_errors(file):
        if file.is_file():
            return file.read_bytes()
    if len(file.parts) < DEPTH + 1:
        return None
    name = "/".join(file.parts[-DEPTH:])
    which = "name IN (?, ?)", (name, name + COLUMNS)
    return next((data for _, data in _rows(file.parents[DEPTH - 1], *which)), None)


@contextmanager
def placed(folder: Path, *names: str) -> Iterator[Path]:
    """A trial's folder, or a temporary one with the packed files of that name: these, or all."""
    if folder.is_dir():
        yield folder
        return
    with tempfile.TemporaryDirectory(prefix="realitygap-") as name:
        inside = "/".join(folder.parts[1 - DEPTH :])
        some = [f"{inside}/{one}{end}" for one in names for end in ("", COLUMNS)]
        which = (f"name IN ({', '.join('?' * len(some))})", tuple(some)) if names else (_IN, _in(inside))
        for path, data in _rows(folder.parents[DEPTH - 2], *which):
            Path(name, path.name).write_bytes(data)
        yield Path(name)


def every(home: Path, name: str) -> Iterator[tuple[Path, bytes]]:
    """The file of this name of every packed trial in a folder of transfers, and its content."""
    return _rows(home, "name LIKE ?", (f"%/{name}",))


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """A study, its folder of transfers or a part of that, with packed trials as folders too, temporarily; the
    path itself if nothing in it is packed."""
    place = path.resolve()
    home = next((one for one in (place, *place.parents) if (one / PACKED).is_file()), place / HOME)
    inside = place.relative_to(home) if place.is_relative_to(home) else None  # None: the study itself
    which, values = (_IN, _in(inside.as_posix())) if inside and inside.parts else ("name > ?", ("",))
    rows = _rows(home, which, values)
    if path.is_file() or (first := next(rows, None)) is None:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="realitygap-") as name:
        made = Path(name, home.name)
        for file, data in chain((first,), rows):
            there = made / file.relative_to(home)
            there.parent.mkdir(parents=True, exist_ok=True)
            there.write_bytes(data)
        if place.is_dir():  # a trial's folder takes precedence over packed files
            into, unread = made.parent if inside is None else made / inside, ignore_patterns("*.mp4", PACKED)
            copytree(place, into, dirs_exist_ok=True, ignore=unread)
        if (home.parent / "profile.toml").is_file():
            copy(home.parent / "profile.toml", name)
        yield made.parent if inside is None else made / inside


def _rows(home: Path, which: str, values: tuple[str, ...]) -> Iterator[tuple[Path, bytes]]:
    path = home / PACKED
    if not path.is_file():
        return
    with (
        database_errors(path),
        closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database,
    ):
        query = f"SELECT name, sz, data FROM sqlar WHERE {which} ORDER BY name"
        (begun,) = database.execute("PRAGMA schema_version").fetchone()  # 0: its writer has just opened it
        rows = database.execute(query, values).fetchall() if begun else []
    for name, size, data in rows:
        parts = name.split("/")
        if len(parts) != DEPTH or not all(part.strip(".") for part in parts):
            raise StudyError(
                f"{path}: it holds {name!r}, which is not a trial's file. Restore the file from a copy."
            )
        try:
            found = data if len(data) == size else zlib.decompress(data)
            found = text_of(found) if name.endswith(COLUMNS) else found
        except (zlib.error, ValueError, TypeError) as error:
            raise StudyError(f"{path}: {name} is damaged ({error}). Restore the file from a copy.") from None
        yield home / name.removesuffix(COLUMNS), found


def _in(folder: str) -> tuple[str, str]:
    """The range for `_IN`: "0" comes after "/"."""
    return f"{folder}/", f"{folder}0"
