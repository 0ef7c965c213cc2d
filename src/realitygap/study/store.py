"""A study's database: `Store` writes it, `Reader` reads it, even while another process writes.

Data first, counter last, in one transaction: the write-ahead log preserves committed data through kill -9; a
power cut may lose the last transactions, never the database. Arrays are NumPy's .npz files, whose checksums
tell damage, as a digest does of a row's plain columns.
"""

from __future__ import annotations

import io
import json
import lzma
import math
import os
import sqlite3
import sys
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from hashlib import blake2b
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import StudyError
from realitygap.evolution.algorithm import Genes
from realitygap.files import atomic_path
from realitygap.values import Closing
from realitygap.work.folder import file_errors
from realitygap.work.pool import cores

__all__ = [
    "DATABASE", "LOST", "WHO", "Advanced", "Finished", "Message", "Reader", "Records", "Results", "Store",
    "Table", "create", "database_errors", "packed", "unpacked",
]  # fmt: skip

DATABASE = "study.db"
WHO = ("fittest", "champion")
"""Who is tested: the highest fitness ever stored (the paper's choice), and the best of the retest."""
APPLICATION = 0x52474150
"""`PRAGMA application_id` of a study's database: "RGAP"."""
FORMAT = 6
"""`PRAGMA user_version`: raised when the tables change. No other format is read."""

SCHEMA = f"""
CREATE TABLE meta (           -- facts of the study: its tasks, who has worked on it, the number of runs
    key TEXT PRIMARY KEY,
    json TEXT NOT NULL,
    digest BLOB NOT NULL
);
CREATE TABLE run (            -- an evolutionary run; its numbers are those of its checkpoint
    id INTEGER PRIMARY KEY,   -- from 1, condition by condition
    name TEXT NOT NULL,
    task TEXT NOT NULL,
    noise REAL NOT NULL,      -- level: 0 zero, 1 observed, 2 double
    position INTEGER NOT NULL, -- from 1 within its condition
    encoding TEXT NOT NULL,   -- JSON: the encoding's name and settings, dtype and shape of its genotypes
    evaluations INTEGER NOT NULL DEFAULT 0,
    best_fitness REAL,        -- highest fitness so far, of evaluation `fittest`
    fittest INTEGER,
    champion INTEGER,         -- evaluation number of the best in the retest, once finished
    champion_fitness REAL,    -- its mean score in the retest
    finished INTEGER NOT NULL DEFAULT 0,
    digest BLOB,              -- of the columns before
    state BLOB                -- npz: what the run goes on from
);
CREATE TABLE block (          -- evaluations between two checkpoints; of a finished run all, in xz
    run INTEGER NOT NULL REFERENCES run(id),
    first INTEGER NOT NULL,   -- number of the first, from 0 within its run
    data BLOB NOT NULL,       -- npz: number, fitness, scores, genes, parents, cell
    PRIMARY KEY (run, first)
);
CREATE TABLE tested (         -- tests of a finished run
    run INTEGER PRIMARY KEY REFERENCES run(id),
    data BLOB NOT NULL        -- npz: cells, numbers, retest of the last population; who, noise, fresh trials
);
PRAGMA application_id = {APPLICATION};
PRAGMA user_version = {FORMAT};
"""
COLUMNS = (
    "id", "name", "task", "noise", "position", "encoding", "evaluations", "best_fitness", "fittest",
    "champion", "champion_fitness", "finished",
)  # fmt: skip
"""Of a run, in its digest."""

MOST_BYTES = 2**30
"""Of a state, or of a run's tests: a hundred million of them."""

Table = dict[str, NDArray[Any]]
Arrays = Mapping[str, NDArray[Any]]


def packed(arrays: Arrays, *, final: bool = False) -> bytes:
    """Arrays as the bytes of an .npz file, deflated; `final` ones in xz: slower, and half as large."""
    file = io.BytesIO()
    if final:
        np.savez(file, **arrays)  # type: ignore[arg-type]
        return lzma.compress(file.getvalue(), preset=2)
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w") as place:
                np.lib.format.write_array(place, np.asanyarray(array), allow_pickle=False)
    return file.getvalue()


def unpacked(data: bytes, *names: str, most: int = MOST_BYTES) -> Table:
    """The arrays of an .npz file, or those of these names, `most` bytes in all.

    Raises:
        ValueError: it is damaged, or longer.
    """
    try:
        if data.startswith(b"\xfd7zXZ"):
            file = lzma.LZMADecompressor()
            data = file.decompress(data, most)
            if not file.eof:
                raise ValueError("it is cut short, or longer than what is kept of a run")
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            if sum(entry.file_size for entry in archive.zip.infolist()) > most:
                raise ValueError("it is longer than what is kept of a run")
            return {name: archive[name] for name in names or archive.files}
    except Exception as error:  # a damaged archive raises a dozen kinds of errors
        raise ValueError(str(error)) from None


@contextmanager
def database_errors(path: Path) -> Iterator[None]:
    """Turn errors of SQLite and of files into one StudyError that names the file and the cure."""
    try:
        with file_errors(path):
            yield
    except (sqlite3.Error, UnicodeDecodeError) as error:  # SQLite's message about a damaged name is no text
        raise StudyError(f"{path}: {_words(error)}") from error


def _words(error: Exception) -> str:
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
        full = "the disk is full" if code == sqlite3.SQLITE_FULL else f"{error}: is the disk full or gone?"
        return f"{full}. What was saved is kept: free some space and resume."
    if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, 0):
        return f"the database is broken ({error}). Restore it from a copy, or begin again in another folder."
    return f"{error}. Check the folder's rights, and that no other program holds the database."


def _broken(path: Path, what: str) -> StudyError:
    return StudyError(
        f"{path}: {what} does not hold what was written there: the file is damaged or was edited. Restore it "
        "from a copy, or begin again in another folder."
    )


def _check_format(database: sqlite3.Connection, path: Path) -> None:
    """Refuse files that are not a study's, or of another format."""
    if database.execute("PRAGMA application_id").fetchone()[0] != APPLICATION:
        raise StudyError(f"{path}: not a study's database. Give the folder of a study, or a new one.")
    version: int = database.execute("PRAGMA user_version").fetchone()[0]
    if version != FORMAT:
        cure = "Upgrade realitygap" if version > FORMAT else "Make the study again"
        raise StudyError(
            f"{path}: written in format {version}, this realitygap reads format {FORMAT}. {cure}."
        )


def _digest(*values: object) -> bytes:
    return blake2b(repr(values).encode(), digest_size=16).digest()


def create(path: Path, rows: Iterable[tuple[Any, ...]], tasks: Mapping[str, Mapping[str, Any]]) -> None:
    """Create a database with the runs of a study, complete or not at all.

    Args:
        path: of the file.
        rows: a run's id, name, task, noise, index and its encoding's facts each.
        tasks: facts of each by name.

    Raises:
        StudyError: it cannot be written there.
    """
    runs = [(*row, json.dumps(encoding)) for *row, encoding in rows]
    with (
        database_errors(path),
        atomic_path(path) as new,
        closing(sqlite3.connect(new, isolation_level=None)) as database,
    ):
        database.executescript(f"PRAGMA journal_mode = DELETE;BEGIN;{SCHEMA}COMMIT;")
        database.execute("BEGIN")
        database.executemany(f"INSERT INTO run ({', '.join(COLUMNS[:6])}) VALUES (?, ?, ?, ?, ?, ?)", runs)
        for run, *_ in runs:
            _seal(database, run)
        for key, value in (("runs", len(runs)), ("tasks", tasks), ("sessions", [])):
            _put(database, key, value)
        database.execute("COMMIT")


def _put(database: sqlite3.Connection, key: str, value: object) -> None:
    text = json.dumps(value)
    database.execute("REPLACE INTO meta VALUES (?, ?, ?)", (key, text, _digest(key, text)))


def _seal(database: sqlite3.Connection, run: int) -> None:
    """Store the digest of a run's columns as they are now."""
    row = database.execute(f"SELECT {', '.join(COLUMNS)} FROM run WHERE id = ?", (run,)).fetchone()
    database.execute("UPDATE run SET digest = ? WHERE id = ?", (_digest(*row), run))


class Records(NamedTuple):
    """n evaluations, a row each."""

    number: NDArray[np.int64]
    fitness: NDArray[np.float64]
    scores: NDArray[np.float64]
    """[n, trials]."""
    genes: Genes
    """[n, ...] of the encoding's type and shape."""
    parents: NDArray[np.int64]
    """[n, 2] evaluation numbers, −1: none."""
    cell: NDArray[np.int64]


class Results(NamedTuple):
    """Results of a finished run's tests."""

    cells: NDArray[np.int64]
    """[m] occupied cells of the last population."""
    numbers: NDArray[np.int64]
    """[m] who: evaluation numbers."""
    retest: NDArray[np.float64]
    """[m, retest trials] scores."""
    champion: int
    """Row of the highest mean in `retest`."""
    fresh: dict[tuple[str, float], NDArray[np.float64]]
    """Scores on fresh trials by (who, noise level)."""


class Advanced(NamedTuple):
    """Evaluations of a run, and the state after them."""

    run: int
    records: Records
    evaluations: int
    best_fitness: float
    best_number: int
    state: bytes


class Finished(NamedTuple):
    """A run's tests, after all its evaluations: the run is complete."""

    run: int
    evaluations: int
    results: Results


Message = Advanced | Finished


LOST = (
    "workers: expected each message of a job once and in order, but one was lost or duplicated. What was "
    "saved is kept: resume with other workers, and fix the pool (realitygap.testing.PoolContract)."
)


class Store(Closing):
    """A study's database, open for writing; one process writes (see `work.folder.lock`)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            raise StudyError(f"{path}: no such database. Restore it from a copy, or choose another folder.")
        Reader(path).check()
        with database_errors(path):
            self._database = sqlite3.connect(path, isolation_level=None)
            try:
                self._database.execute("PRAGMA journal_mode = WAL")
                self._database.execute("PRAGMA synchronous = NORMAL")
            except BaseException:
                self._database.close()
                raise
        self._threads = ThreadPoolExecutor(cores())

    def close(self) -> None:
        self._threads.shutdown()
        self._database.close()

    def begin_session(self, versions: Mapping[str, str]) -> None:
        """Record who works on the study from now on."""
        began = datetime.now(UTC).isoformat(timespec="seconds")
        session = {"began": began, "pid": os.getpid(), "versions": dict(versions)}
        with self._transaction() as database:
            _put(database, "sessions", [*Reader(self.path).meta("sessions"), session])

    def unfinished(self) -> list[tuple[int, int]]:
        """Ids of the unfinished runs, and the number of evaluations each has done."""
        with database_errors(self.path):
            query = "SELECT id, evaluations FROM run WHERE NOT finished ORDER BY id"
            return self._database.execute(query).fetchall()

    def checkpoint(self, run: int, read: Callable[[int, bytes], object]) -> bytes | None:
        """The state that the run continues from, if `read` can read it; None at its beginning.

        Raises:
            StudyError: the checkpoint is damaged.
        """
        state = Reader(self.path).checkpoint(run)
        try:
            if state is not None:
                read(run, state)
        except StudyError as error:
            raise StudyError(f"{self.path}: run {run}: {error}. Restore the file from a copy.") from None
        return state

    def keep(self, messages: Sequence[Message]) -> None:
        """Store what jobs came to, all of it or nothing.

        Raises:
            StudyError: a message is not the next of its run, as where a user's own pool lost or doubled one.
        """
        advanced = [message for message in messages if isinstance(message, Advanced)]
        finished = [one for one in messages if isinstance(one, Finished)]  # after all else of a run
        done = dict(self.unfinished())
        for message in messages:
            new = len(message.records.number) if isinstance(message, Advanced) else 0
            if done.pop(message.run, None) != message.evaluations - new:
                raise StudyError(LOST)
            if isinstance(message, Advanced):
                done[message.run] = message.evaluations
        with self._transaction() as database:
            blocks = self._packed([(one.records._asdict(), False) for one in advanced])
            for one, block in zip(advanced, blocks, strict=True):
                first = one.evaluations - len(one.records.number)
                state = packed({"state": np.frombuffer(one.state, np.uint8)})
                database.execute("INSERT INTO block VALUES (?, ?, ?)", (one.run, first, block))
                database.execute(
                    "UPDATE run SET evaluations = ?, best_fitness = ?, fittest = ?, state = ? WHERE id = ?",
                    (one.evaluations, one.best_fitness, one.best_number, state, one.run),
                )
                _seal(database, one.run)
            query = "SELECT data FROM block WHERE run = ? ORDER BY first"
            parts = [
                [
                    _unpacked(self.path, done.run, "block", data, most=sys.maxsize)  # our own, however long
                    for (data,) in database.execute(query, (done.run,))
                ]
                for done in finished
            ]
            blocks = self._packed([(_joined(blocks), True) for blocks in parts])
            for (run, _, results), block in zip(finished, blocks, strict=True):
                scores = results.retest[results.champion].tolist()
                champion = int(results.numbers[results.champion]), math.fsum(scores) / len(scores)
                who, noise = zip(*results.fresh, strict=True)
                tested = {
                    "cells": results.cells, "numbers": results.numbers, "retest": results.retest,
                    "who": np.array(who), "noise": np.array(noise),
                    "fresh": np.stack([*results.fresh.values()]),
                }  # fmt: skip
                database.execute("DELETE FROM block WHERE run = ?", (run,))
                database.execute("INSERT INTO block VALUES (?, 0, ?)", (run, block))
                database.execute("INSERT INTO tested VALUES (?, ?)", (run, packed(tested, final=True)))
                database.execute(
                    "UPDATE run SET champion = ?, champion_fitness = ?, finished = 1 WHERE id = ?",
                    (*champion, run),
                )
                _seal(database, run)

    def _packed(self, some: Sequence[tuple[Arrays, bool]]) -> Iterable[bytes]:
        """Compressed in threads where there are several."""
        return (map if len(some) < 2 else self._threads.map)(lambda one: packed(one[0], final=one[1]), some)

    def take(self, source: Path, runs: Sequence[int]) -> None:
        """Copy runs from another database of the same study, and who worked on it."""
        sessions = [*Reader(self.path).meta("sessions"), *Reader(source).meta("sessions")]
        with database_errors(source), closing(_opened(source)) as other, self._transaction() as database:
            for table, key in (("block", "run"), ("tested", "run"), ("run", "id")):
                for run in runs:
                    database.execute(f"DELETE FROM {table} WHERE {key} = ?", (run,))
                    rows = other.execute(f"SELECT * FROM {table} WHERE {key} = ?", (run,))
                    places = ", ".join("?" * len(rows.description))
                    database.executemany(f"INSERT INTO {table} VALUES ({places})", rows)
            _put(database, "sessions", sessions)

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with database_errors(self.path):
            self._database.execute("BEGIN IMMEDIATE")
            try:
                yield self._database
                self._database.execute("COMMIT")
            except BaseException:
                if self._database.in_transaction:
                    self._database.execute("ROLLBACK")
                raise


def _joined(blocks: Sequence[Arrays]) -> Table:
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


class Reader:
    """Opens the database whenever something is to be read; that is checked in the same transaction."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        """A consistent view of the database."""
        with database_errors(self.path), closing(_opened(self.path)) as database:
            database.execute("BEGIN")
            _check_format(database, self.path)
            yield database

    def meta(self, key: str) -> Any:
        """A fact of the study."""
        with self._reading() as database:
            return self._meta(database, key)

    def _meta(self, database: sqlite3.Connection, key: str) -> Any:
        row = database.execute("SELECT json, digest FROM meta WHERE +key = ?", (key,)).fetchone()
        if row is None or row[1] != _digest(key, row[0]):
            raise _broken(self.path, "table 'meta'")
        return json.loads(row[0])

    def runs(self) -> list[dict[str, Any]]:
        """All columns of each run but its state."""
        with self._reading() as database:
            return self._runs(database)

    def _runs(self, database: sqlite3.Connection) -> list[dict[str, Any]]:
        rows = database.execute(f"SELECT {', '.join(COLUMNS)}, digest FROM run ORDER BY id").fetchall()
        for row in rows:
            if _digest(*row[:-1]) != row[-1]:
                raise _broken(self.path, f"run {row[0]}: table 'run'")
        if [row[0] for row in rows] != list(range(1, self._meta(database, "runs") + 1)):
            raise _broken(self.path, "table 'run'")
        return [dict(zip(COLUMNS, row, strict=False)) for row in rows]

    def checkpoint(self, run: int) -> bytes | None:
        """The state that a run continues from; None at its beginning."""
        with self._reading() as database:
            row = database.execute("SELECT state FROM run WHERE id = ?", (run,)).fetchone()
            done = self._runs(database)[run - 1]["evaluations"]
        if row is None or (row[0] is None) != (done == 0):
            raise _broken(self.path, f"run {run}: table 'run'")
        return (
            None if row[0] is None else _unpacked(self.path, run, "run", row[0], "state")["state"].tobytes()
        )

    def evaluated(self, run: int, *names: str) -> Table:
        """Arrays of all evaluations of a run so far, as of `run.Records`; {} of none."""
        with self._reading() as database:
            row = self._runs(database)[run - 1]
            trials, genes = self._meta(database, "tasks")[row["task"]]["trials"], json.loads(row["encoding"])
            query = "SELECT data FROM block WHERE +run = ? ORDER BY +first"
            rows = database.execute(query, (run,)).fetchall()
        done, names = row["evaluations"], names and ("number", *names)
        each = math.prod(genes["shape"]) * np.dtype(genes["dtype"]).itemsize + 8 * (trials + 5)
        most = 4096 + done * each
        blocks = [_unpacked(self.path, run, "block", data, *names, most=most) for (data,) in rows]
        made = _joined(blocks) if blocks else {}
        if not np.array_equal(made.get("number", ()), range(done)):
            raise _broken(self.path, f"run {run}: table 'block'")
        return made

    def tested(self, run: int) -> Table:
        """Arrays of a finished run's tests; {} before."""
        with self._reading() as database:
            finished = self._runs(database)[run - 1]["finished"]
            row = database.execute("SELECT data FROM tested WHERE +run = ?", (run,)).fetchone()
        if bool(finished) != (row is not None):
            raise _broken(self.path, f"run {run}: table 'tested'")
        return {} if row is None else _unpacked(self.path, run, "tested", row[0])

    def check(self) -> None:
        """Check the whole database.

        Raises:
            StudyError: it is broken; names the first table that is.
        """
        with self._reading() as database:
            answer = database.execute("PRAGMA quick_check(1)").fetchone()[0]
        if answer != "ok":
            raise StudyError(
                f"{self.path}: the database is broken ({' '.join(str(answer).split())}). "
                "Restore it from a copy, or begin again in another folder."
            )
        for key in ("tasks", "sessions"):
            self.meta(key)
        for run in (row["id"] for row in self.runs()):
            self.evaluated(run), self.tested(run), self.checkpoint(run)

    def copy(self, path: Path) -> None:
        """A copy as of now, what is still in the write-ahead log included."""
        with self._reading() as source, database_errors(path), closing(sqlite3.connect(path)) as copy:
            source.backup(copy)


def _unpacked(path: Path, run: int, table: str, data: bytes, *names: str, most: int = MOST_BYTES) -> Table:
    try:
        return unpacked(data, *names, most=most)
    except ValueError:
        raise _broken(path, f"run {run}: table {table!r}") from None


def _uri(path: Path) -> str:
    return f"{path.resolve().as_uri()}?mode=ro"


def _opened(path: Path) -> sqlite3.Connection:
    """A read-only connection; on a read-only medium SQLite's side files are not used."""
    database = sqlite3.connect(_uri(path), uri=True, isolation_level=None)
    try:
        database.execute("SELECT 1 FROM sqlite_master")
    except sqlite3.OperationalError:
        database.close()
        log = path.with_name(f"{path.name}-wal")
        if log.exists() and log.stat().st_size:
            raise
        database = sqlite3.connect(f"{_uri(path)}&immutable=1", uri=True, isolation_level=None)
    return database
