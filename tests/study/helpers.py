"""Small studies, processes that carry them out, and a look at all that a study's database holds."""

from __future__ import annotations

import hashlib
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

from realitygap.study.config import StudyConfig
from realitygap.study.digest import seal
from realitygap.study.load import load_study
from realitygap.study.parts import Condition
from realitygap.study.schema import NAMES

CHILD = Path(__file__).with_name("child.py")
TABLES = ("run", "evaluation", "checkpoint", "retest", "test")


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
    """Number of rows and a hash of each table, except of who worked on it and when."""
    found = {}
    with closing(sqlite3.connect(folder / "study.db")) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        for table in TABLES:
            columns = [
                row[1] for row in database.execute(f"PRAGMA table_info({table})") if row[1] != "genotype"
            ]
            rows = sorted(map(repr, database.execute(f"SELECT {', '.join(columns)} FROM {table}")))
            found[table] = (len(rows), hashlib.sha256("".join(rows).encode()).hexdigest())
    study = load_study(folder)
    genes = [study.genotypes(run.id) for run in study.runs]
    found["genotypes"] = (sum(map(len, genes)), hashlib.sha256(b"".join(genes)).hexdigest())
    return found


def in_format_3(folder: Path, version: int = 3) -> None:
    """Make a study's database one as earlier versions wrote it: a genotype in each evaluation's row."""
    genes = {run.id: load_study(folder).genotypes(run.id) for run in load_study(folder).runs}
    with closing(sqlite3.connect(folder / "study.db")) as database, database:
        database.execute("ALTER TABLE evaluation ADD COLUMN genotype BLOB NOT NULL DEFAULT x''")
        for run, every in genes.items():
            rows = [(one.tobytes(), run, number) for number, one in enumerate(every)]
            database.executemany("UPDATE evaluation SET genotype = ? WHERE run = ? AND number = ?", rows)
            database.execute(
                "DELETE FROM digest WHERE run = ? AND part IN ('genotypes', 'evaluation')", (run,)
            )
            if rows:
                seal(database, run, "evaluation")
        database.execute("DROP TABLE genotypes")
        for name in NAMES:
            database.execute(f"DROP VIEW {name}")
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
