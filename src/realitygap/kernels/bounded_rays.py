"""Light by an ambient sensor's rays in single precision, with its bounds (light_bounds.py).

Positions are relative to the body's centre. A ray with unit vector u from a sensor h off the wall where it
ends, after d, has an end that errs by less than 3 UNIT d (d + r) / h, r the body's radius: u errs by less
than UNIT, h by less than r UNIT, and d = h / (u · normal).
"""

import math
from typing import NamedTuple

import numpy as np

from realitygap.kernels.geometry import GRAZE
from realitygap.kernels.jit import loose, loose_apart
from realitygap.kernels.params import LAMP_POINTS

f32 = np.float32
UNIT = f32(2.0**-21)
"""Eight roundings."""
EDGE = f32(15.0)
"""3 UNIT times five: what tells whether the body is in the way errs by up to five times the end's error."""
PART, COARSE = f32(3e-4), f32(0.02)
"""Margins, shares of the reflected light: of all rays, and of those nearly along a wall. Half of each is for
where the ray ends."""
BACK, GRAZED = f32(1.0 - GRAZE), f32(GRAZE)
NONE, ONE, FOUR, FAR_PART, NEAR_PART = f32(0.0), f32(1.0), f32(4.0), f32(16.0), f32(81.0)


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


@loose
def meet(fan_x, fan_y, place_x, place_y, here):
    """A ray's end: (x, y, d, h, the gap to the next wall, whether the wall is across x, the ray's x and y,
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
def from_point(here, bulb, fans, rows, lanes):
    """Light from a lamp of one point by the rays in `lanes` (from, to): the most it may be, and what of that
    is doubtful, into `rows`, both over the lamp's light."""
    a, b = lanes
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
def from_points(here, offset, bulbs, fans, rows, lanes):
    """As from_point, for a lamp of LAMP_POINTS, with its light; surfaces are not Lambertian."""
    a, b = lanes
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


@loose
def total(row, a, b):
    """The sum of lanes `a` to `b`, in any order."""
    lanes, whole = row[a:b], NONE
    for i in range(lanes.shape[0]):
        whole += lanes[i]
    return whole
