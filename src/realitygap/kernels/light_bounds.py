"""Bounds of ambient light, in single precision: for trials whose readings nobody sees.

A network's inputs are integers −10 … 10, so a step needs a reading only to within bounds that give the same
input. Direct light is the double-precision law's; reflected light is computed here with a margin. Where single
precision cannot tell (the edge of a shadow, a corner, a ray along a wall), a ray widens its sensor's bounds.

Positions are relative to the body's centre. A ray with unit vector u from a sensor h off the wall where it
ends, after d, has an end that errs by less than 3 UNIT d (d + r) / h, r the body's radius: u errs by
less than UNIT, h by less than r UNIT, and d = h / (u · normal).
"""

import math
from typing import NamedTuple

import numpy as np

from realitygap.kernels.geometry import GRAZE
from realitygap.kernels.jit import apart, loose, loose_apart, step
from realitygap.kernels.light import first_sensor, rays_of_fan, stand_by_sensors
from realitygap.kernels.light_beyond import direct_light, lamp_point, lamp_points
from realitygap.kernels.params import LAMP_POINTS, World

f32 = np.float32
UNIT = f32(2.0**-21)
"""Eight roundings."""
EDGE = f32(15.0)
"""3 UNIT, times five: how much more than the end the terms err that tell whether the body is in the way."""
PART, COARSE = f32(3e-4), f32(0.02)
"""Margins, shares of the reflected light: of all rays, and of those nearly along a wall. Half of each is for
where the ray ends."""
BACK, GRAZED = f32(1.0 - GRAZE), f32(GRAZE)
NONE, ONE, FOUR, FAR_PART, NEAR_PART = f32(0.0), f32(1.0), f32(4.0), f32(16.0), f32(81.0)
POWER = 1e-5
"""Margin, a share, of about_power."""
ROOT_HALF, FIFTY_TWO = np.int64(0x3FE6A09E667F3BCD), np.int64(52)
ROUNDING = 1e-12
"""Margin, a share, of a sum in double precision in another order."""
LARGEST, INSIDE, NEAREST, CANCELLED = 120.0, 0.15, 1.5, 1e-4
"""The largest room, the least distance of a sensor from the body's edge, that of a lamp from a surface, cm, and
the largest share that roundings may be of a lamp's light, for which the margins hold."""


class Here(NamedTuple):
    """What all rays of a step have in common."""

    cos: float
    sin: float
    east: float
    west: float
    north: float
    south: float
    """Distances of the walls from the body's centre."""
    radius: float
    low: float
    """Share of light's path from a surface to a lamp that is below the body's top."""
    height2: float
    steep: float
    flat: float
    near2: float
    """Light falls off by the root of steep d⁴ + flat d² + near2."""
    matt: float
    even: float
    """1 and 0 for Lambertian surfaces, else 0 and 1."""
    edge: float
    rough: float
    coarse: float
    """Of `meet` and `roughness`."""


class Bulb(NamedTuple):
    """A lamp's point: its place, weight, and distances from the walls."""

    x: float
    y: float
    weight: float
    east: float
    west: float
    north: float
    south: float


@step
def stand_here(robot, arena, work):
    """What all rays of this step have in common."""
    x, y, radius, flat, matt = work.pose[0], work.pose[1], robot.radius, robot.light_flat, robot.light_lambertian
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


@loose
def meet(fan_x, fan_y, place_x, place_y, here):
    """A ray's end: (x, y, d, h, the gap to the next wall, whether the wall is one across x, the ray's x and y,
    EDGE UNIT r d (d + r) / h)."""
    x, y = here.cos * fan_x - here.sin * fan_y, here.sin * fan_x + here.cos * fan_y
    px, py = here.cos * place_x - here.sin * place_y, here.sin * place_x + here.cos * place_y
    aside = here.east - px if x > NONE else here.west + px
    along = here.north - py if y > NONE else here.south + py
    over, up = abs(x), abs(y)
    across = aside * up <= along * over
    wall = aside if across else along
    longer = ONE / (over if across else up)
    d = wall * longer
    gap = along - up * d if across else aside - over * d
    back = d * BACK
    return px + x * back, py + y * back, d, wall, gap, across, x, y, here.edge * longer * (d + here.radius)


@loose
def shade(end, ex, ey, square, here):
    """Whether the body hides a lamp's point at e = (ex, ey) from a ray's end w, and whether that is doubtful.

    Near a shadow's edge |w × e|² − r² e² errs by at most five times r (e² + w²) the end's error.
    """
    x, y, r2 = end[0], end[1], here.radius * here.radius
    aside, ahead = x * ey - y * ex, -(x * ex + y * ey)
    line = aside * aside - r2 * square
    tx, ty = x + here.low * ex, y + here.low * ey
    tip = tx * tx + ty * ty - r2
    hidden = ((line < NONE) & (ahead > NONE) & (ahead < here.low * square)) | (tip < NONE)
    return hidden, (abs(line) < end[8] * (square + x * x + y * y)) | (abs(tip) < end[8])


@loose
def roughness(end, far2, here):
    """Whether a ray's light may err by more than half of PART, and than half of COARSE: by
    UNIT (d + r) / h (4 + 9 d / far)."""
    d2 = end[2] * end[2]
    error, scale = end[8] * end[8] * (FAR_PART * far2 + NEAR_PART * d2), d2 * far2
    return error > here.rough * scale, error > here.coarse * scale


@loose_apart
def from_point(here, bulb, fans, rows, a, b):
    """Light from a lamp of one point by the rays in lanes `a` to `b`: the most it may be, and what of that is
    doubtful, into `rows`, both over the lamp's light."""
    fan_x, fan_y, weight = fans[0, a:b], fans[1, a:b], fans[2, a:b]
    place_x, place_y, most, doubts = fans[3, a:b], fans[4, a:b], rows[0, a:b], rows[1, a:b]
    for i in range(most.shape[0]):
        end = meet(fan_x[i], fan_y[i], place_x[i], place_y[i], here)
        ex, ey = bulb.x - end[0], bulb.y - end[1]
        square = ex * ex + ey * ey
        hidden, doubt = shade(end, ex, ey, square, here)
        far2, d2 = square + here.height2, end[2] * end[2]
        aside, along = bulb.east if end[6] > NONE else bulb.west, bulb.north if end[7] > NONE else bulb.south
        corner = end[4] * here.radius < end[8]
        off = max(aside, along) if corner else (aside if end[5] else along)
        sent = weight[i] * (here.matt * max(off - GRAZED * end[3], NONE) + here.even)
        falls = d2 * (here.steep * d2 + here.flat) + here.near2
        sent = sent / (far2 * math.sqrt((here.matt * far2 + here.even) * falls))
        rough, bad = roughness(end, far2, here)
        sent = (FOUR if bad else (ONE + COARSE if rough else ONE)) * sent
        sent = sent if doubt | (not hidden) else NONE
        most[i] = sent
        doubts[i] = sent if doubt | bad | corner else ((COARSE + COARSE) * sent if rough else NONE)


@loose
def add_point(seen, end, bulb, here):
    """Add a lamp's point to (sum of distances, least light, most light) at a ray's end."""
    ex, ey = bulb.x - end[0], bulb.y - end[1]
    square = ex * ex + ey * ey
    hidden, doubt = shade(end, ex, ey, square, here)
    least = seen[1] + (NONE if hidden | doubt else bulb.weight)
    most = seen[2] + (bulb.weight if doubt | (not hidden) else NONE)
    return seen[0] + math.sqrt(square + here.height2), least, most


@loose_apart
def from_points(here, offset, bulbs, fans, rows, a, b):
    """As from_point, for a lamp of LAMP_POINTS, with its light; surfaces are not Lambertian."""
    fan_x, fan_y, weight = fans[0, a:b], fans[1, a:b], fans[2, a:b]
    place_x, place_y, most, doubts = fans[3, a:b], fans[4, a:b], rows[0, a:b], rows[1, a:b]
    share = f32(1.0 / LAMP_POINTS)
    for i in range(most.shape[0]):
        end = meet(fan_x[i], fan_y[i], place_x[i], place_y[i], here)
        seen = add_point((NONE, offset, offset), end, bulbs[0], here)
        seen = add_point(seen, end, bulbs[1], here)
        seen = add_point(seen, end, bulbs[2], here)
        seen = add_point(seen, end, bulbs[3], here)
        seen = add_point(seen, end, bulbs[4], here)
        far2, d2 = seen[0] * share * (seen[0] * share), end[2] * end[2]
        part = weight[i] / (far2 * math.sqrt(d2 * (here.steep * d2 + here.flat) + here.near2))
        rough, bad = roughness(end, far2, here)
        sent = (FOUR if bad else (ONE + COARSE if rough else ONE)) * max(seen[2], NONE) * part
        least = (NONE if bad else (ONE - COARSE if rough else ONE)) * max(seen[1], NONE) * part
        most[i] = sent
        doubts[i] = sent - least


@step
def reflect(robot, arena, lamp, here, lanes, work):
    """Bounds of the light of a lamp by the rays in `lanes`, from the first to the last, into work.bounds.rows."""
    fans, rows, (a, b) = work.bounds.fans, work.bounds.rows, lanes
    first = bulb_of(robot, arena, lamp, 0, work)
    if lamp_points(robot) == 1:
        from_point(here, first, fans, rows, a, b)
        return
    others = bulb_of(robot, arena, lamp, 1, work), bulb_of(robot, arena, lamp, 2, work)
    bulbs = (first, *others, bulb_of(robot, arena, lamp, 3, work), bulb_of(robot, arena, lamp, 4, work))
    from_points(here, f32(arena.lamp_offset[lamp]), bulbs, fans, rows, a, b)


@loose
def total(row, a, b):
    """The sum of lanes `a` to `b`, in any order."""
    lanes, whole = row[a:b], NONE
    for i in range(lanes.shape[0]):
        whole += lanes[i]
    return whole


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
