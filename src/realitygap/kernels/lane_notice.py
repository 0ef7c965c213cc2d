"""Which infrared sensors of trials in lockstep may read more than 0, and which cylinders are in their fans.

The conditions never leave anything out wrongly (as infrared.notice).
"""

import math

import numpy as np

from realitygap.kernels.jit import step

from realitygap.kernels.lanes import (  # isort: skip
    COS, COS1, CROWD, FACING_X, FACING_Y, FORWARD, LIGHT, MANY, PLACE_X, PLACE_Y, SIN, SIN1, WIDE, X1, Y1,
    X, Y,
)  # fmt: skip

U, f32 = np.uint64, np.float32
ROW, TWICE = U(WIDE), U(2 * WIDE)
SLACK = f32(1e-3)
"""Single precision extends the range of sensors by this, cm."""
NONE, ONE, TWO, THREE, FOUR, EIGHT = f32(0.0), f32(1.0), f32(2.0), f32(3.0), f32(4.0), f32(8.0)


@step
def edge_of(edges, k):
    """Column `k` of Lanes.edges."""
    return (
        edges[0, k], edges[1, k], edges[2, k], edges[3, k], edges[4, k], edges[5, k], edges[6, k], edges[7, k]
    )  # fmt: skip


@step
def look_at_walls(n, robot, arena, lanes):
    """Positions of the sensors, and which of them have an outer wall within reach (infrared.notice_walls)."""
    s, noticed, edges = lanes.single, lanes.noticed, lanes.edges
    width, depth, cone = f32(arena.size[0]), f32(arena.size[1]), f32(robot.proximity_cone)
    for k in range(edges.shape[1]):
        e, reach, o = edge_of(edges, k), f32(robot.proximity_reach[k]), U(k) * ROW
        for t in range(n):
            c, q = s[COS1 + t], s[SIN1 + t]
            px, py = s[X1 + t] + (c * e[0] - q * e[1]), s[Y1 + t] + (q * e[0] + c * e[1])
            fx, fy = c * e[2] - q * e[3], q * e[2] + c * e[3]
            ax, ay = c * e[4] - q * e[5], q * e[4] + c * e[5]
            bx, by = c * e[6] - q * e[7], q * e[6] + c * e[7]
            s[PLACE_X + o + t], s[PLACE_Y + o + t] = px, py
            s[FACING_X + o + t], s[FACING_Y + o + t] = fx, fy
            s[LIGHT + o + t] = NONE
            east = reach * (ONE if fx > cone else max(ax, bx)) + SLACK
            west = reach * (ONE if -fx > cone else max(-ax, -bx)) + SLACK
            north = reach * (ONE if fy > cone else max(ay, by)) + SLACK
            south = reach * (ONE if -fy > cone else max(-ay, -by)) + SLACK
            near = (width - px < east) | (px < west) | (depth - py < north) | (py < south)
            noticed[o + t] = np.uint32(near)


@step
def before_robot(n, j, lanes):
    """Cylinder `j` as the robots see it, forward and leftward; returns its radius."""
    s, at, disc = lanes.single, FORWARD + U(j) * TWICE, lanes.discs[j + 1]
    middle_x, middle_y = disc[0], disc[1]
    for t in range(n):
        x, y = middle_x - s[X1 + t], middle_y - s[Y1 + t]
        s[at + t] = s[COS1 + t] * x + s[SIN1 + t] * y
        s[at + ROW + t] = s[COS1 + t] * y - s[SIN1 + t] * x
    return disc[2] + SLACK


@step
def in_fan(crowd, near, x, y, fan, disc):
    """Whether cylinder number `disc[0]` at x, y is in a fan (then the crowd has one more digit), and near."""
    before, beside, cos, sin, cone, sine, reach = fan
    ahead, aside, out = x * cos + y * sin - before, abs(y * cos - x * sin - beside), disc[1] + reach
    inside = (aside * cone - ahead * sine < disc[1]) & (ahead > -disc[1])
    within = inside & (ahead * ahead + aside * aside < out * out)
    return crowd * (EIGHT if inside else ONE) + (disc[0] if inside else NONE), near | within


@step
def look_at_cylinders(n, robot, lanes):
    """Which sensors have a cylinder within reach (infrared.notice_cylinder), and which are in their fans."""
    s, noticed, edges = lanes.single, lanes.noticed, lanes.edges
    discs = (
        (ONE, before_robot(n, 0, lanes)), (TWO, before_robot(n, 1, lanes)),
        (THREE, before_robot(n, 2, lanes)), (FOUR, before_robot(n, 3, lanes)),
    )  # fmt: skip
    cone, sine = f32(robot.proximity_cone), f32(math.sqrt(1.0 - robot.proximity_cone**2))
    for k in range(edges.shape[1]):
        e, o = edge_of(edges, k), U(k) * ROW
        before, beside = e[0] * e[2] + e[1] * e[3], e[1] * e[2] - e[0] * e[3]
        fan = (before, beside, e[2], e[3], cone, sine, f32(robot.proximity_reach[k]))
        for t in range(n):
            crowd, near = NONE, False
            at = FORWARD + t
            crowd, near = in_fan(crowd, near, s[at], s[at + ROW], fan, discs[0])
            crowd, near = in_fan(crowd, near, s[at + TWICE], s[at + TWICE + ROW], fan, discs[1])
            crowd, near = in_fan(crowd, near, s[at + TWICE * U(2)], s[at + TWICE * U(2) + ROW], fan, discs[2])
            crowd, near = in_fan(crowd, near, s[at + TWICE * U(3)], s[at + TWICE * U(3) + ROW], fan, discs[3])
            s[CROWD + o + t] = crowd
            noticed[o + t] |= np.uint32(near)


@step
def notice(n, robot, arena, lanes):
    """List the pairs of a sensor and a lane that may read more than 0: first those with at most two cylinders
    in their fans, then, from MANY on, the others. Returns their numbers."""
    d, s, count, few = lanes.double, lanes.single, U(0), U(0)
    for t in range(n):
        s[X1 + t], s[Y1 + t] = f32(d[X + t]), f32(d[Y + t])
        s[COS1 + t], s[SIN1 + t] = f32(d[COS + t]), f32(d[SIN + t])
    look_at_walls(n, robot, arena, lanes)
    look_at_cylinders(n, robot, lanes)
    for k in range(lanes.edges.shape[1]):
        for t in range(n):
            at = U(k) * ROW + t
            lanes.listed[count] = at
            count += U(lanes.noticed[at])
    for i in range(count):
        at = lanes.listed[i]
        lanes.listed[few], lanes.listed[MANY + i - few] = at, at
        few += U(s[CROWD + at] < EIGHT * EIGHT)
    return few, count - few
