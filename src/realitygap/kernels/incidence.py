"""Under which angle rays meet the surfaces where they end: for walls that are matt (Lambert).

Beyond the paper, for calibrated robots: a matt surface throws back what falls on it by the cosine
of the angle to its normal.
"""

import math

from realitygap.kernels.geometry import GRAZE, from_segment
from realitygap.kernels.jit import step
from realitygap.kernels.params import LANES


@step
def find_normals(arena, a, b, work):
    """The surfaces' normals, towards the robot's side, where the rays from lane `a` to `b` end: of whatever
    is nearest there."""
    end_x, end_y, near = work.end_x[a:b], work.end_y[a:b], work.hidden[a:b]
    normal_x, normal_y = work.normal_x[a:b], work.normal_y[a:b]
    width, depth = arena.size[0], arena.size[1]
    for i in range(b - a):
        ex, ey = end_x[i], end_y[i]
        aside, along = min(ex, width - ex), min(ey, depth - ey)
        near[i] = min(aside, along)
        across = aside <= along
        sign_x = 1.0 if 2.0 * ex <= width else -1.0
        sign_y = 1.0 if 2.0 * ey <= depth else -1.0
        normal_x[i] = sign_x if across else 0.0
        normal_y[i] = 0.0 if across else sign_y
    for j in range(arena.cylinders.shape[0]):
        for i in range(b - a):
            dx = end_x[i] - arena.cylinders[j, 0]
            dy = end_y[i] - arena.cylinders[j, 1]
            d = math.sqrt(dx * dx + dy * dy)
            gap = abs(d - arena.cylinders[j, 2])
            if gap < near[i]:
                near[i] = gap
                normal_x[i] = dx / max(d, 1e-12)
                normal_y[i] = dy / max(d, 1e-12)
    lean_on_segments(arena, a, b, work)


@step
def lean_on_segments(arena, a, b, work):
    """Of the rays from lane `a` to `b` those that end on an inner wall: its normal."""
    end_x, end_y, near = work.end_x[a:b], work.end_y[a:b], work.hidden[a:b]
    ray_x, ray_y = work.ray_x[a:b], work.ray_y[a:b]
    normal_x, normal_y = work.normal_x[a:b], work.normal_y[a:b]
    for j in range(arena.segments.shape[0]):
        ax = arena.segments[j, 2] - arena.segments[j, 0]
        ay = arena.segments[j, 3] - arena.segments[j, 1]
        length = max(math.sqrt(ax * ax + ay * ay), 1e-12)
        for i in range(b - a):
            dx, dy = from_segment(arena, j, end_x[i], end_y[i])
            d = math.sqrt(dx * dx + dy * dy)
            if d < near[i]:
                near[i] = d
                side = -1.0 if ay * ray_x[i] - ax * ray_y[i] > 0.0 else 1.0
                normal_x[i] = side * ay / length
                normal_y[i] = -side * ax / length


@step
def lean_on_surfaces(arena, px, py, work):
    """The cosine of the angle under which each ray from (px, py) meets what is nearest, into work.slant."""
    ray_x, ray_y, inverse = work.ray_x[:LANES], work.ray_y[:LANES], work.inverse[:LANES]
    end_x, end_y, slant = work.end_x[:LANES], work.end_y[:LANES], work.slant[:LANES]
    normal_x, normal_y = work.normal_x[:LANES], work.normal_y[:LANES]
    for i in range(LANES):
        d = (1.0 - GRAZE) / inverse[i]
        end_x[i] = px + ray_x[i] * d
        end_y[i] = py + ray_y[i] * d
    find_normals(arena, 0, LANES, work)
    for i in range(LANES):
        slant[i] = max(-(ray_x[i] * normal_x[i] + ray_y[i] * normal_y[i]), 0.0)
