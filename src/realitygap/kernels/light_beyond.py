"""Extensions of the paper's light model (§3.3) that a calibration may fit, all neutral in the paper.

Computed sensor by sensor, since one that the lamp alone brings to its floor needs no reflections.
"""

import math

import numpy as np

from realitygap.kernels.jit import apart, step
from realitygap.kernels.light import (
    first_sensor,
    follow_sensor,
    go_to_ends,
    hide_behind_obstacles,
    hide_behind_outline,
    light_on_places,
    ray_count,
    rays_of_fan,
    reflected_light,
    stand_by_sensors,
)
from realitygap.kernels.near import from_segment
from realitygap.kernels.params import LAMP_POINTS
from realitygap.kernels.rng import log
from realitygap.kernels.shade import circle_blocks, covers
from realitygap.kernels.work import whole_vectors

SERIES = tuple(1.0 / math.factorial(i) for i in range(13, -1, -1))
"""Coefficients of eˣ, the highest power first."""


@step
def power(x, p):
    """x^p for 0 ≤ x ≤ 1 and p ≥ 0, to about 1e-15: the same bits on every machine; 0 below e⁻⁴⁰."""
    y = p * log(min(max(x, 1e-300), 1.0))
    k = math.floor(y * 1.4426950408889634 + 0.5)
    r = (y - k * 0.6931471803691238) - k * 1.9082149292705877e-10
    t = SERIES[0]
    for i in range(1, len(SERIES)):
        t = t * r + SERIES[i]
    scale = np.float64(np.int64(1) << np.int64(min(-k, 62)))
    return t / scale if y > -40.0 else 0.0


@step
def lamp_points(robot):
    """Number of distinct points of a lamp."""
    return 1 if robot.light_narrow >= 1.0 else LAMP_POINTS


@step
def lamp_point(robot, arena, lamp, p):
    """Position (x, y) and weight of a lamp's point `p`: moved towards the lamp's centre by the share
    `narrow`, and kept `wall_offset` cm off the room's walls. A lamp of one point has all the weight."""
    narrow, off = robot.light_narrow, robot.light_wall_offset
    x = arena.lamp_points[lamp, p, 0]
    y = arena.lamp_points[lamp, p, 1]
    weight = arena.lamp_weights[lamp, p]
    if narrow >= 1.0:
        x = arena.lamp_centre[lamp, 0]
        y = arena.lamp_centre[lamp, 1]
        for q in range(1, LAMP_POINTS):
            weight += arena.lamp_weights[lamp, q]
    x = x + narrow * (arena.lamp_centre[lamp, 0] - x)
    y = y + narrow * (arena.lamp_centre[lamp, 1] - y)
    x = min(max(x, off), arena.size[0] - off)
    y = min(max(y, off), arena.size[1] - off)
    return x, y, weight


@step
def light_under_an_angle(robot, arena, lamp, work):
    """As light_on_places for the sensors, with a lamp at a height, times its visible points' cosine^p."""
    a, b, points = first_sensor(robot, work), work.light.shape[0], lamp_points(robot)
    end_x, end_y, ray_x, ray_y = work.end_x[a:b], work.end_y[a:b], work.ray_x[a:b], work.ray_y[a:b]
    light, far, hidden, cosine = work.light[a:], work.far[a:b], work.hidden[a:b], work.incidence[a:b]
    ahead, seen = work.normal_x[a:b], work.normal_y[a:b]
    for i in range(b - a):
        light[i] = arena.lamp_offset[lamp]
        far[i] = ahead[i] = seen[i] = 0.0
    for p in range(points):
        lx, ly, weight = lamp_point(robot, arena, lamp, p)
        for i in range(b - a):
            ex = lx - end_x[i]
            ey = ly - end_y[i]
            d = max(math.sqrt(ex * ex + ey * ey + robot.light_height2), 1e-3)
            far[i] += d
            cosine[i] = (ex * ray_x[i] + ey * ray_y[i]) / d
            hidden[i] = 0.0 if cosine[i] >= 0.0 else 1.0
        hide_behind_obstacles(arena, lx, ly, a, b, work)
        for i in range(b - a):
            light[i] += weight * (1.0 - hidden[i])
            ahead[i] += (1.0 - hidden[i]) * cosine[i]
            seen[i] += 1.0 - hidden[i]
    for i in range(b - a):
        d = far[i] / points
        faced = power(ahead[i] / max(seen[i], 1.0), robot.light_facing)
        unseen = (seen[i] == 0.0) & (robot.light_facing > 0.0)
        light[i] = 0.0 if unseen else max(light[i], 0.0) / (d * d) * faced


@step
def find_normals(arena, a, b, work):
    """Normals, towards the robot's side, of the surfaces where the rays from lane `a` to `b` end: of whatever
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
    face_segments(arena, a, b, work)


@step
def face_segments(arena, a, b, work):
    """Among the rays from lane `a` to `b`, the normals of those that end on an inner wall."""
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
def look_round(robot, arena, count, work):
    """Follow all rays of the first `count` sensors of work.listed, side by side in one row, and set the
    weights of the light reflected there by the robot's model; returns the row's length and each sensor's
    part."""
    each = ray_count(work) // max(robot.ambient_place.shape[0], 1)
    n = whole_vectors(count * each)
    for m in range(count):
        follow_sensor(robot, arena, work.listed[m], m * each, (m + 1) * each, work)
    go_to_ends(0, n, work)
    terms, inverse = work.terms[:n], work.inverse[:n]
    if robot.light_flat > 0.0:
        near = robot.light_near
        for i in range(n):
            close = near * inverse[i]
            terms[i] *= inverse[i] / math.sqrt(1.0 + close * close)
    else:
        for i in range(n):
            terms[i] *= inverse[i] * inverse[i]
    if robot.light_lambertian > 0.0:
        find_normals(arena, 0, n, work)
    return n, each


@step
def light_walls(robot, arena, lamp, a, b, work):
    """As light_on_surfaces for lanes `a` to `b`, from a lamp at a height; on a Lambertian surface times the
    mean cosine of incidence of the lamp's points."""
    end_x, end_y, normal_x = work.end_x[a:b], work.end_y[a:b], work.normal_x[a:b]
    normal_y, light, far = work.normal_y[a:b], work.light[a:b], work.far[a:b]
    incidence, hidden = work.incidence[a:b], work.hidden[a:b]
    x, y = work.pose[0], work.pose[1]
    points = lamp_points(robot)
    low = 1.0 - robot.light_clear
    for i in range(b - a):
        light[i] = arena.lamp_offset[lamp]
        far[i] = 0.0
        incidence[i] = 0.0
    for p in range(points):
        lx, ly, weight = lamp_point(robot, arena, lamp, p)
        for i in range(b - a):
            ex = lx - end_x[i]
            ey = ly - end_y[i]
            d = max(math.sqrt(ex * ex + ey * ey + robot.light_height2), 1e-3)
            far[i] += d
            incidence[i] += max(ex * normal_x[i] + ey * normal_y[i], 0.0) / d
            # Above the body's top nothing is hidden: the line ends there.
            wx, wy, ex, ey = x - end_x[i], y - end_y[i], low * ex, low * ey
            under = 1.0 if covers(wx - ex, wy - ey, robot.radius) else 0.0
            hidden[i] = max(circle_blocks(wx, wy, ex, ey, robot.radius), under)
        if robot.outline.shape[0] > 0:
            hide_behind_outline(robot, (lx, ly, low), a, b, work)
        hide_behind_obstacles(arena, lx, ly, a, b, work)
        for i in range(b - a):
            light[i] += weight * (1.0 - hidden[i])
    if points > 1:
        for i in range(b - a):
            far[i] /= points
            incidence[i] /= points
    lambertian = robot.light_lambertian > 0.0
    for i in range(b - a):
        cosine = incidence[i] if lambertian else 1.0
        light[i] = max(light[i], 0.0) / (far[i] * far[i]) * cosine


@apart
def direct_light(robot, arena, work, out):
    """Direct illumination of all ambient sensors by all lamps into `out`, in any model."""
    stand_by_sensors(robot, work)
    sensors = first_sensor(robot, work)
    beyond = robot.light_facing + robot.light_height2 + robot.light_narrow + robot.light_wall_offset > 0.0
    for k in range(out.shape[0]):
        out[k] = 0.0
    for lamp in range(arena.lamp_points.shape[0]):
        if beyond:
            light_under_an_angle(robot, arena, lamp, work)
        else:
            light_on_places(robot, arena, lamp, sensors, work)
        for k in range(out.shape[0]):
            out[k] += work.light[sensors + k]


@step
def goes_beyond(robot):
    """Whether any extension of the paper's model affects the illumination."""
    direct = robot.light_facing + robot.light_height2 + robot.light_narrow + robot.light_wall_offset
    reflected = robot.light_flat + robot.light_near + robot.light_lambertian
    return direct + reflected > 0.0 or robot.ambient_ray.shape[0] > robot.ambient_place.shape[0]


@apart
def illuminate_beyond(robot, arena, enough, work, out):
    """As illuminate, with all extensions.

    With `enough`, a sensor that the lamps alone bring to its floor gets only that light.
    """
    direct_light(robot, arena, work, out)
    count, used = 0, rays_of_fan(robot, work)
    for k in range(out.shape[0]):
        work.listed[count] = k
        count += 0 if enough and out[k] * robot.ambient_gain[k] >= robot.ambient_full[k] else 1
    n, each = look_round(robot, arena, count, work)
    for lamp in range(arena.lamp_points.shape[0]):
        light_walls(robot, arena, lamp, 0, n, work)
        for m in range(count):
            for a in range(m * each, (m + 1) * each, used):
                out[work.listed[m]] += reflected_light(a, a + used, work)
