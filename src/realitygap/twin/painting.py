"""The robot in a drawn picture, sample by sample: compiled, for a camera that watches many trials.

Lengths are single precision, as the picture's are; the front patch's place has double precision.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from realitygap.twin.jit import jit, step

__all__ = ["paint_robot"]


@step
def _inside(x: Any, y: Any, radius: Any) -> Any:
    """Whether a sample lies in a circle: squares tell, but for those on its very edge."""
    square = x * x + y * y - np.float32(radius * radius)
    if abs(square) < np.float32(1e-5 * radius * radius):
        return math.hypot(x, y) < np.float32(radius)
    return square < 0.0


@step
def _share(x: Any, y: Any, radius: Any, samples: Any) -> Any:
    """How much of a sample a circle covers: its edge is as soft as a sample is wide."""
    square, soft = x * x + y * y, 1.0 / samples
    if square > (radius + soft) ** 2:
        return np.float32(0.0)
    if radius > soft and square < (radius - soft) ** 2:
        return np.float32(1.0)
    off = math.sqrt(square)
    if abs(off - radius) < soft:
        off = math.hypot(x, y)
    return np.float32(min(max((radius - off) * samples + 0.5, 0.0), 1.0))


@step
def _is_body(row: int, column: int, still: Any, x: Any, y: Any, heights: Any, radius: Any) -> Any:
    """Whether a sample shows the body's side."""
    floor, slope = still[0], still[1]
    for layer in range(heights.shape[0] - 1):
        dx = slope[0, row, column] * heights[layer] + floor[0, row, column] - x
        dy = slope[1, row, column] * heights[layer] + floor[1, row, column] - y
        if _inside(dx, dy, radius):
            return True
    return False


@step
def _sample(row: int, column: int, still: Any, place: Any, ahead: Any, samples: Any, heights: Any,
            radii: Any, colours: Any, shown: Any) -> None:  # fmt: skip
    """A sample's colour into `shown`."""
    floor, slope, fine, over = still
    x, y = np.float32(place[0]), np.float32(place[1])
    for colour in range(3):
        shown[colour] = fine[colour, row, column]
    if over[row, column]:
        return
    if _is_body(row, column, still, x, y, heights, radii[0]):
        for colour in range(3):
            shown[colour] = colours[0, colour]
    there_x = slope[0, row, column] * heights[-1] + floor[0, row, column]
    there_y = slope[1, row, column] * heights[-1] + floor[1, row, column]
    for mark in range(1, 4):
        if mark < 3:
            share = _share(there_x - x, there_y - y, np.float32(radii[mark]), samples)
        else:
            share = _share(there_x - ahead[0], there_y - ahead[1], radii[mark], samples)
        if share > 0.0:
            for colour in range(3):
                shown[colour] += (colours[mark, colour] - shown[colour]) * share


@jit
def paint_robot(picture: Any, corner: Any, rows: Any, columns: Any, still: Any, place: Any, ahead: Any,
                sub: int, samples: Any, heights: Any, radii: Any, colours: Any) -> None:  # fmt: skip
    """The robot into a window of the picture: each pixel the mean of its samples.

    Args:
        picture: [rows, columns, 3] of the window, without the robot.
        corner: its first row and column in the whole picture.
        rows, columns: first and end of what is painted anew.
        still: floor, slope, fine, over, as `Drawing` keeps them.
        place: x, y (m).
        ahead: of the front patch (m).
        sub: samples along a pixel's side.
        samples: a metre.
        heights, radii, colours: of the body and the marks, as `drawing.LOOKS` has them.
    """
    shown, total = np.empty(3, np.float32), np.empty(3, np.float32)
    part = np.float32(1.0 / sub**2)
    for row in range(rows[0], rows[1]):
        for column in range(columns[0], columns[1]):
            total[:] = 0.0
            for k in range(sub * sub):
                down, right = row * sub + k // sub, column * sub + k % sub
                _sample(down, right, still, place, ahead, samples, heights, radii, colours, shown)
                for colour in range(3):
                    total[colour] += shown[colour]
            for colour in range(3):
                picture[row - corner[0], column - corner[1], colour] = total[colour] * part
