"""The infrared sensors of trials in lockstep (lockstep.py), in single precision with a margin.

A network's inputs are integers −10 … 10. Where the upper and the lower bound of a reading give different
inputs, or a ray grazes, a lane is marked to sense separately, in double precision.
"""

import math

import numpy as np

from realitygap.kernels.geometry import TOUCHING
from realitygap.kernels.jit import step

from realitygap.kernels.lanes import (  # isort: skip
    ASIDE, COS, COS1, CYLINDERS, DISCS, EAST, FACING_X, FACING_Y, FORWARD, FX, FY, INVERSE, LEAST, LEFTWARD,
    LIGHT, NORTH, OFFSET, PLACE_X, PLACE_Y, PX, PY, SIN, SIN1, SOME, SOUTH, SUM, WEST, WIDE, X1, Y1, X, Y,
)  # fmt: skip
from realitygap.kernels.network import LIMIT
from realitygap.kernels.work import MOTOR_NOISE

U, f32 = np.uint64, np.float32
ROW = U(WIDE)
SLACK = f32(1e-3)
"""Single precision extends the range of sensors by this, cm."""
GRAZE = f32(2e-3)
"""Half a chord, squared (cm²), below which a ray may miss as well as hit."""
NEAR, TWENTIETH = f32(0.1), f32(0.05)
"""Walls nearer than this, cm, and cylinders nearer than this share of their radius squared, are handled
separately."""
COUNTS, PART, ROUNDING = f32(0.02), f32(3e-4), f32(1e-3)
"""Margins of a reading: counts, a share of the returned light, and counts of the sum with noise."""
BAND = f32(1e-4)
"""Margin of an input before it is rounded."""
FAR, NONE, ONE, HALF = f32(1e9), f32(0.0), f32(1.0), f32(0.5)


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
def look_at_cylinder(n, robot, disc, lanes):
    """Which sensors have a cylinder within reach (infrared.notice_cylinder)."""
    s, noticed, edges, cone = lanes.single, lanes.noticed, lanes.edges, f32(robot.proximity_cone)
    middle_x, middle_y, radius = disc[0], disc[1], disc[2] + SLACK
    for t in range(n):
        x, y = middle_x - s[X1 + t], middle_y - s[Y1 + t]
        s[FORWARD + t] = s[COS1 + t] * x + s[SIN1 + t] * y
        s[LEFTWARD + t] = s[COS1 + t] * y - s[SIN1 + t] * x
    for k in range(edges.shape[1]):
        e, reach, o = edge_of(edges, k), f32(robot.proximity_reach[k]) + radius, U(k) * ROW
        for t in range(n):
            x, y = s[FORWARD + t] - e[0], s[LEFTWARD + t] - e[1]
            square, ahead = x * x + y * y, x * e[2] + y * e[3]
            inside = (ahead > NONE) & (ahead * ahead > cone * cone * square)
            edge = (abs(x * e[5] - y * e[4]) < radius) | (abs(x * e[7] - y * e[6]) < radius)
            noticed[o + t] |= np.uint32((square < reach * reach) & (inside | edge))


@step
def notice(n, robot, arena, lanes):
    """List the pairs of a sensor and a lane that may read more than 0; returns their number."""
    d, s, count = lanes.double, lanes.single, U(0)
    for t in range(n):
        s[X1 + t], s[Y1 + t] = f32(d[X + t]), f32(d[Y + t])
        s[COS1 + t], s[SIN1 + t] = f32(d[COS + t]), f32(d[SIN + t])
    look_at_walls(n, robot, arena, lanes)
    for j in range(arena.cylinders.shape[0]):
        look_at_cylinder(n, robot, lanes.discs[j], lanes)
    for k in range(lanes.edges.shape[1]):
        for t in range(n):
            at = U(k) * ROW + t
            lanes.listed[count] = at
            count += U(lanes.noticed[at])
    return count


@step
def circle(radius):
    """The radius squared, and its reciprocal."""
    return radius * radius, ONE / radius


@step
def nearer(best, p, at, disc, ray):
    """The nearer cylinder along a ray: distance of its middle, half its chord squared, INVERSE, 1/radius.

    Cylinders do not touch, so the one whose middle is nearer is met first.
    """
    ahead, aside = p[at], p[at + ASIDE]
    t, across = ahead * ray[0] + aside * ray[1], ahead * ray[1] - aside * ray[0]
    under = disc[0] - across * across
    hit = (under > -GRAZE) & (t > NONE) & (t < best[0])
    return (
        t if hit else best[0], under if hit else best[1],
        p[at + INVERSE] if hit else best[2], disc[1] if hit else best[3],
    )  # fmt: skip


@step
def trace(p, i, discs, ray):
    """1/d and the cosine of incidence of pair `i` along one ray of its fan, and how certain they are."""
    best = nearer((FAR, ONE, NONE, NONE), p, DISCS[0] + i, discs[0], ray)
    best = nearer(best, p, DISCS[1] + i, discs[1], ray)
    best = nearer(best, p, DISCS[2] + i, discs[2], ray)
    best = nearer(best, p, DISCS[3] + i, discs[3], ray)
    x, y = p[FX + i] * ray[0] - p[FY + i] * ray[1], p[FX + i] * ray[1] + p[FY + i] * ray[0]
    across, along = max(x * p[EAST + i], x * p[WEST + i]), max(y * p[NORTH + i], y * p[SOUTH + i])
    wall, cosine = max(across, along), abs(x) if across >= along else abs(y)
    half = math.sqrt(max(best[1], NONE))
    met = (best[0] + half) * best[2]
    return max(wall, met), half * best[3] if met > wall else cosine, min(p[LEAST + i], best[1])


@step
def place_pairs(n, arena, lanes):
    """Positions of `n` pairs' sensors relative to the walls and cylinders."""
    p, width, depth, touching = lanes.pair, f32(arena.size[0]), f32(arena.size[1]), f32(TOUCHING)
    for i in range(n):
        east, north = width - p[PX + i], depth - p[PY + i]
        p[WEST + i], p[SOUTH + i] = -ONE / max(p[PX + i], touching), -ONE / max(p[PY + i], touching)
        p[EAST + i], p[NORTH + i] = ONE / max(east, touching), ONE / max(north, touching)
        p[LEAST + i] = min(min(p[PX + i], p[PY + i]), min(east, north)) - NEAR
        p[SUM + i] = NONE
    for j in range(CYLINDERS):
        middle_x, middle_y, radius = lanes.discs[j, 0], lanes.discs[j, 1], lanes.discs[j, 2]
        square = radius * radius
        at = DISCS[0] + U(j) * (ASIDE + INVERSE)
        for i in range(n):
            x, y = middle_x - p[PX + i], middle_y - p[PY + i]
            k = x * x + y * y - square
            p[at + i] = x * p[FX + i] + y * p[FY + i]
            p[at + ASIDE + i] = y * p[FX + i] - x * p[FY + i]
            p[at + INVERSE + i] = ONE / max(k, GRAZE)
            p[LEAST + i] = min(p[LEAST + i], k - TWENTIETH * square)


@step
def follow_pairs(first, some, robot, arena, lanes):
    """Light returned to `some` listed pairs, Σ weight cos / (d + offset)²; −1 if it is not certain."""
    p, s, fan, listed = lanes.pair, lanes.single, lanes.fan, lanes.listed
    for i in range(some):
        at = listed[first + i]
        p[PX + i], p[PY + i] = s[PLACE_X + at], s[PLACE_Y + at]
        p[FX + i], p[FY + i] = s[FACING_X + at], s[FACING_Y + at]
        p[OFFSET + i] = f32(robot.proximity_offset[at >> U(6)])
    n = U((np.int64(some) + 15) & -16)
    place_pairs(n, arena, lanes)
    r = lanes.discs[:, 2]
    discs = circle(r[0]), circle(r[1]), circle(r[2]), circle(r[3])
    matt = extended = robot.proximity_lambertian > 0.0
    for k in range(robot.proximity_offset.shape[0]):
        extended = extended or robot.proximity_offset[k] > 0.0
    for j in range(fan.shape[1]):
        ray, weight = (fan[0, j], fan[1, j]), fan[2, j]
        if extended:
            for i in range(n):
                v, cosine, certain = trace(p, i, discs, ray)
                v = v / (ONE + p[OFFSET + i] * v)
                p[LEAST + i] = certain
                p[SUM + i] += weight * (v * v) * (cosine if matt else ONE)
        else:
            for i in range(n):
                v, _, p[LEAST + i] = trace(p, i, discs, ray)
                p[SUM + i] += weight * (v * v)
    for i in range(n):
        p[SUM + i] = -ONE if p[LEAST + i] < GRAZE else p[SUM + i]
    for i in range(some):
        s[LIGHT + listed[first + i]] = p[SUM + i]


@step
def take_in(n, robot, task, level, lanes):
    """Inputs from returned light; a lane whose margins give different inputs is marked `apart`."""
    s, apart, weights = lanes.single, lanes.apart, NONE
    for j in range(lanes.fan.shape[1]):
        weights += lanes.fan[2, j]
    lit, dark = f32(level * robot.noise_proximity), f32(level * robot.noise_proximity_dark)
    top, low, most = f32(robot.proximity_top), f32(robot.proximity_low), f32(LIMIT)
    per = f32(2.0 * LIMIT / (robot.proximity_high - robot.proximity_low))
    for t in range(n):
        apart[t] = U(0)
    for i in range(task.channels.shape[0]):
        k = task.channels[i]
        light, noise = s[np.int64(LIGHT) + k * WIDE :], lanes.noise[(MOTOR_NOISE + k) * WIDE :]
        inputs, change = lanes.inputs[i * WIDE :], lanes.change[i * WIDE :]
        a, b = f32(robot.proximity_a[k]), f32(robot.proximity_b[k]) * weights
        for t in range(n):
            value, margin = a * light[t] + b, COUNTS + PART * (a * light[t])
            drawn = (lit if value > NONE else dark) * f32(noise[t]) + HALF
            least = np.floor(min(max(value - margin, NONE), top) + drawn - ROUNDING)
            highest = np.floor(min(max(value + margin, NONE), top) + drawn + ROUNDING)
            least = np.floor((min(max(least, NONE), top) - low) * per - most + HALF - BAND)
            highest = np.floor((min(max(highest, NONE), top) - low) * per - most + HALF + BAND)
            least, highest = min(max(least, -most), most), min(max(highest, -most), most)
            certain = (least == highest) & (light[t] >= NONE) & ((light[t] == NONE) | (abs(value) > margin))
            apart[t] |= U(not certain)
            new = np.int32(least)
            change[t] = new - inputs[t]
            inputs[t] = new


@step
def sense_lanes(n, world, lanes):
    """Inputs of all lanes; uncertain ones are marked `apart`."""
    count = np.int64(notice(n, world.robot, world.arena, lanes))
    for first in range(0, count, SOME):
        follow_pairs(U(first), U(min(SOME, count - first)), world.robot, world.arena, lanes)
    take_in(n, world.robot, world.task, world.level, lanes)
