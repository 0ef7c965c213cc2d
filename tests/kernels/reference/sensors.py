"""Noise-free readings of every sensor: infrared (§3.2.3) and ambient light (§3.3)."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from realitygap.world.arena import Arena, Cylinder
from realitygap.world.robot import Body, Profile
from realitygap.world.sensors import Ambient
from tests.kernels.reference import outline
from tests.kernels.reference.rays import (
    ANGLES,
    Point,
    crossing,
    distance,
    from_wall,
    place_and_direction,
    reflectance,
)

DRAWN_BACK = 3e-5
"""A ray's end lies this share of its length before the surface it meets, so that the surface
itself hides nothing that is on the ray's side of it."""


def proximity_sum(profile: Profile, arena: Arena, pose, k: int) -> float:
    """I = Σ cos^m β (a/(d + offset)² + b) of sensor `k`, before clipping.

    Beyond the paper: a times the surface's reflectance, and the cosine of the angle between a ray and the
    normal where it ends.
    """
    sensor = profile.infrared.sensors[k]
    place, direction = place_and_direction(sensor, pose)
    total = 0.0
    for degrees in ANGLES:
        beta = math.radians(degrees)
        ray = (math.cos(direction + beta), math.sin(direction + beta))
        d = distance(arena, place, ray)
        weight = math.cos(beta) ** profile.infrared.exponent
        slant = cosine_of_incidence(arena, place, ray, d) if profile.infrared.matt else 1.0
        back = slant * reflectance(arena, place, ray)
        total += weight * (sensor.a * back / (d + sensor.offset_cm) ** 2 + sensor.b)
    return total


def gathered(profile: Profile, arena: Arena, pose, k: int) -> float:
    """x = Σ share a ρ cos / ((d + offset)² + width²) of measured sensor `k`: what reaches it, ray by ray.

    Less what the outermost rays would see of a flat surface at the middle ray's distance, `overlap` times.
    """
    law, sensor = profile.infrared, profile.infrared.sensors[k]

    def back(d: float) -> float:
        if law.range_cm and d > law.range_cm:
            return 0.0
        return sensor.a / (max(d + sensor.offset_cm, 1e-3) ** 2 + law.width_cm**2)

    place, direction = place_and_direction(sensor, pose)
    total = 0.0
    for quarters, share in enumerate(law.lobe):
        for side in (-1, 1):
            beta = side * math.radians(law.aperture_deg * quarters / 4)
            ray = (math.cos(direction + beta), math.sin(direction + beta))
            d = distance(arena, place, ray)
            slant = cosine_of_incidence(arena, place, ray, d) if law.matt else 1.0
            slant *= reflectance(arena, place, ray)
            total += share / 2 * slant * back(d)
            if quarters == 0:
                total -= law.overlap / 2 * slant * back(d / math.cos(math.radians(law.aperture_deg)))
    return total


def on_curve(curve, knee: float, x: float) -> float:
    """Counts on a curve of values at equal steps of √x / (√x + knee), straight between them."""
    u = math.sqrt(max(x, 0.0)) / (math.sqrt(max(x, 0.0)) + knee)
    return float(np.interp(u, np.linspace(0.0, 1.0, len(curve)), curve))


def cosine_of_incidence(arena: Arena, place: Point, ray: Point, d: float) -> float:
    """Cosine of the angle between a ray of length `d` and the normal of the surface where it ends."""
    normal = normal_at(arena, (place[0] + d * ray[0], place[1] + d * ray[1]), ray)
    return max(-(ray[0] * normal[0] + ray[1] * normal[1]), 0.0)


def proximity(profile: Profile, arena: Arena, pose) -> list[float]:
    """Readings of all proximity sensors: the sum is clipped, not its terms."""
    law, top = profile.infrared, profile.infrared.top
    if law.measured:
        lit = [gathered(profile, arena, pose, k) for k in range(len(law.sensors))]
        return [on_curve(s.curve, 1 / law.curve_cm, x) for s, x in zip(law.sensors, lit, strict=True)]
    sums = [proximity_sum(profile, arena, pose, k) for k in range(len(profile.infrared.sensors))]
    return [min(max(total, 0.0), top) for total in sums]


def circle_hides(circle: Cylinder, a: Point, b: Point) -> bool:
    """The line from `a` to `b` passes through a circle."""
    ex, ey = b[0] - a[0], b[1] - a[1]
    wx, wy = circle.x_cm - a[0], circle.y_cm - a[1]
    share = min(max((wx * ex + wy * ey) / (ex * ex + ey * ey), 0.0), 1.0)
    return math.hypot(wx - share * ex, wy - share * ey) < circle.radius_cm


def body_hides(body: Body, pose, a: Point, b: Point) -> bool:
    """The line from `a` to `b` passes through the robot's body."""
    if body.outline_cm:
        return outline.cut(a, b, outline.corners(body.outline_cm, pose)) > 0
    return circle_hides(disc(*pose[:2], body.radius_cm), a, b)


@lru_cache(maxsize=16)  # asked for again at each ray
def disc(x: float, y: float, radius: float) -> Cylinder:
    """A robot's body."""
    return Cylinder(x_cm=x, y_cm=y, radius_cm=radius)


def wall_hides(wall, a: Point, b: Point) -> bool:
    """The line from `a` to `b` crosses an inner wall."""
    t, u = crossing(wall[:2], wall[2:], a, (b[0] - a[0], b[1] - a[1]))
    return 0 < t < 1 and 0 < u < 1


def direct(lamp, place: Point, visible, height: float) -> float:
    """D = (offset + Σ L_i k_i) / d², d the mean distance to the five points, never below 0."""
    points = lamp.points()
    total = lamp.offset + sum(k for k, point in zip(lamp.weights, points, strict=True) if visible(point))
    d = sum(math.hypot(math.dist(place, point), height) for point in points) / len(points)
    return max(lamp.brightness * total, 0.0) / d**2


def hidden_by_obstacles(arena: Arena, place: Point, point: Point) -> bool:
    """A cylinder or an inner wall stands between a place and a point of a lamp."""
    return any(circle_hides(cylinder, place, point) for cylinder in arena.cylinders) or any(
        wall_hides(wall, place, point) for wall in arena.walls
    )


def light_on_sensor(arena: Arena, lamp, place: Point, direction: float, law: Ambient) -> float:
    """D_i: the robot's own body hides what is more than 90° off the sensor's direction.

    Beyond the paper: times the mean cosine of the angle to the lamp's visible points, to a power.
    """
    height = law.lamp_height_cm

    def visible(point: Point) -> bool:
        ahead = (point[0] - place[0]) * math.cos(direction) + (point[1] - place[1]) * math.sin(direction)
        return ahead >= 0 and not hidden_by_obstacles(arena, place, point)

    light = direct(lamp, place, visible, height)
    seen = [point for point in lamp.points() if visible(point)]
    if not seen or law.facing == 0:
        return light
    along = [(x - place[0]) * math.cos(direction) + (y - place[1]) * math.sin(direction) for x, y in seen]
    far = [math.hypot(math.dist(place, point), height) for point in seen]
    mean = sum(a / d for a, d in zip(along, far, strict=True)) / len(seen)
    return light * mean**law.facing


def light_on_surface(arena: Arena, lamp, place: Point, hides, height: float, top: float = math.inf) -> float:
    """D_ij of the place where a ray ends: the robot's own body throws a shadow too, where light passes
    less than `top` above the place; hides(a, b): it stands in the way of a line."""

    def visible(point: Point) -> bool:
        share = min(top / height, 1.0) if height else 1.0
        risen = tuple(a + share * (b - a) for a, b in zip(place, point, strict=True))
        return not hides(place, risen) and not hidden_by_obstacles(arena, place, point)

    return direct(lamp, place, visible, height)


def illumination(profile: Profile, arena: Arena, pose, k: int) -> float:
    """A_i = Σ over lamps of D_i + Σ_j D_ij · cos^m β_ij · reflectance / d_ij² (or, beyond it, / d_ij)."""
    law = profile.ambient
    sensor = profile.ambient.sensors[k]
    lamps = [Hung(lamp, law, arena) for lamp in arena.lamps]
    place, direction = place_and_direction(sensor, pose)
    hides = partial(body_hides, profile.body, pose)
    total = sum(light_on_sensor(arena, lamp, place, direction, law) for lamp in lamps)
    top = profile.body.height_cm - law.sensor_height_cm if profile.body.height_cm else math.inf
    step = 180 / law.rays
    angles = [-90 + step * (i + 0.5) for i in range(int(law.rays))]
    for degrees in angles:
        beta = math.radians(degrees)
        ray = (math.cos(direction + beta), math.sin(direction + beta))
        d = distance(arena, place, ray)
        back = d * (1 - DRAWN_BACK)
        end = (place[0] + back * ray[0], place[1] + back * ray[1])
        light, white = 0.0, law.reflectance * reflectance(arena, place, ray)
        for lamp in lamps:
            cosine = incidence(lamp, end, normal_at(arena, end, ray), law.lamp_height_cm) if law.matt else 1.0
            light += cosine * light_on_surface(arena, lamp, end, hides, law.lamp_height_cm, top)
        reached = 1 / d**2 if law.falloff == 2 else 1 / math.hypot(d, law.near_cm)
        total += light * math.cos(beta) ** law.exponent * white * reached * 10 / len(angles)
    return total * sensor.gain


class Hung:
    """A lamp whose points are drawn together and kept off the walls, as a profile has it."""

    def __init__(self, lamp, law: Ambient, arena: Arena) -> None:
        self.weights, self.offset, self.brightness = lamp.weights, lamp.offset, lamp.brightness
        narrow = replace(lamp, spacing_cm=lamp.spacing_cm * (1 - law.lamp_narrow))
        (width, depth), off = arena.size_cm, law.lamp_proud_cm
        self._points = [
            (min(max(x, off), width - off), min(max(y, off), depth - off)) for x, y in narrow.points()
        ]

    def points(self) -> list[Point]:
        return self._points


def incidence(lamp, end: Point, normal: Point, height: float) -> float:
    """Mean cosine of the angles under which a lamp's points light a surface, hidden or not."""
    cosines = []
    for x, y in lamp.points():
        ex, ey = x - end[0], y - end[1]
        far = math.hypot(math.hypot(ex, ey), height)
        cosines.append(max((ex * normal[0] + ey * normal[1]) / far, 0.0))
    return sum(cosines) / len(cosines)


def normal_at(arena: Arena, end: Point, ray: Point) -> Point:
    """The normal, towards where the ray comes from, of the surface that the end of a ray lies on."""
    width, depth = arena.size_cm
    found = [
        (end[0], (1.0, 0.0)), (width - end[0], (-1.0, 0.0)),
        (end[1], (0.0, 1.0)), (depth - end[1], (0.0, -1.0)),
    ]  # fmt: skip
    for c in arena.cylinders:
        d = math.dist(end, (c.x_cm, c.y_cm))
        found.append((abs(d - c.radius_cm), ((end[0] - c.x_cm) / d, (end[1] - c.y_cm) / d)))
    for x0, y0, x1, y1 in arena.walls:
        length = math.dist((x0, y0), (x1, y1))
        normal = ((y1 - y0) / length, -(x1 - x0) / length)
        if normal[0] * ray[0] + normal[1] * ray[1] > 0:
            normal = (-normal[0], -normal[1])
        dx, dy = from_wall((x0, y0, x1, y1), *end)
        found.append((math.hypot(dx, dy), normal))
    return min(found, key=lambda one: one[0])[1]


def ambient(profile: Profile, arena: Arena, pose) -> list[float]:
    """Readings of all ambient sensors: V = floor + 1/√A, clipped at the dark reading.

    Beyond the paper: V = dark − A, clipped at the floor.
    """
    law = profile.ambient
    readings = []
    for k, sensor in enumerate(law.sensors):
        floor, dark = law.floor + sensor.floor_shift, law.dark + sensor.dark_shift
        total = illumination(profile, arena, pose, k)
        if law.response == "measured":
            readings.append(on_curve(sensor.curve, math.sqrt(law.curve_light), total))
        elif law.response == "linear":
            readings.append(max(dark - total, floor))
        else:
            readings.append(min(floor + 1 / math.sqrt(total), dark) if total > 0 else dark)
    return readings
