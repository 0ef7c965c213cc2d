"""A study's database answers what is asked of it most, in SQL, whatever its format."""

import shutil
import sqlite3
from contextlib import closing

import numpy as np
import pytest

from realitygap.errors import StudyError
from realitygap.study.load import load_study
from realitygap.study.schema import NAMES
from tests.study.helpers import content, in_format_3


def test_a_new_database_holds_the_views(finished):
    """Any tool that reads SQLite finds what Python says of runs, evaluations and tests."""
    with closing(sqlite3.connect(finished.folder / "study.db")) as database:
        counts = [database.execute(f"SELECT count(*) FROM {name}").fetchone()[0] for name in NAMES]
        task, seed, seconds = database.execute("SELECT task, set_seed, set_task_seconds FROM runs").fetchone()
    tests = len(finished.tests()["run"]) + len(finished.retests()["run"])
    assert counts == [len(finished.runs), len(finished.evaluations()["run"]), tests]
    assert (task, seed, seconds) == ("obstacle-avoidance", 7, 0.5)


def test_the_views_say_what_the_study_says(finished):
    """A run with its champion and its tests; its evaluations; its trials."""
    runs = finished.query("SELECT * FROM runs ORDER BY run")
    for k, run in enumerate(finished.runs):
        assert (runs["name"][k], runs["champion"][k]) == (run.name, run.champion_number)
        assert (
            runs["best_fitness"][k] == run.best_fitness
            and runs["champion_fitness"][k] == run.champion_fitness
        )
        for who in ("fittest", "champion"):
            assert runs[f"{who}_fresh"][k] == pytest.approx(run.tests[who, run.noise].mean(), abs=1e-12)
    rows = finished.query("SELECT * FROM evaluations WHERE run = 2 ORDER BY number")
    there = finished.evaluations(2)
    assert np.array_equal(rows["fitness"], there["fitness"]) and np.array_equal(rows["cell"], there["cell"])
    best = finished.query("SELECT max(score) AS best FROM tests WHERE who = 'population' AND run = 1")
    assert best["best"][0] == finished.retests(1)["score"].max()


def test_an_older_database_is_asked_in_the_same_way(finished, tmp_path):
    """Nothing is written into it, and it answers what the new one does."""
    asked = [f"SELECT * FROM {name}" for name in NAMES]
    for version in (3, 2, 1):
        shutil.copytree(finished.folder, tmp_path / str(version))
        in_format_3(tmp_path / str(version), version)
        old, before = load_study(tmp_path / str(version)), (tmp_path / str(version) / "study.db").read_bytes()
        for sql in asked:
            new, found = finished.query(sql), old.query(sql)
            assert list(new) == list(found)
            assert all(np.array_equal(new[key], found[key], equal_nan=new[key].dtype == float) for key in new)
        assert (tmp_path / str(version) / "study.db").read_bytes() == before


@pytest.mark.parametrize(
    ("sql", "words"),
    [
        ("SELECT colour FROM runs", "sql: no such column: colour.*SELECT from runs, evaluations, tests"),
        ("DELETE FROM run", "sql: attempt to write a readonly database"),
        ("SELECT 1 AS a, 2 AS a", "two columns have one name"),
    ],
)
def test_sql_that_cannot_be_is_refused(finished, sql, words):
    """With what is wrong and what there is to select from; the study is as it was."""
    before = content(finished.folder)
    with pytest.raises(StudyError, match=words):
        finished.query(sql)
    assert content(finished.folder) == before


def test_a_damaged_row_is_not_counted(finished, tmp_path):
    """A query sees no number that was not written."""
    shutil.copytree(finished.folder, tmp_path / "copy")
    with closing(sqlite3.connect(tmp_path / "copy" / "study.db")) as database, database:
        database.execute("UPDATE evaluation SET fitness = 99 WHERE run = 1 AND number = 3")
    with pytest.raises(StudyError, match="'evaluation' does not hold what was written"):
        load_study(tmp_path / "copy").query("SELECT avg(fitness) AS mean FROM evaluations")
