"""Bodies of a convex outline, the slow way: exact clearance, shortest ways out by Minkowski difference."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from scipy.spatial import ConvexHull

from realitygap.world.arena import Arena
from tests.kernels.reference.motion import ROUNDS

Array = np.ndarray
FREE = 1e-9


def corners(outline: Array, pose) -> Array:
    """The outline's corners in the room, [V, 2]."""
    x, y, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    return np.asarray(outline) @ np.array([[c, s], [-s, c]]) + (x, y)


def to_segment(p: Array, a: Array, b: Array) -> float:
    """Distance of a point to a segment."""
    (px, py), (ax, ay), (bx, by) = p.tolist(), a.tolist(), b.tolist()
    ex, ey = bx - ax, by - ay
    share = min(max(((px - ax) * ex + (py - ay) * ey) / max(ex * ex + ey * ey, 1e-30), 0.0), 1.0)
    return math.hypot(px - ax - share * ex, py - ay - share * ey)


def within(p: Array, body: Array) -> float:
    """How deep a point is inside a convex polygon, counter-clockwise; negative where it is outside."""
    ahead = np.roll(body, -1, axis=0) - body
    away = p - body
    return float(((ahead[:, 0] * away[:, 1] - ahead[:, 1] * away[:, 0]) / np.hypot(*ahead.T)).min())


def cut(a: Iterable[float], b: Iterable[float], body: Array) -> float:
    """The length of a segment that lies inside a convex polygon: clipped edge by edge (Cyrus and Beck)."""
    low, high = 0.0, 1.0
    (ax, ay), (bx, by) = map(float, a), map(float, b)
    ends = body.tolist()
    for (px, py), (qx, qy) in zip(ends, [*ends[1:], ends[0]], strict=True):
        inward_x, inward_y = py - qy, qx - px
        at, rise = inward_x * (ax - px) + inward_y * (ay - py), inward_x * (bx - ax) + inward_y * (by - ay)
        if rise == 0:
            if at < 0:
                return 0.0
        elif rise > 0:
            low = max(low, -at / rise)
        else:
            high = min(high, -at / rise)
    return max(high - low, 0.0) * math.hypot(bx - ax, by - ay)


def clearance(arena: Arena, outline: Array, pose) -> float:
    """How far a body is from whatever is nearest, cm; below 0: how deep it is in it."""
    body = corners(outline, pose)
    edges = list(zip(body, np.roll(body, -1, axis=0), strict=True))
    gaps = [body.min(), (np.array(arena.size_cm) - body).min()]
    for one in arena.cylinders:
        middle = np.array([one.x_cm, one.y_cm])
        away = min(to_segment(middle, a, b) for a, b in edges)
        gaps.append((-away if within(middle, body) > 0 else away) - one.radius_cm)
    for wall in arena.walls:
        a, b = np.array(wall[:2]), np.array(wall[2:])
        inside = cut(a, b, body)
        away = min(
            *(to_segment(p, a, b) for p in body), *(to_segment(e, p, q) for e in (a, b) for p, q in edges)
        )
        gaps.append(-float(np.hypot(*shortest_way(np.array([a, b]), body))) if inside > 1e-7 else away)
    return float(min(gaps))


def shortest_way(thing: Array, body: Array) -> Array:
    """The shortest movement of a body that takes it off a convex thing that it overlaps."""
    hull = ConvexHull((thing[:, None] - body[None]).reshape(-1, 2))
    depth = -hull.equations[:, 2]  # of the origin, below each face of thing − body
    nearest = depth.argmin()
    return hull.equations[nearest, :2] * depth[nearest]


def ways(arena: Arena, outline: Array):
    """Of every surface a function of a pose: what takes the body off it, [2] cm; None where it is free."""
    width, depth = arena.size_cm

    def flat(axis: int, sign: int, at: float):
        def way(pose):
            deep = (sign * (at - corners(outline, pose)[:, axis])).max()
            return None if deep <= FREE else deep * sign * np.eye(2)[axis]

        return way

    def round_one(one):
        def way(pose):
            body, middle = corners(outline, pose), np.array([one.x_cm, one.y_cm])
            nearest, gap = None, math.inf
            for a, b in zip(body, np.roll(body, -1, axis=0), strict=True):
                at = a + min(max((middle - a) @ (b - a) / ((b - a) @ (b - a)), 0), 1) * (b - a)
                if np.hypot(*(middle - at)) < gap:
                    nearest, gap = at, float(np.hypot(*(middle - at)))
            side = -1 if within(middle, body) > 0 else 1
            deep = one.radius_cm - side * gap
            return None if deep <= FREE else side * (nearest - middle) / gap * deep

        return way

    def inner(wall):
        def way(pose):
            body, ends = corners(outline, pose), np.array(wall).reshape(2, 2)
            if cut(*ends, body) <= 0:
                return None
            out = shortest_way(ends, body)
            return None if np.hypot(*out) <= FREE else out

        return way

    yield flat(0, 1, 0.0)
    yield flat(1, 1, 0.0)
    yield flat(0, -1, width)
    yield flat(1, -1, depth)
    yield from map(round_one, arena.cylinders)
    yield from map(inner, arena.walls)


def push_out(arena: Arena, outline: Array, begin: Array, at: Array, heading: float):
    """Where a body ends that has moved from begin to `at`, and whether anything pushed it; None: nowhere."""
    touched = False
    for _ in range(ROUNDS + 1):
        clear = True
        for surface in ways(arena, outline):
            out = surface((*at, heading))
            if out is None:
                continue
            touched, clear = True, False
            deep = np.hypot(*out)
            tangent = np.array([-out[1], out[0]]) / deep
            along = tangent @ (at - begin)
            at = at + out - tangent * math.copysign(min(abs(along), arena.sliding * deep), along)
        if clear:
            return at, touched
    return None, True


def settle(arena: Arena, outline: Array, pose, dx: float, dy: float, turn: float):
    """Where a body ends, how far it turned, whether it touched something: in pieces of a sixteenth radius."""
    radius = np.hypot(*np.asarray(outline).T).max()
    pieces = int((math.hypot(dx, dy) + abs(turn) * radius) / (radius / 16)) + 1
    at, heading, touched = np.array(pose[:2]), pose[2], False
    step = np.array([dx, dy]) / pieces
    for _ in range(pieces):
        for go, spin in ((1, 1), (0, 1), (1, 0)):
            to, met = push_out(arena, outline, at, at + go * step, heading + spin * turn / pieces)
            touched = touched or met
            if to is not None:
                at, heading = to, heading + spin * turn / pieces
                break
    return float(at[0]), float(at[1]), heading - pose[2], touched
