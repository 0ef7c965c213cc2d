"""What stands around a robot on its way: the nearest surface and the nearest lamp."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.world.arena import Arena

__all__ = ["RADIUS_CM", "Around", "around", "fits"]

Floats = NDArray[np.float64]

RADIUS_CM, NEARLY_CM = 2.9, 0.25
"""A Khepera's (§3.1), as the scale's exemplars have. A body that is nearly so wide is described with theirs:
four times the difference can just be noticed, and scores stay comparable with all that were kept."""
OUTSIDE_CM = 1.0
"""How far a track's centre may seem to be inside something: a camera's error."""


class Around(NamedTuple):
    """Arrays [n] of one trial; angles relative to the heading, rad, counter-clockwise."""

    clearance: Floats
    """From the body's edge to the nearest surface, cm."""
    surface: Floats
    """Where that surface is."""
    lamp_distance: Floats | None
    """To the nearest lamp's centre, cm; None in a room without one."""
    lamp: Floats | None
    """Where the lamp is."""


def around(arena: Arena, x: Floats, y: Floats, heading: Floats, radius_cm: Floats | float) -> Around:
    """What stands around a robot at places x, y [n] (cm) that looks along `heading` (rad).

    Args:
        arena: where it is.
        x, y, heading: its poses.
        radius_cm: its body's, one or [n].
    """
    dx, dy, gap = _nearest_surface(arena, x, y)
    clearance = gap - _told(radius_cm)
    lamps = [(lamp.x_cm, lamp.y_cm) for lamp in arena.lamps]
    surface = _turned(np.arctan2(dy, dx) - heading)
    if not lamps:
        return Around(clearance, surface, None, None)
    to = np.array([[lx - x, ly - y] for lx, ly in lamps])
    far = np.hypot(to[:, 0], to[:, 1])
    near = far.argmin(axis=0)
    n = np.arange(len(x))
    bearing = np.arctan2(to[near, 1, n], to[near, 0, n]) - heading
    return Around(clearance, surface, far[near, n], _turned(bearing))


def fits(arena: Arena, x: Floats, y: Floats, radius_cm: float) -> bool:
    """Whether a robot whose body is so wide could have been at all these places."""
    return bool((_nearest_surface(arena, x, y)[2] > _told(radius_cm) - OUTSIDE_CM).all())


def _told(radius_cm: Floats | float) -> Floats:
    return np.where(np.abs(np.asarray(radius_cm) - RADIUS_CM) <= NEARLY_CM, RADIUS_CM, radius_cm)


def _nearest_surface(arena: Arena, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Direction (dx, dy) and distance of the nearest surface from a centre; below 0 outside the room."""
    zero = np.zeros_like(x)
    width, depth = arena.size_cm
    found = [
        (zero - 1, zero, x), (zero + 1, zero, width - x),
        (zero, zero - 1, y), (zero, zero + 1, depth - y),
    ]  # fmt: skip
    for c in arena.cylinders:
        dx, dy = c.x_cm - x, c.y_cm - y
        found.append((dx, dy, np.hypot(dx, dy) - c.radius_cm))
    for x0, y0, x1, y1 in arena.walls:
        ex, ey = x1 - x0, y1 - y0
        share = np.clip(((x - x0) * ex + (y - y0) * ey) / (ex * ex + ey * ey), 0, 1)
        dx, dy = x0 + share * ex - x, y0 + share * ey - y
        found.append((dx, dy, np.hypot(dx, dy)))
    every = np.array(found)
    nearest = every[:, 2].argmin(axis=0)
    n = np.arange(len(x))
    return every[nearest, 0, n], every[nearest, 1, n], every[nearest, 2, n]


def _turned(angle: Floats) -> Floats:
    return (angle + np.pi) % (2 * np.pi) - np.pi
