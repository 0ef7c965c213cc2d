"""Contact of a body whose outline is a convex polygon, with the same rules as contact.py's disc.

An overlap is resolved along the shortest way: from an outer wall by the deepest corner, from a cylinder by
the edge or corner nearest to its middle, from an inner wall along the normal (of an edge or the wall) with
the least overlap (separating axes). A body that cannot turn anywhere near does not turn.
"""

import math
from typing import NamedTuple

from realitygap.compiled import step
from realitygap.kernels.contact import ROUNDS, Move, push
from realitygap.kernels.near import SPARE, is_beyond, stands_clear, unit
from realitygap.kernels.rng import sin_cos

PIECE = 0.0625
"""The longest movement of any corner in one piece, over the radius: a quarter of the least width of an
outline."""
FREE = 1e-9
"""An overlap that counts as none, cm."""
X, Y, NX, NY = 0, 1, 2, 3
"""Columns of params.Robot.outline."""


class Way(NamedTuple):
    """The unit vector along which a body leaves something soonest, and the distance, cm; negative: it is
    free."""

    nx: float
    ny: float
    depth: float


@step
def off_wall(outline, nx, ny, behind):
    """Out of a wall with normal (nx, ny) in the body's frame, `behind` cm behind the body's middle."""
    least = math.inf
    for i in range(outline.shape[0]):
        least = min(least, nx * outline[i, X] + ny * outline[i, Y])
    return Way(nx, ny, -least - behind)


@step
def off_cylinder(outline, qx, qy, radius):
    """Out of a cylinder at (qx, qy) in the body's frame."""
    nearest, dx, dy, outside = math.inf, 1.0, 0.0, -math.inf
    last = outline.shape[0] - 1
    for i in range(outline.shape[0]):
        j = i + 1 if i < last else 0
        ex, ey = outline[j, X] - outline[i, X], outline[j, Y] - outline[i, Y]
        vx, vy = qx - outline[i, X], qy - outline[i, Y]
        outside = max(outside, vx * outline[i, NX] + vy * outline[i, NY])
        share = min(max((vx * ex + vy * ey) / (ex * ex + ey * ey), 0.0), 1.0)
        vx, vy = vx - share * ex, vy - share * ey
        if vx * vx + vy * vy < nearest:
            nearest, dx, dy = vx * vx + vy * vy, vx, vy
    ux, uy, gap = unit(dx, dy)
    side = 1.0 if outside > 0.0 else -1.0
    return Way(-side * ux, -side * uy, radius - side * gap)


@step
def off_segment(outline, ax, ay, bx, by):
    """Out of an inner wall from (ax, ay) to (bx, by) in the body's frame."""
    tx, ty, _ = unit(bx - ax, by - ay)
    far, near = -math.inf, math.inf
    way = Way(1.0, 0.0, math.inf)
    for i in range(outline.shape[0]):
        x, y, nx, ny = outline[i, X], outline[i, Y], outline[i, NX], outline[i, NY]
        depth = -min(nx * (ax - x) + ny * (ay - y), nx * (bx - x) + ny * (by - y))
        if depth < way.depth:
            way = Way(-nx, -ny, depth)
        across = tx * (y - ay) - ty * (x - ax)
        far, near = max(far, across), min(near, across)
    if -near < way.depth:
        way = Way(-ty, tx, -near)
    if far < way.depth:
        way = Way(ty, -tx, far)
    return way


@step
def way_out(arena, robot, j, at, c, s):
    """Out of surface `j` of the room (four walls, cylinders, inner walls), for a body at a Move's end."""
    x, y, outline = at.x, at.y, robot.outline
    cylinders = arena.cylinders.shape[0]
    if j < 4:
        # x = 0, y = 0, x = width, y = depth: the normal points into the room.
        nx = 1.0 if j == 0 else (-1.0 if j == 2 else 0.0)
        ny = 1.0 if j == 1 else (-1.0 if j == 3 else 0.0)
        middle = nx * x + ny * y + (arena.size[j - 2] if j >= 2 else 0.0)
        way = off_wall(outline, c * nx + s * ny, c * ny - s * nx, middle)
    elif j < 4 + cylinders:
        qx, qy = arena.cylinders[j - 4, 0] - x, arena.cylinders[j - 4, 1] - y
        way = off_cylinder(outline, c * qx + s * qy, c * qy - s * qx, arena.cylinders[j - 4, 2])
    elif is_beyond(arena, j - 4 - cylinders, x, y, robot.radius):
        way = Way(1.0, 0.0, -SPARE)
    else:
        wall = arena.segments[j - 4 - cylinders]
        ax, ay, bx, by = wall[0] - x, wall[1] - y, wall[2] - x, wall[3] - y
        way = off_segment(outline, c * ax + s * ay, c * ay - s * ax, c * bx + s * by, c * by - s * bx)
    return Way(c * way.nx - s * way.ny, s * way.nx + c * way.ny, way.depth)


@step
def push_out(arena, robot, to, c, s):
    """A move after all surfaces have pushed, and the number of rounds; -1: nothing near is clear."""
    surfaces = 4 + arena.cylinders.shape[0] + arena.segments.shape[0]
    for k in range(ROUNDS + 1):
        clear = True
        for j in range(surfaces):
            way = way_out(arena, robot, j, to, c, s)
            if way.depth > FREE:
                to = push(to, way.nx, way.ny, way.depth, arena.sliding)
                clear = False
        if clear:
            return to, k
    return to, -1


@step
def settle_outline(arena, robot, pose, dx, dy, turn):
    """End of a body's movement from a clear pose by (dx, dy) with a turn: (x, y, turned, touched).

    It moves in pieces too short to jump over anything. If a piece ends nowhere clear, the body only turns; if
    that fails, it only moves; else it stays.
    """
    x, y, turned, touched = pose[0], pose[1], 0.0, False
    way = math.sqrt(dx * dx + dy * dy)
    if way < 0.5 * robot.radius and stands_clear(arena, x + dx, y + dy, robot.radius):
        return x + dx, y + dy, turn, False
    pieces = int((way + abs(turn) * robot.radius) / (PIECE * robot.radius)) + 1
    dx, dy, turn = dx / pieces, dy / pieces, turn / pieces
    for _ in range(pieces):
        for attempt in range(3):
            go = 0.0 if attempt == 1 else 1.0
            spin = 0.0 if attempt == 2 else turn
            s, c = sin_cos(pose[2] + turned + spin)
            ahead = Move(x + go * dx, y + go * dy, go * dx, go * dy)
            to, rounds = push_out(arena, robot, ahead, c, s)
            touched = touched or rounds != 0
            if rounds >= 0:
                x, y, turned = to.x, to.y, turned + spin
                break
    return x, y, turned, touched


@step
def body_clear(robot, arena, x, y, heading):
    """True if the robot's body at a pose overlaps nothing (less than 1e-9 cm)."""
    if robot.outline.shape[0] == 0:
        return stands_clear(arena, x, y, robot.radius)
    s, c = sin_cos(heading)
    inside = 0.0 <= x <= arena.size[0] and 0.0 <= y <= arena.size[1]
    for j in range(4 + arena.cylinders.shape[0] + arena.segments.shape[0]):
        inside = inside and way_out(arena, robot, j, Move(x, y, 0.0, 0.0), c, s).depth <= FREE
    return inside
