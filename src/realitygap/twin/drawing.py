"""An overhead view without a renderer: drawn through the same camera and lens as the other.

Each pixel's ray is followed down: walls and cylinders once for the whole film, the robot in each frame,
where it is in the picture.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.arena import WALL_HALF
from realitygap.twin.arithmetic import hypot, one_cos_sin
from realitygap.twin.lens import HEIGHT, WIDTH, Lens
from realitygap.twin.model import BODY_RADIUS, BODY_TOP, WALL_HEIGHT
from realitygap.twin.painting import SUB, Look, Still, paint_robot
from realitygap.twin.plate import Plate

__all__ = [
    "DISK_HEIGHT", "DISK_RADIUS", "FRONT_AHEAD", "FRONT_RADIUS", "MIDDLE_RADIUS", "WHOLE",
    "Drawing", "Window",
]  # fmt: skip

Array = NDArray[np.float32]
Window = tuple[slice, slice]
"""Rows and columns of a picture."""
WHOLE = (slice(0, HEIGHT), slice(0, WIDTH))

DISK_RADIUS, MIDDLE_RADIUS, FRONT_RADIUS, FRONT_AHEAD = 0.0275, 0.007, 0.0045, 0.0195
"""The disk on the robot's back: black, with a white patch in the middle and another ahead (issue 3)."""
DISK_HEIGHT = 0.0305
"""On top of the robot: half a millimetre of card above its body (m)."""

FLOOR = np.array([199, 196, 189], np.float32)
WALL = np.array([237, 235, 230], np.float32)
OUTSIDE = np.array([120, 118, 115], np.float32)
LAMP = np.array([255, 255, 205], np.float32)
BODY = np.array([52, 56, 52], np.float32)
BLACK = np.array([14, 14, 15], np.float32)
WHITE = np.array([243, 243, 241], np.float32)
LAYERS = 5
SIDES = [0.003 + (BODY_TOP - 0.003) * layer / (LAYERS - 1) for layer in range(LAYERS)]
"""Heights at which the body's side is drawn (m), as far as the camera sees it."""
LOOK = Look(
    np.array([*SIDES, DISK_HEIGHT], np.float32),
    (BODY_RADIUS, DISK_RADIUS, MIDDLE_RADIUS, FRONT_RADIUS),
    np.array([BODY, BLACK, WHITE, WHITE]),
)
SPREAD, EDGE = 1.05, 2
"""The robot's box in the picture: its radius over the middle of the floor, with this factor for what is
higher or nearer and so many pixels more."""


class Drawing:
    """Draws frames [480, 640, 3] of one arena through one lens; the robot may wear a plate, not the disk."""

    def __init__(self, arena: Mapping[str, Any], lens: Lens, plate: Plate | None = None) -> None:
        step = (np.arange(SUB) + 0.5) / SUB - 0.5
        columns = (np.arange(WIDTH)[:, None] + step).ravel()
        rows = (np.arange(HEIGHT)[:, None] + step).ravel()
        grid = np.meshgrid(columns, rows)
        floor, slope = lens.floor(*grid)
        # [2, ...]: x and y apart, each in one piece
        self._floor = np.moveaxis(floor, -1, 0).astype(np.float32, order="C")
        self._slope = np.moveaxis(slope, -1, 0).astype(np.float32, order="C")
        self._lens = lens
        self._samples = float(SUB * lens.focal / lens.position[2])  # a metre
        self._fine = np.moveaxis(self._still(arena), -1, 0).copy()  # [3, ...] one colour after another
        self._plate, self._look, self._reach, self._top = plate, LOOK, BODY_RADIUS, DISK_HEIGHT
        if plate is not None:
            self._soft = plate.softened(1 / self._samples)
            self._look = LOOK._replace(radii=(BODY_RADIUS, -1.0, -1.0, -1.0))  # there is no disk
            self._reach, self._top = max(BODY_RADIUS, plate.reach), max(DISK_HEIGHT, plate.height)
        self.background = np.moveaxis(self._coarse(self._fine), 0, -1).copy()

    @staticmethod
    def _coarse(fine: Array) -> Array:
        """[3, ...] each pixel the mean of its samples."""
        total = fine[:, ::SUB, ::SUB].copy()
        for k in range(1, SUB * SUB):
            total += fine[:, k // SUB :: SUB, k % SUB :: SUB]
        return np.asarray(total * np.float32(1.0 / SUB**2))

    def _at(self, z: float) -> Array:
        """[2, ...] x and y of the samples' rays at a height (m)."""
        return np.asarray(self._slope * np.float32(z) + self._floor)

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
                stands |= hypot(x - cx, y - cy) < r
            for x0, y0, x1, y1 in np.array(arena["walls"]).reshape(-1, 4) / 100.0:
                length = hypot(x1 - x0, y1 - y0)
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
            picture[hypot(x - cx, y - cy) < 0.008] = LAMP
        return picture

    def _about(self, x: float, y: float, window: Window) -> tuple[tuple[int, int], ...]:
        """Rows and columns (first, end) of a window in which the robot may be seen."""
        reach = math.ceil(SPREAD * self._samples / SUB * self._reach) + EDGE
        foot, top = (self._lens.pixel(x, y, z) for z in (SIDES[0], self._top))
        ends = zip(window, reversed(foot), reversed(top), strict=True)
        return tuple(
            (max(side.start, round(min(a, b)) - reach), min(side.stop, round(max(a, b)) + reach))
            for side, a, b in ends
        )

    def frame(self, x: float, y: float, heading: float, window: Window = WHOLE) -> Array:
        """[rows, columns, 3] of a window of the picture: grey levels as floats, without the camera's noise.

        Args:
            x, y: of the robot, m.
            heading: of the robot, rad.
            window: which rows and columns of the picture.
        """
        picture = self.background[window].copy()
        c, s = one_cos_sin(heading)
        ahead = x + FRONT_AHEAD * c, y + FRONT_AHEAD * s
        corner = window[0].start, window[1].start
        still = Still(self._floor, self._slope, self._fine, self._over, self._samples)
        box = self._about(x, y, window)
        paint_robot(picture, corner, box, still, (x, y, *ahead), self._look)
        if self._plate is not None and all(low < high for low, high in box):
            self._lay(picture, corner, box, (x, y), (c, s))
        return picture

    def _lay(self, picture: Array, corner: Any, box: Any, place: Any, turn: tuple[float, float]) -> None:
        """The plate into a box (rows and columns) of a picture that begins at a corner."""
        assert self._plate is not None
        rows, columns = (slice(low * SUB, high * SUB) for low, high in box)
        at = self._slope[:, rows, columns] * np.float64(self._plate.height) + self._floor[:, rows, columns]
        shown = self._plate.shown(self._soft, at - np.reshape(place, (2, 1, 1)), turn)
        cover, white = self._coarse(shown * ~self._over[rows, columns])[..., None]
        part = picture[tuple(slice(low - k, high - k) for k, (low, high) in zip(corner, box, strict=True))]
        part += cover * (BLACK - part) + white * (WHITE - BLACK)
