"""The infrared proximity sensors (§3.2.3): I = Σ cos β_i (a/d_i² + b), ten rays a sensor.

Where nothing is nearer than a sensor's reach √(a/−b), all its terms are ≤ 0 and it reads 0 exactly. Most
sensors are in that state most of the time, so this is tested first, for all sensors side by side, by
conditions that never exclude a sensor wrongly.
"""

from typing import NamedTuple

from realitygap.kernels.geometry import TOUCHING, Rays, Spot, added, is_brighter, is_tinted, see, tint
from realitygap.kernels.jit import apart, step
from realitygap.kernels.near import SPARE, cell_at, is_beyond
from realitygap.kernels.params import LANES, RAYS
from realitygap.kernels.replay import replay
from realitygap.kernels.response import respond


@step
def faces_walls(robot, arena, fan, k, x, y, c, s):
    """Whether a ray of sensor `k` meets an outer wall within reach, its robot being at (x, y) and turned by
    an angle of cosine `c` and sine `s`.

    The ray that meets a wall soonest is the one closest to its normal: the sensor's own
    direction if that lies inside the fan, else an outermost ray.
    """
    reach, cone, width, depth = robot.proximity_reach[k], robot.proximity_cone, arena.size[0], arena.size[1]
    px = x + c * fan[0, k] - s * fan[1, k]
    py = y + s * fan[0, k] + c * fan[1, k]
    fx = c * fan[2, k] - s * fan[3, k]
    fy = s * fan[2, k] + c * fan[3, k]
    ax = c * fan[4, k] - s * fan[5, k]
    ay = s * fan[4, k] + c * fan[5, k]
    bx = c * fan[6, k] - s * fan[7, k]
    by = s * fan[6, k] + c * fan[7, k]
    east = 1.0 if fx > cone else max(ax, bx)
    west = 1.0 if fx < -cone else max(-ax, -bx)
    north = 1.0 if fy > cone else max(ay, by)
    south = 1.0 if fy < -cone else max(-ay, -by)
    near = (width - px < reach * east) | (px < reach * west)
    return near | (depth - py < reach * north) | (py < reach * south)


@step
def faces_cylinder(robot, fan, k, forward, leftward, radius):
    """Whether a cylinder there is within sensor `k`'s reach and not wholly outside its fan."""
    cone = robot.proximity_cone
    qx = forward - fan[0, k]
    qy = leftward - fan[1, k]
    square = qx * qx + qy * qy
    reach = robot.proximity_reach[k] + radius
    ahead = qx * fan[2, k] + qy * fan[3, k]
    inside = (ahead > 0.0) & (ahead * ahead > cone * cone * square)
    first = abs(qx * fan[5, k] - qy * fan[4, k]) < radius
    last = abs(qx * fan[7, k] - qy * fan[6, k]) < radius
    return (square < reach * reach) & (inside | first | last)


@step
def faces_segment(robot, fan, k, wall):
    """Whether an inner wall, seen from the robot, is within sensor `k`'s reach and not wholly to one side of
    its fan."""
    ux, uy, length = wall.along_x, wall.along_y, wall.length
    qx, qy = wall.x - fan[0, k], wall.y - fan[1, k]
    along, reach = -(qx * ux + qy * uy), robot.proximity_reach[k] + SPARE
    near = (abs(qx * uy - qy * ux) < reach) & (along > -reach) & (along < length + reach)
    # How far its ends lie to the left of the first ray, and to the right of the last.
    left = fan[4, k] * qy - fan[5, k] * qx
    right = fan[7, k] * qx - fan[6, k] * qy
    left = max(left, left + length * (fan[4, k] * uy - fan[5, k] * ux))
    right = max(right, right + length * (fan[7, k] * ux - fan[6, k] * uy))
    return near & (left > -SPARE) & (right > -SPARE)


class Inner(NamedTuple):
    """An inner wall as the robot sees it (x forward, y leftward): one end, direction and length."""

    x: float
    y: float
    along_x: float
    along_y: float
    length: float


@step
def inner_wall(arena, j, x, y, c, s):
    """Inner wall `j` from (x, y), to a robot that is turned by an angle of cosine `c` and sine `s`."""
    ax, ay = arena.segments[j, 0] - x, arena.segments[j, 1] - y
    ux, uy = arena.segment_along[j, 0], arena.segment_along[j, 1]
    length = arena.segment_along[j, 2]
    return Inner(c * ax + s * ay, c * ay - s * ax, c * ux + s * uy, c * uy - s * ux, length)


@step
def notice_walls(robot, arena, work):
    """Mark the sensors with a ray that meets an outer wall within reach."""
    x, y, c, s = work.pose[0], work.pose[1], work.pose[3], work.pose[4]
    fan = work.fan
    for k in range(work.noticed.shape[0]):
        work.noticed[k] = 1 if faces_walls(robot, arena, fan, k, x, y, c, s) else 0


@step
def notice_cylinder(robot, arena, j, work):
    """Mark the sensors that cylinder `j` is within reach of and not wholly outside their fan."""
    x, y, c, s = work.pose[0], work.pose[1], work.pose[3], work.pose[4]
    cx, cy, radius = arena.cylinders[j, 0] - x, arena.cylinders[j, 1] - y, arena.cylinders[j, 2]
    far = work.span[0] + radius
    if cx * cx + cy * cy > far * far:
        return
    # The cylinder as the robot sees it: (forward, leftward).
    forward = c * cx + s * cy
    leftward = c * cy - s * cx
    fan = work.fan
    for k in range(work.noticed.shape[0]):
        near = faces_cylinder(robot, fan, k, forward, leftward, radius)
        work.noticed[k] = 1 if near else work.noticed[k]


@step
def notice_segment(robot, arena, j, work):
    """Mark the sensors that inner wall `j` is within reach of and not wholly to one side of their fan."""
    wall, fan = inner_wall(arena, j, work.pose[0], work.pose[1], work.pose[3], work.pose[4]), work.fan
    for k in range(work.noticed.shape[0]):
        near = faces_segment(robot, fan, k, wall)
        work.noticed[k] = 1 if near else work.noticed[k]


@step
def notice(robot, arena, work):
    """Mark the sensors that may read more than 0 (work.noticed)."""
    if is_brighter(arena):
        for k in range(work.noticed.shape[0]):
            work.noticed[k] = 1
        return
    notice_walls(robot, arena, work)
    x, y, span = work.pose[0], work.pose[1], work.span[0]
    cell = cell_at(arena, x, y)
    for n in range(arena.cylinders.shape[0]):
        if arena.cylinder_gap[cell, n] > span:
            break
        notice_cylinder(robot, arena, arena.near_cylinders[cell, n], work)
    for n in range(arena.segments.shape[0]):
        if arena.segment_gap[cell, n] > span:
            break
        j = arena.near_segments[cell, n]
        if not is_beyond(arena, j, x, y, span):
            notice_segment(robot, arena, j, work)


@step
def surfaces_differ(robot, arena):
    """Whether readings depend on which surface a ray meets, and how, not only where."""
    return robot.proximity_lambertian > 0.0 or is_tinted(arena)


@step
def reflected(robot, arena, k, rays, t):
    """Σ over the rays of cos^m β (a/(d + offset)² + b), outermost pairs first.

    a is multiplied by the surface's reflectance and, if it is Lambertian, by the cosine of incidence. The
    order makes mirror-image sensors add mirror-image rays in the same order.
    """
    a, b, offset = robot.proximity_a[k], robot.proximity_b[k], robot.proximity_offset[k]
    inverse = rays.inverse
    if offset != 0.0:
        for i in range(inverse.shape[0]):
            inverse[i] = inverse[i] / (1.0 + offset * inverse[i])
    if surfaces_differ(robot, arena):
        for i in range(inverse.shape[0]):
            t[i] = robot.proximity_weight[k, i] * (a * (inverse[i] * inverse[i]) * rays.incidence[i] + b)
    else:
        for i in range(inverse.shape[0]):
            t[i] = robot.proximity_weight[k, i] * (a * (inverse[i] * inverse[i]) + b)
    return added(t)


@step
def thrown_back(robot, k, inverse):
    """Light of one ray for a measured sensor: a / ((d + offset)² + width²), 0 beyond its range."""
    v = inverse if inverse >= robot.proximity_least else 0.0
    near = max(1.0 + robot.proximity_offset[k] * v, TOUCHING * v)
    return robot.proximity_a[k] * (v * v) / (near * near + robot.proximity_width2 * (v * v))


@step
def gathered(robot, arena, k, rays, t):
    """Light for a measured sensor: Σ weight ρ cos a / ((d + offset)² + width²), minus the overlap of beams.

    The overlap is what a flat surface, at the distance of the middle ray, reflects into the outermost.
    """
    inverse, overlap, middle = rays.inverse, 0.0, RAYS // 2
    for i in range(inverse.shape[0]):
        t[i] = robot.proximity_weight[k, i] * thrown_back(robot, k, inverse[i])
    if robot.proximity_overlap > 0.0:
        overlap = robot.proximity_overlap * thrown_back(robot, k, inverse[middle] * robot.proximity_cone)
    if surfaces_differ(robot, arena):
        for i in range(inverse.shape[0]):
            t[i] *= rays.incidence[i]
        overlap *= rays.incidence[middle]
    return added(t) - overlap


@step
def list_noticed(work):
    """Move the marked sensors' numbers to the front of work.listed; returns their number.

    Without branches, since which sensors are marked is unpredictable for a processor.
    """
    count = 0
    for k in range(work.noticed.shape[0]):
        work.listed[count] = k
        count += work.noticed[k]
    return count


@step
def spot_of(robot, k, work):
    """Where proximity sensor `k` is."""
    x, y, c, s = work.pose[0], work.pose[1], work.pose[3], work.pose[4]
    px = x + c * robot.proximity_place[k, 0] - s * robot.proximity_place[k, 1]
    py = y + s * robot.proximity_place[k, 0] + c * robot.proximity_place[k, 1]
    return Spot(px, py, c, s)


@step
def follow(robot, arena, k, rays, work):
    """Find what the rays of proximity sensor `k` meet."""
    spot = spot_of(robot, k, work)
    if surfaces_differ(robot, arena):
        see(arena, robot.proximity_ray, k, spot, rays, True)
        if is_tinted(arena):
            tint(arena, spot, rays, robot.proximity_lambertian)
    else:
        see(arena, robot.proximity_ray, k, spot, rays, None)


@step
def fan_of(robot, work):
    """Room for the rays of one proximity sensor."""
    narrow, n = robot.proximity_narrow, LANES
    return Rays(work.ray_x[:n], work.ray_y[:n], work.inverse[:n], work.incidence[:n], narrow)


@step
def receive(robot, arena, work, out):
    """Light for all measured sensors into `out` ([P]), before their curves."""
    rays = fan_of(robot, work)
    for k in range(out.shape[0]):
        follow(robot, arena, k, rays, work)
        out[k] = gathered(robot, arena, k, rays, work.terms)


@step
def by_rays(robot, arena, work, out):
    """As `infrared`, for a robot without a table."""
    rays, measured = fan_of(robot, work), robot.proximity_curve.shape[1] > 0
    notice(robot, arena, work)
    for k in range(out.shape[0]):
        out[k] = 0.0
    for n in range(list_noticed(work)):
        k = work.listed[n]
        follow(robot, arena, k, rays, work)
        if measured:
            out[k] = gathered(robot, arena, k, rays, work.terms)
        else:
            total = reflected(robot, arena, k, rays, work.terms)
            out[k] = min(max(total, 0.0), robot.proximity_top)
    if measured:  # of all at once: side by side their roots cost less than a few separately
        for k in range(out.shape[0]):
            out[k] = respond(robot.proximity_curve, k, robot.proximity_knee, out[k])


@step
def by_table_or_rays(table, robot, arena, work, out):
    """As `infrared`. Only one of the two is compiled for a robot, since the table's length is part of the
    type."""
    if len(table) > 0:
        replay(table, robot.radius, robot.proximity_top, arena, work.pose, out)
    else:
        by_rays(robot, arena, work, out)


@apart
def infrared(robot, arena, work, out):
    """Noise-free readings of all proximity sensors into `out` ([P], counts, unrounded)."""
    by_table_or_rays(robot.proximity_table, robot, arena, work, out)
