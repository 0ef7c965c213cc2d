"""A study is believed only as it was made: its folder, and every row of its database."""

from __future__ import annotations

import shutil
import sqlite3
import zlib
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from realitygap.errors import StudyError
from realitygap.study.digest import seal
from realitygap.study.folder import open_folder
from realitygap.study.jobs import Job, Workshop
from realitygap.study.load import load_study
from realitygap.study.materials import gather
from realitygap.study.reader import DATABASE
from realitygap.study.runner import run_study
from realitygap.study.store import Store
from tests.hostile.flips import BELIEVED, HARMLESS, NOTICED, flips
from tests.study.helpers import content, in_format_3, small


@pytest.fixture
def copy(finished, folder) -> Path:
    """A finished study that may be spoilt."""
    return Path(shutil.copytree(finished.folder, folder))


@pytest.fixture
def change(copy) -> Callable[..., None]:
    """Carries out SQL behind the study's back."""

    def execute(*commands: str) -> None:
        with closing(sqlite3.connect(copy / DATABASE)) as database, database:
            for command in commands:
                database.execute(command)

    return execute


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), "utf-8")


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("study.toml", "seed = 7", "seed = 8", "study.toml was edited .*: seed was 7, now 8"),
        ("study.toml", '"observed"', '"zero"', r"conditions\[0\].noise was 'observed', now 'zero'"),
        ("profile.toml", "step_cm", "stop_cm", "profile.toml was edited since"),
        ("arenas/light-seeking.toml", "[110.0, 70.0]", "[150.0, 70.0]",
         r"light-seeking.toml was edited .*: size_cm was \[110.0, 70.0\], now \[150.0, 70.0\]"),
    ],
)  # fmt: skip
def test_an_edited_study_is_refused_with_the_difference(copy, file, old, new, words):
    """Another seed, noise, robot or arena in the folder: --resume says what was edited, and does nothing."""
    if file == "profile.toml":
        line = next(line for line in (copy / file).read_text().splitlines() if " = 2.9" in line)
        old, new, words = line, line.replace("2.9", "2.91"), "body.radius_cm was 2.9, now 2.91"
    edit(copy / file, old, new)
    before = (copy / DATABASE).read_bytes()
    with pytest.raises(StudyError, match=words):
        run_study(copy, resume=True)
    assert (copy / DATABASE).read_bytes() == before
    if file == "study.toml":
        with pytest.raises(StudyError, match=words):
            load_study(copy)


def test_what_changes_no_result_may_be_edited(copy):
    """The title and a comment are for people."""
    edit(copy / "study.toml", 'title = ""', 'title = "Mine" # today')
    edit(copy / "profile.toml", "\n", "\n# a comment\n")
    assert load_study(copy).config.title == "Mine"
    run_study(copy, resume=True)


def test_every_row_of_a_run_is_sealed(copy, change, finished):
    """A changed, lost or added row is refused by run and table; other runs can still be read."""
    for number, command in enumerate((
        "UPDATE evaluation SET fitness = fitness + 1e-9 WHERE run = 2 AND number = 40",
        "DELETE FROM evaluation WHERE run = 2 AND number = 89",
        "UPDATE evaluation SET parent_b = -1 WHERE run = 2 AND number = 80",
        "UPDATE digest SET value = zeroblob(16) WHERE run = 2 AND part = 'evaluation'",
    )):  # fmt: skip
        change(command) if number == 0 else (shutil.copy(finished.folder / DATABASE, copy), change(command))
        study = load_study(copy)
        with pytest.raises(StudyError, match=r"study.db: run 2: table 'evaluation' does not hold what was"):
            _ = study.evaluations(2)
        with pytest.raises(StudyError, match=r"run 2"):
            study.evaluations()
        assert len(study.evaluations(1)["number"]) == 90
        with pytest.raises(StudyError, match=r"run 2"):
            run_study(copy, resume=True)


@pytest.mark.parametrize(
    ("command", "read"),
    [
        ("UPDATE test SET score = 0 WHERE run = 1 AND trial = 0", lambda study: study.runs[0].tests),
        ("UPDATE genotypes SET content = zeroblob(99) WHERE run = 1 AND number = 20",
         lambda study: study.runs[0].fittest),
        ("DELETE FROM genotypes WHERE run = 1 AND number = 80", lambda study: study.genotypes(1)),
        ("DELETE FROM retest WHERE run = 1 AND cell = 5", lambda study: study.retests(1)),
        ("UPDATE run SET champion = 3 WHERE id = 1", lambda study: study.runs),
        ("UPDATE session SET pid = 1", lambda study: study.versions()),
        ("UPDATE task SET facts = '{}'", lambda study: study.layout("light-seeking")),
        ("UPDATE checkpoint SET state = (SELECT state FROM checkpoint WHERE run = 2) WHERE run = 1",
         lambda study: study.runs[0].population),
    ],
)  # fmt: skip
def test_every_table_is_sealed(copy, change, command, read):
    """Tests, retests, champions, checkpoints, sessions and tasks that were changed are refused."""
    change(command)
    with pytest.raises(StudyError, match="does not hold what was written there"):
        read(load_study(copy))


def test_a_digest_is_of_what_came_of_the_runs(copy, finished):
    """Not of how often it was kept, nor of how another zlib packs it."""
    genes, before = load_study(copy).genotypes(1), finished.digest()
    with closing(sqlite3.connect(copy / DATABASE)) as database, database:
        database.execute("DELETE FROM genotypes WHERE run = 1")
        database.execute("INSERT INTO genotypes VALUES (1, 0, ?)", (zlib.compress(genes.tobytes(), 1),))
        seal(database, 1, "genotypes")
    study = load_study(copy)
    assert (study.genotypes(1) == genes).all() and study.digest() == before
    other = 1 - genes
    with closing(sqlite3.connect(copy / DATABASE)) as database, database:
        database.execute("UPDATE genotypes SET content = ? WHERE run = 1", (zlib.compress(other.tobytes()),))
        seal(database, 1, "genotypes")
    assert load_study(copy).digest() != before
    with closing(sqlite3.connect(copy / DATABASE)) as database, database:
        database.execute("UPDATE test SET score = 0.25 WHERE run = 1 AND trial = 1")
        seal(database, 1, "test")
    assert load_study(copy).digest() != before


def half_done(folder: Path) -> None:
    """The second run has two checkpoints, the first is not begun."""
    folder.mkdir()
    materials = open_folder(folder, gather(small()), resume=False)
    with Store(folder / DATABASE) as store:
        messages = Workshop(materials).messages([Job(2, None)])
        for message, _ in zip(messages, range(2), strict=False):
            store.advance(message)


def test_an_unfinished_run_is_sealed_too(folder):
    """A run is not continued from evaluations that were changed."""
    half_done(folder)
    with closing(sqlite3.connect(folder / DATABASE)) as database, database:
        database.execute("UPDATE evaluation SET score_1 = 0 WHERE run = 2 AND number = 25")
    with pytest.raises(StudyError, match="run 2: table 'evaluation'"):
        run_study(folder, resume=True, workers=1)


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_study_of_an_earlier_format_is_read_and_goes_on(folder, finished, version):
    """Without sources and digests (1), encodings (2), or compressed genotypes (3), in its database a study is
    read, and resumes to the same bits."""
    half_done(folder)
    in_format_3(folder, version)
    with closing(sqlite3.connect(folder / DATABASE)) as database, database:
        if version < 3:
            database.execute("ALTER TABLE run DROP COLUMN encoding")
        for table in ("source", "task", "digest") if version == 1 else ():
            database.execute(f"DROP TABLE {table}")
        for (run,) in database.execute("SELECT id FROM run").fetchall() if version == 2 else ():
            seal(database, run, "run")
    assert load_study(folder).layout("light-seeking") == finished.layout("light-seeking")
    run_study(folder, resume=True, workers=1)
    here, there = content(folder), content(finished.folder)
    assert {**here, "run": 0} == {**there, "run": 0}
    assert load_study(folder).genotypes(2).shape == (90, 30, 34)
    assert (load_study(folder).runs[0].champion == finished.runs[0].champion).all()


def test_flipped_bits_are_noticed(copy):
    """Of flipped bits in the database none is read as other data (a slice of `tests/hostile/flips.py`)."""
    found = flips(copy, 60, seed=3)
    assert found[BELIEVED] == 0 and found[NOTICED] > found[HARMLESS] / 8 > 0
