"""An overhead view without a renderer: drawn through the same camera and lens as the other.

Each pixel's ray is followed down: walls and cylinders once for the whole film, the robot in each frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.arena import WALL_HALF
from realitygap.twin.lens import HEIGHT, WIDTH, Lens
from realitygap.twin.model import BODY_RADIUS, BODY_TOP, WALL_HEIGHT

__all__ = [
    "DISK_HEIGHT", "DISK_RADIUS", "FRONT_AHEAD", "FRONT_RADIUS", "MIDDLE_RADIUS", "Drawing",
]  # fmt: skip

Array = NDArray[np.float32]

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


class Drawing:
    """Draws frames [480, 640, 3] of one arena through one lens."""

    def __init__(self, arena: Mapping[str, Any], lens: Lens) -> None:
        step = (np.arange(SUB) + 0.5) / SUB - 0.5
        columns = (np.arange(WIDTH)[:, None] + step).ravel()
        rows = (np.arange(HEIGHT)[:, None] + step).ravel()
        grid = np.meshgrid(columns, rows)
        floor, slope = lens.floor(*grid)
        self._floor, self._slope = floor.astype(np.float32), slope.astype(np.float32)
        self._lens = lens
        self._samples = SUB * lens.focal / lens.position[2]  # a metre
        self._fine = self._still(arena)
        self.background = self._coarse(self._fine)

    @staticmethod
    def _coarse(fine: Array) -> Array:
        h, w = fine.shape[0] // SUB, fine.shape[1] // SUB
        return np.asarray(fine.reshape(h, SUB, w, SUB, 3).mean(axis=(1, 3), dtype=np.float32))

    def _at(self, z: float, window: tuple[slice, slice] = (slice(None), slice(None))) -> Array:
        return np.asarray(self._floor[window] + np.float32(z) * self._slope[window])

    def _still(self, arena: Mapping[str, Any]) -> Array:
        """What does not move, from the floor up."""
        w, h = (v / 100.0 for v in arena["size_cm"])
        picture = np.broadcast_to(FLOOR, (*self._floor.shape[:2], 3)).copy()
        light = 1.0 - 0.10 * ((self._floor - [w / 2, h / 2]) ** 2).sum(-1) / (w * w + h * h) * 4
        picture *= light[..., None].astype(np.float32)
        self._over = np.zeros(picture.shape[:2], np.bool_)
        for layer in range(LAYERS + 1):
            z = WALL_HEIGHT * layer / LAYERS
            p = self._at(z)
            x, y = p[..., 0], p[..., 1]
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
            p = self._at(0.05)
            picture[np.hypot(p[..., 0] - cx, p[..., 1] - cy) < 0.008] = LAMP
        return picture

    def _paint(self, fine: Array, p: Array, circle: tuple[float, float, float], colour: Array) -> None:
        """A circle on the plane `p`, its edge as soft as a sample is wide."""
        off = np.hypot(p[..., 0] - circle[0], p[..., 1] - circle[1])
        inside = np.clip((circle[2] - off) * self._samples + 0.5, 0.0, 1.0)[..., None]
        fine += (colour - fine) * inside.astype(np.float32)

    def frame(self, x: float, y: float, heading: float) -> Array:
        """The picture with the robot at x, y (m): grey levels as floats, without the camera's noise."""
        centre = self._lens.pixels(np.array([x, y, DISK_HEIGHT / 2]))
        reach = int(self._lens.focal / self._lens.position[2] * (DISK_RADIUS + 0.012)) + 4
        left, right = max(int(centre[0]) - reach, 0), min(int(centre[0]) + reach + 1, WIDTH)
        top, bottom = max(int(centre[1]) - reach, 0), min(int(centre[1]) + reach + 1, HEIGHT)
        picture = self.background.copy()
        if left >= right or top >= bottom:
            return picture
        window = (slice(top * SUB, bottom * SUB), slice(left * SUB, right * SUB))
        fine = self._fine[window].copy()
        for layer in range(LAYERS):  # the body's side, as far as the camera sees it
            p = self._at(0.003 + (BODY_TOP - 0.003) * layer / (LAYERS - 1), window)
            fine[np.hypot(p[..., 0] - x, p[..., 1] - y) < BODY_RADIUS] = BODY
        p = self._at(DISK_HEIGHT, window)
        ahead_x, ahead_y = x + FRONT_AHEAD * np.cos(heading), y + FRONT_AHEAD * np.sin(heading)
        self._paint(fine, p, (x, y, DISK_RADIUS), BLACK)
        self._paint(fine, p, (x, y, MIDDLE_RADIUS), WHITE)
        self._paint(fine, p, (ahead_x, ahead_y, FRONT_RADIUS), WHITE)
        over = self._over[window]
        fine[over] = self._fine[window][over]
        picture[top:bottom, left:right] = self._coarse(fine)
        return picture
