"""Light beyond the paper's law (§3.3): what a calibration may fit, all neutral in the paper.

It is asked for once a sensor or once a robot, never once a ray.
"""

import math

import numpy as np

from realitygap.kernels.geometry import circle_blocks, from_segment, segment_blocks
from realitygap.kernels.jit import step
from realitygap.kernels.light import (
    FACING,
    HEIGHT2,
    MATT,
    NARROW,
    PROUD,
    follow_rays,
    lamp_point,
    light_on_sensor,
    light_on_surfaces,
    look,
    reflected_light,
)
from realitygap.kernels.params import LAMP_POINTS, RAYS
from realitygap.kernels.rng import log


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
def goes_beyond(robot):
    """Whether anything but the paper's law decides the illumination."""
    total = 0.0
    for i in range(FACING, PROUD + 1):
        total += robot.ambient_form[i]
    return total > 0.0 or robot.ambient_ray.shape[0] > robot.ambient_place.shape[0]


@step
def direct_light(robot, arena, lamp, k, work):
    """Direct illumination D_k of ambient sensor `k` by one lamp, whatever the law."""
    px, py, fx, fy = look(robot, k, work)
    form = robot.ambient_form
    if form[FACING] + form[HEIGHT2] + form[NARROW] + form[PROUD] > 0.0:
        return light_under_an_angle(robot, arena, lamp, px, py, fx, fy)
    return light_on_sensor(arena, lamp, px, py, fx, fy)


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
