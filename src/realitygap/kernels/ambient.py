"""The ambient light sensors (§3.3): direct light, and light reflected by what the rays meet."""

import math

from realitygap.kernels.geometry import GRAZE, circle_blocks, see, segment_blocks, turn_rays
from realitygap.kernels.jit import step
from realitygap.kernels.params import LAMP_POINTS, LANES


@step
def light_on_surfaces(robot, arena, lamp, x, y, work):
    """Direct illumination D_ij of the points where the rays end, by one lamp, into work.light.

    D = (offset + Σ L_i k_i) / d², d the mean distance to the lamp's points; never below 0.
    """
    for i in range(work.light.shape[0]):
        work.light[i] = arena.lamp_offset[lamp]
        work.far[i] = 0.0
    for p in range(LAMP_POINTS):
        lx = arena.lamp_points[lamp, p, 0]
        ly = arena.lamp_points[lamp, p, 1]
        weight = arena.lamp_weights[lamp, p]
        for i in range(work.light.shape[0]):
            ex = lx - work.end_x[i]
            ey = ly - work.end_y[i]
            work.far[i] += math.sqrt(ex * ex + ey * ey)
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
def follow_rays(robot, arena, k, px, py, c, s, work):
    """Where the rays of ambient sensor `k` end, and the weight of the light reflected there.

    Weights: 1.5 cos² β / d², into work.terms. Ends are drawn back by GRAZE, off their own wall.
    """
    turn_rays(robot.ambient_ray, k, c, s, work.ray_x, work.ray_y)
    see(arena, px, py, work.ray_x, work.ray_y, work.inverse)
    for i in range(work.light.shape[0]):
        d = (1.0 - GRAZE) / work.inverse[i]
        work.end_x[i] = px + work.ray_x[i] * d
        work.end_y[i] = py + work.ray_y[i] * d
        work.terms[i] = robot.ambient_weight[k, i] * (work.inverse[i] * work.inverse[i])


@step
def illumination(robot, arena, k, work):
    """A_i = D_i + Σ_j D_ij cos² β_ij · 1.5 / d_ij² of ambient sensor `k`, over all lamps."""
    x, y, c, s = work.pose[0], work.pose[1], work.pose[3], work.pose[4]
    px = x + c * robot.ambient_place[k, 0] - s * robot.ambient_place[k, 1]
    py = y + s * robot.ambient_place[k, 0] + c * robot.ambient_place[k, 1]
    fx = c * robot.ambient_facing[k, 0] - s * robot.ambient_facing[k, 1]
    fy = s * robot.ambient_facing[k, 0] + c * robot.ambient_facing[k, 1]
    follow_rays(robot, arena, k, px, py, c, s, work)
    total = 0.0
    for lamp in range(arena.lamp_points.shape[0]):
        light_on_surfaces(robot, arena, lamp, x, y, work)
        t = work.far
        for i in range(work.light.shape[0]):
            t[i] = work.light[i] * work.terms[i]
        indirect = (t[0] + t[9]) + (t[1] + t[8])
        indirect = indirect + ((t[2] + t[7]) + (t[3] + t[6])) + (t[4] + t[5])
        total += light_on_sensor(arena, lamp, px, py, fx, fy) + indirect
    return total * robot.ambient_gain[k]


@step
def ambient(robot, arena, work, out):
    """Noise-free readings of all ambient sensors into `out` ([A], counts, unrounded).

    V = 55 + 1/√A, clipped at the dark reading.
    """
    floor = robot.ambient_law[0]
    dark = robot.ambient_law[1]
    for k in range(robot.ambient_place.shape[0]):
        total = illumination(robot, arena, k, work)
        out[k] = dark
        if total > 0.0:
            out[k] = min(floor + 1.0 / math.sqrt(total), dark)
