"""The drawn view, slow and obvious: every sample of a generous square about the robot, in plain steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.drawing import (
    BLACK,
    BODY,
    DISK_HEIGHT,
    DISK_RADIUS,
    FRONT_AHEAD,
    FRONT_RADIUS,
    LAYERS,
    MIDDLE_RADIUS,
    SUB,
    WHITE,
    Drawing,
)
from realitygap.twin.lens import HEIGHT, WIDTH, Lens
from realitygap.twin.model import BODY_RADIUS, BODY_TOP

Array = NDArray[np.float32]


def slow_frame(drawing: Drawing, lens: Lens, x: float, y: float, heading: float) -> Array:
    """[480, 640, 3] as `Drawing.frame`."""
    background = np.moveaxis(drawing._fine, 0, -1)
    fine = background.copy()
    centre = lens.pixels(np.array([x, y, DISK_HEIGHT / 2]))
    reach = int(lens.focal / lens.position[2] * (DISK_RADIUS + 0.012)) + 4
    left, right = max(int(centre[0]) - reach, 0), min(int(centre[0]) + reach + 1, WIDTH)
    top, bottom = max(int(centre[1]) - reach, 0), min(int(centre[1]) + reach + 1, HEIGHT)
    if left < right and top < bottom:
        part = (slice(top * SUB, bottom * SUB), slice(left * SUB, right * SUB))
        floor, slope = (a[:, *part] for a in (drawing._floor, drawing._slope))
        for layer in range(LAYERS):
            z = np.float32(0.003 + (BODY_TOP - 0.003) * layer / (LAYERS - 1))
            px, py = floor + z * slope
            fine[part][np.hypot(px - x, py - y) < BODY_RADIUS] = BODY
        ahead = x + FRONT_AHEAD * np.cos(heading), y + FRONT_AHEAD * np.sin(heading)
        px, py = floor + np.float32(DISK_HEIGHT) * slope
        for (cx, cy), radius, colour in (
            ((x, y), DISK_RADIUS, BLACK),
            ((x, y), MIDDLE_RADIUS, WHITE),
            (ahead, FRONT_RADIUS, WHITE),
        ):
            off = np.hypot(px - cx, py - cy)
            inside = np.clip((radius - off) * SUB * lens.focal / lens.position[2] + 0.5, 0.0, 1.0)
            fine[part] += (colour - fine[part]) * inside[..., None].astype(np.float32)
        over = drawing._over[part]
        fine[part][over] = background[part][over]
    pixels = fine.reshape(HEIGHT, SUB, WIDTH, SUB, 3)
    return np.asarray(pixels.mean(axis=(1, 3), dtype=np.float32))
