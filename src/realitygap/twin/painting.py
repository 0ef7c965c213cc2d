"""The robot in a drawn picture: compiled, for a camera that watches many trials.

It is painted a row of samples at a time, in loops without branches that a processor takes eight samples
a step; the few samples on a circle's very edge come after. Lengths are single precision, as the picture's
are; the front patch's place has double precision.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from realitygap.twin.arithmetic import jit, step

__all__ = ["paint_robot"]


@step
def _length(x: Any, y: Any) -> Any:
    """Of x, y, in double precision."""
    return math.sqrt(np.float64(x) * np.float64(x) + np.float64(y) * np.float64(y))


@step
def _cover_body(
    row: int, first: int, still: Any, x: Any, y: Any, heights: Any, radius: Any, body: Any
) -> None:
    """Whether samples show the body's side: squares tell, but for those on its very edge."""
    end = first + body.shape[0]
    floor_x, floor_y = still[0][0, row, first:end], still[0][1, row, first:end]
    slope_x, slope_y = still[1][0, row, first:end], still[1][1, row, first:end]
    square, near = np.float32(radius * radius), np.float32(1e-5 * radius * radius)
    body[:] = 0
    for layer in range(heights.shape[0] - 1):
        z, doubtful = heights[layer], 0
        for k in range(body.shape[0]):
            dx = slope_x[k] * z + floor_x[k] - x
            dy = slope_y[k] * z + floor_y[k] - y
            less = dx * dx + dy * dy - square
            body[k] |= less <= -near
            doubtful |= abs(less) < near
        if doubtful:
            for k in range(body.shape[0]):
                dx = slope_x[k] * z + floor_x[k] - x
                dy = slope_y[k] * z + floor_y[k] - y
                if abs(dx * dx + dy * dy - square) < near:
                    body[k] |= np.float32(_length(dx, dy)) < np.float32(radius)


@step
def _cover_mark(x: Any, y: Any, radius: Any, samples: Any, share: Any) -> None:
    """How much of samples at x, y from its middle a mark covers: its edge is as soft as a sample is wide."""
    soft = 1.0 / samples
    out, full = (radius + soft) ** 2, max(radius - soft, 0.0) ** 2
    edge = 0
    for k in range(share.shape[0]):
        square = x[k] * x[k] + y[k] * y[k]
        share[k] = 1.0 if square < full else 0.0
        edge |= (square >= full) & (square <= out)
    if edge:
        for k in range(share.shape[0]):
            square = x[k] * x[k] + y[k] * y[k]
            if full <= square <= out:
                off = math.sqrt(square)
                if abs(off - radius) < soft:
                    off = x.dtype.type(_length(x[k], y[k]))
                share[k] = min(max((radius - off) * samples + 0.5, 0.0), 1.0)


@step
def _cover_marks(row: int, first: int, still: Any, x: Any, y: Any, ahead: Any, z: Any, radii: Any,
                 samples: Any, offs: Any, exact: Any, shares: Any) -> None:  # fmt: skip
    """How much of samples the disk and its two patches cover, into `shares`."""
    end = first + shares.shape[1]
    floor_x, floor_y = still[0][0, row, first:end], still[0][1, row, first:end]
    slope_x, slope_y = still[1][0, row, first:end], still[1][1, row, first:end]
    off_x, off_y, exact_x, exact_y = offs[0], offs[1], exact[0], exact[1]
    for k in range(shares.shape[1]):
        there_x = slope_x[k] * z + floor_x[k]
        there_y = slope_y[k] * z + floor_y[k]
        off_x[k], off_y[k] = there_x - x, there_y - y
        exact_x[k], exact_y[k] = there_x - ahead[0], there_y - ahead[1]
    _cover_mark(off_x, off_y, np.float32(radii[1]), samples, shares[0])
    _cover_mark(off_x, off_y, np.float32(radii[2]), samples, shares[1])
    _cover_mark(exact_x, exact_y, radii[3], samples, shares[2])


@step
def _colour(row: int, first: int, still: Any, colours: Any, body: Any, shares: Any, shown: Any) -> None:
    """The samples' colours into `shown`."""
    end = first + body.shape[0]
    disk, patch, front = shares[0], shares[1], shares[2]
    for colour in range(3):
        fine, over = still[2][colour, row, first:end], still[3][row, first:end]
        into = shown[colour]
        side, black, white = (
            colours[0, colour], colours[1, colour], colours[2, colour],
        )  # fmt: skip
        for k in range(body.shape[0]):
            value = side if body[k] else fine[k]
            value += (black - value) * disk[k]
            value += (white - value) * patch[k]
            value += (white - value) * front[k]
            into[k] = fine[k] if over[k] else value


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
    first, count = columns[0] * sub, max(columns[1] - columns[0], 0) * sub
    x, y, part = np.float32(place[0]), np.float32(place[1]), np.float32(1.0 / sub**2)
    body, offs, exact = np.empty(count, np.uint8), np.empty((2, count), np.float32), np.empty((2, count))
    shares, shown = np.empty((3, count), np.float32), np.empty((sub, 3, count), np.float32)
    for row in range(rows[0], rows[1]):
        for k in range(sub):
            at = row * sub + k
            _cover_body(at, first, still, x, y, heights, radii[0], body)
            _cover_marks(at, first, still, x, y, ahead, heights[-1], radii, samples, offs, exact, shares)
            _colour(at, first, still, colours, body, shares, shown[k])
        for column in range(count // sub):
            for colour in range(3):
                total = np.float32(0.0)
                for k in range(sub * sub):
                    total += shown[k // sub, colour, column * sub + k % sub]
                picture[row - corner[0], columns[0] + column - corner[1], colour] = total * part
