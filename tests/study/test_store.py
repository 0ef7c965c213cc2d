"""A study's database is believed only as it was written; what it holds can be asked for in SQL."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from realitygap.api import evolve
from realitygap.errors import StudyError, UsageError
from realitygap.experiments.noise import NoiseConfig
from realitygap.experiments.robots import RobotsConfig
from realitygap.study.folder import gather, open_folder
from realitygap.study.jobs import Job, StudyExecutor
from realitygap.study.load import load_study
from realitygap.study.runner import run_study
from realitygap.study.store import DATABASE, Store, database_errors, packed, unpacked
from tests.hostile.flips import BELIEVED, HARMLESS, NOTICED, flips
from tests.study.helpers import content, end, small, start


@pytest.fixture
def copy(finished, folder) -> Path:
    """A finished study that may be spoilt."""
    return Path(shutil.copytree(finished.folder, folder))


def change(folder: Path, command: str) -> None:
    """Carry out SQL behind the study's back."""
    with closing(sqlite3.connect(folder / DATABASE)) as database, database:
        database.execute(command)


def hole(data: bytes) -> bytes:
    return data[:8192] + b"\xa5" * (len(data) - 8192)


@pytest.mark.parametrize(
    ("spoilt", "words"),
    [
        (lambda data: b"not a database at all" * 1000, "broken .*Restore it from a copy"),
        (lambda data: b"", "not a study's database"),
        (hole, "broken|does not hold"),
        (lambda data: data[: len(data) // 2], "broken|does not hold"),
    ],
)
def test_a_broken_file_is_refused(copy, spoilt, words):
    """No database, an empty one, one with a hole and one cut short: in one line, by loading and resuming."""
    (copy / DATABASE).write_bytes(spoilt((copy / DATABASE).read_bytes()))
    with pytest.raises(StudyError, match=words) as loading:
        load_study(copy).evaluations()
    with pytest.raises(StudyError, match=words):
        run_study(copy, resume=True)
    assert "study.db" in str(loading.value) and "\n" not in str(loading.value)


@pytest.mark.parametrize(("version", "cure"), [(99, "Upgrade realitygap"), (5, "Make the study again")])
def test_another_format_is_left_alone(copy, version, cure):
    """Of a newer realitygap, or of one before the first release."""
    change(copy, f"PRAGMA user_version = {version}")
    with pytest.raises(StudyError, match=rf"format {version}, this realitygap reads format 6\. {cure}"):
        load_study(copy)


@pytest.mark.parametrize(
    ("command", "read"),
    [
        ("UPDATE run SET champion = 3 WHERE id = 1", lambda study: study.runs),
        ("DELETE FROM run WHERE id = 2", lambda study: study.runs),
        ("UPDATE run SET state = zeroblob(500) WHERE id = 1", lambda study: study.runs[0].population),
        ("DELETE FROM block WHERE run = 2", lambda study: study.evaluations()),
        ("UPDATE block SET data = zeroblob(99) WHERE run = 1", lambda study: study.runs[0].fittest),
        ("DELETE FROM tested WHERE run = 1", lambda study: study.retests(1)),
        ("UPDATE meta SET json = '{}' WHERE key = 'tasks'", lambda study: study.facts("light-seeking")),
        ("UPDATE meta SET json = '[]' WHERE key = 'sessions'", lambda study: study.versions()),
    ],
)  # fmt: skip
def test_a_changed_row_is_refused(copy, command, read):
    """In every table; and the study does not go on from it."""
    change(copy, command)
    with pytest.raises(StudyError, match=r"study.db: .*does not hold what was written there"):
        read(load_study(copy))
    with pytest.raises(StudyError, match="does not hold"):
        run_study(copy, resume=True, workers=1)


@pytest.mark.parametrize("final", [False, True])
def test_arrays_of_strangers_are_not_unpacked_beyond_what_a_run_has(final):
    """However small they are in the database."""
    data = packed({"number": np.zeros(10**6)}, final=final)
    assert len(data) < 10**5 and len(unpacked(data, most=9 * 10**6)["number"]) == 10**6
    with pytest.raises(ValueError, match="longer than what is kept of a run"):
        unpacked(data, most=10**6)


def test_flipped_bits_are_noticed(copy):
    """Of flipped bits in the database none is read as other data (a slice of `tests/hostile/flips.py`)."""
    found = flips(copy, 60, seed=3)
    assert found[BELIEVED] == 0 and found[NOTICED] > found[HARMLESS] / 8 > 0


def test_what_is_read_is_what_was_checked_while_another_process_writes(folder):
    """A study that is being worked on is read as of one moment, then as of the next."""
    folder.mkdir()
    executor = StudyExecutor(open_folder(folder, gather(small()), resume=False))
    messages: list = []
    executor.carry_out(Job(2, None), messages.append)
    with Store(folder / DATABASE) as store:
        for k, message in enumerate(messages):
            store.keep([message])
            study, done = load_study(folder), min(20 * (k + 1), 90)
            assert study.evaluations(2)["number"].tolist() == list(range(done))
            assert study.query("SELECT count(*) AS n FROM evaluations")["n"] == [done]
            assert (study.runs[1].fittest == study.genotype(2, study.runs[1].fittest_number)).all()


@pytest.mark.parametrize("kind", [None, NoiseConfig, RobotsConfig])
def test_no_study(tmp_path, kind):
    """A folder without one, and one that is not there; an experiment's says which command made it."""
    with pytest.raises(StudyError, match="no such folder"):
        load_study(tmp_path / "nowhere")
    if kind is not None:
        (tmp_path / kind.FILE).touch()
    made = (
        "Give a study" if kind is None else f".*`{kind.COMMAND} --out {tmp_path} --resume` makes its results"
    )
    with pytest.raises(StudyError, match=f"no study there .*{made}"):
        load_study(tmp_path)


def test_a_full_disk(finished, folder, tmp_path):
    """By SQLite's own word, and to a process whose files may not grow: what was saved resumes to the same
    bits."""
    with closing(sqlite3.connect(tmp_path / "x.db", isolation_level=None)) as database:
        database.execute("CREATE TABLE t (x)")
        database.execute("PRAGMA max_page_count = 2")
        words = r"the disk is full. What was saved is kept: free some space"
        with pytest.raises(StudyError, match=words), database_errors(tmp_path / "x.db"):
            database.execute("INSERT INTO t VALUES (zeroblob(100000))")
    folder.with_suffix(".toml").write_text(small().to_toml())
    code, said = end(start(folder, "--limit", "150000"))
    assert code == 2 and said.startswith("StudyError: ") and "What was saved is kept" in said
    assert len(said.splitlines()) == 1
    assert 0 < sum(run.evaluations for run in load_study(folder).runs) < 180
    run_study(folder, resume=True, workers=1)
    assert content(folder) == content(finished.folder)


def test_sql_says_what_the_study_says(finished):
    """A run with its champion, its tests and the settings; its evaluations; its trials."""
    runs = finished.query("SELECT * FROM runs ORDER BY run")
    assert (runs["set_seed"][0], runs["set_task_seconds"][0]) == (7, 0.5)
    for k, run in enumerate(finished.runs):
        for name in ("name", "best_fitness", "champion_fitness", "index"):
            assert runs[name][k] == getattr(run, name)
        for who in ("fittest", "champion"):
            assert runs[f"{who}_fresh"][k] == pytest.approx(run.tests[who, run.noise].mean(), abs=1e-12)
    rows = finished.query("SELECT * FROM evaluations WHERE run = 2 ORDER BY number")
    there = finished.evaluations(2)
    assert all(np.array_equal(rows[key], there[key]) for key in there)
    best = finished.query("SELECT max(score) AS best FROM tests WHERE who = 'population' AND run = 1")
    assert best["best"][0] == finished.retests(1)["score"].max()
    every = finished.query("SELECT count(*) AS n FROM tests")["n"][0]
    assert every == len(finished.tests()["run"]) + len(finished.retests()["run"])


@pytest.mark.parametrize(
    ("sql", "words"),
    [
        ("SELECT colour FROM runs", "sql: no such column: colour.*SELECT from runs, evaluations, tests"),
        ("DELETE FROM runs", "sql: attempt to write a readonly database"),
        ("ATTACH 'x.db' AS y", "sql: "),
        ("VACUUM INTO 'x.db'", "sql: "),
    ],
)
def test_sql_that_cannot_be_is_refused(finished, tmp_path, monkeypatch, sql, words):
    """With what is wrong and what there is to select from; nothing is written anywhere."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(StudyError, match=words):
        finished.query(sql)
    assert not list(tmp_path.iterdir())


def test_runs_and_tests_by_what_a_person_says(finished, monkeypatch):
    """A Run stands for its number, a level's name for the level, the database for its folder; the best run is
    that of the highest test score; a name that is not there is refused with those that are."""
    first, second = finished.runs
    assert load_study(finished.folder / DATABASE).digest() == finished.digest()
    assert finished.evaluations(second)["run"].tolist() == finished.evaluations(2)["run"].tolist()
    assert (first.tests["champion", "double"] == first.tests["champion", 2.0]).all()
    assert ("fittest", "zero") in first.tests and ("fittest", 5) not in first.tests
    assert first.fitness == pytest.approx(first.tests["champion", first.noise].mean(), abs=1e-12)
    for run in finished.runs:
        for name in (run.task, run.task.split("-")[1], f"{run.task}/{run.noise_name}"):
            assert finished.run(f"best:{name}") is run
    with pytest.raises(StudyError, match=r"scores of different tasks do not compare. Name best:obstacle"):
        _ = finished.best
    with pytest.raises(StudyError, match=r"best: expected a task or a noise level .*, got 'loud'"):
        finished.run("best:loud")
    for key in (("nobody", 1.0), ("champion", "loud"), "champion", 1):
        with pytest.raises(UsageError, match=r"tests: expected one of \('fittest', 0.0\)") as refusal:
            first.tests[key]
        assert isinstance(refusal.value, KeyError)
    with pytest.raises(UsageError, match=r"figures: expected one of robot, .* got 'x'"):
        finished.figures()["x"]
    monkeypatch.chdir(finished.folder.parent)
    with pytest.raises(StudyError, match=r"\.: no study there .* Did you mean \./study\?"):
        load_study(".")


def test_a_slip_in_an_argument_is_named():
    """Instead of a TypeError, or of words about a folder."""
    with pytest.raises(UsageError, match=r"evolve: evals: unknown argument. Did you mean 'evaluations'"):
        evolve("avoidance", evals=10)
    with pytest.raises(StudyError, match=r"first argument is a folder; realitygap.evolve\('avoidance'\)"):
        run_study("avoidance")
