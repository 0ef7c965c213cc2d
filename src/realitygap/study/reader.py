"""A study's database, read while another process may be writing it; what is damaged is not read."""

import json
import sqlite3
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import StudyError
from realitygap.study.digest import verify
from realitygap.study.schema import BLOCKS, NAMES, SEALED, check_format, told, views

__all__ = ["DATABASE", "Reader", "Table", "open_to_read"]

DATABASE = "study.db"
Table = dict[str, NDArray[Any]]


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
        with told(self._path), closing(open_to_read(self._path)) as database:
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

    def runs(self) -> list[dict[str, Any]]:
        """What stands of each run, by the names of `load.Run`."""
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

    def encoding(self, run: int) -> dict[str, Any] | None:
        """What is kept of the encoding of a run's genotypes; None in an older format."""
        with self.reading("run", run) as database:
            if "encoding" not in [row[1] for row in database.execute("PRAGMA table_info(run)")]:
                return None
            text = database.execute("SELECT encoding FROM run WHERE id = ?", (run,)).fetchone()[0]
        facts: dict[str, Any] = json.loads(text)
        return facts

    def checkpoint(self, run: int) -> bytes | None:
        """What a run goes on from; None at its beginning."""
        with self.reading("checkpoint", run) as database:
            row = database.execute("SELECT state FROM checkpoint WHERE run = ?", (run,)).fetchone()
        return None if row is None else bytes(row[0])

    def genotypes(self, run: int, number: int | None = None) -> tuple[int, bytes]:
        """Of all evaluations of a run, or of some with this one: number of the first, and their bytes."""
        with self.reading() as database:
            blocks = check_format(database, self._path) >= BLOCKS
        part, column = ("genotypes", "content") if blocks else ("evaluation", "genotype")
        which, values = "", [run]
        if number is not None:
            which = f"AND number = (SELECT max(number) FROM {part} WHERE run = ? AND number <= ?)"
            values += [*values, number]
        query = f"SELECT number, {column} FROM {part} WHERE run = ? {which} ORDER BY number"
        with self.reading(part, run) as database:
            rows = database.execute(query, values).fetchall()
        found = b"".join(zlib.decompress(row[1]) if blocks else row[1] for row in rows)
        return rows[0][0] if rows else 0, found

    def table(self, name: str, kinds: Mapping[str, Any], order: str, run: int | None) -> Table:
        """Columns of a table, of a run or of all; NaN where there is nothing.

        `kinds` are NumPy types by column, `order` is what SQL orders the rows by.

        Args:
            name: the table's.
            kinds: NumPy types by column.
            order: SQL, what the rows are ordered by.
            run: whose rows; all runs' if None.
        """
        where, values = ("", ()) if run is None else ("WHERE run = ?", (run,))
        with self.reading(name, run) as database:
            count = database.execute(f"SELECT count(*) FROM {name} {where}", values).fetchone()[0]
            rows = database.execute(f"SELECT {', '.join(kinds)} FROM {name} {where} ORDER BY {order}", values)
            filled = np.fromiter(map(_nan_for_none, rows), np.dtype(list(kinds.items())), count)
        return {key: np.ascontiguousarray(filled[key]) for key in kinds}

    def query(self, sql: str, config: Mapping[str, Any]) -> Table:
        """Columns of what a statement of SQL selects from the tables and the views.

        Raises:
            StudyError: the statement cannot be carried out, or writes.
        """
        for part in ("run", "evaluation", "retest", "test"):
            with self.reading(part):
                pass  # it holds what was written
        with self.reading() as database:
            for view in views(database, config, temporary=True):
                database.execute(view)
            try:
                rows = database.execute(sql)
                names = [column[0] for column in rows.description or ()]
                found = rows.fetchall()
            except sqlite3.Error as error:
                raise StudyError(
                    f"sql: {error}. Expected a SELECT from {', '.join(NAMES)} or a table of the study."
                ) from None
        if len(set(names)) != len(names):
            raise StudyError(f"sql: two columns have one name: {', '.join(names)}. Rename one (AS).")
        columns = zip(*found, strict=True) if found else [()] * len(names)
        return {name: _column(values) for name, values in zip(names, columns, strict=True)}

    def digest(self) -> str:
        """Of every row of every run, genotypes as they were before they were packed; not of checkpoints,
        which say how to go on. Of the oldest format, which keeps no digests, of its runs and genotypes."""
        with self.reading() as database:
            runs = [row[0] for row in database.execute("SELECT id FROM run ORDER BY id")]
            query = "SELECT name, evaluations, best_fitness, champion_fitness FROM run ORDER BY id"
            if check_format(database, self._path) >= SEALED:
                query = "SELECT run, part, value FROM digest WHERE run > 0 "
                query += "AND part NOT IN ('checkpoint', 'genotypes') ORDER BY run, part"
            whole = blake2b(repr(database.execute(query).fetchall()).encode(), digest_size=16)
        for run in runs:
            whole.update(blake2b(self.genotypes(run)[1]).digest())
        return whole.hexdigest()

    def versions(self) -> dict[str, list[str]]:
        """What has worked on the study, by name, each version once."""
        with self.reading("session", 0) as database:
            rows = database.execute("SELECT versions FROM session ORDER BY id").fetchall()
        found: dict[str, list[str]] = {}
        for (text,) in rows:
            for name, version in json.loads(text).items():
                if version not in found.setdefault(name, []):
                    found[name].append(version)
        return found

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


def _nan_for_none(row: Sequence[Any]) -> tuple[Any, ...]:
    return tuple(np.nan if value is None else value for value in row)


def _column(values: Sequence[Any]) -> NDArray[Any]:
    """Whole numbers, or numbers with NaN for nothing, or whatever they are."""
    if all(type(value) is int for value in values):
        return np.array(values, np.int64)
    if all(isinstance(value, int | float | None) for value in values):
        return np.array([np.nan if value is None else value for value in values], np.float64)
    return np.array([*values, None], object)[:-1]


def open_to_read(path: Path) -> sqlite3.Connection:
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
