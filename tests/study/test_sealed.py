"""A study is believed only as it was made: its folder, and every row of its database."""

from __future__ import annotations

import lzma
import shutil
import sqlite3
import tarfile
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
from realitygap.study.views import NAMES
from realitygap.transfer.load import load_transfers
from tests.hostile.flips import BELIEVED, HARMLESS, NOTICED, all_that_is_read, flips
from tests.study.helpers import content, in_format, small


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
    """Not of how it is packed, nor in which format."""
    genes, before = load_study(copy).genotypes(1), finished.digest()
    old = shutil.copytree(copy, copy.with_name("old"))
    in_format(old, 4)
    assert load_study(old).digest() == before

    def kept(column: str, value: object, part: str = "evolved") -> str:
        with closing(sqlite3.connect(copy / DATABASE)) as database, database:
            database.execute(f"UPDATE {part} SET {column} = ? WHERE run = 1", (value,))
            seal(database, 1, part)
        return load_study(copy).digest()

    assert kept("genotypes", lzma.compress(genes.tobytes(), preset=9)) == before
    assert kept("genotypes", lzma.compress((1 - genes).tobytes())) != before
    assert kept("genotypes", lzma.compress(genes.tobytes())) == before
    assert kept("scores", bytes(24), "tested") != before


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


@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_a_study_of_an_earlier_format_is_read_and_goes_on(folder, finished, version):
    """As `in_format` has them: a study is read, and resumes to the same bits."""
    half_done(folder)
    in_format(folder, version)
    assert load_study(folder).layout("light-seeking") == finished.layout("light-seeking")
    assert len(load_study(folder).evaluations()["run"]) == 40
    run_study(folder, resume=True, workers=1)
    here, there = content(folder), content(finished.folder)
    assert {**here, "run": 0} == {**there, "run": 0}
    assert load_study(folder).genotypes(2).shape == (90, 30, 34)
    assert (load_study(folder).runs[0].champion == finished.runs[0].champion).all()


def test_a_profile_of_an_earlier_version_is_no_other_profile(copy):
    """A study whose copy lacks the keys added since goes on with the same profile, and with no other."""
    in_format(copy, 1)
    kept = copy / "profile.toml"
    text = kept.read_text("utf-8")
    kept.write_text(text.replace("sensor_height_cm = 0.0\n", "").replace("height_cm = 0.0\n", "", 1), "utf-8")
    assert run_study(copy, small(), resume=True).runs[0].finished
    with pytest.raises(StudyError, match=r"keeps a different profile.toml"):
        run_study(copy, small(profile="khepera"), resume=True)


def test_a_study_that_an_earlier_version_wrote_says_the_same(tmp_path):
    """A file of format 4 as it was written: all that its version read of it, and its packed trials."""
    safe = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}  # not before 3.11.4
    shutil.unpack_archive(Path(__file__).with_name("format-4.tar.xz"), tmp_path, **safe)
    study = load_study(tmp_path / "format-4")
    assert all_that_is_read(study.folder).startswith("6601df65ad85f7641ac66af8b0e01867")
    assert [len(study.query(f"SELECT * FROM {name}")["run"]) for name in NAMES] == [2, 180, 292]
    trials = load_transfers(study.folder)
    assert [(one.run, one.start, len(one.situated), len(one.simulated)) for one in trials] == [
        (1, 1, 6, 6), (2, 1, 6, 6),
    ]  # fmt: skip


def test_flipped_bits_are_noticed(copy):
    """Of flipped bits in the database none is read as other data (a slice of `tests/hostile/flips.py`)."""
    found = flips(copy, 60, seed=3)
    assert found[BELIEVED] == 0 and found[NOTICED] > found[HARMLESS] / 8 > 0
