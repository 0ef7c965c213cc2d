"""Small studies, processes that carry them out, and a look at all that a study's database holds."""

from __future__ import annotations

import hashlib
import sqlite3
import subprocess
import sys
import zlib
from contextlib import closing
from pathlib import Path
from typing import Any

from realitygap.study.config import StudyConfig
from realitygap.study.digest import seal
from realitygap.study.load import load_study
from realitygap.study.parts import Condition
from realitygap.study.views import NAMES

CHILD = Path(__file__).with_name("child.py")


def small(**changes: Any) -> StudyConfig:
    """Two tasks, a run each: short trials, few tests, frequent checkpoints."""
    fields = {
        "seed": 7,
        "runs": 1,
        "evaluations": 90,
        "retest_trials": 2,
        "fresh_trials": 3,
        "checkpoint_every": 20,
        "conditions": (Condition(task="avoidance", noise=1.0), Condition(task="light", noise=2.0)),
        **changes,
    }
    return StudyConfig(**fields).with_settings(["task.seconds=0.5"])


def content(folder: Path) -> dict[str, tuple[int, str]]:
    """Number of rows and a hash of all that is kept, in any format, except of who worked on it and when."""
    found = {}
    with closing(sqlite3.connect(folder / "study.db")) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        for table in ("run", "checkpoint"):
            rows = sorted(map(repr, database.execute(f"SELECT * FROM {table}")))
            found[table] = (len(rows), hashlib.sha256("".join(rows).encode()).hexdigest())
    study = load_study(folder)
    tables = {"evaluations": study.evaluations(), "tests": study.tests(), "retests": study.retests()}
    for name, columns in tables.items():
        text = "".join(name + repr(column.tolist()) for name, column in columns.items())
        found[name] = (len(columns["run"]), hashlib.sha256(text.encode()).hexdigest())
    genes = [study.genotypes(run.id) for run in study.runs]
    found["genotypes"] = (sum(map(len, genes)), hashlib.sha256(b"".join(genes)).hexdigest())
    return found


def in_format(folder: Path, version: int) -> None:
    """Make a study's database one as earlier versions wrote it: a row for each evaluation and each trial, the
    genotype in it (3) or many in another (4); without encodings (2); without sources and digests (1)."""
    study = load_study(folder)
    genes = {run.id: study.genotypes(run.id) for run in study.runs}
    old = {
        "evaluation": (study.evaluations(), "run, number"),
        "retest": (study.retests(), "run, cell, trial"),
        "test": (study.tests(), "run, who, noise, trial"),
    }
    with closing(sqlite3.connect(folder / "study.db")) as database, database:
        for name in ("TABLE evolved", "TABLE tested", *(f"VIEW {name}" for name in NAMES)):
            database.execute(f"DROP {name}")
        database.execute("DELETE FROM digest WHERE part IN ('evolved', 'tested')")
        for part, (table, key) in old.items():
            columns = ", ".join(table)
            database.execute(f"CREATE TABLE {part} ({columns}, PRIMARY KEY ({key})) WITHOUT ROWID")
            places = ", ".join("?" * len(table))
            rows = zip(*(column.tolist() for column in table.values()), strict=True)
            database.executemany(f"INSERT INTO {part} VALUES ({places})", rows)
        if version >= 4:
            database.execute("CREATE TABLE genotypes (run, number, content, PRIMARY KEY (run, number))")
            blocks = [(run, 0, zlib.compress(every.tobytes())) for run, every in genes.items() if len(every)]
            database.executemany("INSERT INTO genotypes VALUES (?, ?, ?)", blocks)
        else:
            database.execute("ALTER TABLE evaluation ADD COLUMN genotype BLOB NOT NULL DEFAULT x''")
            rows = [(a.tobytes(), run, k) for run, every in genes.items() for k, a in enumerate(every)]
            database.executemany("UPDATE evaluation SET genotype = ? WHERE run = ? AND number = ?", rows)
        for run in study.runs:
            grown = ["evaluation"] + (["genotypes"] if version >= 4 else []) if run.evaluations else []
            seal(database, run.id, *grown, *(["retest", "test"] if run.finished else []))
        if version < 3:
            database.execute("ALTER TABLE run DROP COLUMN encoding")
        for table in ("source", "task", "digest") if version == 1 else ():
            database.execute(f"DROP TABLE {table}")
        for run in study.runs if version == 2 else ():
            seal(database, run.id, "run")
        database.execute(f"PRAGMA user_version = {version}")


def start(folder: Path, *options: str) -> subprocess.Popen[str]:
    """A process that carries out or resumes the study; a line on stdout for each progress event."""
    return subprocess.Popen(
        [sys.executable, str(CHILD), str(folder), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for(process: subprocess.Popen[str], phase: str, least: int = 0) -> None:
    """Read its lines up to one of this phase with at least so many evaluations done."""
    assert process.stdout is not None
    for line in process.stdout:
        name, _, done = line.rpartition(" ")
        if name == phase and int(done) >= least:
            return
    raise AssertionError(process.communicate()[1])


def end(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Wait for its end: exit code and what it said on stderr."""
    _, said = process.communicate(timeout=120)
    return process.returncode, said
