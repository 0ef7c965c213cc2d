"""Rays against a room whose surfaces are matt: how far, and under which angle they meet them.

Beyond the paper, for calibrated robots: a matt surface throws back what falls on it by the cosine
of the angle to its normal (Lambert). As geometry.see, with that cosine kept beside 1/d; apart from
it, so that the paper's law pays nothing for it (a robot with matt surfaces is a fifth slower).
"""

import math

from realitygap.kernels.geometry import NARROW, TOUCHING
from realitygap.kernels.jit import step
from realitygap.kernels.params import RAYS


@step
def lean_on_room(arena, rays, k, px, py, c, s, ray_x, ray_y, inverse, slant):
    """As see_room; the cosine under which each ray meets its wall."""
    west = 1.0 / max(px, TOUCHING)
    south = 1.0 / max(py, TOUCHING)
    east = 1.0 / max(arena.size[0] - px, TOUCHING)
    north = 1.0 / max(arena.size[1] - py, TOUCHING)
    for i in range(inverse.shape[0]):
        x = c * rays[k, 0, i] - s * rays[k, 1, i]
        y = s * rays[k, 0, i] + c * rays[k, 1, i]
        ray_x[i] = x
        ray_y[i] = y
        across = max(x * east, -x * west)
        along = max(y * north, -y * south)
        inverse[i] = max(across, along)
        slant[i] = abs(x) if across >= along else abs(y)


@step
def lean_on_cylinder(qx, qy, radius, ray_x, ray_y, inverse, slant):
    """As see_cylinder; the half chord over the radius is the cosine to the normal."""
    square = qx * qx + qy * qy
    k = max(square - radius * radius, TOUCHING * TOUCHING)
    inverse_k = 1.0 / k
    inverse_radius = 1.0 / radius
    if radius * radius < NARROW * square:
        leftward = ray_x[RAYS] * qy - ray_y[RAYS] * qx
        a = 2 if leftward > 0.0 else 0
        b = a + 8
        ray_x, ray_y, inverse, slant = ray_x[a:b], ray_y[a:b], inverse[a:b], slant[a:b]
    for i in range(inverse.shape[0]):
        t = qx * ray_x[i] + qy * ray_y[i]
        under = t * t - k
        half = math.sqrt(max(under, 0.0))
        met = (t + half) * inverse_k
        met = met if under > 0.0 else 0.0
        met = met if t > 0.0 else 0.0
        slant[i] = min(half * inverse_radius, 1.0) if met > inverse[i] else slant[i]
        inverse[i] = max(inverse[i], met)


@step
def lean_on_segments(arena, px, py, ray_x, ray_y, inverse, slant):
    """As see_segments; the cosine under which each ray meets an inner wall."""
    for j in range(arena.segments.shape[0]):
        ax = arena.segments[j, 0] - px
        ay = arena.segments[j, 1] - py
        bx = arena.segments[j, 2] - px
        by = arena.segments[j, 3] - py
        area = ax * by - ay * bx
        sign = 1.0 if area >= 0.0 else -1.0
        length = math.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay))
        inverse_area = 1.0 / (sign * max(abs(area), TOUCHING * length))
        inverse_length = 1.0 / max(length, TOUCHING)
        for i in range(ray_x.shape[0]):
            from_a = (ax * ray_y[i] - ay * ray_x[i]) * sign
            to_b = (ray_x[i] * by - ray_y[i] * bx) * sign
            through = ray_x[i] * (by - ay) - ray_y[i] * (bx - ax)
            met = through * inverse_area
            met = met if from_a >= 0.0 else 0.0
            met = met if to_b >= 0.0 else 0.0
            slant[i] = abs(through) * inverse_length if met > inverse[i] else slant[i]
            inverse[i] = max(inverse[i], met)


@step
def lean(arena, rays, k, px, py, c, s, ray_x, ray_y, inverse, slant):
    """1/d from (px, py) to whatever is nearest along each ray of sensor `k`, and the cosine of the
    angle between the ray and the normal there."""
    lean_on_room(arena, rays, k, px, py, c, s, ray_x, ray_y, inverse, slant)
    for j in range(arena.cylinders.shape[0]):
        qx = arena.cylinders[j, 0] - px
        qy = arena.cylinders[j, 1] - py
        radius = arena.cylinders[j, 2]
        if qx * ray_x[RAYS] + qy * ray_y[RAYS] > -radius:
            lean_on_cylinder(qx, qy, radius, ray_x, ray_y, inverse, slant)
    lean_on_segments(arena, px, py, ray_x, ray_y, inverse, slant)
