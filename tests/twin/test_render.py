"""MuJoCo's renderer in its process: windows of one picture, and waits that end."""

from __future__ import annotations

import os
import select
import signal
import time
from collections.abc import Iterator

import numpy as np
import pytest

import realitygap.twin.process as process
import realitygap.twin.render as render
from realitygap.errors import FilmError, RobotError
from realitygap.twin.arena import check_arena
from realitygap.twin.lens import hang_camera
from realitygap.twin.render import PAD_HEIGHT, PAD_WIDTH, Renderer, open_renderer
from realitygap.twin.states import States
from realitygap.twin.unit import draw_unit
from tests.twin.rooms import ARENAS


def opened(name: str) -> Renderer:
    """A renderer, or a skipped test where no GL library works."""
    arena = check_arena(ARENAS[name])
    found = open_renderer(arena, 1, hang_camera(arena, draw_unit(1)))
    return found or pytest.skip("neither EGL nor OSMesa works here")


@pytest.fixture
def renderer() -> Iterator[Renderer]:
    """One above the obstacles."""
    found = opened("obstacle-avoidance")
    yield found
    found.close()


@pytest.mark.parametrize("name", ARENAS)
def test_a_window_round_the_robot_shows_what_the_whole_does(name: str) -> None:
    """Anywhere, at a wall, behind one, tipped or out of the picture: the bits of a whole rendered frame."""
    width, depth = ARENAS[name]["size_cm"]
    places = [(0.5, 0.47), (0.06, 0.05), (0.94, 0.95), (0.97, 0.1), (-0.08, 0.4), (0.3, 0.7), (3.0, 0.5)]
    poses = [
        States.standing([0], [x * width], [y * depth], [k - 3.0]).pose[0] for k, (x, y) in enumerate(places)
    ]
    poses.append(np.array([*poses[0][:2], 0.03, np.cos(0.4), np.sin(0.4), 0.0, 0.0]))  # lies on its side
    renderer = opened(name)
    try:
        for pose in poses:
            frame = renderer.frame(pose)
            renderer._padded = renderer._seen(pose, 0, 0, PAD_WIDTH, PAD_HEIGHT).copy()
            assert np.array_equal(frame, renderer._bent(render.WHOLE)), pose
        changed = renderer.frame(poses[0]) != renderer._still
        assert changed.any(axis=2).sum() > 500
        assert np.array_equal(renderer.frame(poses[6]), renderer._still)
    finally:
        renderer.close()


def test_an_interrupted_frame_arrives(renderer: Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unbuffered and interrupted while a frame is on its way, the renderer still sends all of it."""
    monkeypatch.setenv("PYTHONUNBUFFERED", "1")
    monkeypatch.setattr(render, "ANSWER_S", 20.0)
    unbuffered = opened("obstacle-avoidance")
    read = render._read

    def interrupted(source: int, size: int, patience_s: float) -> bytes:
        assert select.select([source], [], [], patience_s)[0]
        interrupt(unbuffered._process.pid)
        return read(source, size, patience_s)

    pose = States.standing([0], [12], [25], [1.0]).pose[0]
    monkeypatch.setattr(render, "_read", interrupted)
    frame = unbuffered._seen(pose, 0, 0, PAD_WIDTH, PAD_HEIGHT)
    monkeypatch.setattr(render, "_read", read)
    assert np.array_equal(frame, renderer._seen(pose, 0, 0, PAD_WIDTH, PAD_HEIGHT))
    unbuffered.close()


def interrupt(pid: int) -> None:
    """Stop a process that waits for room in its pipe, and let it go on."""
    time.sleep(0.2)
    os.kill(pid, signal.SIGSTOP)
    time.sleep(0.1)
    os.kill(pid, signal.SIGCONT)


def test_a_renderer_that_hangs_or_dies_is_told_of(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No wait for it is without an end: one that does not answer, and one that is gone, are one message."""
    pose = States.standing([0], [12], [25], [1.0]).pose[0]
    monkeypatch.setattr(render, "ANSWER_S", 0.2)
    os.kill(renderer._process.pid, signal.SIGSTOP)
    with pytest.raises(FilmError, match=r"not answered for 0\.2 s"):
        renderer.frame(pose)
    renderer._process.kill()
    renderer._process.wait()
    for _ in range(2):
        with pytest.raises(FilmError, match="renderer ended"):
            renderer.frame(pose)


def test_a_process_that_says_nothing_at_its_start_is_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing heard for too long: the process is ended, and the module is named."""
    monkeypatch.setattr(process, "START_S", 0.2)
    with pytest.raises(RobotError, match=r"json\.tool has not answered for 0\.2 s"):
        process.launch("json.tool", {})  # it waits for the end of its input
