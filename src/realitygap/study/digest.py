"""Digests of everything in a study's database, so that a flipped bit is never read as data.

SQLite detects invalid pages, but not a changed number. Each table's rows are chained, row by row, run by run:
adding rows costs only their length, reading checks the whole.
"""

import json
import sqlite3
from collections.abc import Iterable
from hashlib import blake2b
from pathlib import Path
from typing import Any

from realitygap.errors import StudyError

__all__ = ["OF_RUN", "SCHEMA", "check_of", "kept", "seal", "seal_more", "verify", "verify_all"]

OF_RUN = {
    "run": "id",
    "evolved": "number",
    "tested": "who, noise, cell",
    "checkpoint": "evaluations",
}
"""Tables whose rows belong to a run, and their order."""
OF_STUDY = {"source": "name", "task": "name", "session": "id"}
"""Tables of the whole study; their digests are stored under run 0."""
SCHEMA = "sqlite_master"
"""SQLite's own table of tables, which is sealed too."""
BYTES = 16


def check_of(facts: object) -> str:
    """A digest of JSON data, to be stored beside it in its file."""
    return blake2b(json.dumps(facts).encode(), digest_size=8).hexdigest()


def seal(database: sqlite3.Connection, run: int, *parts: str) -> None:
    """Store the digests of tables as they are now, of the rows of a run (0: of all)."""
    for part in parts:
        _put(database, run, part, _digests(database, run, part)[1])


def seal_more(database: sqlite3.Connection, run: int, part: str, since: int) -> None:
    """Update a digest after rows were added, from the one up to row number `since`.

    Args:
        database: open for writing.
        run: whose rows.
        part: the table.
        since: number of the first row that is new.
    """
    query = f"SELECT * FROM {part} WHERE run = ? AND number >= ? ORDER BY number"
    rows = database.execute(query, (run, since))
    _put(database, run, part, _chained(kept(database, run, part) or _first(part, rows), rows))


def verify(database: sqlite3.Connection, path: Path, run: int, part: str) -> None:
    """Check that a table's rows of a run are those that were written; run 0: of a table of the study.

    Args:
        database: open for reading.
        path: its file, for the message.
        run: whose rows; 0 for a table that belongs to the study.
        part: the table.

    Raises:
        StudyError: they differ; names the file, the run and the cure.
    """
    of_none, there = _digests(database, run, part)
    if there != (kept(database, run, part) or of_none):
        whose = f"run {run}: " if run else ""
        raise StudyError(
            f"{path}: {whose}table {part!r} does not hold what was written there: the file is damaged or was "
            "edited. Restore it from a copy, or begin again in another folder."
        )


def verify_all(database: sqlite3.Connection, path: Path) -> None:
    """Check the whole database.

    Raises:
        StudyError: names the first table that differs.
    """
    for part in (*OF_STUDY, SCHEMA):
        verify(database, path, 0, part)
    for (run,) in database.execute("SELECT id FROM run ORDER BY id").fetchall():
        for part in OF_RUN:
            verify(database, path, run, part)


def _digests(database: sqlite3.Connection, run: int, part: str) -> tuple[bytes, bytes]:
    """The digest without rows, and that of the present rows."""
    if part == SCHEMA:
        own = "', '".join([*OF_RUN, *OF_STUDY, "digest"])  # tables that others may have added are not checked
        rows = database.execute(f"SELECT name, sql FROM {SCHEMA} WHERE name IN ('{own}') ORDER BY name")
    elif part in OF_STUDY:
        # the rows themselves, not an index, since they are what is read
        rows = database.execute(f"SELECT * FROM {part} ORDER BY +{OF_STUDY[part]}")
    else:
        whose = "id" if part == "run" else "run"
        rows = database.execute(f"SELECT * FROM {part} WHERE {whose} = ? ORDER BY {OF_RUN[part]}", (run,))
    first = _first(part, rows)
    return first, _chained(first, rows)


def _first(part: str, rows: sqlite3.Cursor) -> bytes:
    """The start of a table's chain, which includes the columns' names."""
    names = [part, *(column[0] for column in rows.description)]
    return blake2b(repr(names).encode(), digest_size=BYTES).digest()


def _chained(before: bytes, rows: Iterable[tuple[Any, ...]]) -> bytes:
    for row in rows:
        plain = repr([f"{len(value)} bytes" if isinstance(value, bytes) else value for value in row])
        content = b"".join(value for value in row if isinstance(value, bytes))
        before = blake2b(before + plain.encode() + content, digest_size=BYTES).digest()
    return before


def kept(database: sqlite3.Connection, run: int, part: str) -> bytes | None:
    """The digest on file of a table's rows; None where none was written."""
    query = "SELECT value FROM digest WHERE run = ? AND part = ?"
    row = database.execute(query, (run, part)).fetchone()
    return None if row is None else row[0]


def _put(database: sqlite3.Connection, run: int, part: str, value: bytes) -> None:
    database.execute("REPLACE INTO digest VALUES (?, ?, ?)", (run, part, value))
