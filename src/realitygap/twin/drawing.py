"""An overhead view without a renderer: drawn through the same camera and lens as the other.

Each pixel's ray is followed down: walls and cylinders once for the whole film, the robot in each frame,
where it is in the picture.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.arena import WALL_HALF
from realitygap.twin.lens import HEIGHT, WIDTH, Lens
from realitygap.twin.model import BODY_RADIUS, BODY_TOP, WALL_HEIGHT

__all__ = [
    "DISK_HEIGHT", "DISK_RADIUS", "FRONT_AHEAD", "FRONT_RADIUS", "MIDDLE_RADIUS", "WHOLE",
    "Drawing", "Window",
]  # fmt: skip

Array = NDArray[np.float32]
Circle = tuple[float, float, float, float]
"""x, y, height and radius (m)."""
Window = tuple[slice, slice]
"""Rows and columns of a picture."""
WHOLE = (slice(0, HEIGHT), slice(0, WIDTH))

DISK_RADIUS, MIDDLE_RADIUS, FRONT_RADIUS, FRONT_AHEAD = 0.0275, 0.007, 0.0045, 0.0195
"""The disk on the robot's back: black, with a white patch in the middle and another ahead (issue 3)."""
DISK_HEIGHT = 0.0305
"""On top of the robot: half a millimetre of card above its body (m)."""

SUB = 2  # samples along a pixel's side
FLOOR = np.array([199, 196, 189], np.float32)
WALL = np.array([237, 235, 230], np.float32)
OUTSIDE = np.array([120, 118, 115], np.float32)
LAMP = np.array([255, 255, 205], np.float32)
BODY = np.array([52, 56, 52], np.float32)
BLACK = np.array([14, 14, 15], np.float32)
WHITE = np.array([243, 243, 241], np.float32)
LAYERS = 5
SIDES = [0.003 + (BODY_TOP - 0.003) * layer / (LAYERS - 1) for layer in range(LAYERS)]
"""Heights at which the body's side is drawn (m)."""
SPREAD, EDGE = 1.05, 2
"""A circle's box in the picture: its radius over the middle of the floor, with this factor for what is
higher or nearer and so many pixels more."""


class Drawing:
    """Draws frames [480, 640, 3] of one arena through one lens."""

    def __init__(self, arena: Mapping[str, Any], lens: Lens) -> None:
        step = (np.arange(SUB) + 0.5) / SUB - 0.5
        columns = (np.arange(WIDTH)[:, None] + step).ravel()
        rows = (np.arange(HEIGHT)[:, None] + step).ravel()
        grid = np.meshgrid(columns, rows)
        floor, slope = lens.floor(*grid)
        # [2, ...]: x and y apart, each in one piece
        self._floor = np.moveaxis(floor, -1, 0).astype(np.float32, order="C")
        self._slope = np.moveaxis(slope, -1, 0).astype(np.float32, order="C")
        self._lens = lens
        self._samples = SUB * lens.focal / lens.position[2]  # a metre
        self._fine = np.moveaxis(self._still(arena), -1, 0).copy()  # [3, ...] one colour after another
        self.background = np.moveaxis(self._coarse(self._fine), 0, -1).copy()

    @staticmethod
    def _coarse(fine: Array) -> Array:
        """[3, ...] each pixel the mean of its samples."""
        total = fine[:, ::SUB, ::SUB].copy()
        for k in range(1, SUB * SUB):
            total += fine[:, k // SUB :: SUB, k % SUB :: SUB]
        return np.asarray(total * np.float32(1.0 / SUB**2))

    def _at(self, z: float, window: Window = (slice(None), slice(None))) -> Array:
        """[2, ...] x and y of the samples' rays at a height (m)."""
        part = (slice(None), *window)
        there = self._slope[part] * np.float32(z)
        there += self._floor[part]
        return np.asarray(there)

    def _still(self, arena: Mapping[str, Any]) -> Array:
        """What does not move, from the floor up."""
        w, h = (v / 100.0 for v in arena["size_cm"])
        picture = np.broadcast_to(FLOOR, (*self._floor.shape[1:], 3)).copy()
        off_x, off_y = self._floor[0] - np.float64(w / 2), self._floor[1] - np.float64(h / 2)
        light = 1.0 - 0.10 * (off_x**2 + off_y**2) / (w * w + h * h) * 4
        picture *= light[..., None].astype(np.float32)
        self._over = np.zeros(picture.shape[:2], np.bool_)
        for layer in range(LAYERS + 1):
            z = WALL_HEIGHT * layer / LAYERS
            x, y = self._at(z)
            shade = np.float32(0.72 if layer < LAYERS else 1.0)
            stands = np.zeros(x.shape, np.bool_)
            for cx, cy, r in np.array(arena["cylinders"]).reshape(-1, 3) / 100.0:
                stands |= np.hypot(x - cx, y - cy) < r
            for x0, y0, x1, y1 in np.array(arena["walls"]).reshape(-1, 4) / 100.0:
                length = np.hypot(x1 - x0, y1 - y0)
                along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length
                off = ((y - y0) * (x1 - x0) - (x - x0) * (y1 - y0)) / length
                stands |= (along > -WALL_HALF) & (along < length + WALL_HALF) & (np.abs(off) < WALL_HALF)
            picture[stands] = WALL * shade
            if z > DISK_HEIGHT:
                self._over |= stands
            out = np.maximum(np.abs(x - w / 2) - w / 2, np.abs(y - h / 2) - h / 2)
            picture[(out > 0) & (out < 0.01)] = WALL * shade
        picture[out >= 0.01] = OUTSIDE
        for cx, cy in np.array(arena["lamps"]).reshape(-1, 2) / 100.0:
            x, y = self._at(0.05)
            picture[np.hypot(x - cx, y - cy) < 0.008] = LAMP
        return picture

    def _boxes(self, circles: Sequence[Circle]) -> NDArray[np.int64]:
        """[n, 4] pixels top, bottom, left, right of what shows circles; not all in the picture."""
        middles = np.rint(self._lens.pixels(np.array([circle[:3] for circle in circles]))).astype(np.int64)
        reach = [math.ceil(SPREAD * self._samples / SUB * circle[3]) + EDGE for circle in circles]
        ends = middles[:, 1::-1, None] + np.array(reach)[:, None, None] * np.array([-1, 1])
        return np.asarray(np.clip(ends, 0, [[HEIGHT], [WIDTH]]).reshape(-1, 4), np.int64)

    def _paint(self, fine: Array, window: Window, circle: Circle, colour: Array) -> None:
        """A circle, its edge as soft as a sample is wide."""
        inside = np.clip((circle[3] - self._off(circle, window)) * self._samples + 0.5, 0.0, 1.0)
        fine += (colour[:, None, None] - fine) * inside.astype(np.float32)

    def _inside(self, circle: Circle, window: Window) -> NDArray[np.bool_]:
        """Whether samples lie in a circle: squares tell, but for those on its very edge."""
        x, y, z, radius = circle
        there = self._at(z, window)
        there[0] -= x
        there[1] -= y
        square = np.square(there).sum(axis=0)
        square -= radius * radius
        inside = square < 0.0
        doubtful = np.abs(square, out=square) < 1e-5 * radius * radius
        if doubtful.any():
            inside[doubtful] = np.hypot(there[0][doubtful], there[1][doubtful]) < radius
        return np.asarray(inside)

    def _off(self, circle: Circle, window: Window) -> Array:
        """How far samples are from a circle's middle: to the last bit near its edge, where it matters."""
        there = self._at(circle[2], window)
        x, y = there[0] - circle[0], there[1] - circle[1]
        off = x * x
        off += y * y
        np.sqrt(off, out=off)
        near = off - circle[3]
        edge = (np.abs(near, out=near) < 1.0 / self._samples).nonzero()
        off[edge] = np.hypot(x[edge], y[edge])
        return np.asarray(off)

    def frame(self, x: float, y: float, heading: float, window: Window = WHOLE) -> Array:
        """The picture with the robot at x, y (m): grey levels as floats, without the camera's noise.

        Returns:
            [rows, columns, 3] of the window.
        """
        picture = self.background[window].copy()
        robot, whole = self._robot(x, y, heading)
        both = tuple(
            slice(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(window, whole, strict=True)
        )
        if all(part.start < part.stop for part in both):
            picture[_within(both, window)] = np.moveaxis(robot[:, *_within(both, whole)], 0, -1)
        return picture

    def _robot(self, x: float, y: float, heading: float) -> tuple[Array, Window]:
        """[3, rows, columns] the window of the picture that shows the robot, and where it is."""
        ahead_x, ahead_y = x + FRONT_AHEAD * np.cos(heading), y + FRONT_AHEAD * np.sin(heading)
        sides = [(x, y, z, BODY_RADIUS) for z in SIDES]  # the body's side, as far as the camera sees it
        marks = [(x, y, DISK_HEIGHT, DISK_RADIUS), (x, y, DISK_HEIGHT, MIDDLE_RADIUS),
                 (ahead_x, ahead_y, DISK_HEIGHT, FRONT_RADIUS)]  # fmt: skip
        boxes = self._boxes([*sides, *marks])
        top, left = boxes[:, ::2].min(axis=0).tolist()
        bottom, right = boxes[:, 1::2].max(axis=0).tolist()
        whole = _samples(top, bottom, left, right)
        fine, body = self._fine[:, *whole].copy(), np.zeros(self._over[whole].shape, np.bool_)
        parts = [_samples(*box) for box in boxes.tolist()]
        for part, side in zip(parts, sides, strict=False):
            body[_within(part, whole)] |= self._inside(side, part)
        np.copyto(fine, BODY[:, None, None], where=body)
        for part, mark, colour in zip(parts[LAYERS:], marks, (BLACK, WHITE, WHITE), strict=True):
            self._paint(fine[:, *_within(part, whole)], part, mark, colour)
        np.copyto(fine, self._fine[:, *whole], where=self._over[whole])
        return self._coarse(fine), (slice(top, bottom), slice(left, right))


def _samples(top: int, bottom: int, left: int, right: int) -> Window:
    """The samples of some pixels."""
    return slice(top * SUB, bottom * SUB), slice(left * SUB, right * SUB)


def _within(part: Sequence[slice], whole: Sequence[slice]) -> Window:
    """A window in the coordinates of one round it."""
    rows, columns = (slice(a.start - b.start, a.stop - b.start) for a, b in zip(part, whole, strict=True))
    return rows, columns
