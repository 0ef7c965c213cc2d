"""Sensors ray by ray, without arrays: for a GPU, whose registers are many and whose memory is far.

The same steps as in infrared.py, geometry.py and light.py, for surfaces that reflect alike; so the bits are
the same.
"""

import math
from typing import Any

from realitygap.kernels.geometry import (
    GRAZE,
    Spot,
    facing_circle,
    facing_segment,
    meet_circle,
    meet_segment,
    meet_walls,
    turned,
    walls_round,
)
from realitygap.kernels.infrared import list_noticed, notice, spot_of, thrown_back
from realitygap.kernels.jit import step
from realitygap.kernels.light import look, rays_of_fan
from realitygap.kernels.params import LAMP_POINTS, RAYS
from realitygap.kernels.response import respond
from realitygap.kernels.shade import circle_blocks, covers, segment_blocks

_EACH = tuple(range(RAYS))
_SUM = "(t0 + t9) + (t1 + t8) + ((t2 + t7) + (t3 + t6)) + (t4 + t5)"
"""As geometry.added has it."""


def _unrolled(*lines: str) -> Any:
    """A compiled function from lines of text, those with a {i} once for each ray."""
    whole = [line.format(i=i) for line in lines for i in (_EACH if "{i}" in line else _EACH[:1])]
    scope = dict(globals())
    exec("\n".join(whole), scope)
    return step(scope[lines[0][4:].partition("(")[0]])


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


gather = _unrolled(
    "def gather(robot, arena, k, spot):",
    '    """Light of proximity sensor `k`, before its curve."""',
    "    walls, ray = walls_round(arena, spot), robot.proximity_ray",
    "    x{i}, y{i} = turned(spot, ray[k, 0, {i}], ray[k, 1, {i}])",
    "    v{i} = to_walls(walls, x{i}, y{i})",
    "    ahead_x, ahead_y = turned(spot, ray[k, 0, RAYS], ray[k, 1, RAYS])",
    "    for j in range(arena.cylinders.shape[0]):",
    "        qx, qy = arena.cylinders[j, 0] - spot.x, arena.cylinders[j, 1] - spot.y",
    "        if qx * ahead_x + qy * ahead_y > -arena.cylinders[j, 2]:",
    "            square, inverse = facing_circle(qx, qy, arena.cylinders[j, 2])",
    "            v{i} = max(v{i}, meet_circle(qx, qy, square, inverse, x{i}, y{i})[0])",
    "    for j in range(arena.segments.shape[0]):",
    "        ax, ay = arena.segments[j, 0] - spot.x, arena.segments[j, 1] - spot.y",
    "        bx, by = arena.segments[j, 2] - spot.x, arena.segments[j, 3] - spot.y",
    "        sign, inverse, _ = facing_segment(ax, ay, bx, by)",
    "        v{i} = max(v{i}, meet_segment(ax, ay, bx, by, sign, inverse, x{i}, y{i})[0])",
    "    t{i} = returned(robot, k, {i}, v{i})",
    f"    return {_SUM} - overlapping(robot, k, v{RAYS // 2})",
)


@step
def by_rays_alone(robot, arena, work, out):
    """As infrared.by_rays."""
    notice(robot, arena, work)
    for k in range(out.shape[0]):
        out[k] = 0.0
    measured = robot.proximity_curve.shape[1] > 0
    for n in range(list_noticed(work)):
        k = work.listed[n]
        total = gather(robot, arena, k, spot_of(robot, k, work))
        out[k] = total if measured else min(max(total, 0.0), robot.proximity_top)
    if measured:
        for k in range(out.shape[0]):
            out[k] = respond(robot.proximity_curve, k, robot.proximity_knee, out[k])


@step
def nearest(arena, spot, x, y):
    """1/d from a place along (x, y) to whatever is nearest."""
    found = to_walls(walls_round(arena, spot), x, y)
    for j in range(arena.cylinders.shape[0]):
        qx, qy = arena.cylinders[j, 0] - spot.x, arena.cylinders[j, 1] - spot.y
        square, inverse = facing_circle(qx, qy, arena.cylinders[j, 2])
        found = max(found, meet_circle(qx, qy, square, inverse, x, y)[0])
    for j in range(arena.segments.shape[0]):
        ax, ay = arena.segments[j, 0] - spot.x, arena.segments[j, 1] - spot.y
        bx, by = arena.segments[j, 2] - spot.x, arena.segments[j, 3] - spot.y
        sign, inverse, _ = facing_segment(ax, ay, bx, by)
        found = max(found, meet_segment(ax, ay, bx, by, sign, inverse, x, y)[0])
    return found


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
