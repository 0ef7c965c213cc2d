"""Reads a study's database while another process may be writing it; damaged data are never returned."""

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import StudyError
from realitygap.study.arrays import evaluations, spread, unpacked
from realitygap.study.digest import OF_RUN, SCHEMA, kept, verify
from realitygap.study.schema import check_format, most_trials, told
from realitygap.study.views import NAMES, lay_views

__all__ = ["DATABASE", "Reader", "Table", "open_to_read"]

DATABASE = "study.db"
Table = dict[str, NDArray[Any]]


class Reader:
    """Opens the database whenever something is to be read."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._sound: set[tuple[int, str, bytes | None]] = set()

    @contextmanager
    def reading(self, part: str = "", run: int | None = None) -> Iterator[sqlite3.Connection]:
        """A consistent view of the database, after verifying what will be read.

        Args:
            part: the table to verify; "" for none.
            run: whose rows; all runs' if None, 0 for a table that belongs to the study.

        Raises:
            StudyError: it is broken, or not a study's, or its data have changed.
        """
        with told(self._path), closing(open_to_read(self._path)) as database:
            database.execute("BEGIN")
            check_format(database, self._path)
            self._verify(database, 0, SCHEMA)
            if part:
                runs = [row[0] for row in database.execute("SELECT id FROM run")] if run is None else [run]
                for one in runs:
                    self._verify(database, one, part)
            yield database

    def tasks(self) -> dict[str, dict[str, Any]]:
        """Facts of each task by its name."""
        return {name: json.loads(facts) for name, facts in self._kept("task")}

    def sources(self) -> dict[str, bytes]:
        """The files that the study depends on, by name."""
        return dict(self._kept("source"))

    def runs(self) -> list[dict[str, Any]]:
        """What is stored of each run, by the names of `load.Run`."""
        query = (
            'SELECT id, name, task, noise, position AS "index", evaluations, best_fitness, '
            "fittest AS fittest_number, champion AS champion_number, champion_fitness, finished "
            "FROM run ORDER BY id"
        )
        with self.reading("run") as database:
            rows = database.execute(query)
            names = [column[0] for column in rows.description]
            found = [dict(zip(names, row, strict=True)) for row in rows]
        return [{**row, "finished": bool(row["finished"])} for row in found]

    def encoding(self, run: int) -> dict[str, Any]:
        """What is stored of the encoding of a run's genotypes."""
        with self.reading("run", run) as database:
            text = database.execute("SELECT encoding FROM run WHERE id = ?", (run,)).fetchone()[0]
        facts: dict[str, Any] = json.loads(text)
        return facts

    def checkpoint(self, run: int) -> bytes | None:
        """The state that a run continues from; None at its beginning."""
        with self.reading("checkpoint", run) as database:
            row = database.execute("SELECT state FROM checkpoint WHERE run = ?", (run,)).fetchone()
        return None if row is None else bytes(row[0])

    def genotypes(self, run: int, number: int | None = None) -> tuple[int, bytes]:
        """Genotypes of all evaluations of a run, or of a block that contains `number`: number of the first,
        and their bytes."""
        which, values = "", [run]
        if number is not None:
            which = "AND number = (SELECT max(number) FROM evolved WHERE run = ? AND number <= ?)"
            values += [run, number]
        query = f"SELECT number, genotypes FROM evolved WHERE run = ? {which} ORDER BY number"
        with self.reading("evolved", run) as database:
            rows = database.execute(query, values).fetchall()
        return rows[0][0] if rows else 0, b"".join(unpacked(genes) for _, genes in rows)

    def evaluations(self, run: int | None) -> Table:
        """Every evaluation of a run, or of all, by run and number; NaN where there is no score."""
        rows = self._rows("evolved", "run, number, count, scores, fitness, places", run, "run, number")
        with self.reading("task", 0) as database:
            return evaluations(rows, most_trials(database))

    def tests(self, run: int | None) -> Table:
        """Fresh trials of the fittest and the champion."""
        kinds = {"run": np.int64, "who": "U8", "noise": float}
        return self._trials(kinds, run, "run, who DESC, noise", "who != 'population'")

    def retests(self, run: int | None) -> Table:
        """Fresh trials of the last population."""
        kinds = dict.fromkeys(("run", "cell", "number"), np.int64)
        return self._trials(kinds, run, "run, cell", "who = 'population'")

    def query(self, sql: str, config: Mapping[str, Any]) -> Table:
        """Columns that an SQL statement selects from the tables and the views.

        Raises:
            StudyError: the statement is invalid, or writes.
        """
        for part in OF_RUN:
            with self.reading(part):
                pass  # it holds what was written
        with self.reading() as database:
            lay_views(database, config)
            database.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)  # or ATTACH would make a file
            try:
                rows = database.execute(sql)
                names = [column[0] for column in rows.description or ()]
                found = rows.fetchall()
            except sqlite3.Error as error:
                why = str(error).rstrip(".")
                raise StudyError(
                    f"sql: {why}. Expected a SELECT from {', '.join(NAMES)} or a table of the study."
                ) from None
        if not names:
            raise StudyError(f"sql: expected a SELECT from {', '.join(NAMES)}, got {sql!r}.")
        if len(set(names)) != len(names):
            raise StudyError(f"sql: two columns have one name: {', '.join(names)}. Rename one (AS).")
        columns = zip(*found, strict=True) if found else [()] * len(names)
        return {name: _column(values) for name, values in zip(names, columns, strict=True)}

    def versions(self) -> dict[str, list[str]]:
        """Versions of what has worked on the study, by name, each once."""
        with self.reading("session", 0) as database:
            rows = database.execute("SELECT versions FROM session ORDER BY id").fetchall()
        found: dict[str, list[str]] = {}
        for (text,) in rows:
            for name, version in json.loads(text).items():
                if version not in found.setdefault(name, []):
                    found[name].append(version)
        return found

    def _trials(self, kinds: Mapping[str, Any], run: int | None, order: str, who: str) -> Table:
        """A row for each fresh trial of `who`."""
        return spread(self._rows("tested", ", ".join([*kinds, "scores"]), run, order, who), kinds)

    def _rows(
        self, part: str, columns: str, run: int | None, order: str, which: str = "true"
    ) -> list[tuple[Any, ...]]:
        """Rows of a run, or of all."""
        whose, values = ("true", ()) if run is None else ("run = ?", (run,))
        query = f"SELECT {columns} FROM {part} WHERE {whose} AND {which} ORDER BY {order}"
        with self.reading(part, run) as database:
            return database.execute(query, values).fetchall()

    def _kept(self, part: str) -> list[tuple[str, Any]]:
        with self.reading(part, 0) as database:
            return database.execute(f"SELECT * FROM {part} ORDER BY rowid").fetchall()

    def _verify(self, database: sqlite3.Connection, run: int, part: str) -> None:
        """Verify a part once, as long as nothing more is written."""
        seen = (run, part, kept(database, run, part))
        if seen not in self._sound:
            verify(database, self._path, run, part)
            self._sound.add(seen)


def _column(values: Sequence[Any]) -> NDArray[Any]:
    """Integers, or numbers with NaN for NULL, or whatever they are."""
    if all(type(value) is int for value in values):
        return np.array(values, np.int64)
    if all(isinstance(value, int | float | None) for value in values):
        return np.array([np.nan if value is None else value for value in values], np.float64)
    return np.array([*values, None], object)[:-1]


def open_to_read(path: Path) -> sqlite3.Connection:
    """A read-only connection; on a read-only medium SQLite's side files are not used."""
    uri = f"{path.resolve().as_uri()}?mode=ro"
    database = sqlite3.connect(uri, uri=True, isolation_level=None)
    try:
        database.execute("SELECT 1 FROM sqlite_master")
    except UnicodeDecodeError as error:  # of SQLite's message about a damaged name
        raise sqlite3.DatabaseError(f"malformed database schema: {error}") from None
    except sqlite3.OperationalError:
        database.close()
        log = path.with_name(f"{path.name}-wal")
        if log.exists() and log.stat().st_size:
            raise
        database = sqlite3.connect(f"{uri}&immutable=1", uri=True, isolation_level=None)
    return database
