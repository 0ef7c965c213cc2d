"""Propagation of light in the room (§3.3): from lamps to surfaces and sensors, and reflected off surfaces."""

import math
from typing import NamedTuple

from realitygap.kernels.geometry import GRAZE, Rays, Spot, added, is_bare, is_tinted, see, see_room, tint
from realitygap.kernels.jit import step
from realitygap.kernels.params import LAMP_POINTS, LANES, NARROW, RAYS
from realitygap.kernels.shade import circle_blocks, covers, segment_blocks
from realitygap.kernels.work import whole_vectors


class View(NamedTuple):
    """Position and direction of an ambient sensor in the room."""

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
def first_sensor(robot, work):
    """The lane of the first ambient sensor: they come after all rays."""
    return work.light.shape[0] - whole_vectors(robot.ambient_place.shape[0])


@step
def stand_by_sensors(robot, work):
    """Store the ambient sensors' positions and directions as ends and rays of their lanes."""
    a = first_sensor(robot, work)
    for k in range(robot.ambient_place.shape[0]):
        view = look(robot, k, work)
        work.end_x[a + k] = view.x
        work.end_y[a + k] = view.y
        work.ray_x[a + k] = view.ahead_x
        work.ray_y[a + k] = view.ahead_y


@step
def light_on_places(robot, arena, lamp, first, work):
    """Direct illumination by one lamp into work.light, from lane `first`: D_ij of the points where the rays
    end, D_i of the sensors.

    D = (offset + Σ L_i k_i) / d², d the mean distance to the lamp's points; never below 0. The robot's own
    body shades surfaces behind it, and a sensor from lamps more than 90° off its direction.
    """
    x, y, n, sensors = work.pose[0], work.pose[1], work.light.shape[0], first_sensor(robot, work)
    light, far, hidden = work.light[first:], work.far[first:n], work.hidden[first:n]
    end_x, end_y, ray_x, ray_y = (
        work.end_x[first:n],
        work.end_y[first:n],
        work.ray_x[first:n],
        work.ray_y[first:n],
    )
    for i in range(light.shape[0]):
        light[i] = arena.lamp_offset[lamp]
        far[i] = 0.0
    for p in range(LAMP_POINTS):
        lx = arena.lamp_points[lamp, p, 0]
        ly = arena.lamp_points[lamp, p, 1]
        weight = arena.lamp_weights[lamp, p]
        for i in range(light.shape[0]):
            ex = lx - end_x[i]
            ey = ly - end_y[i]
            far[i] += math.sqrt(ex * ex + ey * ey)
            behind = 0.0 if ex * ray_x[i] + ey * ray_y[i] >= 0.0 else 1.0
            blocked = circle_blocks(x - end_x[i], y - end_y[i], ex, ey, robot.radius)
            hidden[i] = blocked if i < sensors - first else behind
        if covers(x - lx, y - ly, robot.radius):
            hidden[: sensors - first] = 1.0
        if robot.outline.shape[0] > 0:
            hide_behind_outline(robot, (lx, ly, 1.0), first, sensors, work)
        hide_behind_obstacles(arena, lx, ly, first, n, work)
        for i in range(light.shape[0]):
            light[i] += weight * (1.0 - hidden[i])
    spread(work.light[first:sensors], work.far[first:sensors], 0.0)
    spread(work.light[sensors:], work.far[sensors:n], 1e-3)


@step
def spread(light, far, least):
    """Divide light by the squared mean distance to a lamp's points, `far` being their sum and `least` its
    minimum."""
    for i in range(light.shape[0]):
        d = max(far[i] * (1.0 / LAMP_POINTS), least)
        light[i] = max(light[i], 0.0) / (d * d)


@step
def hide_behind_outline(robot, light, a, b, work):
    """Mark, among the ray ends from lane `a` to `b`, those that a polygonal body shades from a lamp's point.

    `light`: the point's x and y, and the share of the path there below the body's top. A line meets a convex
    body unless it lies beyond one of its edges, or all corners lie on one side of the line.
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
    """Mark the ray ends from lane `a` to `b` that obstacles shade from a lamp's point (lx, ly)."""
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
def follow_fan(robot, arena, spot, fan, a, work):
    """Ends of the rays of one fan of an ambient sensor at `spot`, as 1/d, from lane `a`, among obstacles.

    A fan's pad lanes are overwritten by the next one's rays.
    """
    b = a + LANES
    rays = Rays(work.ray_x[a:b], work.ray_y[a:b], work.inverse[a:b], work.incidence[a:b], NARROW)
    see(arena, robot.ambient_ray, fan, spot, rays, None)
    if is_tinted(arena):
        tint(arena, spot, rays, 0.0)
        for i in range(rays_of_fan(robot, work)):
            work.terms[a + i] *= rays.incidence[i]


@step
def rays_of_fan(robot, work):
    """Number of rays in each fan of an ambient sensor: RAYS, or as many as have any weight."""
    return ray_count(work) // max(robot.ambient_ray.shape[0], 1)


@step
def ray_count(work):
    """Number of rays of all ambient sensors."""
    return work.all_fans.shape[1] - LANES


@step
def follow_sensor(robot, arena, k, a, b, work):
    """Ends of the rays of ambient sensor `k`, as 1/d, and their weights, from lane `a` to `b`.

    Pad lanes up to whole vectors are overwritten by the next one's rays.
    """
    view = look(robot, k, work)
    spot = Spot(view.x, view.y, work.pose[3], work.pose[4])
    first, fans, used, end = k * (b - a), work.all_fans, rays_of_fan(robot, work), a + whole_vectors(b - a)
    end_x, end_y, terms, weight = work.end_x[a:end], work.end_y[a:end], work.terms[a:end], fans[2, first:]
    for i in range(end_x.shape[0]):
        end_x[i] = spot.x
        end_y[i] = spot.y
        terms[i] = weight[i]
    if is_bare(arena):
        rays = Rays(work.ray_x[a:end], work.ray_y[a:end], work.inverse[a:end], work.incidence[a:end], NARROW)
        see_room(arena, fans[0, first:], fans[1, first:], spot, rays, None)
        return
    for f in range((b - a) // used):
        follow_fan(robot, arena, spot, k * ((b - a) // used) + f, a + f * used, work)


@step
def go_to_ends(a, b, work):
    """Ends of the rays from lane `a` to `b`, moved back by GRAZE, off their own wall."""
    ray_x, ray_y, inverse = work.ray_x[a:b], work.ray_y[a:b], work.inverse[a:b]
    end_x, end_y = work.end_x[a:b], work.end_y[a:b]
    for i in range(b - a):
        d = (1.0 - GRAZE) / inverse[i]
        end_x[i] += ray_x[i] * d
        end_y[i] += ray_y[i] * d


@step
def follow_rays(robot, arena, work):
    """Ends of the rays of all ambient sensors, and the weights of the light reflected there.

    All rays lie in one row, sensor after sensor. Weights: 1.5 cos² β / d², times the surface's reflectance.
    """
    n, used = whole_vectors(ray_count(work)), rays_of_fan(robot, work)
    for k in range(robot.ambient_place.shape[0]):
        follow_sensor(robot, arena, k, k * used, (k + 1) * used, work)
    go_to_ends(0, n, work)
    for i in range(n):
        work.terms[i] *= work.inverse[i] * work.inverse[i]


@step
def reflected_light(a, b, work):
    """Σ_j D_ij cos² β_ij · 1.5 / d_ij² over a fan's rays, lanes `a` to `b`, outermost pairs first."""
    t = work.far[a : a + RAYS]
    for i in range(RAYS):
        t[i] = work.light[a + i] * work.terms[a + i]
    for i in range(b - a, RAYS):
        t[i] = 0.0
    return added(t)
