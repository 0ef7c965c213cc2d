"""The wheels, the arc that they drive, and contact of a disc or a polygon with what stands there (§3.2.2)."""

import math
from typing import NamedTuple

from realitygap.compiled import step
from realitygap.kernels.rays import SPARE, from_segment, is_beyond, is_clear, unit
from realitygap.kernels.rng import sin_cos
from realitygap.kernels.types import STEP_S

MEMORY = 5
"""The integral term is the sum of the proportional terms of the last five steps."""

# A row of `State.wheel`: speed U, last change δv, then the last five P, newest first, then the last target,
# and the wheel's distance (cm/s over a step) from the middle of its play.
SPEED, CHANGE, ERRORS, TARGET, PLAY = 0, 1, 2, 7, 8

FASTEST = 12.7
"""A wheel's largest speed over that of its top command: a Khepera counts speeds up to 127 units."""


@step
def settled_speed(robot, w, command):
    """The speed (cm/s) at which wheel `w` settles under a command, robot's units: by its curve, constant
    beyond its ends; proportional without one."""
    curve = robot.wheels.curve
    if curve.shape[0] > 0:
        i = 1
        while i < curve.shape[0] - 1 and command > curve[i, 0]:
            i += 1
        share = (command - curve[i - 1, 0]) / (curve[i, 0] - curve[i - 1, 0])
        share = min(max(share, 0.0), 1.0)
        command = curve[i - 1, 1 + w] + share * (curve[i, 1 + w] - curve[i - 1, 1 + w])
    return command * robot.wheels.speed_per_unit[w]


@step
def turn_wheel(robot, wheel, target, drag, slip):
    """One step of one wheel towards `target` (cm/s); returns its new speed U (cm/s).

    δv = (Kp·P + Ki·I + Kd·D) / 50000. `drag` multiplies the friction threshold, `slip` is the
    relative error of the achieved speed (both carry the noise).
    """
    for i in range(MEMORY - 1, 0, -1):
        wheel[ERRORS + i] = wheel[ERRORS + i - 1]
    speed = wheel[SPEED]
    # Not in the paper: a share of the command acts a step late.
    asked = target + robot.wheels.lag * (wheel[TARGET] - target)
    wheel[TARGET] = target
    proportional = (asked - speed) / STEP_S
    wheel[ERRORS] = proportional
    integral = 0.0
    for i in range(MEMORY):
        integral += wheel[ERRORS + i]
    # Static friction: a resting wheel does not move until the integral term passes a threshold.
    if abs(speed) < robot.wheels.rest_speed and abs(integral) <= robot.wheels.friction * drag:
        wheel[SPEED] = 0.0
        wheel[CHANGE] = 0.0
        return 0.0
    pid = robot.wheels
    change = (pid.kp * proportional + pid.ki * integral + pid.kd * wheel[CHANGE]) / pid.divisor
    wheel[CHANGE] = change
    speed = speed + change - take_up_play(robot, wheel, target)
    wheel[SPEED] = speed + slip * speed
    return wheel[SPEED]


@step
def bound_wheel(wheel, fastest):
    """Keep a wheel within ±`fastest` (cm/s), since noise proportional to the speed could accelerate it
    without limit."""
    wheel[SPEED] = min(max(wheel[SPEED], -fastest), fastest)
    wheel[CHANGE] = min(max(wheel[CHANGE], -2.0 * fastest), 2.0 * fastest)


@step
def take_up_play(robot, wheel, target):
    """Speed (cm/s) that a wheel loses in this step on reversal; 0 in the paper.

    Friction reverses with the wheel, and the control needs a moment to respond. The effect is that of play
    between motor and wheel: the same distance is lost at each reversal, with or without rest, and takes
    longer the lower the commanded speed.
    """
    half = robot.wheels.half_play
    if half <= 0.0 or target == 0.0:
        return 0.0
    side = 1.0 if target > 0.0 else -1.0
    owed = half - side * wheel[PLAY]
    if owed <= 0.0:
        return 0.0
    room = abs(target) * (1.0 - robot.wheels.lag)
    lost = owed * (room / (room + owed))
    wheel[PLAY] += side * lost
    return side * lost


class Arc(NamedTuple):
    """Movement of the body in one step: distance (cm), turn (rad), chord over arc, the mean heading."""

    dx: float
    dy: float
    turn: float
    share: float
    cos_mean: float
    sin_mean: float


@step
def drive_arc(track, left, right, c, s, period=STEP_S):
    """Movement of the body in one step.

    Exact differential drive: a chord of length v·dt·sin(h)/h, h half the turn, at mean heading.
    (c, s) = (cos, sin) of the heading before the step.
    """
    half = (right - left) * (0.5 * period) / track
    sin_half, cos_half = sin_cos(half)
    share = sin_half / half if abs(half) > 1e-6 else 1.0 - half * half / 6.0
    cos_mean = c * cos_half - s * sin_half
    sin_mean = s * cos_half + c * sin_half
    chord = 0.5 * (left + right) * period * share
    return Arc(chord * cos_mean, chord * sin_mean, 2.0 * half, share, cos_mean, sin_mean)


ROUNDS = 12
"""Passes over all surfaces; corners need two or three."""


class Move(NamedTuple):
    """A position and the movement that led there, cm."""

    x: float
    y: float
    dx: float
    dy: float


@step
def push(to, nx, ny, depth, sliding):
    """A move after one surface (normal n) has pushed the disc out by `depth`.

    Coulomb friction: up to `sliding` · depth of the movement along the surface is held back.
    """
    along = to.dy * nx - to.dx * ny
    held = min(abs(along), sliding * depth)
    held = held if along >= 0.0 else -held
    px = nx * depth + ny * held
    py = ny * depth - nx * held
    return Move(to.x + px, to.y + py, to.dx + px, to.dy + py)


@step
def settle_once(arena, radius, x, y, dx, dy):
    """End of a disc's movement from a clear position (x, y) by (dx, dy): (x, y, touched).

    If no position near is clear (a wedge), it stays: a robot never enters a wall or cylinder.
    The movement must be shorter than the radius, or it could end behind an inner wall.
    """
    to = Move(x + dx, y + dy, dx, dy)
    if is_clear(arena, to.x, to.y, radius):
        return to.x, to.y, False
    slip = arena.sliding
    for _ in range(ROUNDS):
        if to.x < radius:
            to = push(to, 1.0, 0.0, radius - to.x, slip)
        if to.y < radius:
            to = push(to, 0.0, 1.0, radius - to.y, slip)
        over = to.x - (arena.size[0] - radius)
        if over > 0.0:
            to = push(to, -1.0, 0.0, over, slip)
        over = to.y - (arena.size[1] - radius)
        if over > 0.0:
            to = push(to, 0.0, -1.0, over, slip)
        for j in range(arena.cylinders.shape[0]):
            vx = to.x - arena.cylinders[j, 0]
            vy = to.y - arena.cylinders[j, 1]
            apart = radius + arena.cylinders[j, 2]
            if vx * vx + vy * vy < apart * apart:
                nx, ny, gap = unit(vx, vy)
                to = push(to, nx, ny, apart - gap, slip)
        for j in range(arena.segments.shape[0]):
            if not is_beyond(arena, j, to.x, to.y, radius):
                vx, vy = from_segment(arena, j, to.x, to.y)
                nx, ny, gap = unit(vx, vy)
                if gap < radius:
                    to = push(to, nx, ny, radius - gap, slip)
        if is_clear(arena, to.x, to.y, radius):
            return to.x, to.y, True
    return x, y, True


@step
def settle(arena, radius, x, y, dx, dy):
    """As settle_once for a movement of any length, in pieces of at most half a radius."""
    pieces = 1
    if dx * dx + dy * dy > 0.25 * radius * radius:
        pieces = int(math.sqrt(dx * dx + dy * dy) / (0.5 * radius)) + 1
        dx /= pieces
        dy /= pieces
    touched = False
    for _ in range(pieces):
        x, y, met = settle_once(arena, radius, x, y, dx, dy)
        touched = touched or met
    return x, y, touched


@step
def ground_speeds(dx, dy, arc, track, period=STEP_S):
    """Speeds of the two wheels over the ground (cm/s), from the body's movement after contact."""
    forward = (dx * arc.cos_mean + dy * arc.sin_mean) / (arc.share * period)
    apart = 0.5 * arc.turn * track / period
    return forward - apart, forward + apart


PIECE = 0.0625
"""The longest movement of any corner in one piece, over the radius: a quarter of the least width of an
outline."""
FREE = 1e-9
"""An overlap that counts as none, cm."""
X, Y, NX, NY = 0, 1, 2, 3
"""Columns of types.Robot.outline."""


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
    if way < 0.5 * robot.radius and is_clear(arena, x + dx, y + dy, robot.radius):
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
        return is_clear(arena, x, y, robot.radius)
    s, c = sin_cos(heading)
    inside = 0.0 <= x <= arena.size[0] and 0.0 <= y <= arena.size[1]
    for j in range(4 + arena.cylinders.shape[0] + arena.segments.shape[0]):
        inside = inside and way_out(arena, robot, j, Move(x, y, 0.0, 0.0), c, s).depth <= FREE
    return inside
