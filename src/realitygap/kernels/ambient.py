"""The ambient light sensors (§3.3): direct light, and light reflected by what the rays meet.

What goes beyond the paper (robot.ambient_form, all 0 in the paper) is asked for once a sensor or
once a robot, never once a ray.
"""

import math

import numpy as np

from realitygap.kernels.geometry import GRAZE, circle_blocks, from_segment, see, segment_blocks
from realitygap.kernels.jit import step
from realitygap.kernels.params import LAMP_POINTS, LANES, RAYS
from realitygap.kernels.rng import log

# Places in robot.ambient_form.
LINEAR, FACING, HEIGHT2, FLAT, NEAR, MATT, NARROW, PROUD = 0, 1, 2, 3, 4, 5, 6, 7


@step
def power(x, p):
    """x^p for 0 ≤ x ≤ 1 and p ≥ 0, to about 1e-15: the same bits on every machine; 0 below e⁻⁴⁰."""
    y = p * log(min(max(x, 1e-300), 1.0))
    k = math.floor(y * 1.4426950408889634 + 0.5)
    r = (y - k * 0.6931471803691238) - k * 1.9082149292705877e-10
    t = 1.0
    for i in range(13, 0, -1):
        t = 1.0 + t * r / i
    scale = np.float64(np.int64(1) << np.int64(min(-k, 62)))
    return t / scale if y > -40.0 else 0.0


@step
def lamp_point(arena, lamp, p, narrow, proud):
    """Point `p` of a lamp, drawn towards the lamp's centre by the share `narrow`, and kept `proud` cm off
    the room's walls: both 0 in the paper."""
    x = arena.lamp_points[lamp, p, 0]
    y = arena.lamp_points[lamp, p, 1]
    x = x + narrow * (arena.lamp_centre[lamp, 0] - x)
    y = y + narrow * (arena.lamp_centre[lamp, 1] - y)
    return min(max(x, proud), arena.size[0] - proud), min(max(y, proud), arena.size[1] - proud)


@step
def light_on_surfaces(robot, arena, lamp, height2, narrow, proud, work):
    """Direct illumination D_ij of the points where the rays end, by one lamp, into work.light.

    D = (offset + Σ L_i k_i) / d², d the mean distance to the lamp's points; never below 0.
    """
    x, y = work.pose[0], work.pose[1]
    for i in range(work.light.shape[0]):
        work.light[i] = arena.lamp_offset[lamp]
        work.far[i] = 0.0
    for p in range(LAMP_POINTS):
        lx, ly = lamp_point(arena, lamp, p, narrow, proud)
        weight = arena.lamp_weights[lamp, p]
        for i in range(work.light.shape[0]):
            ex = lx - work.end_x[i]
            ey = ly - work.end_y[i]
            work.far[i] += math.sqrt(ex * ex + ey * ey + height2)
            hidden = circle_blocks(x - work.end_x[i], y - work.end_y[i], ex, ey, robot.radius)
            work.hidden[i] = hidden
        hide_behind_obstacles(arena, lx, ly, work)
        for i in range(work.light.shape[0]):
            work.light[i] += weight * (1.0 - work.hidden[i])
    for i in range(work.light.shape[0]):
        d = work.far[i] * (1.0 / LAMP_POINTS)
        work.light[i] = max(work.light[i], 0.0) / (d * d)


@step
def hide_behind_obstacles(arena, lx, ly, work):
    """Mark the ray ends that cylinders and inner walls keep from the lamp point (lx, ly)."""
    for j in range(arena.cylinders.shape[0]):
        cx = arena.cylinders[j, 0]
        cy = arena.cylinders[j, 1]
        radius = arena.cylinders[j, 2]
        for i in range(work.light.shape[0]):
            hx = work.end_x[i]
            hy = work.end_y[i]
            hidden = circle_blocks(cx - hx, cy - hy, lx - hx, ly - hy, radius)
            work.hidden[i] = max(work.hidden[i], hidden)
    for j in range(arena.segments.shape[0]):
        for i in range(work.light.shape[0]):
            hx = work.end_x[i]
            hy = work.end_y[i]
            hidden = segment_blocks(arena, j, hx, hy, lx - hx, ly - hy)
            work.hidden[i] = max(work.hidden[i], hidden)


@step
def light_on_sensor(arena, lamp, px, py, fx, fy):
    """Direct illumination D_i of a sensor at (px, py) facing (fx, fy), by one lamp.

    A point of the lamp more than 90° off the sensor's direction is behind the robot's own body.
    """
    total = arena.lamp_offset[lamp]
    far = 0.0
    for p in range(LAMP_POINTS):
        ex = arena.lamp_points[lamp, p, 0] - px
        ey = arena.lamp_points[lamp, p, 1] - py
        far += math.sqrt(ex * ex + ey * ey)
        hidden = 0.0 if ex * fx + ey * fy >= 0.0 else 1.0
        for j in range(arena.cylinders.shape[0]):
            wx = arena.cylinders[j, 0] - px
            wy = arena.cylinders[j, 1] - py
            hidden = max(hidden, circle_blocks(wx, wy, ex, ey, arena.cylinders[j, 2]))
        for j in range(arena.segments.shape[0]):
            hidden = max(hidden, segment_blocks(arena, j, px, py, ex, ey))
        total += arena.lamp_weights[lamp, p] * (1.0 - hidden)
    d = max(far * (1.0 / LAMP_POINTS), 1e-3)
    return max(total, 0.0) / (d * d)


@step
def light_under_an_angle(robot, arena, lamp, px, py, fx, fy):
    """As light_on_sensor, from a lamp at a height, times the mean cosine of its visible points^p."""
    height2 = robot.ambient_form[HEIGHT2]
    total = arena.lamp_offset[lamp]
    ahead = 0.0
    seen = 0.0
    far = 0.0
    for p in range(LAMP_POINTS):
        lx, ly = lamp_point(arena, lamp, p, robot.ambient_form[NARROW], robot.ambient_form[PROUD])
        ex = lx - px
        ey = ly - py
        d = max(math.sqrt(ex * ex + ey * ey + height2), 1e-3)
        far += d
        cosine = (ex * fx + ey * fy) / d
        hidden = 0.0 if cosine >= 0.0 else 1.0
        for j in range(arena.cylinders.shape[0]):
            wx = arena.cylinders[j, 0] - px
            wy = arena.cylinders[j, 1] - py
            hidden = max(hidden, circle_blocks(wx, wy, ex, ey, arena.cylinders[j, 2]))
        for j in range(arena.segments.shape[0]):
            hidden = max(hidden, segment_blocks(arena, j, px, py, ex, ey))
        total += arena.lamp_weights[lamp, p] * (1.0 - hidden)
        ahead += (1.0 - hidden) * cosine
        seen += 1.0 - hidden
    d = far * (1.0 / LAMP_POINTS)
    return max(total, 0.0) / (d * d) * power(ahead / max(seen, 1.0), robot.ambient_form[FACING])


@step
def follow_rays(robot, arena, fans, work):
    """Where the rays of all ambient sensors end, and the weight of the light reflected there.

    All rays lie in one row, RAYS a sensor; a sensor's pad lanes are overwritten by the next one's
    rays. Weights: 1.5 cos² β / d². Ends are drawn back by GRAZE, off their own wall.
    """
    x, y, c, s = work.pose[0], work.pose[1], work.pose[3], work.pose[4]
    for k in range(robot.ambient_place.shape[0]):
        px = x + c * robot.ambient_place[k, 0] - s * robot.ambient_place[k, 1]
        py = y + s * robot.ambient_place[k, 0] + c * robot.ambient_place[k, 1]
        for fan in range(k * fans, (k + 1) * fans):
            a, b = fan * RAYS, fan * RAYS + LANES
            ray_x, ray_y, inverse = work.ray_x[a:b], work.ray_y[a:b], work.inverse[a:b]
            see(arena, robot.ambient_ray, fan, px, py, c, s, ray_x, ray_y, inverse)
            for i in range(RAYS):
                work.end_x[a + i] = px
                work.end_y[a + i] = py
                work.terms[a + i] = robot.ambient_weight[fan, i]
    for i in range(work.light.shape[0]):
        d = (1.0 - GRAZE) / work.inverse[i]
        work.end_x[i] += work.ray_x[i] * d
        work.end_y[i] += work.ray_y[i] * d
    if robot.ambient_form[FLAT] > 0.0:
        near = robot.ambient_form[NEAR]
        for i in range(work.light.shape[0]):
            work.terms[i] *= work.inverse[i] / (1.0 + near * work.inverse[i])
    else:
        for i in range(work.light.shape[0]):
            work.terms[i] *= work.inverse[i] * work.inverse[i]


@step
def find_normals(arena, work):
    """The surfaces' normals, towards the robot's side, where the rays end: of whatever is nearest there."""
    for i in range(work.light.shape[0]):
        ex = work.end_x[i]
        ey = work.end_y[i]
        near = ex
        nx = 1.0
        ny = 0.0
        if arena.size[0] - ex < near:
            near = arena.size[0] - ex
            nx = -1.0
        if ey < near:
            near = ey
            nx = 0.0
            ny = 1.0
        if arena.size[1] - ey < near:
            near = arena.size[1] - ey
            nx = 0.0
            ny = -1.0
        for j in range(arena.cylinders.shape[0]):
            dx = ex - arena.cylinders[j, 0]
            dy = ey - arena.cylinders[j, 1]
            d = math.sqrt(dx * dx + dy * dy)
            if abs(d - arena.cylinders[j, 2]) < near:
                near = abs(d - arena.cylinders[j, 2])
                nx = dx / max(d, 1e-12)
                ny = dy / max(d, 1e-12)
        for j in range(arena.segments.shape[0]):
            dx, dy = from_segment(arena, j, ex, ey)
            d = math.sqrt(dx * dx + dy * dy)
            if d < near:
                near = d
                ax = arena.segments[j, 2] - arena.segments[j, 0]
                ay = arena.segments[j, 3] - arena.segments[j, 1]
                length = max(math.sqrt(ax * ax + ay * ay), 1e-12)
                side = -1.0 if ay * work.ray_x[i] - ax * work.ray_y[i] > 0.0 else 1.0
                nx = side * ay / length
                ny = -side * ax / length
        work.normal_x[i] = nx
        work.normal_y[i] = ny


@step
def lean(robot, arena, lamp, work):
    """Weaken work.light by the mean cosine under which the lamp's points light each surface."""
    height2 = robot.ambient_form[HEIGHT2]
    for i in range(work.light.shape[0]):
        work.far[i] = 0.0
    for p in range(LAMP_POINTS):
        lx, ly = lamp_point(arena, lamp, p, robot.ambient_form[NARROW], robot.ambient_form[PROUD])
        for i in range(work.light.shape[0]):
            ex = lx - work.end_x[i]
            ey = ly - work.end_y[i]
            d = max(math.sqrt(ex * ex + ey * ey + height2), 1e-3)
            work.far[i] += max(ex * work.normal_x[i] + ey * work.normal_y[i], 0.0) / d
    for i in range(work.light.shape[0]):
        work.light[i] *= work.far[i] * (1.0 / LAMP_POINTS)


@step
def look(robot, k, work):
    """Place and direction of ambient sensor `k` in the room: (px, py, fx, fy)."""
    x, y, c, s = work.pose[0], work.pose[1], work.pose[3], work.pose[4]
    px = x + c * robot.ambient_place[k, 0] - s * robot.ambient_place[k, 1]
    py = y + s * robot.ambient_place[k, 0] + c * robot.ambient_place[k, 1]
    fx = c * robot.ambient_facing[k, 0] - s * robot.ambient_facing[k, 1]
    fy = s * robot.ambient_facing[k, 0] + c * robot.ambient_facing[k, 1]
    return px, py, fx, fy


@step
def direct_light(robot, arena, lamp, k, work):
    """Direct illumination D_k of ambient sensor `k` by one lamp, whatever the law."""
    px, py, fx, fy = look(robot, k, work)
    form = robot.ambient_form
    if form[FACING] + form[HEIGHT2] + form[NARROW] + form[PROUD] > 0.0:
        return light_under_an_angle(robot, arena, lamp, px, py, fx, fy)
    return light_on_sensor(arena, lamp, px, py, fx, fy)


@step
def reflected_light(a, work):
    """Σ_j D_ij cos² β_ij · 1.5 / d_ij² over a fan's rays from lane `a`, outermost pairs first."""
    t = work.far[a : a + RAYS]
    for i in range(RAYS):
        t[i] = work.light[a + i] * work.terms[a + i]
    return (t[0] + t[9]) + (t[1] + t[8]) + ((t[2] + t[7]) + (t[3] + t[6])) + (t[4] + t[5])


@step
def illuminate(robot, arena, work, out):
    """Illumination of all ambient sensors into `out`: A_i = D_i + Σ_j D_ij cos² β_ij · 1.5 / d_ij².

    The paper's law has a path of its own, which pays nothing for what goes beyond it.
    """
    for k in range(out.shape[0]):
        out[k] = 0.0
    if goes_beyond(robot):
        illuminate_beyond(robot, arena, work, out)
        return
    follow_rays(robot, arena, 1, work)
    for lamp in range(arena.lamp_points.shape[0]):
        light_on_surfaces(robot, arena, lamp, 0.0, 0.0, 0.0, work)
        for k in range(out.shape[0]):
            px, py, fx, fy = look(robot, k, work)
            out[k] += light_on_sensor(arena, lamp, px, py, fx, fy) + reflected_light(k * RAYS, work)


@step
def goes_beyond(robot):
    """Whether anything but the paper's law decides the illumination."""
    total = 0.0
    for i in range(FACING, PROUD + 1):
        total += robot.ambient_form[i]
    return total > 0.0 or robot.ambient_ray.shape[0] > robot.ambient_place.shape[0]


@step
def illuminate_beyond(robot, arena, work, out):
    """As illuminate, with everything that robot.ambient_form asks for."""
    form = robot.ambient_form
    fans = robot.ambient_ray.shape[0] // max(robot.ambient_place.shape[0], 1)
    follow_rays(robot, arena, fans, work)
    find_normals(arena, work)
    for lamp in range(arena.lamp_points.shape[0]):
        light_on_surfaces(robot, arena, lamp, form[HEIGHT2], form[NARROW], form[PROUD], work)
        if form[MATT] > 0.0:
            lean(robot, arena, lamp, work)
        for k in range(out.shape[0]):
            total = direct_light(robot, arena, lamp, k, work)
            for fan in range(k * fans, (k + 1) * fans):
                total += reflected_light(fan * RAYS, work)
            out[k] += total


@step
def ambient(robot, arena, work, out):
    """Noise-free readings of all ambient sensors into `out` ([A], counts, unrounded).

    V = 55 + 1/√A, clipped at the dark reading; or, linear in the light, V = dark − A, clipped at 55.
    """
    illuminate(robot, arena, work, out)
    linear = robot.ambient_form[LINEAR] > 0.0
    for k in range(out.shape[0]):
        total = out[k] * robot.ambient_gain[k]
        floor = robot.ambient_range[k, 0]
        dark = robot.ambient_range[k, 1]
        out[k] = dark
        if linear:
            out[k] = max(dark - total, floor)
        elif total > 0.0:
            out[k] = min(floor + 1.0 / math.sqrt(total), dark)
