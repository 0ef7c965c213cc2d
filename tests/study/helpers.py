"""Small studies, processes that carry them out, and a look at all that a study's database holds."""

from __future__ import annotations

import hashlib
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

from realitygap.study.config import Condition, StudyConfig
from realitygap.study.load import load_study

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
    """Number of rows and a hash of all that is kept, except of who worked on it and when."""
    found = {}
    with closing(sqlite3.connect(folder / "study.db")) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        rows = sorted(map(repr, database.execute("SELECT * FROM run")))
        found["run"] = (len(rows), hashlib.sha256("".join(rows).encode()).hexdigest())
    study = load_study(folder)
    tables = {"evaluations": study.evaluations(), "tests": study.tests(), "retests": study.retests()}
    for name, columns in tables.items():
        text = "".join(name + repr(column.tolist()) for name, column in columns.items())
        found[name] = (len(columns["run"]), hashlib.sha256(text.encode()).hexdigest())
    genes = [study.genotypes(run.id) for run in study.runs]
    found["genotypes"] = (sum(map(len, genes)), hashlib.sha256(b"".join(genes)).hexdigest())
    return found


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
