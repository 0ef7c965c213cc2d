"""The ambient light sensors (§3.3): direct light, and light reflected from where the rays end.

A_i = D_i + Σ_j D_ij cos² β_ij · 1.5 / d_ij², D = (offset + Σ L k) / (mean distance to a lamp's points)². The
extensions that a calibration may fit are neutral in the paper. In single precision, as rays.py has it.
"""

import math

import numpy as np

from realitygap.compiled import step
from realitygap.kernels.infrared import apply_curve
from realitygap.kernels.rays import (
    EAST,
    FAR,
    FX,
    FY,
    INVERSE,
    LANES,
    MIRROR,
    NONE,
    NORTH,
    OF_LIGHT,
    ONE,
    PX,
    PY,
    SOUTH,
    SUM,
    WEST,
    U,
    cast_rays,
    cell_at,
    f32,
    hand_over,
    place_sensors,
    root,
    rows,
    white_of,
)
from realitygap.kernels.types import LAMP_POINTS

i32 = np.int32
END_X, END_Y, FALL, WHITE, NX, NY, NEAR, FACED = rows(OF_LIGHT, 8)
HIDDEN = rows(OF_LIGHT + 8, LAMP_POINTS)
"""Rows of one ray's ends: places, what the light that they send falls off by (squared), reflectance, normal
of the surface; and of each lamp's point 1 where something hides it from them."""
BACK = f32(1.0 - 3e-5)
"""The share of a ray at whose end occlusion is tested: off its own wall, for all rounding."""
SHARE, LEAST2 = f32(1.0 / LAMP_POINTS), f32(1e-6)
ROOT_HALF, MANTISSA, LN2, LOG2E = i32(0x3F3504F3), i32(23), f32(0.6931471805599453), f32(1.4426950408889634)
HALF, TWO, DARK = f32(0.5), f32(2.0), f32(-40.0)
LOGS, EXPS = tuple(f32(1 / q) for q in (9, 7, 5, 3)), tuple(f32(1 / q) for q in (720, 120, 24, 6, 2))


@step
def power(x, p):
    """x^p for 0 ≤ x ≤ 1 and p ≥ 0, to some millionths; e⁻⁴⁰ at least: the same bits on every machine."""
    bits = f32(max(x, f32(1e-30))).view(i32)
    exponent = i32(i32(bits - ROOT_HALF) >> MANTISSA)
    m = i32(bits - i32(exponent << MANTISSA)).view(f32)
    s = (m - ONE) / (m + ONE)
    z = s * s
    series = LOGS[3] + z * (LOGS[2] + z * (LOGS[1] + z * LOGS[0]))
    y = max(p * (f32(exponent) * LN2 + TWO * s * (ONE + z * series)), DARK)
    k = np.floor(y * LOG2E + HALF)
    r = y - k * LN2
    t = ONE + r * (ONE + r * (EXPS[4] + r * (EXPS[3] + r * (EXPS[2] + r * (EXPS[1] + r * EXPS[0])))))
    return t * i32(i32(i32(k) + i32(127)) << MANTISSA).view(f32)


@step
def count_points(robot):
    """Number of distinct points of a lamp."""
    return 1 if robot.light.narrow >= 1.0 else LAMP_POINTS


@step
def lamp_point(robot, arena, pose, lamp, q):
    """Position (x, y), weight and row of HIDDEN of a lamp's point `q`: moved towards the lamp's centre by the
    share `narrow`, and kept `wall_offset` cm off the room's walls. A lamp of one point has all the weight."""
    narrow, off = robot.light.narrow, robot.light.wall_offset
    x, y = arena.lamp_points[lamp, q, 0], arena.lamp_points[lamp, q, 1]
    weight = arena.lamp_weights[lamp, q]
    if narrow >= 1.0:
        for other in range(1, LAMP_POINTS):
            weight += arena.lamp_weights[lamp, other]
    x = x + narrow * (arena.lamp_centre[lamp, 0] - x)
    y = y + narrow * (arena.lamp_centre[lamp, 1] - y)
    x = min(max(x, off), arena.size[0] - off)
    y = min(max(y, off), arena.size[1] - off)
    return f32(x - pose[0]), f32(y - pose[1]), f32(weight), HIDDEN[0] + LANES * U(q)


@step
def points_of(robot, arena, pose, lamp):
    """A lamp's points: x, y, weight, row of what is hidden from it."""
    first, second = lamp_point(robot, arena, pose, lamp, 0), lamp_point(robot, arena, pose, lamp, 1)
    third, fourth = lamp_point(robot, arena, pose, lamp, 2), lamp_point(robot, arena, pose, lamp, 3)
    return first, second, third, fourth, lamp_point(robot, arena, pose, lamp, 4)


@step
def in_shadow(wx, wy, ex, ey, square, low, r2):
    """Whether a circle at (wx, wy) from a place stands in the way along the share `low` of (ex, ey).

    square = |e|². No division: the centre's distance to the line, |w × e| / |e|, is compared squared.
    """
    aside, ahead = wx * ey - wy * ex, wx * ex + wy * ey
    tx, ty = wx - low * ex, wy - low * ey
    passed = (aside * aside < r2 * square) & (ahead > NONE) & (ahead < low * square)
    return passed | (tx * tx + ty * ty < r2)


@step
def hide_behind_outline(n, robot, pose, lx, ly, low, hidden, p):
    """Mark the ends that a polygonal body shades from a lamp's point.

    A line meets a convex body unless it lies beyond one of its edges, or all corners lie on one side of the
    line.
    """
    c, s, outline = f32(pose[3]), f32(pose[4]), robot.outline
    for i in range(n):
        p[NEAR + i], p[FACED + i] = f32(1e30), f32(-1e30)
    for k in range(outline.shape[0]):
        vx, vy, nx, ny = f32(outline[k, 0]), f32(outline[k, 1]), f32(outline[k, 2]), f32(outline[k, 3])
        for i in range(n):
            x, y = p[END_X + i], p[END_Y + i]
            ex, ey = low * (lx - x), low * (ly - y)
            dx, dy = c * x + s * y - vx, c * y - s * x - vy
            ex, ey = c * ex + s * ey, c * ey - s * ex
            side, near = ey * dx - ex * dy, dx * nx + dy * ny
            outside = ONE if min(near, near + ex * nx + ey * ny) >= NONE else NONE
            p[NEAR + i], p[FACED + i] = min(p[NEAR + i], side), max(p[FACED + i], side)
            p[hidden + i] = max(p[hidden + i], outside) if k > 0 else outside
    for i in range(n):
        cut = (p[NEAR + i] <= NONE) & (p[FACED + i] >= NONE) & (p[hidden + i] < HALF)
        p[hidden + i] = ONE if cut else NONE


@step
def hide_behind_obstacles(n, arena, pose, lx, ly, x, y, hidden, p):
    """Mark the places in rows `x` and `y` that cylinders and inner walls hide from a lamp's point."""
    for j in range(arena.cylinders.shape[0]):
        cx, cy = f32(arena.cylinders[j, 0] - pose[0]), f32(arena.cylinders[j, 1] - pose[1])
        r2 = f32(arena.cylinders[j, 2] * arena.cylinders[j, 2])
        for i in range(n):
            ex, ey = lx - p[x + i], ly - p[y + i]
            shaded = in_shadow(cx - p[x + i], cy - p[y + i], ex, ey, ex * ex + ey * ey, ONE, r2)
            p[hidden + i] = ONE if shaded else p[hidden + i]
    for j in range(arena.segments.shape[0]):
        x0, y0 = f32(arena.segments[j, 0] - pose[0]), f32(arena.segments[j, 1] - pose[1])
        x1, y1 = f32(arena.segments[j, 2] - pose[0]), f32(arena.segments[j, 3] - pose[1])
        for i in range(n):
            hx, hy = p[x + i], p[y + i]
            ex, ey, ax, ay, bx, by = lx - hx, ly - hy, x0 - hx, y0 - hy, x1 - hx, y1 - hy
            # Where it crosses: the share u = area / (e × (b − a)) of e lies between 0 and 1.
            side_a, side_b, area = ex * ay - ey * ax, ex * by - ey * bx, ax * by - ay * bx
            turn = side_b - side_a
            crossed = (side_a * side_b < NONE) & (area * turn > NONE) & (abs(area) < abs(turn))
            p[hidden + i] = ONE if crossed else p[hidden + i]


@step
def find_surfaces(n, arena, pose, ray, p):
    """Normals, towards the robot's side, and reflectances of the surfaces where a ray ends: of whatever is
    nearest there."""
    west, south = f32(pose[0]), f32(pose[1])
    east, north = f32(arena.size[0] - pose[0]), f32(arena.size[1] - pose[1])
    white = white_of(arena, 0)
    for i in range(n):
        left, right = west + p[END_X + i], east - p[END_X + i]
        below, above = south + p[END_Y + i], north - p[END_Y + i]
        aside, along = min(left, right), min(below, above)
        p[NEAR + i], p[WHITE + i] = min(aside, along), white
        p[NX + i] = (ONE if left <= right else -ONE) if aside <= along else NONE
        p[NY + i] = NONE if aside <= along else (ONE if below <= above else -ONE)
    for j in range(arena.cylinders.shape[0]):
        cx, cy = f32(arena.cylinders[j, 0] - pose[0]), f32(arena.cylinders[j, 1] - pose[1])
        radius, white = f32(arena.cylinders[j, 2]), white_of(arena, j + 1)
        for i in range(n):
            dx, dy = p[END_X + i] - cx, p[END_Y + i] - cy
            d = root(dx * dx + dy * dy)
            gap, scale = abs(d - radius), ONE / max(d, LEAST2)
            here = gap < p[NEAR + i]
            p[NX + i], p[NY + i] = dx * scale if here else p[NX + i], dy * scale if here else p[NY + i]
            p[NEAR + i], p[WHITE + i] = min(gap, p[NEAR + i]), white if here else p[WHITE + i]
    white = white_of(arena, 0)
    for j in range(arena.segments.shape[0]):
        x0, y0 = f32(arena.segments[j, 0] - pose[0]), f32(arena.segments[j, 1] - pose[1])
        ux, uy = f32(arena.segment_along[j, 0]), f32(arena.segment_along[j, 1])
        length = f32(arena.segment_along[j, 2])
        for i in range(n):
            x, y = p[FX + i] * ray[0] - p[FY + i] * ray[1], p[FY + i] * ray[0] + p[FX + i] * ray[1]
            qx, qy = p[END_X + i] - x0, p[END_Y + i] - y0
            along = min(max(qx * ux + qy * uy, NONE), length)
            dx, dy = qx - along * ux, qy - along * uy
            gap, side = root(dx * dx + dy * dy), -ONE if uy * x - ux * y > NONE else ONE
            here = gap < p[NEAR + i]
            p[NX + i], p[NY + i] = side * uy if here else p[NX + i], -side * ux if here else p[NY + i]
            p[NEAR + i], p[WHITE + i] = min(gap, p[NEAR + i]), white if here else p[WHITE + i]


@step
def fall_of(robot):
    """(1 − flat, flat, flat · near²): how reflected light falls off with a ray's length."""
    flat, near = f32(robot.light.flat), f32(robot.light.near)
    return ONE - flat, flat, flat * near * near


@step
def fallen(square, fall):
    """d⁴, or d² + near², of a ray of squared length `square`: 1 over the share that is left, squared."""
    return square * (fall[0] * square + fall[1]) + fall[2]


@step
def end_on_wall(p, i, ray, fall):
    """Where a ray of sensor `i` ends in a bare room: x, y, `fallen`, normal, reflectance."""
    x, y = p[FX + i] * ray[0] - p[FY + i] * ray[1], p[FY + i] * ray[0] + p[FX + i] * ray[1]
    across, along = max(x * p[EAST + i], -x * p[WEST + i]), max(y * p[NORTH + i], -y * p[SOUTH + i])
    aside, d = across >= along, ONE / max(across, along)
    nx, ny = (-ONE if x > NONE else ONE) if aside else NONE, NONE if aside else (-ONE if y > NONE else ONE)
    back = d * BACK
    return p[PX + i] + x * back, p[PY + i] + y * back, fallen(d * d, fall), nx, ny, ONE


@step
def end_in_rows(p, i):
    """As `end_on_wall`, of a ray that `find_ends` has followed."""
    return p[END_X + i], p[END_Y + i], p[FALL + i], p[NX + i], p[NY + i], p[WHITE + i]


@step
def find_ends(n, ray, row, fall, p):
    """Where a ray of each sensor ends, 1/d being in `row`, among obstacles."""
    for i in range(n):
        p[NEAR + i] = p[row + i]
    for i in range(n):
        x, y = p[FX + i] * ray[0] - p[FY + i] * ray[1], p[FY + i] * ray[0] + p[FX + i] * ray[1]
        d = ONE / p[NEAR + i]
        back = d * BACK
        p[END_X + i], p[END_Y + i] = p[PX + i] + x * back, p[PY + i] + y * back
        p[FALL + i], p[WHITE + i] = fallen(d * d, fall), ONE


@step
def seen_from(seen, point, end, body, hidden, incident):
    """Add a lamp's point, as a ray's end sees it, to (Σ distance, Σ light, Σ cosine of incidence).

    body: the share of the way that is below the body's top, its radius², the lamp's height²; hidden: whether
    anything else hides the point; incident: None, and there is no cosine.
    """
    ex, ey = point[0] - end[0], point[1] - end[1]
    square = ex * ex + ey * ey
    shaded, d = (
        in_shadow(-end[0], -end[1], ex, ey, square, body[0], body[1]),
        root(max(square + body[2], LEAST2)),
    )
    cosine = seen[2]
    if incident is not None:
        cosine = cosine + max(ex * end[3] + ey * end[4], NONE) / d
    return seen[0] + d, seen[1] + (NONE if shaded | hidden else point[2]), cosine


@step
def sent_far(points, end, offset, weight, body, hidden, incident):
    """Light of a lamp of five points that comes back from a ray's end."""
    seen = seen_from((NONE, offset, NONE), points[0], end, body, hidden[0], incident)
    seen = seen_from(seen, points[1], end, body, hidden[1], incident)
    seen = seen_from(seen, points[2], end, body, hidden[2], incident)
    seen = seen_from(seen, points[3], end, body, hidden[3], incident)
    seen = seen_from(seen, points[4], end, body, hidden[4], incident)
    far, sent = seen[0] * SHARE, weight * end[5] * max(seen[1], NONE)
    if incident is not None:
        sent = sent * (seen[2] * SHARE)
    return sent / (far * far * root(end[2]))


@step
def reflect_points(n, points, offset, weight, body, ray, fall, bare, incident, p):
    """Add the light of a lamp of five points that comes back from the end of a ray to the sums; in a bare
    room from that of its mirror image too.

    bare: None, and the ends are in rows; incident: None, and there is no cosine of incidence.
    """
    other, clear = (ray[0], -ray[1]), (False, False, False, False, False)
    for i in range(n):
        if bare is None:
            hidden = (
                p[HIDDEN[0] + i] > HALF, p[HIDDEN[1] + i] > HALF, p[HIDDEN[2] + i] > HALF,
                p[HIDDEN[3] + i] > HALF, p[HIDDEN[4] + i] > HALF,
            )  # fmt: skip
            p[SUM + i] += sent_far(points, end_in_rows(p, i), offset, weight, body, hidden, incident)
        else:
            one, two = end_on_wall(p, i, ray, fall), end_on_wall(p, i, other, fall)
            sent = sent_far(points, one, offset, weight, body, clear, incident)
            p[SUM + i] += sent + sent_far(points, two, offset, weight, body, clear, incident)


@step
def sent_back(point, end, weight, body, hidden, matt):
    """Light of a lamp of one point that comes back from a ray's end: with one root and one division."""
    ex, ey = point[0] - end[0], point[1] - end[1]
    square = ex * ex + ey * ey
    hidden = hidden | in_shadow(-end[0], -end[1], ex, ey, square, body[0], body[1])
    far2, dull = max(square + body[2], LEAST2), ONE - matt
    sent = weight * end[5] * (matt * max(ex * end[3] + ey * end[4], NONE) + dull)
    sent = sent / (far2 * root((matt * far2 + dull) * end[2]))
    return NONE if hidden else sent


@step
def reflect_point(n, point, weight, body, ray, fall, bare, matt, p):
    """As `reflect_points`, of a lamp of one point."""
    other = ray[0], -ray[1]
    for i in range(n):
        if bare is None:
            p[SUM + i] += sent_back(point, end_in_rows(p, i), weight, body, p[HIDDEN[0] + i] > HALF, matt)
        else:
            sent = sent_back(point, end_on_wall(p, i, ray, fall), weight, body, False, matt)
            p[SUM + i] += sent + sent_back(point, end_on_wall(p, i, other, fall), weight, body, False, matt)


@step
def hide_ends(n, robot, arena, pose, point, low, p):
    """Mark the rays' ends that obstacles, or a polygonal body, hide from a lamp's point."""
    for i in range(n):
        p[point[3] + i] = NONE
    if robot.outline.shape[0] > 0:
        hide_behind_outline(n, robot, pose, point[0], point[1], low, point[3], p)
    hide_behind_obstacles(n, arena, pose, point[0], point[1], END_X, END_Y, point[3], p)


@step
def reflect_lamp(n, robot, arena, pose, lamp, bare, p):
    """Add the light of a lamp that comes back from the ends of all rays to the sums."""
    fan, points, many = robot.ambient.fan, points_of(robot, arena, pose, lamp), count_points(robot)
    matt, offset, fall = f32(robot.light.lambertian), f32(arena.lamp_offset[lamp]), fall_of(robot)
    radius = robot.radius if robot.outline.shape[0] == 0 else 0.0
    body = f32(1.0 - robot.light.clear), f32(radius * radius), f32(robot.light.height2)
    light = max(points[0][2] + offset, NONE)
    for r in range(fan.shape[1] if bare else 0):
        ray, weight = (fan[0, r], fan[1, r]), fan[2, r]
        if many == 1:
            reflect_point(n, points[0], weight * light, body, ray, fall, True, matt, p)
        else:
            reflect_points(n, points, offset, weight, body, ray, fall, True, None, p)
    for r in range(0 if bare else 2 * fan.shape[1]):
        pair, mirrored = r // 2, r % 2 == 1
        ray, weight = (fan[0, pair], -fan[1, pair] if mirrored else fan[1, pair]), fan[2, pair]
        find_ends(n, ray, INVERSE + LANES * U(pair) + (MIRROR if mirrored else U(0)), fall, p)
        if matt > NONE or arena.reflectance.shape[0] > 0:
            find_surfaces(n, arena, pose, ray, p)
        for q in range(many):
            hide_ends(n, robot, arena, pose, points[q], body[0], p)
        if many == 1:
            reflect_point(n, points[0], weight * light, body, ray, fall, None, matt, p)
        elif matt > NONE:
            reflect_points(n, points, offset, weight, body, ray, fall, None, True, p)
        else:
            reflect_points(n, points, offset, weight, body, ray, fall, None, None, p)


@step
def add_reflected(n, robot, arena, pose, sensors, p):
    """Add the light that the rays bring to the sums of the `n` sensors placed."""
    things = arena.cylinders.shape[0] + arena.segments.shape[0] + arena.reflectance.shape[0]
    bare = things + robot.outline.shape[0] == 0 and (
        robot.light.lambertian == 0.0 or count_points(robot) == 1
    )
    if not bare:
        cell = cell_at(arena, pose[0], pose[1])
        cast_rays(n, arena, pose, cell, robot.radius, sensors, FAR, robot.ambient.fan, p, None)
    for lamp in range(arena.lamp_points.shape[0]):
        reflect_lamp(n, robot, arena, pose, lamp, bare, p)


@step
def direct_from(seen, point, p, i, height2):
    """Add a lamp's point, as sensor `i` sees it, to (Σ distance, Σ light, Σ cosine of incidence, number)."""
    ex, ey = point[0] - p[PX + i], point[1] - p[PY + i]
    along, d = ex * p[FX + i] + ey * p[FY + i], root(max(ex * ex + ey * ey + height2, LEAST2))
    there = ONE if (along >= NONE) & (p[point[3] + i] < HALF) else NONE
    return seen[0] + d, seen[1] + point[2] * there, seen[2] + along / d * there, seen[3] + there


@step
def direct_light(seen, share, facing):
    """The light of what a sensor sees of a lamp: its mean cosine of incidence, to a power, times the rest."""
    d, cosine = seen[0] * share, seen[2] / max(seen[3], ONE)
    faced = power(min(max(cosine, NONE), ONE), facing)
    unseen = (seen[3] == NONE) & (facing > NONE)
    return NONE if unseen else max(seen[1], NONE) / (d * d) * faced


@step
def add_direct(n, robot, arena, pose, lamp, p):
    """Add direct light of a lamp to the sums: of its points that are neither hidden nor more than 90° off a
    sensor's direction."""
    points, many = points_of(robot, arena, pose, lamp), count_points(robot)
    offset, height2, facing = f32(arena.lamp_offset[lamp]), f32(robot.light.height2), f32(robot.light.facing)
    for q in range(many):
        for i in range(n):
            p[points[q][3] + i] = NONE
        hide_behind_obstacles(n, arena, pose, points[q][0], points[q][1], PX, PY, points[q][3], p)
    if many == 1:
        for i in range(n):
            seen = direct_from((NONE, offset, NONE, NONE), points[0], p, i, height2)
            p[SUM + i] += direct_light(seen, ONE, facing)
        return
    for i in range(n):
        seen = direct_from((NONE, offset, NONE, NONE), points[0], p, i, height2)
        seen = direct_from(seen, points[1], p, i, height2)
        seen = direct_from(seen, points[2], p, i, height2)
        seen = direct_from(seen, points[3], p, i, height2)
        seen = direct_from(seen, points[4], p, i, height2)
        p[SUM + i] += direct_light(seen, SHARE, facing)


@step
def illuminate(robot, arena, reflecting, pose, p, out):
    """Illumination of all ambient sensors into `out` ([A]), before their gains; `reflecting`: not only direct
    light."""
    for block in range(robot.ambient.rows.shape[0]):
        sensors = robot.ambient.rows[block]
        n = U(sensors.shape[1])
        place_sensors(n, sensors, arena, pose, p)
        for i in range(n):
            p[SUM + i] = NONE
        for lamp in range(arena.lamp_points.shape[0]):
            add_direct(n, robot, arena, pose, lamp, p)
        if reflecting:
            add_reflected(n, robot, arena, pose, sensors, p)
        hand_over(p, block, out)


@step
def ambient(robot, arena, pose, p, out):
    """Noise-free readings of all ambient sensors into `out` ([A], counts, unrounded).

    V = 55 + 1/√A, clipped at the dark reading; or, linear in the light, V = dark − A, clipped at 55; or by
    each sensor's measured curve.
    """
    illuminate(robot, arena, True, pose, p, out)
    if robot.ambient.curve.shape[1] > 0:
        for k in range(out.shape[0]):
            out[k] = apply_curve(robot.ambient.curve, k, robot.ambient.knee, out[k] * robot.ambient.gain[k])
        return
    linear = robot.light.linear > 0.0
    for k in range(out.shape[0]):
        total = out[k] * robot.ambient.gain[k]
        floor = robot.ambient.floor[k]
        dark = robot.ambient.dark[k]
        out[k] = dark
        if linear:
            out[k] = max(dark - total, floor)
        elif total > 0.0:
            out[k] = min(floor + 1.0 / math.sqrt(total), dark)
