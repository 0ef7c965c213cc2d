"""Obstacles near a position, and the rays of eight sensors at a time held against them (§3.2.3).

The law of rays is in single precision. With NumPy's scalars plain Python has the same bits.
"""

import math

import numpy as np

from realitygap.compiled import step
from realitygap.kernels.types import EYES, PAIRS, RAYS

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
def is_clear(arena, x, y, radius):
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


U, f32 = np.uint64, np.float32
LANES, NEXT = U(EYES), U(2 * EYES)
NONE, ONE, FAR = f32(0.0), f32(1.0), f32(1e9)
TOUCHING = f32(1e-3)
"""Smallest distance that a sensor can see, cm: keeps 1/d finite for sensors on a surface."""
BLOCK = 4
"""Cylinders that a ray is held against at once."""

EYE_X, EYE_Y, AHEAD_X, AHEAD_Y, REACH, EYE_A, EYE_B, EYE_OFFSET = (U(i) for i in range(8))
"""Rows of sensors' constants (types.Proximity.rows, types.Ambient.rows)."""


def rows(first, count):
    """Where so many rows of the scratch begin."""
    return tuple(U(EYES * row) for row in range(first, first + count))


PX, PY, FX, FY, WEST, SOUTH, EAST, NORTH, SUM, LEAST, MOST, KEEN = rows(0, 12)
"""Rows of the scratch: places, directions, 1/distance to the outer walls, the signal; of all rays of a sensor
the least and the most 1/d, and 1 where more may matter."""
THING = rows(12, 3 * BLOCK)
"""A block of cylinders (middle ahead and to the left, |middle|² − radius² of each), or an inner wall."""
OF_LIGHT = 12 + 3 * BLOCK
"""The first of the rows that light.py uses."""
INVERSE, SHADE, MIRROR = U(EYES * (OF_LIGHT + 13)), U(EYES * (OF_LIGHT + 13 + RAYS)), U(EYES * PAIRS)
"""Rows of a ray of each pair: 1/d, and, of RAYS rays, the share that the surface throws back; and how far on
those of its mirror image are: not next to it, or a compiler could not tell that the two are apart."""


@step
def root(x):
    """√x, also in plain Python in single precision."""
    return f32(math.sqrt(x))


@step
def place_sensors(n, sensors, arena, pose, p):
    """Places and directions of `n` sensors, and their distances to the outer walls."""
    c, s, west, south = f32(pose[3]), f32(pose[4]), f32(pose[0]), f32(pose[1])
    east, north = f32(arena.size[0] - pose[0]), f32(arena.size[1] - pose[1])
    for i in range(n):
        ox, oy = sensors[EYE_X, i], sensors[EYE_Y, i]
        dx, dy = sensors[AHEAD_X, i], sensors[AHEAD_Y, i]
        px, py = c * ox - s * oy, s * ox + c * oy
        p[PX + i], p[PY + i] = px, py
        p[FX + i], p[FY + i] = c * dx - s * dy, s * dx + c * dy
        p[WEST + i], p[SOUTH + i] = ONE / max(west + px, TOUCHING), ONE / max(south + py, TOUCHING)
        p[EAST + i], p[NORTH + i] = ONE / max(east - px, TOUCHING), ONE / max(north - py, TOUCHING)


@step
def hit_walls(p, i, x, y):
    """1/d along (x, y) to the nearer outer wall, and the cosine of incidence there."""
    across = max(x * p[EAST + i], -x * p[WEST + i])
    along = max(y * p[NORTH + i], -y * p[SOUTH + i])
    return max(across, along), abs(x) if across >= along else abs(y)


@step
def nearer(best, t, k, own):
    """Of two cylinders that which a ray meets first. They do not overlap: so the one whose middle is nearer.

    t: how far along the ray its middle is; k = |middle|² − radius²; own: 1/radius and reflectance.
    """
    under = t * t - k
    first = (under > NONE) & (t > NONE) & (t < best[0])
    return (
        t if first else best[0], under if first else best[1],
        own[0] if first else best[2], own[1] if first else best[3],
    )  # fmt: skip


@step
def both_nearer(bests, p, i, at, c, s, own):
    """As `nearer`, the cylinder whose rows begin `at` there, a ray (c, s) and its mirror image."""
    a, b, k = p[at + i] * c, p[at + LANES + i] * s, p[at + NEXT + i]
    return nearer(bests[0], a + b, k, own), nearer(bests[1], a - b, k, own)


@step
def end_on(before, best, shades):
    """(1/d, shade) of a ray that ended `before`, now that it meets a cylinder, or none."""
    half, shade = root(best[1]), before[1]
    inverse = ONE / max(best[0] - half, TOUCHING)
    if shades is not None:
        here = best[3] * (shades[0] * min(half * best[2], ONE) + shades[1])
        shade = here if inverse > before[0] else shade
    return max(before[0], inverse), shade


@step
def white_of(arena, surface):
    """The reflectance of the walls, surface 0, or of a cylinder, 1 + its number."""
    return f32(arena.reflectance[surface]) if arena.reflectance.shape[0] > 0 else ONE


@step
def place_cylinder(n, arena, pose, j, at, there, p):
    """Lay cylinder `j` down in the rows from `at` on, or none; returns 1/radius and reflectance."""
    if not there:
        for i in range(n):
            p[at + i] = p[at + LANES + i] = NONE
            p[at + NEXT + i] = FAR
        return ONE, ONE
    x, y = f32(arena.cylinders[j, 0] - pose[0]), f32(arena.cylinders[j, 1] - pose[1])
    radius = f32(arena.cylinders[j, 2])
    square = radius * radius
    for i in range(n):
        qx, qy = x - p[PX + i], y - p[PY + i]
        p[at + i] = qx * p[FX + i] + qy * p[FY + i]
        p[at + LANES + i] = qy * p[FX + i] - qx * p[FY + i]
        p[at + NEXT + i] = max(qx * qx + qy * qy - square, TOUCHING * TOUCHING)
    return ONE / radius, white_of(arena, j + U(1))


@step
def cast_at_walls(n, arena, fan, p, shades):
    """Hold all rays against the outer walls."""
    white = white_of(arena, 0)
    for r in range(fan.shape[1]):
        c, s, o = fan[0, r], fan[1, r], LANES * U(r)
        for i in range(n):
            fx, fy = p[FX + i], p[FY + i]
            a = hit_walls(p, i, fx * c - fy * s, fy * c + fx * s)
            b = hit_walls(p, i, fx * c + fy * s, fy * c - fx * s)
            p[INVERSE + o + i], p[INVERSE + MIRROR + o + i] = a[0], b[0]
            if shades is not None:
                p[SHADE + o + i] = white * (shades[0] * a[1] + shades[1])
                p[SHADE + MIRROR + o + i] = white * (shades[0] * b[1] + shades[1])


@step
def nth(arena, cell, m):
    """The m-th nearest cylinder; the last one where there are fewer."""
    return arena.near_cylinders[cell, min(m, arena.cylinders.shape[0] - 1)]


@step
def cast_at_cylinders(n, arena, pose, cell, fan, first, p, shades):
    """Hold all rays against the block of cylinders from the `first` nearest on."""
    last = min(first + arena.together, arena.cylinders.shape[0])
    one = place_cylinder(n, arena, pose, nth(arena, cell, first), THING[0], True, p)
    two = place_cylinder(n, arena, pose, nth(arena, cell, first + 1), THING[3], first + 1 < last, p)
    three = place_cylinder(n, arena, pose, nth(arena, cell, first + 2), THING[6], first + 2 < last, p)
    four = place_cylinder(n, arena, pose, nth(arena, cell, first + 3), THING[9], first + 3 < last, p)
    none = FAR, NONE, ONE, ONE
    for r in range(fan.shape[1]):
        c, s, o = fan[0, r], fan[1, r], LANES * U(r)
        for i in range(n):
            found = both_nearer((none, none), p, i, THING[0], c, s, one)
            found = both_nearer(found, p, i, THING[3], c, s, two)
            found = both_nearer(found, p, i, THING[6], c, s, three)
            found = both_nearer(found, p, i, THING[9], c, s, four)
            if shades is not None:
                a = end_on((p[INVERSE + o + i], p[SHADE + o + i]), found[0], shades)
                b = end_on((p[INVERSE + MIRROR + o + i], p[SHADE + MIRROR + o + i]), found[1], shades)
                p[SHADE + o + i], p[SHADE + MIRROR + o + i] = a[1], b[1]
            else:
                a = end_on((p[INVERSE + o + i], NONE), found[0], shades)
                b = end_on((p[INVERSE + MIRROR + o + i], NONE), found[1], shades)
            p[INVERSE + o + i], p[INVERSE + MIRROR + o + i] = a[0], b[0]


@step
def cast_at_wall(n, arena, pose, j, fan, p, shades):
    """Hold all rays against inner wall `j`: those between its ends meet it."""
    ax, ay = f32(arena.segments[j, 0] - pose[0]), f32(arena.segments[j, 1] - pose[1])
    bx, by = f32(arena.segments[j, 2] - pose[0]), f32(arena.segments[j, 3] - pose[1])
    length, white = f32(arena.segment_along[j, 2]), white_of(arena, 0)
    bend = ONE / max(length, TOUCHING)
    for i in range(n):
        fx, fy = p[FX + i], p[FY + i]
        qx, qy, rx, ry = ax - p[PX + i], ay - p[PY + i], bx - p[PX + i], by - p[PY + i]
        area = qx * ry - qy * rx
        sign = ONE if area >= NONE else -ONE
        p[THING[0] + i], p[THING[1] + i] = sign * (qx * fx + qy * fy), sign * (qy * fx - qx * fy)
        p[THING[2] + i], p[THING[3] + i] = sign * (rx * fx + ry * fy), sign * (ry * fx - rx * fy)
        p[THING[4] + i] = ONE / max(abs(area), TOUCHING * length)
        ahead = max(qx * fx + qy * fy, rx * fx + ry * fy) > NONE
        p[MOST + i] = p[KEEN + i] if ahead else NONE
    keen = NONE
    for i in range(n):
        keen = max(keen, p[MOST + i])
    if keen == NONE:
        return
    for r in range(fan.shape[1]):
        c, s, o = fan[0, r], fan[1, r], LANES * U(r)
        for i in range(n):
            u, v = p[THING[0] + i] * s, p[THING[1] + i] * c
            w, z = p[THING[3] + i] * c, p[THING[2] + i] * s
            a = through(u - v, w - z, p[THING[4] + i])
            b = through(-u - v, w + z, p[THING[4] + i])
            old, other = p[INVERSE + o + i], p[INVERSE + MIRROR + o + i]
            p[INVERSE + o + i], p[INVERSE + MIRROR + o + i] = max(old, a[0]), max(other, b[0])
            if shades is not None:
                here = white * (shades[0] * (a[1] * bend) + shades[1])
                there = white * (shades[0] * (b[1] * bend) + shades[1])
                p[SHADE + o + i] = here if a[0] > old else p[SHADE + o + i]
                p[SHADE + MIRROR + o + i] = there if b[0] > other else p[SHADE + MIRROR + o + i]


@step
def through(from_a, to_b, inverse_area):
    """1/d to a wall of a ray that lies between its ends if neither cross product with them is negative, else
    0; and its cross product with the wall."""
    across = from_a + to_b
    met = across * inverse_area if from_a >= NONE else NONE
    return met if to_b >= NONE else NONE, across


@step
def are_known(n, sensors, more, pairs, gap, p):
    """Whether what is `gap` cm away or farther changes no sensor's reading: each one's rays all end before
    it, or neither they nor it are within its reach and `more` cm."""
    for i in range(n):
        p[LEAST + i] = p[MOST + i] = p[INVERSE + i]
    for r in range(pairs):
        row = INVERSE + LANES * U(r)
        for i in range(n):
            one, two = p[row + i], p[row + MIRROR + i]
            p[LEAST + i], p[MOST + i] = min(p[LEAST + i], min(one, two)), max(p[MOST + i], max(one, two))
    for i in range(n):
        reach = sensors[REACH, i] + more
        dark = (gap > reach) & (p[MOST + i] * reach < ONE)
        p[KEEN + i] = NONE if dark | (p[LEAST + i] * gap > ONE) else ONE
    keen = NONE
    for i in range(n):
        keen = max(keen, p[KEEN + i])
    return keen == NONE


@step
def cast_rays(n, arena, pose, cell, rim, sensors, more, fan, p, shades):
    """1/d, and shade, of all rays of the `n` sensors placed: nearest obstacles first, as long as they
    matter.

    rim: the farthest that a sensor is from the robot's middle; more: cm beyond the sensors' reach that may
    matter; shades: None, and no shade is wanted; or the weights of the cosine of incidence and of 1 in it.
    """
    cast_at_walls(n, arena, fan, p, shades)
    for i in range(n):
        p[KEEN + i] = ONE
    j, k, cylinders, walls = 0, 0, arena.cylinders.shape[0], arena.segments.shape[0]
    while j < cylinders or k < walls:
        one = arena.cylinder_gap[cell, j] if j < cylinders else math.inf
        other = arena.segment_gap[cell, k] if k < walls else math.inf
        gap = f32(min(one, other) - rim)
        if k % BLOCK == 0 and gap > NONE and are_known(n, sensors, more, fan.shape[1], gap, p):
            return
        if one <= other:
            cast_at_cylinders(n, arena, pose, cell, fan, j, p, shades)
            j += arena.together
        else:
            cast_at_wall(n, arena, pose, arena.near_segments[cell, k], fan, p, shades)
            k += 1


@step
def hand_over(p, block, out):
    """Copy the sums of a block of sensors into the row of all."""
    first = U(block) * LANES
    for k in range(first, min(first + LANES, U(out.shape[0]))):
        out[k] = p[SUM + (k - first)]
