"""A study's database answers what is asked of it most, in SQL."""

import shutil
import sqlite3
from contextlib import closing

import numpy as np
import pytest

from realitygap.errors import StudyError, UsageError
from realitygap.study.arrays import Block, joined
from realitygap.study.digest import seal
from realitygap.study.load import load_study
from realitygap.study.views import NAMES
from tests.study.helpers import content


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


@pytest.mark.parametrize(
    ("sql", "words"),
    [
        ("SELECT colour FROM runs", "sql: no such column: colour.*SELECT from runs, evaluations, tests"),
        ("DELETE FROM run", "sql: attempt to write a readonly database"),
        ("SELECT 1 AS a, 2 AS a", "two columns have one name"),
        ("", "sql: expected a SELECT from runs.*got ''"),
        ("ATTACH 'x.db' AS y", "sql: too many attached databases"),
        ("VACUUM INTO 'x.db'", "sql: "),
        ("SELECT 1; SELECT 2", r"one statement at a time\. Expected"),
        ("-- all of them", "sql: expected a SELECT from runs.*got '-- all of them'"),
    ],
)
def test_sql_that_cannot_be_is_refused(finished, tmp_path, monkeypatch, sql, words):
    """With what is wrong and what there is to select from; the study is as it was, and nothing beside it."""
    monkeypatch.chdir(tmp_path)
    before = content(finished.folder)
    with pytest.raises(StudyError, match=words):
        finished.query(sql)
    assert content(finished.folder) == before and not list(tmp_path.iterdir())


def test_a_damaged_row_is_not_counted(finished, tmp_path):
    """A query sees no number that was not written."""
    shutil.copytree(finished.folder, tmp_path / "copy")
    with closing(sqlite3.connect(tmp_path / "copy" / "study.db")) as database, database:
        database.execute("UPDATE evolved SET scores = zeroblob(length(scores)) WHERE run = 1")
    with pytest.raises(StudyError, match="'evolved' does not hold what was written"):
        load_study(tmp_path / "copy").query("SELECT avg(fitness) AS mean FROM evaluations")


def test_plain_sql_takes_arrays_apart_to_the_bit(finished, tmp_path):
    """Any score that there can be, a fitness that is no plain mean, numbers that need more than two bytes."""
    shutil.copytree(finished.folder, tmp_path / "copy")
    draw = np.random.default_rng(1)
    scores = draw.integers(0, 2**64, (300, 2), np.uint64).view(np.float64)
    scores[~np.isfinite(scores)] = 0.0
    scores[:3] = [[0.0, -0.0], [5e-324, -2.2250738585072014e-308], [1.7976931348623157e308, -1e22]]
    scores[100:200] = draw.random((100, 2)) * 10.0 ** draw.integers(-30, 3, (100, 2))
    places = draw.integers(-1, 70_000, (300, 3))
    block = Block(7, scores, scores[:, 0].copy(), places, b"")
    with closing(sqlite3.connect(tmp_path / "copy" / "study.db")) as database:
        database.execute("DELETE FROM evolved WHERE run = 1")
        database.execute(f"INSERT INTO evolved VALUES (1, {', '.join('?' * 6)})", block.row())
        columns = "number, fitness, score_1, score_2, parent_a, parent_b, cell"
        found = database.execute(
            f"SELECT {columns} FROM evaluations WHERE run = 1 ORDER BY number"
        ).fetchall()
    number, fitness, *rest = map(np.array, zip(*found, strict=True))
    assert (number == 7 + np.arange(300)).all() and fitness.tobytes() == block.fitness.tobytes()
    assert np.column_stack(rest[:2]).tobytes() == scores.tobytes()
    assert (np.column_stack(rest[2:]) == places).all()


def test_a_running_study_is_asked_like_a_finished_one(finished, tmp_path):
    """Its evaluations stand in several rows; plain SQL, `query` and Python say the same of them."""
    shutil.copytree(finished.folder, tmp_path / "copy")
    whole = finished.evaluations(1)
    with closing(sqlite3.connect(tmp_path / "copy" / "study.db")) as database, database:
        kept = database.execute("SELECT * FROM evolved WHERE run = 1").fetchone()
        block = Block.of(kept[1:])
        parts = [Block(a, *(part[a : a + 30] for part in block[1:4]), b"") for a in (0, 30, 60)]
        database.execute("DELETE FROM evolved WHERE run = 1")
        marks = ", ".join("?" * 7)
        database.executemany(f"INSERT INTO evolved VALUES ({marks})", [(1, *one.row()) for one in parts])
        seal(database, 1, "evolved")
    study, sql = load_study(tmp_path / "copy"), "SELECT * FROM evaluations WHERE run = 1 ORDER BY number"
    with closing(sqlite3.connect(study.folder / "study.db")) as database:
        plain = [row[5:] for row in database.execute(sql)]
    assert plain == list(
        zip(*(column.tolist() for column in list(study.query(sql).values())[5:]), strict=True)
    )
    there = study.evaluations(1)
    assert all(np.array_equal(there[name], whole[name], equal_nan=True) for name in whole)
    assert joined(parts)[1].tobytes() == block.scores.tobytes()


@pytest.mark.parametrize("ask", [lambda s: s.query(None), lambda s: s.networks(s.runs[0].task, "champion")])
def test_a_study_refuses_what_is_no_statement_or_genotype(finished, ask):
    """In the package's own words."""
    with pytest.raises(UsageError, match=r"^(sql: expected a str|genotype: expected a ndarray), got "):
        ask(finished)


def test_a_run_in_an_array_is_no_run(finished):
    """It is refused like another name that no run has; a number of NumPy's is one."""
    assert finished.run(np.int64(1)).id == 1
    for wrong, got in ((np.zeros(3), "array"), (True, "True")):
        with pytest.raises(StudyError, match=rf"expected a run, 1 to .*got {got}"):
            finished.run(wrong)


@pytest.mark.parametrize("number", ["3", 3.5, True, -1])
def test_an_evaluation_is_a_whole_number(finished, number):
    """A genotype is asked for by it."""
    with pytest.raises(UsageError, match="number: expected a whole number, 0 or more, got"):
        finished.genotype(1, number)
