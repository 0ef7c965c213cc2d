"""Rays in the room: nearest surfaces, without a division per ray.

A ray's result is 1/d, the reciprocal of the distance to the nearest surface: for a flat wall
it is (ray · normal) / h, for a circle (t + √(t² − k)) / k with k = |centre − place|² − r². The
reciprocals 1/h and 1/k are taken once a sensor.
"""

import math
from typing import NamedTuple

from realitygap.kernels.jit import step
from realitygap.kernels.near import SPARE, cell_at
from realitygap.kernels.params import RAYS, F

TOUCHING = 1e-3
"""Smallest distance that a sensor can see, cm: keeps 1/d finite for sensors on a surface."""
GRAZE = 1e-6
"""Share by which a ray's end is moved back before occlusion is tested: off its own wall."""


LOOK = 8
"""Number of obstacles tested before checking again whether farther ones can matter."""


class Spot(NamedTuple):
    """A sensor's position in the room, and the robot's heading."""

    x: float
    y: float
    cos: float
    sin: float


class Rays(NamedTuple):
    """The rays of one or more sensors, [n]: unit vectors, 1/d to what they meet, the cosine of incidence; and
    how narrow a cylinder must be to meet only one side of their fan."""

    x: F
    y: F
    inverse: F
    incidence: F
    narrow: float


class Walls(NamedTuple):
    """Reciprocals of a place's distances from the outer walls, 1/cm."""

    west: float
    south: float
    east: float
    north: float


@step
def walls_round(arena, spot):
    """The outer walls from a place."""
    west = 1.0 / max(spot.x, TOUCHING)
    south = 1.0 / max(spot.y, TOUCHING)
    east = 1.0 / max(arena.size[0] - spot.x, TOUCHING)
    north = 1.0 / max(arena.size[1] - spot.y, TOUCHING)
    return Walls(west, south, east, north)


@step
def turned(spot, x, y):
    """A direction of the robot's frame in the room's."""
    return spot.cos * x - spot.sin * y, spot.sin * x + spot.cos * y


@step
def meet_walls(walls, x, y):
    """1/d along (x, y) to the east or west wall, and to the north or south wall."""
    return max(x * walls.east, -x * walls.west), max(y * walls.north, -y * walls.south)


@step
def see_room(arena, fan_x, fan_y, spot, rays, incident):
    """Turn a sensor's rays into the room's frame, and set 1/d to the outer walls."""
    walls = walls_round(arena, spot)
    for i in range(rays.inverse.shape[0]):
        x, y = turned(spot, fan_x[i], fan_y[i])
        rays.x[i] = x
        rays.y[i] = y
        across, along = meet_walls(walls, x, y)
        rays.inverse[i] = max(across, along)
        if incident is not None:
            rays.incidence[i] = abs(x) if across >= along else abs(y)


@step
def facing_circle(qx, qy, radius):
    """k = |q|² − r² of a circle at (qx, qy) from a place, and 1/k."""
    k = max(qx * qx + qy * qy - radius * radius, TOUCHING * TOUCHING)
    return k, 1.0 / k


@step
def meet_circle(qx, qy, k, inverse_k, x, y):
    """1/d along (x, y) to a circle, 0 where it is missed, and half of the chord there."""
    t = qx * x + qy * y
    under = t * t - k
    half = math.sqrt(max(under, 0.0))
    met = (t + half) * inverse_k
    met = met if under > 0.0 else 0.0
    return met if t > 0.0 else 0.0, half


@step
def see_cylinder(qx, qy, radius, rays, incident):
    """Shorten the rays that first meet a cylinder at (qx, qy) relative to their origin.

    A cylinder within 56° to either side meets only rays of its own side of the fan and two or three beyond
    the middle, whether the fan has eight rays or ten: eight lanes, half the square roots. The half chord over
    the radius is the cosine of incidence.
    """
    k, inverse_k = facing_circle(qx, qy, radius)
    inverse_radius = 1.0 / radius
    ray_x, ray_y, inverse, incidence = rays.x, rays.y, rays.inverse, rays.incidence
    if radius * radius < rays.narrow * (qx * qx + qy * qy):
        # Lane RAYS is a pad along the sensor's direction; lane 0 is the rightmost ray.
        leftward = ray_x[RAYS] * qy - ray_y[RAYS] * qx
        a = 2 if leftward > 0.0 else 0
        b = a + 8
        ray_x, ray_y, inverse, incidence = ray_x[a:b], ray_y[a:b], inverse[a:b], incidence[a:b]
    for i in range(inverse.shape[0]):
        met, half = meet_circle(qx, qy, k, inverse_k, ray_x[i], ray_y[i])
        if incident is not None:
            incidence[i] = min(half * inverse_radius, 1.0) if met > inverse[i] else incidence[i]
        inverse[i] = max(inverse[i], met)


@step
def goes_between(ax, ay, bx, by, rays):
    """Whether any ray may pass between (ax, ay) and (bx, by): cheaper than a division."""
    sign = 1.0 if ax * by - ay * bx >= 0.0 else -1.0
    any_does = 0
    for i in range(rays.x.shape[0]):
        from_a = (ax * rays.y[i] - ay * rays.x[i]) * sign
        to_b = (rays.x[i] * by - rays.y[i] * bx) * sign
        any_does = any_does | ((from_a >= 0.0) & (to_b >= 0.0))
    return any_does == 1


@step
def facing_segment(ax, ay, bx, by):
    """Of an inner wall from (ax, ay) to (bx, by), relative to a place: on which side it is, the reciprocal of
    the area between, and its length."""
    area = ax * by - ay * bx
    sign = 1.0 if area >= 0.0 else -1.0
    length = math.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay))
    return sign, 1.0 / (sign * max(abs(area), TOUCHING * length)), length


@step
def meet_segment(ax, ay, bx, by, sign, inverse_area, x, y):
    """1/d along (x, y) to an inner wall, 0 where it is missed, and the wall's cross product with (x, y)."""
    from_a = (ax * y - ay * x) * sign
    to_b = (x * by - y * bx) * sign
    through = x * (by - ay) - y * (bx - ax)
    met = through * inverse_area
    met = met if from_a >= 0.0 else 0.0
    return met if to_b >= 0.0 else 0.0, through


@step
def see_segment(ax, ay, bx, by, rays, incident):
    """Shorten the rays that first meet an inner wall from (ax, ay) to (bx, by), relative to their origin."""
    sign, inverse_area, length = facing_segment(ax, ay, bx, by)
    inverse_length = 1.0 / max(length, TOUCHING)
    for i in range(rays.x.shape[0]):
        met, through = meet_segment(ax, ay, bx, by, sign, inverse_area, rays.x[i], rays.y[i])
        if incident is not None:
            cosine = abs(through) * inverse_length
            rays.incidence[i] = cosine if met > rays.inverse[i] else rays.incidence[i]
        rays.inverse[i] = max(rays.inverse[i], met)


@step
def all_nearer(gap, inverse):
    """Whether all rays of a fan end before `gap`."""
    nearer = 1
    for i in range(RAYS):
        nearer = nearer & (inverse[i] * gap > 1.0)
    return nearer == 1


@step
def see_cylinders(arena, cell, spot, rays, incident):
    """Shorten the rays that first meet a cylinder: nearest cylinders first, until all rays end before the
    next."""
    for n in range(arena.cylinders.shape[0]):
        if n % LOOK == LOOK - 1 and all_nearer(arena.cylinder_gap[cell, n], rays.inverse):
            return
        j = arena.near_cylinders[cell, n]
        qx = arena.cylinders[j, 0] - spot.x
        qy = arena.cylinders[j, 1] - spot.y
        radius = arena.cylinders[j, 2]
        # Anything wholly behind the sensor meets no ray.
        if qx * rays.x[RAYS] + qy * rays.y[RAYS] > -radius:
            see_cylinder(qx, qy, radius, rays, incident)


@step
def see_segments(arena, cell, spot, rays, incident):
    """Shorten the rays that meet an inner wall first, as for cylinders."""
    x, y = rays.x[RAYS], rays.y[RAYS]
    for n in range(arena.segments.shape[0]):
        if n % LOOK == LOOK - 1 and all_nearer(arena.segment_gap[cell, n], rays.inverse):
            return
        j = arena.near_segments[cell, n]
        ax = arena.segments[j, 0] - spot.x
        ay = arena.segments[j, 1] - spot.y
        bx = arena.segments[j, 2] - spot.x
        by = arena.segments[j, 3] - spot.y
        if max(ax * x + ay * y, bx * x + by * y) > -SPARE and goes_between(ax, ay, bx, by, rays):
            see_segment(ax, ay, bx, by, rays, incident)


@step
def see(arena, fans, k, spot, rays, incident):
    """1/d from `spot` to whatever is nearest along each ray of sensor `k`.

    With `incident` True (not in the paper) also the cosine of incidence, which a Lambertian surface needs.
    With None, which is compiled separately, the paper's equation avoids this cost (a robot with such surfaces
    is a fifth slower).
    """
    see_room(arena, fans[k, 0], fans[k, 1], spot, rays, incident)
    cell = cell_at(arena, spot.x, spot.y)
    see_cylinders(arena, cell, spot, rays, incident)
    see_segments(arena, cell, spot, rays, incident)


@step
def added(t):
    """The sum of a fan's terms, outermost pairs first."""
    return (t[0] + t[9]) + (t[1] + t[8]) + ((t[2] + t[7]) + (t[3] + t[6])) + (t[4] + t[5])


@step
def is_bare(arena):
    """Whether the room has nothing but walls of the usual reflectance."""
    return arena.cylinders.shape[0] + arena.segments.shape[0] + arena.reflectance.shape[0] == 0


@step
def is_tinted(arena):
    """Whether any surface's reflectance differs from that which robots' constants hold for."""
    return arena.reflectance.shape[0] > 0


@step
def is_brighter(arena):
    """Whether sensors may notice a surface from farther away than usual."""
    most = 1.0
    for i in range(arena.reflectance.shape[0]):
        most = max(most, arena.reflectance[i])
    return most > 1.0


@step
def tint(arena, spot, rays, lambertian):
    """The reflectance of what each ray meets, times the cosine of incidence if `lambertian` is 1, into
    rays.incidence."""
    for i in range(rays.inverse.shape[0]):
        d = 1.0 / rays.inverse[i]
        x, y = spot.x + rays.x[i] * d, spot.y + rays.y[i] * d
        reflectance = arena.reflectance[0]
        for j in range(arena.cylinders.shape[0]):
            dx, dy, radius = x - arena.cylinders[j, 0], y - arena.cylinders[j, 1], arena.cylinders[j, 2]
            if abs(math.sqrt(dx * dx + dy * dy) - radius) < GRAZE:
                reflectance = arena.reflectance[1 + j]
        rays.incidence[i] = reflectance * (rays.incidence[i] if lambertian > 0.0 else 1.0)
