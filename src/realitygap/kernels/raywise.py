"""Sensors ray by ray, without arrays: for a GPU, whose registers are many and whose memory is far.

The same steps as in infrared.py, geometry.py and light.py, for surfaces that reflect alike; so the bits are
the same.
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
def to_walls(walls, x, y):
    """1/d along (x, y) to the outer walls."""
    across, along = meet_walls(walls, x, y)
    return max(across, along)


@step
def returned(robot, k, i, inverse):
    """What ray `i` of proximity sensor `k` returns, measured or printed."""
    if robot.proximity_curve.shape[1] > 0:
        return robot.proximity_weight[k, i] * thrown_back(robot, k, inverse)
    offset = robot.proximity_offset[k]
    if offset != 0.0:
        inverse = inverse / (1.0 + offset * inverse)
    return robot.proximity_weight[k, i] * (robot.proximity_a[k] * (inverse * inverse) + robot.proximity_b[k])


@step
def overlapping(robot, k, inverse):
    """What a measured sensor's beams return less, by its middle ray."""
    if robot.proximity_curve.shape[1] == 0 or robot.proximity_overlap <= 0.0:
        return 0.0
    return robot.proximity_overlap * thrown_back(robot, k, inverse * robot.proximity_cone)


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
def shorten(arena, px, py, x, y, inverse):
    """1/d from (px, py) along (x, y) to whatever is nearest, `inverse` being that to the outer walls.

    A root and a division only where the ray meets a cylinder.
    """
    for j in range(arena.cylinders.shape[0]):
        qx, qy, radius = arena.cylinders[j, 0] - px, arena.cylinders[j, 1] - py, arena.cylinders[j, 2]
        if meets_circle(qx, qy, radius, x, y):
            square, inverse_square = facing_circle(qx, qy, radius)
            inverse = max(inverse, meet_circle(qx, qy, square, inverse_square, x, y)[0])
    for j in range(arena.segments.shape[0]):
        ax, ay = arena.segments[j, 0] - px, arena.segments[j, 1] - py
        bx, by = arena.segments[j, 2] - px, arena.segments[j, 3] - py
        sign, inverse_area, _ = facing_segment(ax, ay, bx, by)
        inverse = max(inverse, meet_segment(ax, ay, bx, by, sign, inverse_area, x, y)[0])
    return inverse


@step
def meets_circle(qx, qy, radius, x, y):
    """Whether a ray along (x, y) meets a circle."""
    t = qx * x + qy * y
    return t > 0.0 and t * t > max(qx * qx + qy * qy - radius * radius, TOUCHING * TOUCHING)


@step
def look_out(robot, arena, k, work, common):
    """Of proximity sensor `k`: whether it notices anything, and then where it is between the outer walls."""
    common.noticed[k] = 0
    if notices(robot, arena, k, work):
        spot = spot_of(robot, k, work)
        walls, place = walls_round(arena, spot), common.places[k]
        common.noticed[k] = 1
        place[0], place[1] = spot.x, spot.y
        place[2], place[3], place[4], place[5] = walls.west, walls.south, walls.east, walls.north


@step
def follow_ray(robot, arena, k, i, work, common):
    """What ray `i` of such a sensor returns, and what its beams overlap by."""
    place, ray = common.places[k], robot.proximity_ray
    spot = Spot(place[0], place[1], work.pose[3], work.pose[4])
    walls = Walls(place[2], place[3], place[4], place[5])
    x, y = turned(spot, ray[k, 0, i], ray[k, 1, i])
    inverse = shorten(arena, spot.x, spot.y, x, y, to_walls(walls, x, y))
    common.terms[k, i] = returned(robot, k, i, inverse)
    if i == RAYS // 2:
        common.terms[k, RAYS] = overlapping(robot, k, inverse)


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
def nearest(arena, spot, x, y):
    """1/d from a place along (x, y) to whatever is nearest."""
    return shorten(arena, spot.x, spot.y, x, y, to_walls(walls_round(arena, spot), x, y))


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
def light_at(robot, arena, lamp, body, px, py, facing, least):
    """As light_on_places, at one place: of a sensor that is `facing` some way, or, if that is (0, 0), on a
    surface, which the robot's body may shade."""
    on_surface = facing[0] == 0.0 and facing[1] == 0.0
    light, far = arena.lamp_offset[lamp], 0.0
    for p in range(LAMP_POINTS):
        lx, ly = arena.lamp_points[lamp, p, 0], arena.lamp_points[lamp, p, 1]
        ex, ey = lx - px, ly - py
        far += math.sqrt(ex * ex + ey * ey)
        if on_surface:
            hidden = circle_blocks(body.x - px, body.y - py, ex, ey, robot.radius)
            hidden = 1.0 if covers(body.x - lx, body.y - ly, robot.radius) else hidden
        else:
            hidden = 0.0 if ex * facing[0] + ey * facing[1] >= 0.0 else 1.0
        light += arena.lamp_weights[lamp, p] * (1.0 - hidden_at(arena, px, py, lx, ly, hidden))
    d = max(far * (1.0 / LAMP_POINTS), least)
    return max(light, 0.0) / (d * d)


@step
def reflected_by(robot, arena, lamp, body, spot, i, each, work):
    """Light of a lamp that ray `i` of the only ambient sensor brings."""
    if i >= each:
        return 0.0
    x, y = turned(spot, work.all_fans[0, i], work.all_fans[1, i])
    inverse = nearest(arena, spot, x, y)
    d = (1.0 - GRAZE) / inverse
    light = light_at(robot, arena, lamp, body, spot.x + x * d, spot.y + y * d, (0.0, 0.0), 0.0)
    return light * (work.all_fans[2, i] * (inverse * inverse))


@step
def illuminate_alone(robot, arena, _enough, work, out):
    """As ambient.illuminate for a robot with one ambient sensor and the printed law."""
    body = Spot(work.pose[0], work.pose[1], work.pose[3], work.pose[4])
    view, each = look(robot, 0, work), rays_of_fan(robot, work)
    spot = Spot(view.x, view.y, body.cos, body.sin)
    out[0] = 0.0
    for lamp in range(arena.lamp_points.shape[0]):
        first, second, total = 0.0, 0.0, 0.0
        for i in range(RAYS // 2):
            pair = reflected_by(robot, arena, lamp, body, spot, i, each, work)
            pair += reflected_by(robot, arena, lamp, body, spot, RAYS - 1 - i, each, work)
            if i == 0:
                first = pair
            elif i == 1:
                first += pair
            elif i == 2:
                second = pair
            elif i == 3:
                second += pair
            else:
                total = (first + second) + pair
        direct = light_at(robot, arena, lamp, body, view.x, view.y, (view.ahead_x, view.ahead_y), 1e-3)
        out[0] += direct + total
