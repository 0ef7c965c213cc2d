"""Noise-free readings by a look-up table, one object at a time."""

from __future__ import annotations

import math

import numpy as np

from realitygap.world.arena import Arena
from realitygap.world.sensors import LookUp


def between(at, table: np.ndarray, distance: float, bearing: float) -> np.ndarray | None:
    """[P] what stands in a table [D, B, P] for an object at a distance and bearing (rad); None: it is farther
    off than anything recorded."""
    if distance > at[-1]:
        return None
    turns = np.arange(table.shape[1] + 1) * math.tau / table.shape[1]
    closed = np.concatenate([table, table[:, :1]], axis=1)
    return np.array(
        [
            np.interp(distance, at, [np.interp(bearing % math.tau, turns, ring) for ring in sensor])
            for sensor in np.moveaxis(closed, 2, 0)
        ]
    )


def objects(arena: Arena, x: float, y: float):
    """Of everything in the room: its kind, its own radius, and where its nearest point, or its middle, is."""
    width, depth = arena.size_cm
    yield from (("wall", 0.0, place) for place in ((width, y), (0.0, y), (x, depth), (x, 0.0)))
    for x0, y0, x1, y1 in arena.walls:
        along = np.array([x1 - x0, y1 - y0])
        share = np.clip((np.array([x - x0, y - y0]) @ along) / max(along @ along, 1e-30), 0.0, 1.0)
        yield "wall", 0.0, (x0 + share * along[0], y0 + share * along[1])
    yield from (("cylinder", c.radius_cm, (c.x_cm, c.y_cm)) for c in arena.cylinders)


def readings(table: LookUp, body_cm: float, top: float, arena: Arena, pose) -> np.ndarray:
    """[P] what all sensors read: of nothing, and what each object within reach adds to that."""
    x, y, heading = pose
    nothing = np.array(table.nothing)
    total = nothing.copy()
    for kind, radius, (ox, oy) in objects(arena, x, y):
        at, rows = getattr(table, f"{kind}_cm"), np.array(getattr(table, kind))
        distance = math.hypot(ox - x, oy - y) - radius - body_cm
        seen = between(
            at, rows.T.reshape(len(at), -1, len(rows)), distance, math.atan2(oy - y, ox - x) - heading
        )
        total += 0.0 if seen is None else seen - nothing
    return np.clip(total, 0.0, top)
