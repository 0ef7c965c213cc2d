"""The robot in a drawn picture: compiled, for a camera that watches many trials.

It is painted a row of samples at a time, in loops without branches that a processor takes eight samples
a step; the few samples on a circle's very edge come after. Lengths are single precision, as the picture's
are; the front patch's place has double precision.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from realitygap.twin.arithmetic import jit, routine, step

__all__ = ["SUB", "Look", "Still", "expose", "paint_robot"]

SUB = 2
"""Samples along a pixel's side."""


class Still(NamedTuple):
    """What a camera sees without the robot, a value a sample: [2, ...] x and y where its ray meets the
    floor and their change with height, [3, ...] colours, [...] whether something higher stands there; so
    many `samples` a metre."""

    floor: Any
    slope: Any
    fine: Any
    over: Any
    samples: float


class Look(NamedTuple):
    """The robot: heights of its sides and last of its disk, radii and colours of body and three marks."""

    heights: Any
    radii: Any
    colours: Any


@step
def _length(x: Any, y: Any) -> Any:
    """Of x, y, in double precision."""
    return math.sqrt(np.float64(x) * np.float64(x) + np.float64(y) * np.float64(y))


@step
def _cover_body(row: int, first: int, still: Any, place: Any, look: Any, body: Any) -> None:
    """Whether samples show the body's side: squares tell, but for those on its very edge."""
    end = first + body.shape[0]
    floor_x, floor_y = still.floor[0, row, first:end], still.floor[1, row, first:end]
    slope_x, slope_y = still.slope[0, row, first:end], still.slope[1, row, first:end]
    x, y, heights, radius = np.float32(place[0]), np.float32(place[1]), look.heights, look.radii[0]
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
def _cover_marks(row: int, first: int, still: Any, place: Any, look: Any, work: Any) -> None:
    """How much of samples the disk and its two patches cover, into `shares`."""
    radii, samples, (offs, exact, shares) = look.radii, still.samples, work
    end = first + shares.shape[1]
    floor_x, floor_y = still.floor[0, row, first:end], still.floor[1, row, first:end]
    slope_x, slope_y = still.slope[0, row, first:end], still.slope[1, row, first:end]
    off_x, off_y, exact_x, exact_y = offs[0], offs[1], exact[0], exact[1]
    x, y, z = np.float32(place[0]), np.float32(place[1]), look.heights[-1]
    for k in range(shares.shape[1]):
        there_x = slope_x[k] * z + floor_x[k]
        there_y = slope_y[k] * z + floor_y[k]
        off_x[k], off_y[k] = there_x - x, there_y - y
        exact_x[k], exact_y[k] = there_x - place[2], there_y - place[3]
    _cover_mark(off_x, off_y, np.float32(radii[1]), samples, shares[0])
    _cover_mark(off_x, off_y, np.float32(radii[2]), samples, shares[1])
    _cover_mark(exact_x, exact_y, radii[3], samples, shares[2])


@step
def _colour(row: int, first: int, still: Any, colours: Any, work: Any, shown: Any) -> None:
    """The samples' colours into `shown`."""
    body, shares = work
    end = first + body.shape[0]
    disk, patch, front = shares[0], shares[1], shares[2]
    for colour in range(3):
        fine, over = still.fine[colour, row, first:end], still.over[row, first:end]
        into = shown[colour]
        side, black, white = colours[0, colour], colours[1, colour], colours[2, colour]
        for k in range(body.shape[0]):
            value = side if body[k] else fine[k]
            value += (black - value) * disk[k]
            value += (white - value) * patch[k]
            value += (white - value) * front[k]
            into[k] = fine[k] if over[k] else value


@routine
def paint_robot(picture: Any, corner: Any, about: Any, still: Any, place: Any, look: Any) -> None:
    """The robot into a window of the picture: each pixel the mean of its samples.

    Args:
        picture: [rows, columns, 3] of the window, without the robot.
        corner: its first row and column in the whole picture.
        about: first and end of the rows, and of the columns, that are painted anew.
        still: as `Drawing` keeps it.
        place: x, y of the robot and of its front patch (m).
        look: `drawing.LOOK`.
    """
    rows, columns = about
    first, wide = columns[0] * SUB, max(columns[1] - columns[0], 0)
    count, part = wide * SUB, np.float32(1.0 / SUB**2)
    shown, total = np.empty((SUB, 3, count), np.float32), np.empty(wide, np.float32)
    offs, shares = np.empty((2, count), np.float32), np.empty((3, count), np.float32)
    body, exact = np.empty(count, np.uint8), np.empty((2, count))
    for row in range(rows[0], rows[1]):
        for k in range(SUB):
            _cover_body(row * SUB + k, first, still, place, look, body)
            _cover_marks(row * SUB + k, first, still, place, look, (offs, exact, shares))
            _colour(row * SUB + k, first, still, look.colours, (body, shares), shown[k])
        into = picture[row - corner[0], columns[0] - corner[1] :]
        for colour in range(3):
            total[:] = 0.0
            for k in range(SUB):
                samples = shown[k, colour]
                for column in range(wide):
                    for sample in range(SUB):
                        total[column] += samples[column * SUB + sample]
            for column in range(wide):
                into[column, colour] = total[column] * part


@jit
def expose(picture: Any, light: Any, noise: Any, corner: Any, frame: Any) -> None:
    """What the camera makes of a picture: its lens takes light away, its pixels add noise.

    Args:
        picture: [rows, n] grey levels of a window, colours beside each other.
        light: of the whole picture, the share of each that is left.
        noise: of each, grey levels.
        corner: the window's first row and number in it.
        frame: [rows, n] into which it goes, rounded.
    """
    (top, left), wide = corner, frame.shape[1]
    for row in range(frame.shape[0]):
        shares, noises = light[top + row, left : left + wide], noise[top + row, left : left + wide]
        for k in range(wide):
            level = np.float32(picture[row, k]) * shares[k] + noises[k] + np.float32(0.5)
            frame[row, k] = np.uint8(min(max(level, np.float32(0.0)), np.float32(255.0)))
