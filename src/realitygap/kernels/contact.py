"""Contact: the disc is moved out of what it overlaps; friction holds back its sliding."""

import math

from realitygap.kernels.geometry import from_segment, stands_clear, unit
from realitygap.kernels.jit import step

ROUNDS = 12
"""Times that all surfaces are gone through: corners need two or three."""


@step
def push(x, y, dx, dy, nx, ny, depth, sliding):
    """The place and movement after one surface (normal n) has pushed the disc out by `depth`.

    Coulomb: the surface holds back up to `sliding` · depth of the movement along itself.
    """
    along = dy * nx - dx * ny
    held = min(abs(along), sliding * depth)
    held = held if along >= 0.0 else -held
    px = nx * depth + ny * held
    py = ny * depth - nx * held
    return x + px, y + py, dx + px, dy + py


@step
def settle_once(arena, radius, x, y, dx, dy):
    """Where a disc ends that moves from the clear place (x, y) by (dx, dy): (x, y, touched).

    Where no place near is clear (a wedge) it stays: a robot never enters a wall or cylinder.
    The movement must be shorter than the radius, or it could end behind an inner wall.
    """
    to_x = x + dx
    to_y = y + dy
    if stands_clear(arena, to_x, to_y, radius):
        return to_x, to_y, False
    slip = arena.sliding
    for _ in range(ROUNDS):
        if to_x < radius:
            to_x, to_y, dx, dy = push(to_x, to_y, dx, dy, 1.0, 0.0, radius - to_x, slip)
        if to_y < radius:
            to_x, to_y, dx, dy = push(to_x, to_y, dx, dy, 0.0, 1.0, radius - to_y, slip)
        over = to_x - (arena.size[0] - radius)
        if over > 0.0:
            to_x, to_y, dx, dy = push(to_x, to_y, dx, dy, -1.0, 0.0, over, slip)
        over = to_y - (arena.size[1] - radius)
        if over > 0.0:
            to_x, to_y, dx, dy = push(to_x, to_y, dx, dy, 0.0, -1.0, over, slip)
        for j in range(arena.cylinders.shape[0]):
            vx = to_x - arena.cylinders[j, 0]
            vy = to_y - arena.cylinders[j, 1]
            apart = radius + arena.cylinders[j, 2]
            if vx * vx + vy * vy < apart * apart:
                nx, ny, gap = unit(vx, vy)
                depth = apart - gap
                to_x, to_y, dx, dy = push(to_x, to_y, dx, dy, nx, ny, depth, slip)
        for j in range(arena.segments.shape[0]):
            vx, vy = from_segment(arena, j, to_x, to_y)
            nx, ny, gap = unit(vx, vy)
            if gap < radius:
                to_x, to_y, dx, dy = push(to_x, to_y, dx, dy, nx, ny, radius - gap, slip)
        if stands_clear(arena, to_x, to_y, radius):
            return to_x, to_y, True
    return x, y, True


@step
def settle(arena, radius, x, y, dx, dy):
    """The same for a movement of any length, in pieces of at most half a radius."""
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
def ground_speeds(dx, dy, turn, share, cos_mean, sin_mean, track, dt):
    """Speeds of the two wheels over the ground (cm/s), from the body's movement after contact."""
    forward = (dx * cos_mean + dy * sin_mean) / (share * dt)
    apart = 0.5 * turn * track / dt
    return forward - apart, forward + apart
