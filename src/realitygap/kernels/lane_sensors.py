"""The infrared sensors of trials in lockstep (lockstep.py), in single precision with a margin.

A network's inputs are integers −10 … 10. Where the upper and the lower bound of a reading give different
inputs, or a ray grazes, a lane is marked to sense separately, in double precision.
"""

import math

import numpy as np

from realitygap.kernels.geometry import TOUCHING
from realitygap.kernels.jit import step
from realitygap.kernels.lane_noise import SINGLE
from realitygap.kernels.lane_notice import EIGHT, FOUR, NONE, ONE, ROW, TWO, notice

from realitygap.kernels.lanes import (  # isort: skip
    ASIDE, BEND, CROWD, CYLINDERS, DISCS, EAST, FACING_X, FACING_Y, FX, FY, INVERSE, LEAST, LIGHT, MANY,
    NOISE, NORTH, OFFSET, PLACE_X, PLACE_Y, PX, PY, SOME, SOUTH, SQUARE, SUM, UNSURE, WEST, WHICH,
)  # fmt: skip
from realitygap.kernels.network import LIMIT

U, f32 = np.uint64, np.float32
GRAZE = f32(2e-3)
"""Half a chord, squared (cm²), below which a ray may miss as well as hit."""
NEAR, TWENTIETH = f32(0.1), f32(0.05)
"""Walls nearer than this, cm, and cylinders nearer than this share of their radius squared, are handled
separately."""
COUNTS, PART, ROUNDING = f32(0.02), f32(3e-4), f32(1e-3)
"""Margins of a reading: counts, a share of the returned light, and counts of the sum with noise."""
BAND = f32(1e-4)
"""Margin of an input before it is rounded."""
LOWEST, HIGHEST = f32(0.5 - BAND - LIMIT), f32(0.5 + BAND - LIMIT)
"""What is added to both bounds of an input before they are rounded down."""
FAR, HALF, EIGHTH = f32(1e9), f32(0.5), f32(0.125)


@step
def nearer(best, p, at, t, across):
    """The nearer cylinder along a ray: distance of its middle, half its chord squared, INVERSE, 1/radius.

    Cylinders do not touch, so the one whose middle is nearer is met first. This one's middle is `t` along the
    ray and `across` aside.
    """
    under = p[at + SQUARE] - across * across
    hit = (under > -GRAZE) & (t > NONE) & (t < best[0])
    return (
        t if hit else best[0], under if hit else best[1],
        p[at + INVERSE] if hit else best[2], p[at + BEND] if hit else best[3],
    )  # fmt: skip


@step
def nearer_both(bests, p, at, ray):
    """As `nearer`, of a ray and its mirror image."""
    a, b, c, d = p[at] * ray[0], p[at + ASIDE] * ray[1], p[at] * ray[1], p[at + ASIDE] * ray[0]
    return nearer(bests[0], p, at, a + b, c - d), nearer(bests[1], p, at, a - b, c + d)


@step
def met(best, p, i, x, y):
    """1/d and the cosine of incidence of pair `i` along a ray in direction x, y; `best` is its cylinder."""
    across, along = max(x * p[EAST + i], x * p[WEST + i]), max(y * p[NORTH + i], y * p[SOUTH + i])
    wall, cosine = max(across, along), abs(x) if across >= along else abs(y)
    half = math.sqrt(max(best[1], NONE))
    disc = (best[0] + half) * best[2]
    return max(wall, disc), half * best[3] if disc > wall else cosine


@step
def trace(p, i, ray, many):
    """1/d and the cosine of incidence of pair `i` along a ray of its fan and along its mirror image, and how
    certain they are."""
    nothing = (FAR, ONE, NONE, NONE)
    bests = nearer_both((nothing, nothing), p, DISCS[0] + i, ray)
    bests = nearer_both(bests, p, DISCS[1] + i, ray)
    if many is not None:
        bests = nearer_both(bests, p, DISCS[2] + i, ray)
        bests = nearer_both(bests, p, DISCS[3] + i, ray)
    a, b, c, d = p[FX + i] * ray[0], p[FY + i] * ray[1], p[FX + i] * ray[1], p[FY + i] * ray[0]
    one, other = met(bests[0], p, i, a - b, c + d), met(bests[1], p, i, a + b, d - c)
    return one, other, min(p[LEAST + i], min(bests[0][1], bests[1][1]))


@step
def chosen(which, column):
    """The number of that disc in a column of Lanes.discs."""
    one = column[1] if which == ONE else column[0]
    other = column[3] if which < FOUR else column[4]
    return one if which < TWO else column[2] if which == TWO else other


@step
def column_of(discs, c):
    """Column `c` of Lanes.discs."""
    return discs[0, c], discs[1, c], discs[2, c], discs[3, c], discs[4, c]


@step
def place_disc(n, slot, lanes, many):
    """Positions of `n` pairs' sensors relative to a cylinder: the one of that number, or so many-th in their
    fans."""
    p, discs, at = lanes.pair, lanes.discs, DISCS[0] + U(slot) * (BEND + ASIDE)
    middle_x, middle_y, radii = column_of(discs, 0), column_of(discs, 1), column_of(discs, 2)
    for i in range(n):
        high = np.floor(p[WHICH + i] * EIGHTH)
        which = high if slot else p[WHICH + i] - EIGHT * high
        which = which if many is None else f32(slot + 1)
        radius = chosen(which, radii)
        x, y = chosen(which, middle_x) - p[PX + i], chosen(which, middle_y) - p[PY + i]
        square = radius * radius
        k = x * x + y * y - square
        p[at + i] = x * p[FX + i] + y * p[FY + i]
        p[at + ASIDE + i] = y * p[FX + i] - x * p[FY + i]
        p[at + INVERSE + i] = ONE / max(k, GRAZE)
        p[at + SQUARE + i], p[at + BEND + i] = square, ONE / radius
        p[LEAST + i] = min(p[LEAST + i], k - TWENTIETH * square)


@step
def place_pairs(n, arena, lanes, many):
    """Positions of `n` pairs' sensors relative to the walls and cylinders."""
    p, width, depth, touching = lanes.pair, f32(arena.size[0]), f32(arena.size[1]), f32(TOUCHING)
    for i in range(n):
        east, north = width - p[PX + i], depth - p[PY + i]
        p[WEST + i], p[SOUTH + i] = -ONE / max(p[PX + i], touching), -ONE / max(p[PY + i], touching)
        p[EAST + i], p[NORTH + i] = ONE / max(east, touching), ONE / max(north, touching)
        p[LEAST + i] = min(min(p[PX + i], p[PY + i]), min(east, north)) - NEAR
        p[SUM + i] = NONE
    for slot in range(2 if many is None else CYLINDERS):
        place_disc(n, slot, lanes, many)


@step
def follow_pairs(first, some, robot, arena, lanes, many):
    """Light returned to `some` listed pairs, Σ weight cos / (d + offset)²; −1 if it is not certain.

    Unless they are `many`, at most two cylinders are in a pair's fan.
    """
    p, s, fan, listed = lanes.pair, lanes.single, lanes.fan, lanes.listed
    for i in range(some):
        at = listed[first + i]
        p[PX + i], p[PY + i] = s[PLACE_X + at], s[PLACE_Y + at]
        p[FX + i], p[FY + i] = s[FACING_X + at], s[FACING_Y + at]
        p[WHICH + i] = s[CROWD + at]
    n = U((np.int64(some) + 15) & -16)
    place_pairs(n, arena, lanes, many)
    matt = extended = robot.proximity_lambertian > 0.0
    for k in range(robot.proximity_offset.shape[0]):
        extended = extended or robot.proximity_offset[k] > 0.0
    if extended:
        for i in range(some):
            p[OFFSET + i] = f32(robot.proximity_offset[listed[first + i] // ROW])
    for j in range(fan.shape[1] // 2):
        ray, weight = (fan[0, j], fan[1, j]), fan[2, j]
        if extended:
            for i in range(n):
                one, other, certain = trace(p, i, ray, many)
                v, w = one[0] / (ONE + p[OFFSET + i] * one[0]), other[0] / (ONE + p[OFFSET + i] * other[0])
                p[LEAST + i] = certain
                both = v * v * one[1] + w * w * other[1] if matt else v * v + w * w
                p[SUM + i] += weight * both
        else:
            for i in range(n):
                (v, _), (w, _), p[LEAST + i] = trace(p, i, ray, many)
                p[SUM + i] += weight * (v * v + w * w)
    for i in range(n):
        p[SUM + i] = -ONE if p[LEAST + i] < GRAZE else p[SUM + i]
    for i in range(some):
        s[LIGHT + listed[first + i]] = p[SUM + i]


@step
def take_in(n, robot, task, lanes):
    """Inputs from returned light; a lane whose margins give different inputs is marked `apart`."""
    s, apart, weights, lit, dark = lanes.single, lanes.apart, NONE, lanes.loud[0], lanes.loud[1]
    for j in range(lanes.fan.shape[1]):
        weights += lanes.fan[2, j]
    top, low, high = f32(robot.proximity_top), f32(robot.proximity_low), f32(robot.proximity_high)
    per, first, last = (
        f32(2 * LIMIT) / (high - low),
        max(low, NONE),
        min(high, top),
    )  # inputs −LIMIT and LIMIT
    rounding = ROUNDING + SINGLE * max(lit, dark)
    lower, higher = HALF - rounding, HALF + rounding
    for t in range(n):
        s[UNSURE + t] = NONE
    for i in range(task.channels.shape[0]):
        k, to = U(task.channels[i]), U(i) * ROW
        at, noise = LIGHT + k * ROW, NOISE + k * ROW
        a, b = f32(robot.proximity_a[k]), f32(robot.proximity_b[k]) * weights
        for t in range(n):
            light = s[at + t]
            value, margin = a * light + b, COUNTS + PART * (a * light)
            drawn = (lit if value > NONE else dark) * s[noise + t]
            least = np.floor(min(max(value - margin, NONE), top) + (drawn + lower))
            highest = np.floor(min(max(value + margin, NONE), top) + (drawn + higher))
            least = np.floor((min(max(least, first), last) - low) * per + LOWEST)
            highest = np.floor((min(max(highest, first), last) - low) * per + HIGHEST)
            certain = (least == highest) & (light >= NONE) & ((light == NONE) | (abs(value) > margin))
            s[UNSURE + t] += NONE if certain else ONE
            new = np.int32(least)
            lanes.change[to + t] = new - lanes.inputs[to + t]
            lanes.inputs[to + t] = new
    for t in range(n):
        apart[t] = U(s[UNSURE + t] > NONE)


@step
def follow_all(n, robot, arena, lanes):
    """Light returned to all sensors that may read more than 0."""
    few, many = notice(n, robot, arena, lanes)
    for first in range(0, np.int64(few), SOME):
        follow_pairs(U(first), U(min(SOME, np.int64(few) - first)), robot, arena, lanes, None)
    for first in range(0, np.int64(many), SOME):
        follow_pairs(MANY + U(first), U(min(SOME, np.int64(many) - first)), robot, arena, lanes, True)


@step
def sense_lanes(n, world, lanes):
    """Inputs of all lanes; uncertain ones are marked `apart`."""
    follow_all(n, world.robot, world.arena, lanes)
    take_in(n, world.robot, world.task, lanes)
