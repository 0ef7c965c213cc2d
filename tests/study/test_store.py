"""Broken, foreign, newer and full databases: one clear message, nothing lost."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing

import pytest

from realitygap.errors import StudyError
from realitygap.experiments.noise import NoiseConfig
from realitygap.experiments.realities import Realities
from realitygap.study.load import load_study
from realitygap.study.runner import run_study
from realitygap.study.schema import told
from tests.study.helpers import content, end, small, start


@pytest.fixture
def copy(finished, folder):
    """A finished study that may be spoilt."""
    shutil.copytree(finished.folder, folder)
    return folder


def refused(folder, words):
    """Loading and resuming are both refused with these words and the file's name."""
    with pytest.raises(StudyError, match=words) as loading:
        load_study(folder).evaluations()
    with pytest.raises(StudyError, match=words):
        run_study(folder, resume=True)
    assert "study.db" in str(loading.value) and "\n" not in str(loading.value)


def test_a_file_that_is_no_database(copy):
    """Garbage is told as a broken database, with the cure."""
    (copy / "study.db").write_bytes(b"not a database at all" * 1000)
    refused(copy, "broken .*Restore it from a copy")


def test_an_empty_file(copy):
    """An empty file is not a study's."""
    (copy / "study.db").write_bytes(b"")
    refused(copy, "not a study's database")


def test_a_database_with_a_hole(copy):
    """Pages overwritten in the middle are found before anything is written."""
    data = bytearray((copy / "study.db").read_bytes())
    data[8192:] = b"\xa5" * (len(data) - 8192)
    (copy / "study.db").write_bytes(data)
    refused(copy, "broken")


def test_a_database_cut_short(copy):
    """So is a file that lost its end."""
    data = (copy / "study.db").read_bytes()
    (copy / "study.db").write_bytes(data[: len(data) // 2])
    refused(copy, "broken")


@pytest.mark.parametrize(("version", "cure"), [(99, "Upgrade realitygap"), (4, "Make the study again")])
def test_another_format(copy, version, cure):
    """A study of a newer realitygap, or of one before the first release, is left alone."""
    with closing(sqlite3.connect(copy / "study.db")) as database:
        database.execute(f"PRAGMA user_version = {version}")
    refused(copy, f"format {version}, this realitygap reads format 5\\. {cure}")


def test_a_damaged_checkpoint(copy):
    """A checkpoint whose checksum does not fit names the run."""
    with closing(sqlite3.connect(copy / "study.db")) as database, database:
        database.execute("UPDATE run SET finished = 0 WHERE id = 2")
        database.execute("UPDATE checkpoint SET state = zeroblob(500) WHERE run = 2")
    with pytest.raises(StudyError, match=r"study.db: run 2: .*Restore"):
        run_study(copy, resume=True, workers=1)


def test_no_study(tmp_path):
    """A folder without a study, and one that is not there, are told apart."""
    with pytest.raises(StudyError, match="no study there"):
        load_study(tmp_path)
    with pytest.raises(StudyError, match="no such folder"):
        load_study(tmp_path / "nowhere")


@pytest.mark.parametrize("kind", [NoiseConfig, Realities])
def test_an_experiments_folder_is_told_from_a_studys(tmp_path, kind):
    """Its settings' file says which command made it, and so which one makes its results again."""
    (tmp_path / kind.FILE).touch()
    command = f"`{kind.COMMAND} --out {tmp_path} --resume` makes its results"
    with pytest.raises(StudyError, match=f"no study there .*experiment's folder: {command}"):
        load_study(tmp_path)


def test_a_missing_configuration(copy):
    """Without its study.toml a study is not guessed at."""
    (copy / "study.toml").unlink()
    with pytest.raises(StudyError, match=r"study.toml: missing"):
        load_study(copy)


def test_a_place_that_cannot_be_written(tmp_path):
    """A folder that cannot be made ends in one message with the path."""
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match=r"file.*Check the path and its rights"):
        run_study(tmp_path / "file" / "study", small())
    (tmp_path / "link").symlink_to("nowhere")
    for there in ("file", "link"):
        with pytest.raises(StudyError, match=rf"{there}: a file, or a link to nothing, is there\. Check"):
            run_study(tmp_path / there, small())


def test_a_read_only_folder(copy, monkeypatch):
    """A study that cannot be locked for writing can still be read."""

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied", str(copy / "study.lock"))

    monkeypatch.setattr("filelock.FileLock.acquire", refuse)
    with pytest.raises(StudyError, match=r"study.lock: Permission denied. Check the path"):
        run_study(copy, resume=True)
    assert load_study(copy).runs[0].finished


def test_sqlite_says_that_the_disk_is_full(tmp_path):
    """SQLite's own "database or disk is full" says what is kept and how to go on."""
    with closing(sqlite3.connect(tmp_path / "study.db", isolation_level=None)) as database:
        database.execute("CREATE TABLE t (x)")
        database.execute("PRAGMA max_page_count = 2")
        words = r"the disk is full. What was saved is kept: free some space"
        with pytest.raises(StudyError, match=words), told(tmp_path / "study.db"):
            database.execute("INSERT INTO t VALUES (zeroblob(100000))")


def test_a_file_that_cannot_grow(finished, folder):
    """A process whose files may not grow fails clearly; what was saved resumes to the same bits."""
    folder.with_suffix(".toml").write_text(small().to_toml())
    code, said = end(start(folder, "--limit", "150000"))
    assert code == 2 and said.startswith("StudyError: ") and "What was saved is kept" in said
    assert len(said.splitlines()) == 1
    assert 0 < sum(run.evaluations for run in load_study(folder).runs) < 180
    run_study(folder, resume=True, workers=1)
    assert content(folder) == content(finished.folder)
