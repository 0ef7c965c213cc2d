"""A study's database, read while another process may be writing it; what is damaged is not read."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from realitygap.study.digest import verify
from realitygap.study.schema import SEALED, check_format, told

__all__ = ["DATABASE", "Reader"]

DATABASE = "study.db"


class Reader:
    """Opens the database whenever something is to be read."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._sound: set[tuple[int, str, bytes]] = set()

    @contextmanager
    def reading(self, part: str = "", run: int | None = None) -> Iterator[sqlite3.Connection]:
        """The database at one moment, after a look at what will be read.

        Args:
            part: the table; "" for none of those that hold data.
            run: whose rows; all runs' if None, 0 for a table that belongs to the study.

        Raises:
            StudyError: it is broken, or no study's, or holds something else than was written.
        """
        with told(self._path), closing(_open(self._path)) as database:
            database.execute("BEGIN")
            if check_format(database, self._path) >= SEALED and part:
                runs = [row[0] for row in database.execute("SELECT id FROM run")] if run is None else [run]
                for one in runs:
                    self._verify(database, one, part)
            yield database

    def tasks(self) -> dict[str, dict[str, Any]] | None:
        """Facts of each task by its name; None in an older format."""
        rows = self._kept("task")
        return None if rows is None else {name: json.loads(facts) for name, facts in rows}

    def sources(self) -> dict[str, bytes] | None:
        """All that the study follows from, by the files' names; None in an older format."""
        rows = self._kept("source")
        return None if rows is None else dict(rows)

    def _kept(self, part: str) -> list[tuple[str, Any]] | None:
        with self.reading(part, 0) as database:
            if check_format(database, self._path) < SEALED:
                return None
            return database.execute(f"SELECT * FROM {part} ORDER BY rowid").fetchall()

    def _verify(self, database: sqlite3.Connection, run: int, part: str) -> None:
        """Once is enough, as long as nothing more is written."""
        query = "SELECT value FROM digest WHERE run = ? AND part = ?"
        seen = (run, part, *(database.execute(query, (run, part)).fetchone() or (b"",)))
        if seen not in self._sound:
            verify(database, self._path, run, part)
            self._sound.add(seen)


def _open(path: Path) -> sqlite3.Connection:
    """Read-only; on a medium that cannot be written even SQLite's own side files are done without."""
    uri = f"{path.resolve().as_uri()}?mode=ro"
    database = sqlite3.connect(uri, uri=True, isolation_level=None)
    try:
        database.execute("SELECT 1 FROM sqlite_master")
    except sqlite3.OperationalError:
        database.close()
        log = path.with_name(f"{path.name}-wal")
        if log.exists() and log.stat().st_size:
            raise
        database = sqlite3.connect(f"{uri}&immutable=1", uri=True, isolation_level=None)
    return database
