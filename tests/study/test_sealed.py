"""A study is believed only as it was made: its folder, and every row of its database."""

from __future__ import annotations

import lzma
import shutil
import sqlite3
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
from tests.study.helpers import small


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
        ("study.toml", "seed = 7", "seed = 8", "study.toml has been edited .*: seed was 7, now 8"),
        ("study.toml", '"observed"', '"zero"', r"conditions\[0\].noise was 'observed', now 'zero'"),
        ("profile.toml", "step_cm", "stop_cm", "profile.toml has been edited since"),
        ("arenas/light-seeking.toml", "[110.0, 70.0]", "[150.0, 70.0]",
         r"light-seeking.toml has been edited .*: size_cm was \[110.0, 70.0\], now \[150.0, 70.0\]"),
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
        "UPDATE evolved SET scores = zeroblob(length(scores)) WHERE run = 2",
        "DELETE FROM evolved WHERE run = 2",
        "UPDATE evolved SET places = zeroblob(length(places)) WHERE run = 2",
        "UPDATE digest SET value = zeroblob(16) WHERE run = 2 AND part = 'evolved'",
    )):  # fmt: skip
        change(command) if number == 0 else (shutil.copy(finished.folder / DATABASE, copy), change(command))
        study = load_study(copy)
        with pytest.raises(StudyError, match=r"study.db: run 2: table 'evolved' does not hold what was"):
            _ = study.evaluations(2)
        with pytest.raises(StudyError, match=r"run 2"):
            study.evaluations()
        assert len(study.evaluations(1)["number"]) == 90
        with pytest.raises(StudyError, match=r"run 2"):
            run_study(copy, resume=True)


@pytest.mark.parametrize(
    ("command", "read"),
    [
        ("UPDATE tested SET scores = zeroblob(24) WHERE run = 1 AND who = 'fittest'",
         lambda study: study.runs[0].tests),
        ("UPDATE evolved SET genotypes = zeroblob(99) WHERE run = 1", lambda study: study.runs[0].fittest),
        ("UPDATE evolved SET number = 1 WHERE run = 1", lambda study: study.genotypes(1)),
        ("DELETE FROM tested WHERE run = 1 AND cell = 5", lambda study: study.retests(1)),
        ("UPDATE run SET champion = 3 WHERE id = 1", lambda study: study.runs),
        ("UPDATE session SET pid = 1", lambda study: study.versions()),
        ("UPDATE task SET facts = '{}'", lambda study: study.encoding("light-seeking")),
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
    """Not of how it is packed."""
    genes, before = load_study(copy).genotypes(1), finished.digest()

    def kept(column: str, value: object, part: str = "evolved") -> str:
        with closing(sqlite3.connect(copy / DATABASE)) as database, database:
            database.execute(f"UPDATE {part} SET {column} = ? WHERE run = 1", (value,))
            seal(database, 1, part)
        return load_study(copy).digest()

    assert kept("genotypes", lzma.compress(genes.tobytes(), preset=9)) == before
    assert kept("genotypes", lzma.compress((1 - genes).tobytes())) != before
    assert kept("genotypes", lzma.compress(genes.tobytes())) == before
    assert kept("scores", bytes(24), "tested") != before


def test_a_study_goes_on_with_its_own_robot_only(copy):
    """Asked for with another profile, it is refused with the file that differs."""
    assert run_study(copy, small(), resume=True).runs[0].finished
    with pytest.raises(StudyError, match=r"keeps a different profile.toml"):
        run_study(copy, small(profile="khepera"), resume=True)


def half_done(folder: Path) -> None:
    """The second run has two checkpoints, the first is not begun."""
    folder.mkdir()
    materials = open_folder(folder, gather(small()), resume=False)
    with Store(folder / DATABASE) as store:
        messages: list = []
        Workshop(materials).carry_out(Job(2, None), messages.append)
        store.keep(messages[:2])


def test_an_unfinished_run_is_sealed_too(folder):
    """A run is not continued from evaluations that were changed."""
    half_done(folder)
    with closing(sqlite3.connect(folder / DATABASE)) as database, database:
        database.execute("UPDATE evolved SET scores = zeroblob(320) WHERE run = 2 AND number = 20")
    with pytest.raises(StudyError, match="run 2: table 'evolved'"):
        run_study(folder, resume=True, workers=1)


def test_flipped_bits_are_noticed(copy):
    """Of flipped bits in the database none is read as other data (a slice of `tests/hostile/flips.py`)."""
    found = flips(copy, 60, seed=3)
    assert found[BELIEVED] == 0 and found[NOTICED] > found[HARMLESS] / 8 > 0
