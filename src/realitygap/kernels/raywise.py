"""Sensors ray by ray, without rows of rays: for a GPU, whose threads share the rays of all sensors.

The same steps as in infrared.py, geometry.py and light.py, for surfaces of the usual reflectance; so the bits
are the same.
"""

import math

from realitygap.kernels.geometry import (
    GRAZE,
    TOUCHING,
    Spot,
    Walls,
    added,
    facing_circle,
    facing_segment,
    meet_circle,
    meet_segment,
    meet_walls,
    turned,
    walls_round,
)
from realitygap.kernels.infrared import (
    faces_cylinder,
    faces_segment,
    faces_walls,
    inner_wall,
    spot_of,
    thrown_back,
)
from realitygap.kernels.jit import step
from realitygap.kernels.light import look, rays_of_fan
from realitygap.kernels.near import cell_at, is_beyond
from realitygap.kernels.params import LAMP_POINTS, RAYS
from realitygap.kernels.response import respond
from realitygap.kernels.shade import circle_blocks, covers, segment_blocks


@step
def returned(robot, k, i, inverse, incidence):
    """What ray `i` of proximity sensor `k` returns, measured or printed."""
    lambertian = robot.proximity_lambertian > 0.0
    if robot.proximity_curve.shape[1] > 0:
        light = robot.proximity_weight[k, i] * thrown_back(robot, k, inverse)
        return light * incidence if lambertian else light
    offset = robot.proximity_offset[k]
    if offset != 0.0:
        inverse = inverse / (1.0 + offset * inverse)
    light = robot.proximity_a[k] * (inverse * inverse)
    light = light * incidence if lambertian else light
    return robot.proximity_weight[k, i] * (light + robot.proximity_b[k])


@step
def overlapping(robot, k, inverse, incidence):
    """What a measured sensor's beams return less, by its middle ray."""
    if robot.proximity_curve.shape[1] == 0 or robot.proximity_overlap <= 0.0:
        return 0.0
    overlap = robot.proximity_overlap * thrown_back(robot, k, inverse * robot.proximity_cone)
    return overlap * incidence if robot.proximity_lambertian > 0.0 else overlap


@step
def notices(robot, arena, k, work):
    """As infrared.notice, for proximity sensor `k`."""
    x, y, c, s = work.pose[0], work.pose[1], work.pose[3], work.pose[4]
    fan, span, cell = work.fan, work.span[0], cell_at(arena, x, y)
    near = faces_walls(robot, arena, fan, k, x, y, c, s)
    for n in range(arena.cylinders.shape[0]):
        if arena.cylinder_gap[cell, n] > span:
            break
        j = arena.near_cylinders[cell, n]
        qx, qy, radius = arena.cylinders[j, 0] - x, arena.cylinders[j, 1] - y, arena.cylinders[j, 2]
        far = span + radius
        if qx * qx + qy * qy <= far * far:
            near = near | faces_cylinder(robot, fan, k, c * qx + s * qy, c * qy - s * qx, radius)
    for n in range(arena.segments.shape[0]):
        if arena.segment_gap[cell, n] > span:
            break
        j = arena.near_segments[cell, n]
        if not is_beyond(arena, j, x, y, span):
            near = near | faces_segment(robot, fan, k, inner_wall(arena, j, x, y, c, s))
    return near


@step
def met_by(arena, place, x, y, lambertian):
    """1/d along (x, y) from a sensor's place to whatever is nearest, and, if surfaces are
    Lambertian, the cosine of incidence.

    A root and a division only where the ray meets a cylinder.
    """
    across, along = meet_walls(Walls(place[2], place[3], place[4], place[5]), x, y)
    found, incidence = max(across, along), abs(x) if across >= along else abs(y)
    for j in range(arena.cylinders.shape[0]):
        qx, qy = arena.cylinders[j, 0] - place[0], arena.cylinders[j, 1] - place[1]
        radius = arena.cylinders[j, 2]
        if meets_circle(qx, qy, radius, x, y):
            square, inverse_square = facing_circle(qx, qy, radius)
            met, half = meet_circle(qx, qy, square, inverse_square, x, y)
            if lambertian:
                incidence = min(half * (1.0 / radius), 1.0) if met > found else incidence
            found = max(found, met)
    for j in range(arena.segments.shape[0]):
        ax, ay = arena.segments[j, 0] - place[0], arena.segments[j, 1] - place[1]
        bx, by = arena.segments[j, 2] - place[0], arena.segments[j, 3] - place[1]
        sign, inverse_area, length = facing_segment(ax, ay, bx, by)
        met, through = meet_segment(ax, ay, bx, by, sign, inverse_area, x, y)
        if lambertian:
            cosine = abs(through) * (1.0 / max(length, TOUCHING))
            incidence = cosine if met > found else incidence
        found = max(found, met)
    return found, incidence


@step
def meets_circle(qx, qy, radius, x, y):
    """Whether a ray along (x, y) meets a circle."""
    t = qx * x + qy * y
    return t > 0.0 and t * t > max(qx * qx + qy * qy - radius * radius, TOUCHING * TOUCHING)


@step
def stand_between(arena, spot, place):
    """Store where a sensor is, and the reciprocals of its distances from the outer walls."""
    walls = walls_round(arena, spot)
    place[0], place[1] = spot.x, spot.y
    place[2], place[3], place[4], place[5] = walls.west, walls.south, walls.east, walls.north


@step
def look_out(robot, arena, k, work, common):
    """Whether proximity sensor `k` notices anything, and then where it is."""
    common.noticed[k] = 0
    if notices(robot, arena, k, work):
        common.noticed[k] = 1
        stand_between(arena, spot_of(robot, k, work), common.places[k])


@step
def follow_ray(robot, arena, k, i, work, common):
    """What ray `i` of such a sensor returns, and what its beams overlap by."""
    place, ray = common.places[k], robot.proximity_ray
    x, y = turned(Spot(place[0], place[1], work.pose[3], work.pose[4]), ray[k, 0, i], ray[k, 1, i])
    inverse, incidence = met_by(arena, place, x, y, robot.proximity_lambertian > 0.0)
    common.terms[k, i] = returned(robot, k, i, inverse, incidence)
    if i == RAYS // 2:
        common.terms[k, RAYS] = overlapping(robot, k, inverse, incidence)


@step
def take_up(robot, k, common):
    """The noise-free reading of proximity sensor `k` from what its rays return."""
    total, measured = 0.0, robot.proximity_curve.shape[1] > 0
    if common.noticed[k] == 1:
        total = added(common.terms[k]) - common.terms[k, RAYS]
    if measured:
        return respond(robot.proximity_curve, k, robot.proximity_knee, total)
    return min(max(total, 0.0), robot.proximity_top)


@step
def hidden_at(arena, px, py, lx, ly, hidden):
    """Whether obstacles hide a lamp's point (lx, ly) from a place; `hidden`: whether anything else does."""
    for j in range(arena.cylinders.shape[0]):
        cx, cy, radius = arena.cylinders[j, 0], arena.cylinders[j, 1], arena.cylinders[j, 2]
        hidden = max(hidden, circle_blocks(cx - px, cy - py, lx - px, ly - py, radius))
        hidden = 1.0 if covers(cx - lx, cy - ly, radius) else hidden
    for j in range(arena.segments.shape[0]):
        hidden = max(hidden, segment_blocks(arena, j, px, py, lx - px, ly - py))
    return hidden


@step
def light_at(robot, arena, lamp, work, place, facing, least):
    """As light_on_places, at one place: of a sensor that is `facing` some way, or, if that is (0, 0), on a
    surface, which the robot's body may shade."""
    on_surface = facing[0] == 0.0 and facing[1] == 0.0
    (px, py), x, y = place, work.pose[0], work.pose[1]
    light, far = arena.lamp_offset[lamp], 0.0
    for p in range(LAMP_POINTS):
        lx, ly = arena.lamp_points[lamp, p, 0], arena.lamp_points[lamp, p, 1]
        ex, ey = lx - px, ly - py
        far += math.sqrt(ex * ex + ey * ey)
        if on_surface:
            hidden = circle_blocks(x - px, y - py, ex, ey, robot.radius)
            hidden = 1.0 if covers(x - lx, y - ly, robot.radius) else hidden
        else:
            hidden = 0.0 if ex * facing[0] + ey * facing[1] >= 0.0 else 1.0
        light += arena.lamp_weights[lamp, p] * (1.0 - hidden_at(arena, px, py, lx, ly, hidden))
    d = max(far * (1.0 / LAMP_POINTS), least)
    return max(light, 0.0) / (d * d)


@step
def stand_about(robot, arena, k, work, common):
    """Where ambient sensor `k` is, and no light yet."""
    view = look(robot, k, work)
    stand_between(arena, Spot(view.x, view.y, work.pose[3], work.pose[4]), common.places[k])
    for i in range(RAYS + 1):
        common.terms[k, i] = 0.0


@step
def follow_light(robot, arena, lamp, k, i, work, common):
    """Light of a lamp that ray `i` of ambient sensor `k` brings; after the last ray, what falls on it."""
    place, each = common.places[k], rays_of_fan(robot, work)
    spot, last = (place[0], place[1]), i == each
    facing, weight, least = (0.0, 0.0), 1.0, 0.0
    if last:
        view = look(robot, k, work)
        facing, least = (view.ahead_x, view.ahead_y), 1e-3
    else:
        row = k * each + i
        heading = Spot(place[0], place[1], work.pose[3], work.pose[4])
        x, y = turned(heading, work.all_fans[0, row], work.all_fans[1, row])
        inverse, _ = met_by(arena, place, x, y, False)
        d = (1.0 - GRAZE) / inverse
        spot = (place[0] + x * d, place[1] + y * d)
        weight = work.all_fans[2, row] * (inverse * inverse)
    light = light_at(robot, arena, lamp, work, spot, facing, least)
    common.terms[k, RAYS if last else i] = light if last else light * weight


@step
def take_in(k, common):
    """Light of a lamp on ambient sensor `k`."""
    return common.terms[k, RAYS] + added(common.terms[k])
