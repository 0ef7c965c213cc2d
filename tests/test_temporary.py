"""Temporary folders: made, held, and gone in the end."""

from __future__ import annotations

import gc
from pathlib import Path

import pytest

from realitygap import temporary


@pytest.mark.filterwarnings("error")
def test_a_folder_that_was_swept_before_it_was_held_is_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process may remove it in between; nothing is said of it when the second is done with."""
    held, made = temporary.hold, list[Path]()

    def late(folder: Path) -> int | None:
        made.append(folder)
        if len(made) == 1:
            folder.rmdir()
        return held(folder)

    monkeypatch.setattr(temporary, "hold", late)
    with temporary.Folder("test") as name:
        assert Path(name).is_dir() and [str(folder) for folder in made[1:]] == [name]
    gc.collect()
    assert not any(folder.exists() for folder in made)


def test_a_folder_of_a_dead_process_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Making the next one removes what nobody holds, and leaves what somebody does, and what is not ours."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    left, other = temporary.name("test"), tmp_path / "realitygap.tmp.mine"
    for folder in (left, other):
        folder.mkdir(mode=0o700)
    with temporary.Folder("test") as one, temporary.Folder("test") as two:
        assert Path(one).is_dir() and Path(two).is_dir()
        assert not left.exists() and other.exists()
