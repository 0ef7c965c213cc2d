"""Bounds of ambient light (§3.3): for trials whose readings nobody sees.

A network's inputs are integers −10 … 10, so a step needs a reading only to within bounds that give the same
input. Reflected light is computed in single precision, with a margin (bounded_rays.py). Where that cannot
tell (a shadow's edge, a corner, a ray along a wall), a ray widens its sensor's bounds.
"""

import math

import numpy as np

from realitygap.kernels.bounded_rays import (
    COARSE,
    EDGE,
    PART,
    UNIT,
    Bulb,
    Here,
    f32,
    from_point,
    from_points,
    total,
)  # fmt: skip
from realitygap.kernels.jit import apart, loose, step
from realitygap.kernels.light import first_sensor, rays_of_fan, stand_by_sensors
from realitygap.kernels.light_beyond import direct_light, lamp_point, lamp_points
from realitygap.kernels.params import LAMP_POINTS, World

POWER = 1e-5
"""Margin, a share, of about_power."""
ROOT_HALF, FIFTY_TWO = np.int64(0x3FE6A09E667F3BCD), np.int64(52)
ROUNDING = 1e-12
"""Margin, a share, of a sum in double precision in another order."""
LARGEST, INSIDE, NEAREST, CANCELLED = 120.0, 0.15, 1.5, 1e-4
"""Limits within which the margins hold: the largest room, the least distance of a sensor from the body's edge
and of a lamp from a surface (cm), and the largest share of a lamp's light that rounding may take."""


@step
def stand_here(robot, arena, work):
    """What all rays of this step have in common."""
    x, y, radius = work.pose[0], work.pose[1], robot.radius
    flat, matt = robot.light_flat, robot.light_lambertian
    rough = 0.125 * (EDGE * radius * PART) * (EDGE * radius * PART)
    return Here(
        f32(work.pose[3]), f32(work.pose[4]), f32(arena.size[0] - x), f32(x), f32(arena.size[1] - y), f32(y),
        f32(radius), f32(1.0 - robot.light_clear), f32(robot.light_height2),
        f32(1.0 - flat), f32(flat), f32(flat * robot.light_near * robot.light_near),
        f32(matt), f32(1.0 - matt), f32(EDGE * UNIT * radius),
        f32(rough), f32(rough * (COARSE / PART) * (COARSE / PART)),
    )  # fmt: skip


@step
def bulb_of(robot, arena, lamp, p, work):
    """Point `p` of a lamp."""
    x, y, weight = lamp_point(robot, arena, lamp, p)
    return Bulb(
        f32(x - work.pose[0]), f32(y - work.pose[1]), f32(weight),
        f32(arena.size[0] - x), f32(x), f32(arena.size[1] - y), f32(y),
    )  # fmt: skip


@step
def reflect(robot, arena, lamp, here, lanes, work):
    """Bounds of a lamp's light by the rays in `lanes` (from, to), into work.bounds.rows."""
    fans, rows = work.bounds.fans, work.bounds.rows
    first = bulb_of(robot, arena, lamp, 0, work)
    if lamp_points(robot) == 1:
        from_point(here, first, fans, rows, lanes)
        return
    others = bulb_of(robot, arena, lamp, 1, work), bulb_of(robot, arena, lamp, 2, work)
    bulbs = (first, *others, bulb_of(robot, arena, lamp, 3, work), bulb_of(robot, arena, lamp, 4, work))
    from_points(here, f32(arena.lamp_offset[lamp]), bulbs, fans, rows, lanes)


@loose
def about_power(x, p):
    """x^p for 0 < x ≤ 1 and 0 ≤ p ≤ 20, to a few millionths; at least e⁻⁴⁰."""
    b = np.float64(max(x, 1e-300)).view(np.int64)
    e = (b - ROOT_HALF) >> FIFTY_TWO
    m = np.int64(b - (e << FIFTY_TWO)).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    log = np.float64(e) * 0.6931471805599453 + 2.0 * s * (1.0 + z * (1 / 3 + z * (0.2 + z / 7)))
    y = max(p * log, -40.0) * 1.4426950408889634
    k = math.floor(y + 0.5)
    r = (y - k) * 0.6931471805599453
    t = 1.0 + r * (1.0 + r * (0.5 + r * (1 / 6 + r * (1 / 24 + r / 120))))
    return t * np.int64((np.int64(k) + np.int64(1023)) << FIFTY_TWO).view(np.float64)


@loose
def add_direct(robot, arena, lamp, lower, upper, work):
    """Add bounds of the direct light from a lamp of one point, times its cosine's power.

    The positions and directions are those of stand_by_sensors, in double precision.
    """
    a, b, height2, p = first_sensor(robot, work), work.light.shape[0], robot.light_height2, robot.light_facing
    end_x, end_y, ray_x, ray_y = work.end_x[a:b], work.end_y[a:b], work.ray_x[a:b], work.ray_y[a:b]
    least, most = work.light[a:b], work.far[a:b]
    x, y, weight = lamp_point(robot, arena, lamp, 0)
    light = max(arena.lamp_offset[lamp] + weight, 0.0)
    for i in range(b - a):
        ex, ey = x - end_x[i], y - end_y[i]
        ahead, square = ex * ray_x[i] + ey * ray_y[i], ex * ex + ey * ey + height2
        whole, cosine = light / square, min(max(ahead, 0.0) / math.sqrt(square), 1.0)
        seen = whole * about_power(cosine, p)
        most[i] = seen * (1.0 + POWER) if ahead > -1e-9 else 0.0
        least[i] = max(seen * (1.0 - POWER) - whole * 1e-16, 0.0)
    for k in range(lower.shape[0]):
        lower[k] += least[k]
        upper[k] += most[k]


@step
def bound_direct(robot, arena, work, lower, upper):
    """Bounds of the direct light of all ambient sensors."""
    if lamp_points(robot) > 1 or robot.light_facing == 0.0:
        direct_light(robot, arena, work, lower)
        for k in range(lower.shape[0]):
            upper[k] = lower[k]
        return
    stand_by_sensors(robot, work)
    for k in range(lower.shape[0]):
        lower[k] = upper[k] = 0.0
    for lamp in range(arena.lamp_points.shape[0]):
        add_direct(robot, arena, lamp, lower, upper, work)


@apart
def bound_light(robot, arena, work, lower, upper):
    """Bounds of all ambient sensors' illumination into `lower` and `upper` ([A]).

    `illuminate` finds it between them, or a sensor's reading is its floor by all three.
    """
    bound_direct(robot, arena, work, lower, upper)
    sensors, rows, here = lower.shape[0], work.bounds.rows, stand_here(robot, arena, work)
    each = rays_of_fan(robot, work) * (robot.ambient_ray.shape[0] // max(sensors, 1))
    for k in range(sensors):
        work.listed[k] = 0 if lower[k] * robot.ambient_gain[k] >= robot.ambient_full[k] else 1
    for lamp in range(arena.lamp_points.shape[0]):
        _, _, light = lamp_point(robot, arena, lamp, 0)
        light = max(light + arena.lamp_offset[lamp], 0.0) if lamp_points(robot) == 1 else 1.0
        first = 0
        for k in range(sensors + 1):  # neighbours' rays lie in one row
            if k < sensors and work.listed[k] == 1:
                continue
            if k > first:
                lanes = first * each, first * each + (((k - first) * each + 15) & -16)
                reflect(robot, arena, lamp, here, lanes, work)
            first = k + 1
        for k in range(sensors):
            if work.listed[k] == 1:
                most = total(rows[0], k * each, (k + 1) * each)
                doubt = total(rows[1], k * each, (k + 1) * each)
                upper[k] += light * most * (1.0 + PART)
                lower[k] += light * max(most * (1.0 - PART) - doubt, 0.0)
    for k in range(sensors):
        upper[k] *= 1.0 + ROUNDING
        lower[k] *= 1.0 - ROUNDING


def fit_bounds(world: World) -> bool:
    """Whether light can be bounded here: for a disc with printed or extended laws, in a room with nothing but
    walls and lamps, and constants for which the margins hold."""
    robot, arena = world.robot, world.arena
    if world.task.feed != 1:  # trial.AMBIENT
        return False
    furnished = len(arena.cylinders) + len(arena.segments) + len(arena.reflectance)
    measured = robot.ambient_curve.shape[1] + robot.ambient_noise.shape[1] + len(robot.outline)
    if furnished or measured or not len(robot.ambient_gain) or arena.size.max() > LARGEST:
        return False
    inside = np.hypot(*robot.ambient_place.T).max() <= robot.radius - INSIDE
    if lamp_points(robot) == 1:
        return bool(inside and robot.light_height2 >= NEAREST**2 and (arena.lamp_offset <= 0).all())
    away = np.hypot(*(arena.lamp_points[:, :, None] - arena.lamp_points[:, None]).transpose(3, 0, 1, 2))
    away = (1.0 - robot.light_narrow) * away.mean(axis=-1)
    near = robot.light_height2 < NEAREST**2 and (away < NEAREST + robot.light_wall_offset).any()
    seen = (np.arange(2**LAMP_POINTS)[:, None] >> np.arange(LAMP_POINTS)) & 1
    offset, summed = arena.lamp_offset[:, None], arena.lamp_weights @ seen.T
    exact = (np.abs(offset + summed) * CANCELLED > 2.0**-22 * (summed - offset)).all()
    bounded = exact and (arena.lamp_weights >= 0).all() and (arena.lamp_offset <= 0).all()
    return bool(inside and bounded and not near and robot.light_lambertian == 0)
