"""Figures and films show what they are given, to scale."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Circle

from realitygap.report import save_animation, save_picture, style
from realitygap.report.drawing import (
    arena_figure,
    cast,
    frames,
    rays_of,
    robot_figure,
    tail,
)
from realitygap.tasks import load_task
from realitygap.world.robot import load_profile
from tests.report.scenes import circle

PROFILE = load_profile("paper")
TASKS = [load_task("avoidance"), load_task("light")]


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_an_arena_is_drawn_to_scale(task) -> None:
    """Axes are in cm with one scale for both, and every cylinder has its place and radius."""
    with style.styled():
        axes = arena_figure(task.arena, PROFILE, task.feeds, task.to_kernel(PROFILE).start).axes[0]
    assert axes.get_aspect() == 1.0
    assert "(cm)" in axes.get_xlabel() and "(cm)" in axes.get_ylabel()
    drawn = {(*patch.center, patch.radius) for patch in axes.patches if isinstance(patch, Circle)}
    assert {tuple(map(float, c)) for c in task.arena.to_kernel().cylinders} <= drawn


def test_rays_end_where_they_meet_something() -> None:
    """From the middle of the paper's arena: a wall at 25 cm ahead, a cylinder on the diagonal; a sensor's ten
    are no longer than it reaches."""
    arena, robot = TASKS[0].arena.to_kernel(), PROFILE.to_kernel()
    away = np.array([[1.0, 0.0], [math.sqrt(0.5), math.sqrt(0.5)], [0.0, -1.0]])
    found = cast(arena, np.full((3, 2), 25.0), away)
    assert found == pytest.approx([25.0, math.hypot(10, 10) - 4.0, 25.0])
    rays = rays_of(robot, arena, "proximity", (25.0, 25.0, 0.3))
    lengths = np.hypot(*(rays[:, 1] - rays[:, 0]).T)
    assert rays.shape == (80, 2, 2) and lengths == pytest.approx(np.repeat(robot.proximity.reach, 10))
    assert len(rays_of(robot, arena, "proximity+ambient", (10.0, 5.0, 0.0))) == 160


def test_a_tail_has_a_stroke_from_centre_to_leading_edge_for_every_step() -> None:
    """Strokes start at the path's places, are one radius long, point ahead, and are not joined."""
    trajectory = circle(50)
    strokes = tail(trajectory, 2.9).reshape(-1, 3, 2)
    assert len(strokes) == 51
    assert strokes[:-1, 0, 0] == pytest.approx(trajectory.x)
    along = strokes[:, 1] - strokes[:, 0]
    assert np.hypot(*along.T) == pytest.approx(np.full(51, 2.9))
    assert np.cos(np.arctan2(along[:-1, 1], along[:-1, 0]) - trajectory.heading) == pytest.approx(np.ones(50))
    assert np.isnan(strokes[:, 2]).all()


def test_noise_levels_keep_their_look() -> None:
    """Zero, observed and double look the same whatever else is shown, and nothing is told by colour alone:
    a robot has another line, width and body than its simulation."""
    shown = style.noise_styles([0, 0.5, 1, 1.5, 2])
    assert all(shown[level] == style.noise_styles([level])[level] for level in (0.0, 1.0, 2.0))
    assert len({(s.colour) for s in shown.values()}) == len({s.marker for s in shown.values()}) == 5
    assert len({str(s.line) for s in shown.values()}) == 5
    assert all(ours != theirs for ours, theirs in zip(style.SIMULATED, style.SITUATED, strict=True))
    many = style.noise_styles([k / 4 for k in range(11)])
    assert len({(s.marker, str(s.line)) for s in many.values()}) == 11
    assert all(sign for _, _, sign in style.noise_key(dict.fromkeys(many, "")))


def test_a_figure_is_written_to_the_same_bytes(tmp_path: Path) -> None:
    """Two drawings of one thing are the same files, and SVG text stays text."""
    prints = []
    for name in "ab":
        folder = tmp_path / name
        folder.mkdir()
        with style.styled():
            svg = style.save_figure(robot_figure(PROFILE), folder, "robot", dpi=60)
        prints.append(
            [hashlib.sha256((folder / f"robot.{e}").read_bytes()).hexdigest() for e in ("png", "svg")]
        )
        assert ">5.8 cm</text>" in svg
    assert prints[0] == prints[1]


def test_an_inline_svg_has_ids_of_its_own_and_the_pages_colours(tmp_path: Path) -> None:
    """Two figures on one page do not share an id; ink follows light and dark; the blind are told."""
    with style.styled():
        svg = style.save_figure(robot_figure(PROFILE), tmp_path, "robot", dpi=60)
    text = style.inline_svg(svg, "robot", 'A "robot" & more')
    assert text.startswith("<svg ") and 'aria-label="A &quot;robot&quot; &amp; more"' in text
    assert "var(--ink, " in text and "<metadata" not in text
    assert 'id="robot-figure_1"' in text and 'id="figure_1"' not in text


def test_pictures_and_films_are_of_the_kind_that_their_names_say(tmp_path: Path) -> None:
    """A film has a frame for every step, ten a second, or faster when asked."""
    from PIL import Image

    for ending, mark in ((".png", b"\x89PNG"), (".svg", b"<?xml"), (".PDF", b"%PDF")):
        path = save_picture(tmp_path / f"path{ending}", TASKS[0], PROFILE, circle(20), "a run")
        assert path.read_bytes().startswith(mark)
    path = save_animation(tmp_path / "path.gif", TASKS[0], PROFILE, circle(12), speed=2.0)
    with Image.open(path) as film:
        assert film.n_frames == 12 and film.info["duration"] == 50
    av = pytest.importorskip("av")
    path = save_animation(tmp_path / "path.mp4", TASKS[1], PROFILE, circle(12))
    with av.open(str(path)) as film:
        assert film.streams.video[0].average_rate == 10
        assert sum(1 for _ in film.decode(video=0)) == 12


def test_tails_are_not_erased_in_a_film() -> None:
    """The last frame differs from the first in more places than a robot covers."""
    pictures = list(frames(TASKS[0], PROFILE, circle(40)))
    assert all(picture.dtype == np.uint8 and picture.shape == pictures[0].shape for picture in pictures)
    changed = (pictures[0] != pictures[-1]).any(axis=2).sum()
    assert changed > (pictures[0] != pictures[1]).any(axis=2).sum() > 0
