"""The writer of a study's database: data first, counter last, in one transaction.

One process writes (see `folder.lock`). The write-ahead log keeps what was committed through
kill -9 at any moment; a power cut may lose the last transactions, never the database.
"""

import json
import math
import os
import sqlite3
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path

from realitygap import whole
from realitygap.controller.encoding import facts_of
from realitygap.errors import StudyError
from realitygap.study.digest import seal, seal_more, verify_all
from realitygap.study.jobs import Advanced
from realitygap.study.materials import Materials
from realitygap.study.plan import plans
from realitygap.study.run import Records, Results
from realitygap.study.schema import BLOCKS, SEALED, check_format, schema, told, views
from realitygap.values import Closing

__all__ = ["Store", "create"]


def create(path: Path, materials: Materials, sources: Mapping[str, bytes]) -> None:
    """Make a database with the runs of a study, whole or not at all; `sources` are its files by their names.

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
    trials = max(task.trials for task in tasks)
    with told(path), whole.new(path) as new, closing(sqlite3.connect(new, isolation_level=None)) as database:
        database.execute("PRAGMA page_size = 8192")
        database.execute("PRAGMA journal_mode = DELETE")
        database.executescript(f"BEGIN;{schema(trials)}COMMIT;")
        database.execute("BEGIN")
        for view in views(database, materials.copies()[0].to_dict()):
            database.execute(view)
        columns = "id, name, task, noise, position, encoding"
        database.executemany(f"INSERT INTO run ({columns}) VALUES (?, ?, ?, ?, ?, ?)", rows)
        database.executemany("INSERT INTO source VALUES (?, ?)", sources.items())
        database.executemany("INSERT INTO task VALUES (?, ?)", facts.items())
        seal(database, 0, "source", "task")
        for row in rows:
            seal(database, row[0], "run")
        database.execute("COMMIT")


class Store(Closing):
    """A study's database, open for writing."""

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            raise StudyError(f"{path}: no such database. Restore it from a copy, or choose another folder.")
        with told(path):
            self._database = sqlite3.connect(path, isolation_level=None)
            try:
                version = check_format(self._database, path)
                self._sealed, self._blocks = version >= SEALED, version >= BLOCKS
                self._check_whole()
                self._database.execute("PRAGMA journal_mode = WAL")
                self._database.execute("PRAGMA synchronous = NORMAL")
                columns = [row[1] for row in self._database.execute("PRAGMA table_info(evaluation)")]
            except BaseException:
                self._database.close()
                raise
        self._trials = sum(name.startswith("score_") for name in columns)
        self._insert = f"INSERT INTO evaluation VALUES ({', '.join('?' * len(columns))})"

    def close(self) -> None:
        """Let go of the database."""
        self._database.close()

    def begin_session(self, versions: Mapping[str, str]) -> None:
        """Note who works on the study from now on."""
        row = (datetime.now(UTC).isoformat(timespec="seconds"), os.getpid(), json.dumps(dict(versions)))
        with self._transaction():
            self._database.execute("INSERT INTO session (began, pid, versions) VALUES (?, ?, ?)", row)
            self._seal(0, "session")

    def unfinished(self) -> list[tuple[int, int]]:
        """Ids of the runs that are not finished, and how many evaluations each has done."""
        with told(self.path):
            query = "SELECT id, evaluations FROM run WHERE NOT finished ORDER BY id"
            return self._database.execute(query).fetchall()

    def checkpoint(self, run: int, read: Callable[[int, bytes], object]) -> bytes | None:
        """What the run goes on from, if `read` can read it; None at its beginning.

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

    def advance(self, what: Advanced) -> None:
        """Keep evaluations, and the state after the last of them."""
        run, records, done, best_fitness, best_number, state = what
        with self._transaction():
            genes = records.genes.astype(records.genes.dtype.newbyteorder("<"), copy=False)
            rows = _rows(run, records, self._trials)
            if self._blocks:
                block = (run, done - len(genes), zlib.compress(genes.tobytes()))
                self._database.execute("INSERT INTO genotypes VALUES (?, ?, ?)", block)
            else:
                rows = ((*row, one.tobytes()) for row, one in zip(rows, genes, strict=True))
            self._database.executemany(self._insert, rows)
            self._database.execute("REPLACE INTO checkpoint VALUES (?, ?, ?)", (run, done, state))
            self._database.execute(
                "UPDATE run SET evaluations = ?, best_fitness = ?, fittest = ? WHERE id = ?",
                (done, best_fitness, best_number, run),
            )
            for part in ("evaluation", "genotypes")[: self._sealed + self._blocks]:
                seal_more(self._database, run, part, done - len(genes))
            self._seal(run, "checkpoint", "run")

    def finish(self, run: int, results: Results) -> None:
        """Keep a run's tests and declare it finished."""
        retest = [
            (run, cell, number, trial, score)
            for cell, number, row in zip(
                results.cells.tolist(), results.numbers.tolist(), results.retest.tolist(), strict=True
            )
            for trial, score in enumerate(row)
        ]
        test = [
            (run, who, noise, trial, score)
            for (who, noise), row in results.fresh.items()
            for trial, score in enumerate(row.tolist())
        ]
        champion = int(results.numbers[results.champion])
        scores = results.retest[results.champion].tolist()
        with self._transaction():
            self._database.executemany("INSERT INTO retest VALUES (?, ?, ?, ?, ?)", retest)
            self._database.executemany("INSERT INTO test VALUES (?, ?, ?, ?, ?)", test)
            self._database.execute(
                "UPDATE run SET champion = ?, champion_fitness = ?, finished = 1 WHERE id = ?",
                (champion, math.fsum(scores) / len(scores), run),
            )
            self._seal(run, "retest", "test", "run")

    def _seal(self, run: int, *parts: str) -> None:
        """Renew digests after a change; a study of an older format has none."""
        if self._sealed:
            seal(self._database, run, *parts)

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
        if self._sealed:
            verify_all(self._database, self.path)


def _rows(run: int, records: Records, trials: int) -> Iterator[tuple[object, ...]]:
    """Rows of the table `evaluation`; tasks with fewer trials than others leave scores empty."""
    empty = (None,) * (trials - records.scores.shape[1])
    columns = zip(
        records.number.tolist(),
        records.fitness.tolist(),
        records.scores.tolist(),
        records.parents.tolist(),
        records.cell.tolist(),
        strict=True,
    )
    for number, fitness, scores, (first, second), cell in columns:
        yield (run, number, fitness, *scores, *empty, first, second, cell)
