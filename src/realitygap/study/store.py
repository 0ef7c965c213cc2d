"""Writes a study's database: data first, counter last, in one transaction.

One process writes (see `folder.lock`). The write-ahead log preserves committed data through kill -9; a power
cut may lose the last transactions, never the database.
"""

import json
import math
import os
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.control.encoding import facts_of
from realitygap.errors import StudyError
from realitygap.files import atomic_path
from realitygap.study.arrays import Block, joined
from realitygap.study.digest import SCHEMA, seal, seal_more, verify_all
from realitygap.study.jobs import Advanced, Finished, Message
from realitygap.study.materials import Materials
from realitygap.study.plan import plans
from realitygap.study.run import WHO, Results
from realitygap.study.schema import check_format, schema, told
from realitygap.study.views import views
from realitygap.values import Closing
from realitygap.work.pool import cores

__all__ = ["Store", "create"]

Row = tuple[Any, ...]
"""Of the table `evolved`."""


def create(path: Path, materials: Materials, sources: Mapping[str, bytes]) -> None:
    """Create a database with the runs of a study, complete or not at all; `sources` are its files by name.

    Raises:
        StudyError: it cannot be written there.
    """
    tasks, config = materials.tasks, materials.config
    local = materials.copies()[0].encoding  # a user's file by its name in the folder
    own = {"kind": local.kind, **local.to_dict()}
    forms = [facts_of(config.encoding_for(task), {**own, "inputs": len(task.sensors)}) for task in tasks]
    encodings = [json.dumps(form) for form in forms]
    rows = [(p.id, p.name, p.task, p.noise, p.index, encodings[p.condition]) for p in plans(materials)]
    facts = {task.name: json.dumps(task.to_dict()) for task in tasks}
    with (
        told(path),
        atomic_path(path) as new,
        closing(sqlite3.connect(new, isolation_level=None)) as database,
    ):
        database.execute("PRAGMA page_size = 1024")
        database.execute("PRAGMA journal_mode = DELETE")
        database.executescript(f"BEGIN;{schema()}COMMIT;")
        database.execute("BEGIN")
        columns = "id, name, task, noise, position, encoding"
        database.executemany(f"INSERT INTO run ({columns}) VALUES (?, ?, ?, ?, ?, ?)", rows)
        database.executemany("INSERT INTO source VALUES (?, ?)", sources.items())
        database.executemany("INSERT INTO task VALUES (?, ?)", facts.items())
        for view in views(database, materials.copies()[0].to_dict()):
            database.execute(view)
        seal(database, 0, "source", "task", SCHEMA)
        for row in rows:
            seal(database, row[0], "run")
        database.execute("COMMIT")


class Store(Closing):
    """A study's database, open for writing."""

    def __init__(self, path: Path) -> None:
        self.path, self._threads = path, ThreadPoolExecutor(cores())
        if not path.is_file():
            raise StudyError(f"{path}: no such database. Restore it from a copy, or choose another folder.")
        with told(path):
            self._database = sqlite3.connect(path, isolation_level=None)
            try:
                check_format(self._database, path)
                self._check_whole()
                self._database.execute("PRAGMA journal_mode = WAL")
                self._database.execute("PRAGMA synchronous = NORMAL")
            except BaseException:
                self._database.close()
                raise

    def close(self) -> None:
        self._threads.shutdown()
        self._database.close()

    def begin_session(self, versions: Mapping[str, str]) -> None:
        """Record who works on the study from now on."""
        row = (datetime.now(UTC).isoformat(timespec="seconds"), os.getpid(), json.dumps(dict(versions)))
        with self._transaction():
            self._database.execute("INSERT INTO session (began, pid, versions) VALUES (?, ?, ?)", row)
            seal(self._database, 0, "session")

    def unfinished(self) -> list[tuple[int, int]]:
        """Ids of the unfinished runs, and the number of evaluations each has done."""
        with told(self.path):
            query = "SELECT id, evaluations FROM run WHERE NOT finished ORDER BY id"
            return self._database.execute(query).fetchall()

    def checkpoint(self, run: int, read: Callable[[int, bytes], object]) -> bytes | None:
        """The state that the run continues from, if `read` can read it; None at its beginning.

        Raises:
            StudyError: the checkpoint is damaged.
        """
        with told(self.path):
            row = self._database.execute("SELECT state FROM checkpoint WHERE run = ?", (run,)).fetchone()
        if row is None:
            return None
        try:
            read(run, row[0])
        except StudyError as error:
            raise StudyError(f"{self.path}: run {run}: {error}. Restore the file from a copy.") from None
        return bytes(row[0])

    def keep(self, messages: Sequence[Message]) -> None:
        """Store what jobs came to, all of it or nothing."""
        evolved = [what for what in messages if isinstance(what, Advanced)]
        finished = [what for what in messages if isinstance(what, Finished)]  # after all else of their runs
        with self._transaction():
            for what, row in zip(evolved, self._rows(_packed, evolved), strict=True):
                self._advance(what, row)
            query = "SELECT * FROM evolved WHERE run = ? ORDER BY number"
            parts = (self._database.execute(query, (what.run,)).fetchall() for what in finished)
            for (run, results), row in zip(finished, self._rows(_whole, parts), strict=True):
                self._finish(run, results, row)

    def _rows(self, pack: Callable[[Any], Row], some: Iterable[Any]) -> Iterable[Row]:
        """Rows of `evolved`, compressed in threads where there are several."""
        some = list(some)
        return map(pack, some) if len(some) < 2 else self._threads.map(pack, some)

    def _advance(self, what: Advanced, row: Row) -> None:
        """Store evaluations, and the state after them."""
        run, records, done, best_fitness, best_number, state = what
        self._add("evolved", [row])
        self._database.execute("REPLACE INTO checkpoint VALUES (?, ?, ?)", (run, done, state))
        self._database.execute(
            "UPDATE run SET evaluations = ?, best_fitness = ?, fittest = ? WHERE id = ?",
            (done, best_fitness, best_number, run),
        )
        seal_more(self._database, run, "evolved", done - len(records.fitness))
        seal(self._database, run, "checkpoint", "run")

    def _finish(self, run: int, results: Results, row: Row) -> None:
        """Store a run's tests and mark it as finished; its evaluations become one row."""
        champion = int(results.numbers[results.champion])
        scores = results.retest[results.champion].tolist()
        self._database.execute(
            "UPDATE run SET champion = ?, champion_fitness = ?, finished = 1 WHERE id = ?",
            (champion, math.fsum(scores) / len(scores), run),
        )
        self._database.execute("DELETE FROM evolved WHERE run = ?", (run,))
        self._add("evolved", [row])
        self._add("tested", self._tested(run, results))
        seal(self._database, run, "evolved", "tested", "run")

    def _tested(self, run: int, results: Results) -> list[tuple[object, ...]]:
        query = "SELECT fittest, champion, noise FROM run WHERE id = ?"
        *numbers, own = self._database.execute(query, (run,)).fetchone()
        number = dict(zip(WHO, numbers, strict=True))
        some = zip(results.cells.tolist(), results.numbers.tolist(), results.retest, strict=True)
        rows = [(run, *key, -1, number[key[0]], scores) for key, scores in results.fresh.items()]
        rows += [(run, "population", own, *one) for one in some]
        return [(*row, scores.astype("<f8").tobytes()) for *row, scores in rows]

    def _add(self, part: str, rows: Sequence[tuple[object, ...]]) -> None:
        places = ", ".join("?" * len(rows[0]))
        self._database.executemany(f"INSERT INTO {part} VALUES ({places})", rows)

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        with told(self.path):
            self._database.execute("BEGIN IMMEDIATE")
            try:
                yield
                self._database.execute("COMMIT")
            except BaseException:
                if self._database.in_transaction:
                    self._database.execute("ROLLBACK")
                raise

    def _check_whole(self) -> None:
        answer = self._database.execute("PRAGMA quick_check(1)").fetchone()[0]
        if answer != "ok":
            raise StudyError(
                f"{self.path}: the database is broken ({' '.join(str(answer).split())}). "
                "Restore it from a copy, or begin again in another folder."
            )
        verify_all(self._database, self.path)


def _packed(what: Advanced) -> Row:
    records, genes = what.records, what.records.genes
    places = np.column_stack([records.parents, records.cell])
    plain = genes.astype(genes.dtype.newbyteorder("<"), copy=False).tobytes()  # little-endian, as in files
    first = what.evaluations - len(records.fitness)
    return what.run, *Block(first, records.scores, records.fitness, places, plain).row(final=False)


def _whole(rows: Sequence[Row]) -> Row:
    """A run's rows of `evolved` as one."""
    return rows[0][0], *joined([Block.of(row[1:]) for row in rows]).row()
