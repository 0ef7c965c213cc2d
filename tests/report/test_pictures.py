"""Single pictures and films of a trajectory."""

from __future__ import annotations

import resource
from pathlib import Path

import numpy as np
import pytest

from realitygap.errors import UsageError
from realitygap.report import save_animation, save_picture
from realitygap.report.pictures import frames
from realitygap.tasks import load_task
from realitygap.world.robot import load_profile
from tests.report.scenes import circle

PROFILE = load_profile("paper")
TASK = load_task("avoidance")


@pytest.mark.parametrize(("ending", "mark"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".PDF", b"%PDF")])
def test_the_file_ending_says_the_format(tmp_path: Path, ending: str, mark: bytes) -> None:
    """PNG, SVG and PDF, in capitals too."""
    path = save_picture(tmp_path / f"path{ending}", TASK, PROFILE, circle(20), "a run")
    assert path.read_bytes().startswith(mark)


@pytest.mark.parametrize("save", [save_picture, save_animation])
@pytest.mark.parametrize("name", ["path.bmp", "path"])
def test_other_endings_are_refused_by_name(tmp_path: Path, save, name: str) -> None:
    """The message names the endings that can be written."""
    with pytest.raises(UsageError, match=r"\.(png|gif).* or \.(pdf|mp4)"):
        save(tmp_path / name, TASK, PROFILE, circle(3))


def test_a_gif_has_a_frame_for_every_step_at_ten_a_second(tmp_path: Path) -> None:
    """In real time, or faster when asked."""
    from PIL import Image

    for speed, duration in ((1.0, 100), (2.0, 50)):
        path = save_animation(tmp_path / "path.gif", TASK, PROFILE, circle(12), speed=speed)
        with Image.open(path) as film:
            assert film.n_frames == 12 and film.info["duration"] == duration


def test_an_mp4_can_be_played(tmp_path: Path) -> None:
    """As many frames as steps, ten a second."""
    av = pytest.importorskip("av")
    path = save_animation(tmp_path / "path.mp4", load_task("light"), PROFILE, circle(12))
    with av.open(str(path)) as film:
        assert film.streams.video[0].average_rate == 10
        assert sum(1 for _ in film.decode(video=0)) == 12


@pytest.mark.parametrize(
    ("save", "ending"),
    [(save_picture, "png"), (save_picture, "svg"), (save_animation, "gif"), (save_animation, "mp4")],
)
def test_what_was_there_stays_where_the_disk_is_full(tmp_path: Path, save, ending: str) -> None:
    """A picture or film that cannot be finished leaves the earlier one as it was, and nothing beside it."""
    path = tmp_path / f"path.{ending}"
    path.write_bytes(b"earlier")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(OSError, match=f"File too large: '{path}'"):
            save(path, TASK, PROFILE, circle(12))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert path.read_bytes() == b"earlier" and [*tmp_path.iterdir()] == [path]


def test_tails_are_not_erased_in_a_film() -> None:
    """The last frame differs from the first in more places than a robot covers."""
    pictures = list(frames(TASK, PROFILE, circle(40)))
    assert all(picture.dtype == np.uint8 and picture.shape == pictures[0].shape for picture in pictures)
    changed = (pictures[0] != pictures[-1]).any(axis=2).sum()
    assert changed > (pictures[0] != pictures[1]).any(axis=2).sum() > 0


def test_a_film_needs_a_speed(tmp_path: Path) -> None:
    """Standing still is refused."""
    with pytest.raises(UsageError, match="speed"):
        save_animation(tmp_path / "path.gif", TASK, PROFILE, circle(3), speed=0)
