"""The tables of a study's database, as SQL, and SQLite's errors in plain words."""

import errno
import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from realitygap.errors import StudyError

__all__ = ["APPLICATION", "FORMAT", "check_format", "most_trials", "schema", "told"]

APPLICATION = 0x52474150
"""`PRAGMA application_id` of a study's database: "RGAP"."""
FORMAT = 5
"""`PRAGMA user_version`: raised when the tables change. No other format is read."""


def schema() -> str:
    """SQL of all tables."""
    fixed = Path(__file__).with_name("schema.sql").read_text("utf-8")
    return f"\n{fixed}PRAGMA application_id = {APPLICATION};\nPRAGMA user_version = {FORMAT};\n"


def check_format(database: sqlite3.Connection, path: Path) -> None:
    """Refuse files that are not a study's, or of another format.

    Raises:
        StudyError: names the file and the cure.
    """
    if database.execute("PRAGMA application_id").fetchone()[0] != APPLICATION:
        raise StudyError(f"{path}: not a study's database. Give the folder of a study, or a new one.")
    version: int = database.execute("PRAGMA user_version").fetchone()[0]
    if version != FORMAT:
        cure = "Upgrade realitygap" if version > FORMAT else "Make the study again"
        raise StudyError(
            f"{path}: written in format {version}, this realitygap reads format {FORMAT}. {cure}."
        )


@contextmanager
def told(path: Path) -> Iterator[None]:
    """Turn errors of SQLite and of files into one StudyError that names the file and the cure."""
    try:
        yield
    except sqlite3.Error as error:
        raise StudyError(f"{path}: {_words(error)}") from error
    except OSError as error:
        kept = "What was saved is kept. " if error.errno == errno.ENOSPC else ""
        cure = "Free some space and resume" if kept else "Check the path and its rights, or take another"
        there = "a file, or a link to nothing, is there" if isinstance(error, FileExistsError) else None
        what = there or error.strerror or str(error)
        raise StudyError(f"{error.filename or path}: {what}. {kept}{cure}.") from error


def _words(error: sqlite3.Error) -> str:
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code == sqlite3.SQLITE_FULL:
        return "the disk is full. What was saved is kept: free some space and resume."
    if code == sqlite3.SQLITE_IOERR:
        return f"{error}: is the disk full or gone? What was saved is kept: see to it and resume."
    if code in (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_PERM, sqlite3.SQLITE_CANTOPEN):
        return f"{error}. Check the folder's rights, or copy the study elsewhere."
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return f"another program holds the database ({error}). Close it and resume."
    return f"the database is broken ({error}). Restore it from a copy, or begin again in another folder."


def most_trials(database: sqlite3.Connection) -> int:
    """The largest number of trials that a task's evaluations have."""
    return max(int(json.loads(facts)["trials"]) for (facts,) in database.execute("SELECT facts FROM task"))
