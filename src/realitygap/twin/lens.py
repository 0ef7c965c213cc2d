"""The lens of the camera above the twin, where it hangs, and the disk that it looks at."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.unit import Unit

__all__ = [
    "DISK_HEIGHT", "DISK_RADIUS", "FRONT_AHEAD", "FRONT_RADIUS", "HEIGHT", "MIDDLE_RADIUS", "WIDTH", "Lens",
    "hang_camera",
]  # fmt: skip

Array = NDArray[np.float64]

DISK_RADIUS, MIDDLE_RADIUS, FRONT_RADIUS, FRONT_AHEAD = 0.0275, 0.007, 0.0045, 0.0195
"""The disk on the robot's back: black, with a white patch in the middle and another ahead (issue 3)."""
DISK_HEIGHT = 0.0305
"""On top of the robot: half a millimetre of card above its body (m)."""
WIDTH, HEIGHT = 640, 480
MARGIN = 1.085
"""The picture shows 8.5 % more than the floor."""
ABOVE = 1.9
"""The camera hangs 1.9 times the floor's longer side above it, at least `LOWEST` (m)."""
LOWEST = 1.2


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A pinhole with two radial terms. World in metres; pixel centres are whole numbers.

    Attributes:
        position: [3] of the pinhole (m).
        rotation: [3, 3] camera to world; the camera looks along its −z, y is up in the picture.
        focal: pixels.
        k1, k2: radial terms on coordinates divided by the focal length.
    """

    position: Array
    rotation: Array
    focal: float
    k1: float
    k2: float

    def pixels(self, points: Array) -> Array:
        """[..., 2] column and row of world points [..., 3] (m)."""
        q = (points - self.position) @ self.rotation
        x, y = q[..., 0] / -q[..., 2], q[..., 1] / -q[..., 2]
        r2 = x * x + y * y
        bend = self.focal * (1.0 + self.k1 * r2 + self.k2 * r2 * r2)
        return np.stack([(WIDTH - 1) / 2 + x * bend, (HEIGHT - 1) / 2 - y * bend], axis=-1)

    def straightened(self, columns: Array, rows: Array) -> tuple[Array, Array]:
        """x right and y up of pixels as a pinhole of focal length 1 would see them."""
        bent_x = (columns - (WIDTH - 1) / 2) / self.focal
        bent_y = ((HEIGHT - 1) / 2 - rows) / self.focal
        x, y = bent_x, bent_y
        for _ in range(12):  # a contraction: the terms are small
            r2 = x * x + y * y
            bend = 1.0 + self.k1 * r2 + self.k2 * r2 * r2
            x, y = bent_x / bend, bent_y / bend
        return x, y

    def floor(self, columns: Array, rows: Array) -> tuple[Array, Array]:
        """Where the pixels' rays meet the floor, and how far they move a metre above it.

        Returns:
            [..., 2] x, y on the floor (m) and [..., 2] their change for each metre of height.
        """
        x, y = self.straightened(columns, rows)
        ray = np.stack([x, y, -np.ones_like(x)], axis=-1) @ self.rotation.T
        slope = ray[..., :2] / ray[..., 2:]
        return self.position[:2] - self.position[2] * slope, slope


def _turn(axis: int, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    out = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[i, i], out[i, j], out[j, i], out[j, j] = c, -s, s, c
    return out


def hang_camera(arena: Mapping[str, Any], unit: Unit) -> Lens:
    """The camera of this unit's room above this arena."""
    w, h = (v / 100.0 for v in arena["size_cm"])
    hung = unit.camera
    nominal = max(LOWEST, ABOVE * max(w, h))
    height = nominal * hung.height_share
    focal = min(WIDTH / (w * MARGIN), HEIGHT / (h * MARGIN)) * nominal
    rotation = _turn(0, hung.tilt[0]) @ _turn(1, hung.tilt[1]) @ _turn(2, hung.roll)
    # somebody looked at the picture and pushed the camera until the floor was about in its middle
    straight_down = height * rotation[:2, 2] / rotation[2, 2]
    off = min(w, h) * np.array(hung.offset_share)
    position = np.array([w / 2 + off[0], h / 2 + off[1], height])
    position[:2] += straight_down
    return Lens(position=position, rotation=rotation, focal=focal, k1=hung.k1, k2=hung.k2)
