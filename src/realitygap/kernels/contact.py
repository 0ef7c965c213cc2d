"""Contact: the disc is pushed out of what it overlaps; friction limits its sliding."""

import math
from typing import NamedTuple

from realitygap.compiled import step
from realitygap.kernels.near import from_segment, is_beyond, stands_clear, unit
from realitygap.kernels.params import STEP_S

ROUNDS = 12
"""Passes over all surfaces; corners need two or three."""


class Move(NamedTuple):
    """A position and the movement that led there, cm."""

    x: float
    y: float
    dx: float
    dy: float


@step
def push(to, nx, ny, depth, sliding):
    """A move after one surface (normal n) has pushed the disc out by `depth`.

    Coulomb friction: up to `sliding` · depth of the movement along the surface is held back.
    """
    along = to.dy * nx - to.dx * ny
    held = min(abs(along), sliding * depth)
    held = held if along >= 0.0 else -held
    px = nx * depth + ny * held
    py = ny * depth - nx * held
    return Move(to.x + px, to.y + py, to.dx + px, to.dy + py)


@step
def settle_once(arena, radius, x, y, dx, dy):
    """End of a disc's movement from a clear position (x, y) by (dx, dy): (x, y, touched).

    If no position near is clear (a wedge), it stays: a robot never enters a wall or cylinder.
    The movement must be shorter than the radius, or it could end behind an inner wall.
    """
    to = Move(x + dx, y + dy, dx, dy)
    if stands_clear(arena, to.x, to.y, radius):
        return to.x, to.y, False
    slip = arena.sliding
    for _ in range(ROUNDS):
        if to.x < radius:
            to = push(to, 1.0, 0.0, radius - to.x, slip)
        if to.y < radius:
            to = push(to, 0.0, 1.0, radius - to.y, slip)
        over = to.x - (arena.size[0] - radius)
        if over > 0.0:
            to = push(to, -1.0, 0.0, over, slip)
        over = to.y - (arena.size[1] - radius)
        if over > 0.0:
            to = push(to, 0.0, -1.0, over, slip)
        for j in range(arena.cylinders.shape[0]):
            vx = to.x - arena.cylinders[j, 0]
            vy = to.y - arena.cylinders[j, 1]
            apart = radius + arena.cylinders[j, 2]
            if vx * vx + vy * vy < apart * apart:
                nx, ny, gap = unit(vx, vy)
                to = push(to, nx, ny, apart - gap, slip)
        for j in range(arena.segments.shape[0]):
            if not is_beyond(arena, j, to.x, to.y, radius):
                vx, vy = from_segment(arena, j, to.x, to.y)
                nx, ny, gap = unit(vx, vy)
                if gap < radius:
                    to = push(to, nx, ny, radius - gap, slip)
        if stands_clear(arena, to.x, to.y, radius):
            return to.x, to.y, True
    return x, y, True


@step
def settle(arena, radius, x, y, dx, dy):
    """As settle_once for a movement of any length, in pieces of at most half a radius."""
    pieces = 1
    if dx * dx + dy * dy > 0.25 * radius * radius:
        pieces = int(math.sqrt(dx * dx + dy * dy) / (0.5 * radius)) + 1
        dx /= pieces
        dy /= pieces
    touched = False
    for _ in range(pieces):
        x, y, met = settle_once(arena, radius, x, y, dx, dy)
        touched = touched or met
    return x, y, touched


@step
def ground_speeds(dx, dy, arc, track, period=STEP_S):
    """Speeds of the two wheels over the ground (cm/s), from the body's movement after contact."""
    forward = (dx * arc.cos_mean + dy * arc.sin_mean) / (arc.share * period)
    apart = 0.5 * arc.turn * track / period
    return forward - apart, forward + apart
