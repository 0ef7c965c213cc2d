"""The overhead camera: both views, one lens."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

import realitygap.twin.render as render
from realitygap.errors import ConfigError
from realitygap.track import Track
from realitygap.twin.camera import (
    DISK_HEIGHT,
    FRONT_AHEAD,
    FRONT_RADIUS,
    HEIGHT,
    MIDDLE_RADIUS,
    WIDTH,
    OverheadCamera,
    Plate,
    hang_camera,
)
from realitygap.twin.unit import draw_unit, plain_arena
from realitygap.values import Pose
from tests.twin.rooms import ARENAS


def camera(view: str, name: str = "obstacle-avoidance", unit: int = 1, noise: float = 1.0) -> OverheadCamera:
    """A camera, or a skipped test where no GL library works."""
    try:
        return OverheadCamera(ARENAS[name], unit=unit, view=view, noise=noise)
    except ConfigError as error:
        pytest.skip(str(error))


def white_spot(frame: NDArray[np.uint8], near: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Centre of the white in the black around a pixel: column, row."""
    reach = math.ceil(radius) + 1
    left, top = (round(v) - reach for v in near)
    part = frame[top : top + 2 * reach + 1, left : left + 2 * reach + 1].mean(axis=2)
    weight = np.maximum(part - (part.min() + part.max()) / 2, 0)
    rows, columns = np.mgrid[: part.shape[0], : part.shape[1]]
    weight[np.hypot(columns + left - near[0], rows + top - near[1]) > radius] = 0
    return np.array([(columns * weight).sum(), (rows * weight).sum()]) / weight.sum() + [left, top]


@pytest.mark.parametrize("view", ["drawn", "mujoco"])
@pytest.mark.parametrize("name", list(ARENAS))
def test_the_disk_is_where_the_lens_says(view: str, name: str) -> None:
    """Both white patches are seen within a fifth of a pixel of where the camera's geometry puts them."""
    width, depth = (v / 100 for v in ARENAS[name]["size_cm"])
    with camera(view, name, noise=0.0) as eye:
        for x, y, heading in [
            (0.06, 0.07, 0.4),
            (width / 2, depth / 2, -2.0),
            (width - 0.05, depth - 0.2, 2.5),
        ]:
            frame = eye.frame(Pose(x=x * 100, y=y * 100, heading=heading))
            assert frame.shape == (480, 640, 3) and frame.dtype == np.uint8
            scale = eye.lens.focal / eye.lens.position[2]
            for ahead, radius in ((0.0, MIDDLE_RADIUS), (FRONT_AHEAD, FRONT_RADIUS)):
                patch = [x + ahead * math.cos(heading), y + ahead * math.sin(heading), DISK_HEIGHT]
                expected = eye.lens.pixels(np.array(patch))
                assert np.hypot(*(white_spot(frame, expected, scale * (radius + 0.0025)) - expected)) < 0.2


def test_both_views_show_the_same() -> None:
    """Rendered and drawn frames agree about where walls, cylinders and robot are."""
    pose = Pose(x=9, y=25, heading=1.0)
    with camera("mujoco", noise=0.0) as first, camera("drawn", noise=0.0) as second:
        a, b = (eye.frame(pose).astype(float).mean(axis=2) for eye in (first, second))
    inside = (slice(60, 420), slice(110, 520))
    assert np.corrcoef(a[inside].ravel(), b[inside].ravel())[0, 1] > 0.85


@pytest.mark.parametrize("name", list(ARENAS))
def test_every_unit_sees_its_whole_floor(name: str) -> None:
    """However a unit's camera hangs, the disk is in the picture wherever the robot can be."""
    arena = plain_arena(ARENAS[name])
    w, h = (v / 100 for v in arena["size_cm"])
    corners = np.array([[x, y, DISK_HEIGHT] for x in (0, w) for y in (0, h)])
    for unit in range(200):
        seen = hang_camera(arena, draw_unit(unit)).pixels(corners)
        assert (seen >= 0).all() and (seen[:, 0] < WIDTH).all() and (seen[:, 1] < HEIGHT).all()


def test_the_lens_bends_and_straightens() -> None:
    """Pixels go to the floor and back; a straight edge is bent; height moves points out."""
    lens = hang_camera(ARENAS["light-seeking"], draw_unit(0))
    columns, rows = np.meshgrid([0.0, 100.5, 320, 639], [0.0, 77, 240, 479])
    floor, slope = lens.floor(columns, rows)
    back = lens.pixels(np.concatenate([floor, np.zeros_like(floor[..., :1])], axis=-1))
    assert back == pytest.approx(np.stack([columns, rows], axis=-1), abs=1e-6)
    raised = np.concatenate([floor + 0.03 * slope, np.full_like(floor[..., :1], 0.03)], axis=-1)
    assert lens.pixels(raised) == pytest.approx(back, abs=1e-6)
    edge = lens.pixels(np.array([[x, 0.0, 0.0] for x in (0.0, 0.55, 1.1)]))
    chord = edge[0] + (edge[2] - edge[0]) * (edge[1, 0] - edge[0, 0]) / (edge[2, 0] - edge[0, 0])
    assert abs(edge[1, 1] - chord[1]) > 0.7
    parallax = lens.pixels(np.array([[1.0, 0.6, z] for z in (0.0, DISK_HEIGHT)]))
    assert 2 < np.hypot(*(parallax[1] - parallax[0])) < 20


def test_a_film_of_recorded_places() -> None:
    """Places recorded first give frames at an even pace afterwards, the same each time; in grey, too."""
    t = np.arange(21) / 50 + 0.137
    truth = Track(t=t, x=20 + 10 * t, y=20 + t, heading=t)
    with camera("drawn") as eye, camera("drawn", noise=0.0) as still:
        film, again = (list(eye.frames(truth, fps=25)) for _ in range(2))
        quiet = [frame for _, frame in still.frames(truth, fps=25)]
    assert [t for t, _ in film] == pytest.approx(np.arange(11) / 25)
    assert all(np.array_equal(a[1], b[1]) for a, b in zip(film, again, strict=True))
    noise = np.array([f.astype(float) - q for (_, f), q in zip(film, quiet, strict=True)])
    assert noise.std() == pytest.approx(2.5, abs=0.2)
    assert abs(np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]) < 0.03
    with OverheadCamera(ARENAS["obstacle-avoidance"], unit=1, noise=0.0, grey=True) as grey:
        frame = grey.frame(Pose(x=truth.x[0], y=truth.y[0], heading=truth.heading[0]))
    assert np.abs(frame - quiet[0].astype(float) @ (0.299, 0.587, 0.114)).max() < 1.5


def test_a_tracker_is_shown_the_same_surroundings() -> None:
    """Frames that are painted onto the one before are, 3.5 cm about the robot, those of a film; and only one
    robot is in each, however far it has jumped."""
    x = np.array([20.0, 20.4, 20.8, 41.0, 41.5])
    truth = Track(t=np.arange(5) / 10, x=x, y=np.full(5, 22.0), heading=x)
    with OverheadCamera(ARENAS["obstacle-avoidance"], unit=1, grey=True) as eye:
        for (_, whole), (_, part), at in zip(
            eye.frames(truth, fps=10), eye.watched(truth, fps=10), x, strict=True
        ):
            column, row = np.rint(eye.lens.pixels(np.array([at / 100, 0.22, DISK_HEIGHT]))).astype(int)
            here = slice(row - 55, row + 55), slice(column - 55, column + 55)
            assert np.array_equal(part[here], whole[here])
            assert np.abs(part.astype(int) - whole).max() < 40


def test_a_renderer_that_is_not_there_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without EGL and OSMesa frames can be drawn all the same."""
    monkeypatch.setattr(render, "LIBRARIES", ("glory",))
    monkeypatch.setenv("MUJOCO_GL", "glory")
    with OverheadCamera(ARENAS["light-seeking"], unit=0) as eye:
        assert eye.metadata["view"].startswith("drawn")
    with pytest.raises(ConfigError, match="EGL or OSMesa"):
        OverheadCamera(ARENAS["light-seeking"], unit=0, view="mujoco")
    with pytest.raises(ConfigError, match="drawn, mujoco"):
        OverheadCamera(ARENAS["light-seeking"], unit=0, view="film")


def test_a_plate_is_drawn_cell_by_cell() -> None:
    """Where the lens sees the middle of a cell of a plate on the robot it is black or white as that cell is,
    and the robot's disk is not seen."""
    arena, cells = ARENAS["obstacle-avoidance"], np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]], np.uint8)
    half = 0.015
    corners = half * np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) + np.array([0.004, -0.003])
    x, y, heading = 0.22, 0.18, 0.7
    with OverheadCamera(arena, unit=1, noise=0.0, plate=Plate(cells, corners, 0.034)) as eye:
        frame = eye.frame(Pose(x=100 * x, y=100 * y, heading=heading)) / eye._light
        away = eye.frame(Pose(x=300, y=300, heading=0.0))
        assert np.array_equal(away, np.rint(eye._still).clip(0, 255))
    c, s = np.cos(heading), np.sin(heading)
    for row in range(-1, 4):
        for column in range(-1, 4):
            ahead, left = corners[0] - (np.array([row, column]) + 0.5) * 0.01
            there = np.array([x + c * ahead - s * left, y + s * ahead + c * left, 0.034])
            at, down = np.rint(eye.lens.pixels(there)).astype(int)
            inside = 0 <= row < 3 and 0 <= column < 3
            grey = 243.0 if not inside or cells[row, column] else 14.0
            assert np.abs(frame[down, at] - grey).max() < 4.0, (row, column)
