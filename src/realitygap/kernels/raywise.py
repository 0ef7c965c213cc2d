"""Sensors ray by ray, without rows of rays: for a GPU, whose threads share the rays of all sensors.

The same steps as in infrared.py, geometry.py and light.py, for surfaces of the usual reflectance; so the bits
are the same.
"""

import math

from realitygap.kernels.geometry import (
    GRAZE,
    TOUCHING,
    Spot,
    facing_circle,
    facing_segment,
    meet_circle,
    meet_segment,
    turned,
    walls_round,
)
from realitygap.kernels.infrared import thrown_back
from realitygap.kernels.jit import step
from realitygap.kernels.light import rays_of_fan
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
def to_walls(walls, x, y):
    """As geometry.meet_walls: 1/d is positive where a ray goes towards a wall."""
    return x * walls.east if x > 0.0 else -x * walls.west, y * walls.north if y > 0.0 else -y * walls.south


@step
def met_by(arena, place, walls, x, y):
    """1/d along (x, y) from a place to whatever is nearest: a root and a division only where a ray meets a
    cylinder."""
    across, along = to_walls(walls, x, y)
    found = max(across, along)
    for j in range(arena.cylinders.shape[0]):
        qx, qy = arena.cylinders[j, 0] - place[0], arena.cylinders[j, 1] - place[1]
        radius = arena.cylinders[j, 2]
        if meets_circle(qx, qy, radius, x, y):
            square, inverse_square = facing_circle(qx, qy, radius)
            found = max(found, meet_circle(qx, qy, square, inverse_square, x, y)[0])
    for j in range(arena.segments.shape[0]):
        ax, ay = arena.segments[j, 0] - place[0], arena.segments[j, 1] - place[1]
        bx, by = arena.segments[j, 2] - place[0], arena.segments[j, 3] - place[1]
        sign, inverse_area, _ = facing_segment(ax, ay, bx, by)
        found = max(found, meet_segment(ax, ay, bx, by, sign, inverse_area, x, y)[0])
    return found


@step
def meets_circle(qx, qy, radius, x, y):
    """Whether a ray along (x, y) meets a circle."""
    t = qx * x + qy * y
    return t > 0.0 and t * t > max(qx * qx + qy * qy - radius * radius, TOUCHING * TOUCHING)


@step
def in_order(n):
    """The ray that comes `n`-th where outermost pairs are added first."""
    return n // 2 if n % 2 == 0 else RAYS - 1 - n // 2


@step
def ray_of(robot, k, i, spot):
    """Ray `i` of proximity sensor `k`, there, in the room's frame."""
    return turned(spot, robot.proximity_ray[k, 0, i], robot.proximity_ray[k, 1, i])


@step
def pass_walls(robot, arena, k, spot, inverse, incidence):
    """Set 1/d of a sensor's rays to the outer walls, and, if surfaces are Lambertian, their incidence."""
    walls, lambertian = walls_round(arena, spot), robot.proximity_lambertian > 0.0
    for i in range(RAYS):
        x, y = ray_of(robot, k, i, spot)
        across, along = to_walls(walls, x, y)
        inverse[i] = max(across, along)
        if lambertian:
            incidence[i] = abs(x) if across >= along else abs(y)


@step
def pass_cylinders(robot, arena, k, spot, inverse, incidence):
    """Shorten the rays that meet a cylinder first; one behind the sensor meets none."""
    ahead_x, ahead_y = ray_of(robot, k, RAYS, spot)
    lambertian = robot.proximity_lambertian > 0.0
    for j in range(arena.cylinders.shape[0]):
        qx, qy, radius = arena.cylinders[j, 0] - spot.x, arena.cylinders[j, 1] - spot.y, arena.cylinders[j, 2]
        if qx * ahead_x + qy * ahead_y > -radius:
            square, inverse_square = facing_circle(qx, qy, radius)
            for i in range(RAYS):
                x, y = ray_of(robot, k, i, spot)
                t = qx * x + qy * y
                under = t * t - square
                if t > 0.0 and under > 0.0:
                    half = math.sqrt(under)
                    met = (t + half) * inverse_square
                    if met > inverse[i]:
                        inverse[i] = met
                        if lambertian:
                            incidence[i] = min(half * (1.0 / radius), 1.0)


@step
def pass_segments(robot, arena, k, spot, inverse, incidence):
    """Shorten the rays that meet an inner wall first."""
    lambertian = robot.proximity_lambertian > 0.0
    for j in range(arena.segments.shape[0]):
        ax, ay = arena.segments[j, 0] - spot.x, arena.segments[j, 1] - spot.y
        bx, by = arena.segments[j, 2] - spot.x, arena.segments[j, 3] - spot.y
        sign, inverse_area, length = facing_segment(ax, ay, bx, by)
        for i in range(RAYS):
            x, y = ray_of(robot, k, i, spot)
            met, through = meet_segment(ax, ay, bx, by, sign, inverse_area, x, y)
            if met > inverse[i]:
                inverse[i] = met
                if lambertian:
                    incidence[i] = abs(through) * (1.0 / max(length, TOUCHING))


@step
def look_along(robot, arena, k, pose, inverse, incidence):
    """What the rays of proximity sensor `k` return to a robot whose x, y, cosine and sine are `pose`.

    A sum as geometry.added has it. `inverse` and `incidence`: room for RAYS numbers.
    """
    x, y, c, s = pose
    px = x + c * robot.proximity_place[k, 0] - s * robot.proximity_place[k, 1]
    py = y + s * robot.proximity_place[k, 0] + c * robot.proximity_place[k, 1]
    spot, middle = Spot(px, py, c, s), RAYS // 2
    pass_walls(robot, arena, k, spot, inverse, incidence)
    pass_cylinders(robot, arena, k, spot, inverse, incidence)
    pass_segments(robot, arena, k, spot, inverse, incidence)
    first, second, pair = 0.0, 0.0, 0.0
    for n in range(RAYS):
        i = in_order(n)
        light = returned(robot, k, i, inverse[i], incidence[i])
        pair = light if n % 2 == 0 else pair + light
        if n == 1 or n == 3:
            first += pair
        elif n == 5 or n == 7:
            second += pair
    return first + second + pair - overlapping(robot, k, inverse[middle], incidence[middle])


@step
def answer_near(robot, k, light):
    """The noise-free reading of proximity sensor `k` by what its rays return."""
    if robot.proximity_curve.shape[1] > 0:
        return respond(robot.proximity_curve, k, robot.proximity_knee, light)
    return min(max(light, 0.0), robot.proximity_top)


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
def light_by(robot, arena, lamp, k, i, view, walls, work):
    """Light of a lamp that ray `i` of ambient sensor `k` brings, looking from `view` between `walls`; or, for
    i = RAYS, what falls on the sensor."""
    place, facing, weight, least = (view.x, view.y), (view.ahead_x, view.ahead_y), 1.0, 1e-3
    if i < RAYS:
        each = rays_of_fan(robot, work)
        row, facing, least = k * each + min(i, each - 1), (0.0, 0.0), 0.0
        heading = Spot(view.x, view.y, work.pose[3], work.pose[4])
        x, y = turned(heading, work.all_fans[0, row], work.all_fans[1, row])
        inverse = met_by(arena, place, walls, x, y)
        d = (1.0 - GRAZE) / inverse
        place = (view.x + x * d, view.y + y * d)
        weight = work.all_fans[2, row] * (inverse * inverse) if i < each else 0.0
    return light_at(robot, arena, lamp, work, place, facing, least) * weight
