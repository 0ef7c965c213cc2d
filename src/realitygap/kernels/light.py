"""How light travels in the room (§3.3): from lamps to surfaces and sensors, and off the surfaces."""

import math
from typing import NamedTuple

from realitygap.kernels.geometry import (
    GRAZE,
    Rays,
    Spot,
    circle_blocks,
    covers,
    is_tinted,
    see,
    segment_blocks,
    tint,
)
from realitygap.kernels.jit import step
from realitygap.kernels.params import LAMP_POINTS, LANES, NARROW, RAYS


class View(NamedTuple):
    """Place and direction of an ambient sensor in the room."""

    x: float
    y: float
    ahead_x: float
    ahead_y: float


@step
def look(robot, k, work):
    """The view of ambient sensor `k`."""
    x, y, c, s = work.pose[0], work.pose[1], work.pose[3], work.pose[4]
    px = x + c * robot.ambient_place[k, 0] - s * robot.ambient_place[k, 1]
    py = y + s * robot.ambient_place[k, 0] + c * robot.ambient_place[k, 1]
    fx = c * robot.ambient_facing[k, 0] - s * robot.ambient_facing[k, 1]
    fy = s * robot.ambient_facing[k, 0] + c * robot.ambient_facing[k, 1]
    return View(px, py, fx, fy)


@step
def light_on_surfaces(robot, arena, lamp, work):
    """Direct illumination D_ij of the points where the rays end, by one lamp, into work.light.

    D = (offset + Σ L_i k_i) / d², d the mean distance to the lamp's points; never below 0.
    """
    x, y = work.pose[0], work.pose[1]
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
        if covers(x - lx, y - ly, robot.radius):
            work.hidden[:] = 1.0
        if robot.outline.shape[0] > 0:
            hide_behind_outline(robot, (lx, ly, 1.0), 0, work.light.shape[0], work)
        hide_behind_obstacles(arena, lx, ly, 0, work.light.shape[0], work)
        for i in range(work.light.shape[0]):
            work.light[i] += weight * (1.0 - work.hidden[i])
    for i in range(work.light.shape[0]):
        d = work.far[i] * (1.0 / LAMP_POINTS)
        work.light[i] = max(work.light[i], 0.0) / (d * d)


@step
def hide_behind_outline(robot, light, a, b, work):
    """Mark anew, of the ray ends from lane `a` to `b`, those that a polygon keeps from a lamp's point.

    `light`: the point's x and y, and the share of the way there that is below the body's top. A line meets a
    convex body unless it lies beyond one of its edges, or all corners lie on one side of the line.
    """
    lx, ly, low = light
    outline = robot.outline
    x, y, c, s = work.pose[0], work.pose[1], work.pose[3], work.pose[4]
    end_x, end_y, hidden = work.end_x[a:b], work.end_y[a:b], work.hidden[a:b]
    for i in range(b - a):
        wx, wy, ex, ey = end_x[i] - x, end_y[i] - y, low * (lx - end_x[i]), low * (ly - end_y[i])
        wx, wy, ex, ey = c * wx + s * wy, c * wy - s * wx, c * ex + s * ey, c * ey - s * ex
        left, right, beyond = False, False, False
        for k in range(outline.shape[0]):
            dx, dy = wx - outline[k, 0], wy - outline[k, 1]
            side = ey * dx - ex * dy
            left, right = left or side >= 0.0, right or side <= 0.0
            near = dx * outline[k, 2] + dy * outline[k, 3]
            far = near + ex * outline[k, 2] + ey * outline[k, 3]
            beyond = beyond or min(near, far) >= 0.0
        hidden[i] = 1.0 if left and right and not beyond else 0.0


@step
def hide_behind_obstacles(arena, lx, ly, a, b, work):
    """Mark the ray ends from lane `a` to `b` that obstacles keep from a lamp's point (lx, ly)."""
    end_x, end_y, hidden = work.end_x[a:b], work.end_y[a:b], work.hidden[a:b]
    for j in range(arena.cylinders.shape[0]):
        cx = arena.cylinders[j, 0]
        cy = arena.cylinders[j, 1]
        radius = arena.cylinders[j, 2]
        for i in range(b - a):
            hx = end_x[i]
            hy = end_y[i]
            hidden[i] = max(hidden[i], circle_blocks(cx - hx, cy - hy, lx - hx, ly - hy, radius))
        if covers(cx - lx, cy - ly, radius):
            hidden[:] = 1.0
    for j in range(arena.segments.shape[0]):
        for i in range(b - a):
            hx = end_x[i]
            hy = end_y[i]
            hidden[i] = max(hidden[i], segment_blocks(arena, j, hx, hy, lx - hx, ly - hy))


@step
def obstacles_hide(arena, px, py, lx, ly):
    """1.0 if an obstacle keeps a sensor at (px, py) from a lamp's point (lx, ly)."""
    ex = lx - px
    ey = ly - py
    hidden = 0.0
    for j in range(arena.cylinders.shape[0]):
        cx = arena.cylinders[j, 0]
        cy = arena.cylinders[j, 1]
        radius = arena.cylinders[j, 2]
        blocked = circle_blocks(cx - px, cy - py, ex, ey, radius)
        hidden = max(hidden, 1.0 if covers(cx - lx, cy - ly, radius) else blocked)
    for j in range(arena.segments.shape[0]):
        hidden = max(hidden, segment_blocks(arena, j, px, py, ex, ey))
    return hidden


@step
def light_on_sensor(arena, lamp, view):
    """Direct illumination D_i of a sensor, by one lamp.

    A point of the lamp more than 90° off the sensor's direction is behind the robot's own body.
    """
    total = arena.lamp_offset[lamp]
    far = 0.0
    for p in range(LAMP_POINTS):
        lx = arena.lamp_points[lamp, p, 0]
        ly = arena.lamp_points[lamp, p, 1]
        ex = lx - view.x
        ey = ly - view.y
        far += math.sqrt(ex * ex + ey * ey)
        hidden = 0.0 if ex * view.ahead_x + ey * view.ahead_y >= 0.0 else 1.0
        hidden = max(hidden, obstacles_hide(arena, view.x, view.y, lx, ly))
        total += arena.lamp_weights[lamp, p] * (1.0 - hidden)
    d = max(far * (1.0 / LAMP_POINTS), 1e-3)
    return max(total, 0.0) / (d * d)


@step
def follow_fan(robot, arena, k, fan, work):
    """Where the rays of one fan of ambient sensor `k` end, as 1/d, and their weights, from lane fan·RAYS.

    A fan's pad lanes are overwritten by the next one's rays.
    """
    x, y, c, s = work.pose[0], work.pose[1], work.pose[3], work.pose[4]
    px = x + c * robot.ambient_place[k, 0] - s * robot.ambient_place[k, 1]
    py = y + s * robot.ambient_place[k, 0] + c * robot.ambient_place[k, 1]
    a, b = fan * RAYS, fan * RAYS + LANES
    rays = Rays(work.ray_x[a:b], work.ray_y[a:b], work.inverse[a:b], work.incidence[a:b], NARROW)
    see(arena, robot.ambient_ray, fan, Spot(px, py, c, s), rays, None)
    for i in range(RAYS):
        work.end_x[a + i] = px
        work.end_y[a + i] = py
        work.terms[a + i] = robot.ambient_weight[fan, i]
    if is_tinted(arena):
        tint(arena, Spot(px, py, c, s), rays, 0.0)
        for i in range(RAYS):
            work.terms[a + i] *= rays.incidence[i]


@step
def go_to_ends(a, b, work):
    """Where the rays from lane `a` to `b` end: drawn back by GRAZE, off their own wall."""
    ray_x, ray_y, inverse = work.ray_x[a:b], work.ray_y[a:b], work.inverse[a:b]
    end_x, end_y = work.end_x[a:b], work.end_y[a:b]
    for i in range(b - a):
        d = (1.0 - GRAZE) / inverse[i]
        end_x[i] += ray_x[i] * d
        end_y[i] += ray_y[i] * d


@step
def follow_rays(robot, arena, work):
    """Where the rays of all ambient sensors end, and the weight of the light reflected there.

    All rays lie in one row, RAYS a sensor. Weights: 1.5 cos² β / d², times the surface's reflectance.
    """
    for k in range(robot.ambient_place.shape[0]):
        follow_fan(robot, arena, k, k, work)
    go_to_ends(0, work.light.shape[0], work)
    for i in range(work.light.shape[0]):
        work.terms[i] *= work.inverse[i] * work.inverse[i]


@step
def reflected_light(a, work):
    """Σ_j D_ij cos² β_ij · 1.5 / d_ij² over a fan's rays from lane `a`, outermost pairs first."""
    t = work.far[a : a + RAYS]
    for i in range(RAYS):
        t[i] = work.light[a + i] * work.terms[a + i]
    return (t[0] + t[9]) + (t[1] + t[8]) + ((t[2] + t[7]) + (t[3] + t[6])) + (t[4] + t[5])
