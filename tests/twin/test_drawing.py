"""The drawn view: quick ways to the same picture."""

from __future__ import annotations

import numpy as np
import pytest

from realitygap.twin.camera import OverheadCamera
from realitygap.twin.drawing import Drawing
from realitygap.twin.lens import hang_camera
from realitygap.twin.plate import Plate
from realitygap.twin.states import States
from realitygap.twin.unit import draw_unit
from tests.twin.rooms import ARENAS
from tests.twin.slow_drawing import slow_frame


@pytest.mark.parametrize("name", ARENAS)
def test_a_frame_is_the_slow_ones(name: str) -> None:
    """Anywhere on the floor, against a wall, half out of the picture or outside of it: to a grey level's
    ten-thousandth, and nearly everywhere to the last bit."""
    arena = ARENAS[name]
    lens = hang_camera(arena, draw_unit(1))
    drawing = Drawing(arena, lens)
    width, depth = (side / 100.0 for side in arena["size_cm"])
    places = [(0.3, 0.4), (0.06, 0.06), (1.0, 0.99), (0.99, 0.02), (-0.04, 0.5), (0.5, 1.05), (3.0, 3.0)]
    for k, (x, y) in enumerate(places):
        frame = drawing.frame(x * width, y * depth, k - 3.0)
        slow = slow_frame(drawing, lens, x * width, y * depth, k - 3.0)
        assert np.abs(frame - slow).max() < 1e-4
        assert (frame != slow).mean() < 1e-4
    assert np.array_equal(drawing.frame(3.0, 3.0, 0.0), drawing.background)


def test_a_plate_is_drawn_cell_by_cell() -> None:
    """Where the lens sees the middle of a cell of a plate on the robot it is black or white as that cell is,
    and the robot's disk is not seen; a window of it is a part of the frame."""
    arena, cells = ARENAS["obstacle-avoidance"], np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]], np.uint8)
    lens, half = hang_camera(arena, draw_unit(1)), 0.015
    corners = half * np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) + np.array([0.004, -0.003])
    drawing = Drawing(arena, lens, Plate(cells, corners, 0.034))
    x, y, heading = 0.22, 0.18, 0.7
    frame = drawing.frame(x, y, heading)
    c, s = np.cos(heading), np.sin(heading)
    for row in range(-1, 4):
        for column in range(-1, 4):
            ahead, left = corners[0] - (np.array([row, column]) + 0.5) * 0.01
            there = np.array([x + c * ahead - s * left, y + s * ahead + c * left, 0.034])
            at, down = np.rint(lens.pixels(there)).astype(int)
            inside = 0 <= row < 3 and 0 <= column < 3
            grey = 243.0 if not inside or cells[row, column] else 14.0
            assert np.abs(frame[down, at] - grey).max() < 3.0, (row, column)
    window = (slice(150, 260), slice(200, 330))
    assert np.array_equal(drawing.frame(x, y, heading, window), frame[window])
    assert np.array_equal(drawing.frame(3.0, 3.0, 0.0), drawing.background)


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_a_window_is_a_part_of_the_frame(noise: float) -> None:
    """With the robot inside, across its edge, or elsewhere: the same bits, its pixels' noise too."""
    arena = ARENAS["obstacle-avoidance"]
    windows = [
        (slice(200, 290), slice(250, 345)),
        (slice(0, 241), slice(321, 640)),
        (slice(0, 9), slice(0, 9)),
    ]
    with OverheadCamera(arena, unit=2, noise=noise, view="drawn") as eye:
        pose = States.standing([0], [30.0], [25.0], [0.7]).pose[0]
        whole = eye.frame(pose, 12)
        for window in windows:
            assert np.array_equal(eye.frame(pose, 12, window), whole[window])
        assert np.array_equal(eye.frame(pose, 13, windows[0]), whole[windows[0]]) is (noise == 0.0)
