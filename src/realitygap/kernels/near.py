"""What is near a position in the room: its grid cell, distances of obstacles, whether it is clear."""

import math

import numpy as np

from realitygap.compiled import step

SPARE = 1e-6
"""Safety margin of far-off tests, cm, against rounding."""


@step
def cell_at(arena, x, y):
    """The cell of a position; for one outside the room that of the nearest position inside."""
    if arena.cylinder_gap.shape[0] == 1:
        return np.uint64(0)
    i = min(max(int(x * arena.cells_per_cm[0]), 0), arena.grid[0] - 1)
    j = min(max(int(y * arena.cells_per_cm[1]), 0), arena.grid[1] - 1)
    return np.uint64(i * arena.grid[1] + j)


@step
def stands_clear(arena, x, y, radius):
    """True if a disc at (x, y) overlaps nothing (less than 1e-9 cm)."""
    clear = radius - 1e-9
    if x < clear or y < clear or arena.size[0] - x < clear or arena.size[1] - y < clear:
        return False
    cell = cell_at(arena, x, y)
    for n in range(arena.cylinders.shape[0]):
        if arena.cylinder_gap[cell, n] > radius:
            break
        j = arena.near_cylinders[cell, n]
        dx = x - arena.cylinders[j, 0]
        dy = y - arena.cylinders[j, 1]
        reach = clear + arena.cylinders[j, 2]
        if dx * dx + dy * dy < reach * reach:
            return False
    for n in range(arena.segments.shape[0]):
        if arena.segment_gap[cell, n] > radius:
            break
        j = arena.near_segments[cell, n]
        if not is_beyond(arena, j, x, y, clear):
            dx, dy = from_segment(arena, j, x, y)
            if dx * dx + dy * dy < clear * clear:
                return False
    return True


@step
def is_beyond(arena, j, x, y, reach):
    """Whether inner wall `j` is farther than `reach` from (x, y), without a division: tested on its bounding
    rectangle, so a yes is always right."""
    ex, ey = x - arena.segments[j, 0], y - arena.segments[j, 1]
    ux, uy = arena.segment_along[j, 0], arena.segment_along[j, 1]
    along = ex * ux + ey * uy
    far = reach + SPARE
    return abs(ex * uy - ey * ux) > far or along < -far or along > arena.segment_along[j, 2] + far


@step
def from_segment(arena, j, x, y):
    """The vector from the nearest point of inner wall `j` to (x, y)."""
    ax = arena.segments[j, 0]
    ay = arena.segments[j, 1]
    ex = arena.segments[j, 2] - ax
    ey = arena.segments[j, 3] - ay
    share = ((x - ax) * ex + (y - ay) * ey) / max(ex * ex + ey * ey, 1e-30)
    share = min(max(share, 0.0), 1.0)
    return x - (ax + share * ex), y - (ay + share * ey)


@step
def unit(x, y):
    """(x, y) scaled to length 1, and its length; (1, 0) where it has none."""
    length = math.sqrt(x * x + y * y)
    if length < 1e-12:
        return 1.0, 0.0, np.float64(0.0)
    return x / length, y / length, length
