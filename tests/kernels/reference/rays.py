"""Rays against a room, one at a time (§3.2.3)."""

from __future__ import annotations

import math

Point = tuple[float, float]

ANGLES = (-81, -63, -45, -27, -9, 9, 27, 45, 63, 81)
"""β of the ten rays, degrees: the middles of ten equal parts of 180°."""


def place_and_direction(sensor, pose) -> tuple[Point, float]:
    """Where a sensor of a robot at `pose` (x, y, heading rad) is, and its direction (rad)."""
    x, y, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    place = (x + c * sensor.x_cm - s * sensor.y_cm, y + s * sensor.x_cm + c * sensor.y_cm)
    return place, heading + math.radians(sensor.direction_deg)


def to_outer_walls(arena, place: Point, ray: Point) -> float:
    """Distance from a place inside the room along a ray to its outer walls."""
    found = math.inf
    for at, along, size in zip(place, ray, arena.size_cm, strict=True):
        if along > 0:
            found = min(found, (size - at) / along)
        elif along < 0:
            found = min(found, at / -along)
    return found


def to_cylinder(cylinder, place: Point, ray: Point) -> float:
    """Distance along a ray to a cylinder: the smaller root of |place + t·ray − centre| = radius."""
    fx, fy = place[0] - cylinder.x_cm, place[1] - cylinder.y_cm
    half_b = fx * ray[0] + fy * ray[1]
    root = half_b**2 - (fx**2 + fy**2 - cylinder.radius_cm**2)
    if root <= 0 or half_b >= 0:
        return math.inf
    # The product of the roots is the constant term: no cancellation where the ray grazes.
    return (fx**2 + fy**2 - cylinder.radius_cm**2) / (-half_b + math.sqrt(root))


def crossing(a: Point, b: Point, place: Point, ray: Point) -> tuple[float, float]:
    """(t, u) with place + t·ray = a + u·(b − a); infinite where they are parallel."""
    ex, ey = b[0] - a[0], b[1] - a[1]
    determinant = ray[1] * ex - ray[0] * ey
    if determinant == 0:
        return math.inf, math.inf
    gx, gy = a[0] - place[0], a[1] - place[1]
    return (gy * ex - gx * ey) / determinant, (ray[0] * gy - ray[1] * gx) / determinant


def to_inner_wall(wall, place: Point, ray: Point) -> float:
    """Distance along a ray to an inner wall (x0, y0, x1, y1)."""
    t, u = crossing(wall[:2], wall[2:], place, ray)
    return t if t > 0 and 0 <= u <= 1 else math.inf


def distance(arena, place: Point, ray: Point) -> float:
    """Distance from a place along a unit vector to the nearest surface."""
    found = [to_outer_walls(arena, place, ray)]
    found += [to_cylinder(cylinder, place, ray) for cylinder in arena.cylinders]
    found += [to_inner_wall(wall, place, ray) for wall in arena.walls]
    return min(found)


def reflectance(arena, place: Point, ray: Point) -> float:
    """Of the surface that a ray meets first."""
    found = [(to_outer_walls(arena, place, ray), arena.reflectance)]
    found += [(to_cylinder(cylinder, place, ray), cylinder.reflectance) for cylinder in arena.cylinders]
    found += [(to_inner_wall(wall, place, ray), arena.reflectance) for wall in arena.walls]
    return min(found)[1]


def from_wall(wall, x: float, y: float) -> tuple[float, float]:
    """The vector from the nearest point of an inner wall to (x, y)."""
    x0, y0, x1, y1 = wall
    length = math.hypot(x1 - x0, y1 - y0)
    ux, uy = (x1 - x0) / length, (y1 - y0) / length
    along = min(max((x - x0) * ux + (y - y0) * uy, 0.0), length)
    return x - x0 - along * ux, y - y0 - along * uy


def overlap(arena, x: float, y: float, radius: float) -> float:
    """How deep a disc at (x, y) is in whatever it overlaps most, cm; negative where it is free."""
    depths = [radius - x, radius - y, x + radius - arena.size_cm[0], y + radius - arena.size_cm[1]]
    for c in arena.cylinders:
        depths.append(radius + c.radius_cm - math.hypot(x - c.x_cm, y - c.y_cm))
    for wall in arena.walls:
        depths.append(radius - math.hypot(*from_wall(wall, x, y)))
    return max(depths)
