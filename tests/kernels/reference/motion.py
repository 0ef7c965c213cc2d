"""Wheels (§3.2.2), the arc they drive the body along, and contact."""

from __future__ import annotations

import math

import numpy as np

from realitygap.world.arena import Arena
from realitygap.world.robot import Profile
from tests.kernels.reference.rays import from_wall, overlap

DT = 0.1
CLEAR = 1e-9
"""An overlap that counts as none, cm."""
ROUNDS = 12


class Wheel:
    """δv = (Kp·P + Ki·I + Kd·D) / 50000 with P = (V − U)/0.1, I the last five P, D the last δv."""

    def __init__(self, profile: Profile) -> None:
        self.law = profile.wheels
        self.speed = 0.0
        self.change = 0.0
        self.last_target = 0.0
        self.play = 0.0
        self.errors: list[float] = []

    def turn(self, target: float, drag: float = 1.0, slip: float = 0.0) -> float:
        """One step towards `target`, cm/s; drag multiplies the friction threshold, slip is relative."""
        law = self.law
        asked = (1 - law.lag) * target + law.lag * self.last_target
        self.last_target = target
        self.errors.append((asked - self.speed) / DT)
        integral = sum(self.errors[-5:])
        resting = abs(self.speed) < law.rest_speed_cm_s
        if resting and abs(integral) <= law.friction_cm_s2 * drag:
            self.speed = self.change = 0.0
            return 0.0
        force = law.kp * self.errors[-1] + law.ki * integral + law.kd * self.change
        self.change = force / law.divisor
        self.speed = (self.speed + self.change - self.taken_up(target)) * (1 + slip)
        return self.speed

    def bound(self, fastest: float) -> float:
        """The speed kept within ±fastest, cm/s; the last change within twice that."""
        self.speed = max(-fastest, min(self.speed, fastest))
        self.change = max(-2 * fastest, min(self.change, 2 * fastest))
        return self.speed

    def taken_up(self, target: float) -> float:
        """Of the play left in the target's direction, what this step takes up; as a speed."""
        left = self.law.play_cm / 2 - self.play * (1 if target > 0 else -1)
        if target == 0 or left <= 0:
            return 0.0
        room = (1 - self.law.lag) * abs(target) * DT
        way = math.copysign(left * room / (room + left), target)
        self.play += way
        return way / DT


def arc(track: float, left: float, right: float, heading: float) -> tuple[float, float, float]:
    """(dx, dy, turn) of one step about the centre of the circle that the wheels describe."""
    turn = (right - left) * DT / track
    if left == right:
        return left * DT * math.cos(heading), left * DT * math.sin(heading), 0.0
    radius = track / 2 * (right + left) / (right - left)
    dx = radius * (math.sin(heading + turn) - math.sin(heading))
    dy = -radius * (math.cos(heading + turn) - math.cos(heading))
    return dx, dy, turn


def surfaces(arena: Arena, radius: float):
    """Every surface as a function of the disc's centre: its normal there and the overlap."""
    width, depth = arena.size_cm

    def flat(normal, gap):
        return lambda at: (np.array(normal), radius - gap(at))

    def round_one(c):
        def meet(at):
            away = at - (c.x_cm, c.y_cm)
            return away / math.hypot(*away), radius + c.radius_cm - math.hypot(*away)

        return meet

    def inner(wall):
        def meet(at):
            away = np.array(from_wall(wall, *at))
            return away / math.hypot(*away), radius - math.hypot(*away)

        return meet

    yield flat((1.0, 0.0), lambda at: at[0])
    yield flat((0.0, 1.0), lambda at: at[1])
    yield flat((-1.0, 0.0), lambda at: width - at[0])
    yield flat((0.0, -1.0), lambda at: depth - at[1])
    yield from map(round_one, arena.cylinders)
    yield from map(inner, arena.walls)


def settle(arena: Arena, radius: float, x: float, y: float, dx: float, dy: float):
    """Where a disc ends, and whether it touched something: in pieces of at most half a radius."""
    pieces = 1
    while math.hypot(dx, dy) / pieces > radius / 2:
        pieces += 1
    touched = False
    for _ in range(pieces):
        x, y, met = settle_once(arena, radius, x, y, dx / pieces, dy / pieces)
        touched = touched or met
    return x, y, touched


def settle_once(arena: Arena, radius: float, x: float, y: float, dx: float, dy: float):
    """Where a disc ends that moves from (x, y) by (dx, dy), and whether it touched something.

    Each overlap pushes it out along the normal and holds back its movement along the surface by
    at most the coefficient times the depth, until nothing overlaps.
    """
    begin, at = np.array([x, y]), np.array([x + dx, y + dy])
    if overlap(arena, *at, radius) <= CLEAR:
        return float(at[0]), float(at[1]), False
    for _ in range(ROUNDS):
        for surface in surfaces(arena, radius):
            normal, depth = surface(at)
            if depth <= 0:
                continue
            tangent = np.array([-normal[1], normal[0]])
            along = float(tangent @ (at - begin))
            held = math.copysign(min(abs(along), arena.sliding * depth), along)
            at = at + normal * depth - tangent * held
        if overlap(arena, *at, radius) <= CLEAR:
            return float(at[0]), float(at[1]), True
    return x, y, True
