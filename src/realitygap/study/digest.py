"""Digests of all that a study's database holds, so that a flipped bit is never read as a datum.

SQLite finds pages that make no sense; a changed number makes sense. Each table's rows are chained,
row by row, run by run: what is added costs its own length, what is read is checked as a whole.
"""

import json
import sqlite3
from collections.abc import Iterable
from hashlib import blake2b
from pathlib import Path
from typing import Any

from realitygap.errors import StudyError
from realitygap.study.schema import ARRAYS, check_format

__all__ = ["SCHEMA", "check_of", "parts", "seal", "seal_more", "verify", "verify_all"]

OF_RUN = {
    "run": "id",
    "evolved": "number",
    "tested": "who, noise, cell",
    "evaluation": "number",
    "genotypes": "number",
    "checkpoint": "evaluations",
    "retest": "cell, trial",
    "test": "who, noise, trial",
}
"""Tables whose rows belong to a run, of any format, and the order of those."""
OF_STUDY = {"source": "name", "task": "name", "session": "id"}
"""Tables that are one whole; their digests stand under run 0."""
SCHEMA = "sqlite_master"
"""What SQLite itself says of the tables: of newer formats it is sealed like those."""
BYTES = 16


def check_of(facts: object) -> str:
    """A digest of what JSON holds, to stand beside it in its file."""
    return blake2b(json.dumps(facts).encode(), digest_size=8).hexdigest()


def seal(database: sqlite3.Connection, run: int, *parts: str) -> None:
    """Put down the digests of tables as they are now, of the rows of a run (0: of all)."""
    for part in parts:
        _put(database, run, part, _digests(database, run, part)[1])


def seal_more(database: sqlite3.Connection, run: int, part: str, since: int) -> None:
    """Put down a digest after rows were added, from the one that holds up to row number `since`.

    Args:
        database: open for writing.
        run: whose rows.
        part: the table.
        since: number of the first row that is new.
    """
    query = f"SELECT * FROM {part} WHERE run = ? AND number >= ? ORDER BY number"
    rows = database.execute(query, (run, since))
    _put(database, run, part, _chained(_kept(database, run, part) or _first(part, rows), rows))


def verify(database: sqlite3.Connection, path: Path, run: int, part: str) -> None:
    """See that a table's rows of a run are those that were written; run 0: of a table of the study.

    Args:
        database: open for reading.
        path: its file, for the message.
        run: whose rows; 0 for a table that belongs to the study.
        part: the table.

    Raises:
        StudyError: they are not; names the file, the run and the cure.
    """
    of_none, there = _digests(database, run, part)
    if there != (_kept(database, run, part) or of_none):
        whose = f"run {run}: " if run else ""
        raise StudyError(
            f"{path}: {whose}table {part!r} does not hold what was written there: the file is damaged or was "
            "edited. Restore it from a copy, or begin again in another folder."
        )


def verify_all(database: sqlite3.Connection, path: Path) -> None:
    """See that everything is what was written.

    Raises:
        StudyError: names the first that is not.
    """
    for part in (*OF_STUDY, *([SCHEMA] if check_format(database, path) >= ARRAYS else [])):
        verify(database, path, 0, part)
    there = parts(database)
    for (run,) in database.execute("SELECT id FROM run ORDER BY id").fetchall():
        for part in there:
            verify(database, path, run, part)


def parts(database: sqlite3.Connection) -> list[str]:
    """The tables that hold rows of runs, in this database's format."""
    there = {name for (name,) in database.execute("SELECT name FROM sqlite_master")}
    return [part for part in OF_RUN if part in there]


def _digests(database: sqlite3.Connection, run: int, part: str) -> tuple[bytes, bytes]:
    """Of no rows, and of those that are there."""
    if part == SCHEMA:
        own = "', '".join([*OF_RUN, *OF_STUDY, "digest"])  # what others may have added is theirs
        rows = database.execute(f"SELECT name, sql FROM {SCHEMA} WHERE name IN ('{own}') ORDER BY name")
    elif part in OF_STUDY:
        # the rows themselves, not what an index says of them: that is what is read
        rows = database.execute(f"SELECT * FROM {part} ORDER BY +{OF_STUDY[part]}")
    else:
        whose = "id" if part == "run" else "run"
        rows = database.execute(f"SELECT * FROM {part} WHERE {whose} = ? ORDER BY {OF_RUN[part]}", (run,))
    first = _first(part, rows)
    return first, _chained(first, rows)


def _first(part: str, rows: sqlite3.Cursor) -> bytes:
    """Where a table's chain begins: a renamed column is a change too."""
    names = [part, *(column[0] for column in rows.description)]
    return blake2b(repr(names).encode(), digest_size=BYTES).digest()


def _chained(before: bytes, rows: Iterable[tuple[Any, ...]]) -> bytes:
    for row in rows:
        plain = repr([f"{len(value)} bytes" if isinstance(value, bytes) else value for value in row])
        content = b"".join(value for value in row if isinstance(value, bytes))
        before = blake2b(before + plain.encode() + content, digest_size=BYTES).digest()
    return before


def _kept(database: sqlite3.Connection, run: int, part: str) -> bytes | None:
    query = "SELECT value FROM digest WHERE run = ? AND part = ?"
    row = database.execute(query, (run, part)).fetchone()
    return None if row is None else row[0]


def _put(database: sqlite3.Connection, run: int, part: str, value: bytes) -> None:
    database.execute("REPLACE INTO digest VALUES (?, ?, ?)", (run, part, value))
