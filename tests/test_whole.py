"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import re
import stat
from pathlib import Path

import pytest

import realitygap
from realitygap.files import atomic_path, atomic_write, move_whole, written_together

SOURCE = Path(realitygap.__file__).parent


def test_a_file_is_on_the_disk_before_it_has_its_name(tmp_path: Path, monkeypatch) -> None:
    """First the file is synced, then it is renamed, then the folder is synced."""
    done: list[tuple[str, str]] = []
    sync, replace = os.fsync, os.replace

    def synced(handle: int) -> None:
        done.append(("sync", os.readlink(f"/proc/self/fd/{handle}")))
        sync(handle)

    def replaced(old: Path, new: Path) -> None:
        assert Path(old).read_text() == "new" and Path(new).read_text() == "old"
        done.append(("rename", str(new)))
        replace(old, new)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    file = tmp_path / "file.txt"
    file.write_text("old")
    atomic_write(file, "new")
    assert file.read_text() == "new"
    (first, spare), *rest = done
    assert first == "sync" and Path(spare).parent == tmp_path and spare != str(file)
    assert rest == [("rename", str(file)), ("sync", str(tmp_path))]


def test_all_of_a_folder_is_on_the_disk_before_it_has_its_name(tmp_path: Path, monkeypatch) -> None:
    """Each file in a folder is synced before the folder is renamed."""
    done: list[str] = []
    monkeypatch.setattr(os, "fsync", lambda handle: done.append(os.readlink(f"/proc/self/fd/{handle}")))
    made = tmp_path / "made"
    (made / "inner").mkdir(parents=True)
    (made / "inner" / "file").write_text("x")
    move_whole(made, tmp_path / "there")
    assert (tmp_path / "there" / "inner" / "file").read_text() == "x"
    parts = (str(made / "inner" / "file"), str(made / "inner"), str(made))
    assert set(parts) == set(done[:3]) and done[3] == str(tmp_path)


def test_a_folder_that_is_moved_whole_goes_to_the_disk_once(tmp_path: Path, monkeypatch) -> None:
    """What is written in it meanwhile is not synced by itself; what is written elsewhere is."""
    done: list[str] = []
    monkeypatch.setattr(os, "fsync", lambda handle: done.append(os.readlink(f"/proc/self/fd/{handle}")))
    made = tmp_path / "made"
    made.mkdir()
    with written_together(made):
        atomic_write(made / "file", "x")
        assert done == []
        atomic_write(tmp_path / "other", "y")
        assert len(done) == 2
    move_whole(made, tmp_path / "there")
    assert done[2:] == [str(made / "file"), str(made), str(tmp_path)]


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_what_was_there_stays_where_writing_fails(tmp_path: Path, error: BaseException) -> None:
    """A write that fails leaves the old file and nothing else."""
    file = tmp_path / "file.txt"
    file.write_text("old")
    with pytest.raises(type(error)) as caught, atomic_path(file) as spare:
        spare.write_text("half")
        raise error
    assert file.read_text() == "old" and os.listdir(tmp_path) == ["file.txt"]
    if isinstance(caught.value, OSError):
        assert caught.value.filename == str(file)


def test_a_full_disk_is_told_with_the_name_of_the_file() -> None:
    """Writing to a full device names it: the system itself does not."""
    with pytest.raises(OSError, match="full") as caught:
        atomic_write("/dev/full", "x" * 100_000)
    assert caught.value.errno == errno.ENOSPC


def test_a_link_stays_a_link_and_a_device_a_device(tmp_path: Path) -> None:
    """What a link points to is written; /dev/null is not made a file."""
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there" / "file")
    atomic_write(tmp_path / "link", "text")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "there" / "file").read_text() == "text"
    atomic_write("/dev/null", "text")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_one_place_renames_files() -> None:
    """No other module of the project writes a file whole by its own hand."""
    found = [p.name for p in SOURCE.rglob("*.py") if re.search(r"os\.(replace|rename)\(", p.read_text())]
    assert found == ["files.py"]
