"""Rays of light in the plane, compiled: against faces (segments) and cylinders (circles)."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.compiled import jit, part

__all__ = ["Scene", "clearance", "is_clear", "meet", "near", "scene_of"]

Array = NDArray[np.float64]
FAR = 100.0
"""A ray that meets nothing goes this far (m); in a closed arena none does."""
SIDES = 4
"""The floor's sides come first, and never stand between two points inside."""


class Scene(NamedTuple):
    """What stops light (m): of each face where it begins [n, 2], its direction [n, 2] and its length [n];
    circles [k, 3] (x, y, radius); how much more than usual the faces and each circle reflect, [1 + k]; and
    room for the numbers of those that are looked at, [n] and [k]."""

    start: Array
    along: Array
    length: Array
    circles: Array
    reflectance: Array
    faces: NDArray[np.int64]
    rounds: NDArray[np.int64]


def scene_of(faces: Array, circles: Array, reflectance: Array | None = None) -> Scene:
    """Of faces [n, 4] (x0, y0, x1, y1, in m), circles [k, 3] and what they reflect [1 + k], 1 if None."""
    reflectance = np.ones(1 + len(circles)) if reflectance is None else reflectance
    way = faces[:, 2:] - faces[:, :2]
    length = np.hypot(*way.T)
    looked_at = np.arange(len(faces)), np.arange(len(circles))
    return Scene(faces[:, :2].copy(), way / length[:, None], length, circles, reflectance, *looked_at)


@part
def _to_face(scene: Any, k: int, x: float, y: float) -> Any:
    """From a point to a face (m)."""
    rx, ry, ux, uy = x - scene.start[k, 0], y - scene.start[k, 1], scene.along[k, 0], scene.along[k, 1]
    along = min(max(rx * ux + ry * uy, 0.0), scene.length[k])
    dx, dy = rx - along * ux, ry - along * uy
    return math.sqrt(dx * dx + dy * dy)


@part
def _to_circle(scene: Any, k: int, x: float, y: float) -> Any:
    """From a point to a circle (m)."""
    dx, dy = x - scene.circles[k, 0], y - scene.circles[k, 1]
    return math.sqrt(dx * dx + dy * dy) - scene.circles[k, 2]


@jit
def clearance(scene: Any, x: float, y: float) -> Any:
    """How far it is from a point to the nearest thing (m)."""
    least = np.inf
    for k in range(scene.length.shape[0]):
        least = min(least, _to_face(scene, k, x, y))
    for k in range(scene.circles.shape[0]):
        least = min(least, _to_circle(scene, k, x, y))
    return least


@part
def near(scene: Any, x: float, y: float, reach: float) -> Any:
    """How many faces and circles come nearer than `reach` (m) to a point; the scene holds their numbers."""
    some, others = 0, 0
    for k in range(scene.length.shape[0]):
        if _to_face(scene, k, x, y) < reach:
            scene.faces[some] = k
            some += 1
    for k in range(scene.circles.shape[0]):
        if _to_circle(scene, k, x, y) < reach:
            scene.rounds[others] = k
            others += 1
    return some, others


@part
def _cross(scene: Any, k: int, x: float, y: float, dx: float, dy: float) -> Any:
    """How far along a ray a face is; inf if it is missed."""
    ux, uy = scene.along[k, 0], scene.along[k, 1]
    rx, ry = scene.start[k, 0] - x, scene.start[k, 1] - y
    turn, ahead = dx * uy - dy * ux, rx * uy - ry * ux
    if turn * ahead <= 0.0:
        return np.inf
    s = (rx * dy - ry * dx) / turn
    return ahead / turn if s >= -1e-9 and s <= scene.length[k] + 1e-9 else np.inf


@part
def _touch(scene: Any, k: int, x: float, y: float, dx: float, dy: float) -> Any:
    """How far along a ray (its direction of length 1) a circle is; inf if it is missed."""
    rx, ry, r = scene.circles[k, 0] - x, scene.circles[k, 1] - y, scene.circles[k, 2]
    middle = rx * dx + ry * dy
    off = rx * dy - ry * dx
    room = r * r - off * off
    if room <= 0.0:
        return np.inf
    t = middle - math.sqrt(room)
    return t if t > 0.0 else np.inf


@part
def meet(scene: Any, counts: tuple[int, int], x: float, y: float, dx: float, dy: float) -> Any:
    """The first thing that a ray meets, of those that `near` has counted; its direction has length 1.

    Returns:
        Distance, cosine of the incidence, x, y of the point, its normal's x and y (towards the ray's side),
        and how much more than usual is reflected there.
    """
    distance, nx, ny, reflectance = FAR, -dx, -dy, scene.reflectance[0]
    if counts[0]:
        which, least = scene.faces[0], np.inf
        for i in range(counts[0]):
            k = scene.faces[i]
            t = _cross(scene, k, x, y, dx, dy)
            if t < least:
                which, least = k, t
        distance = min(least, FAR)
        nx, ny = scene.along[which, 1], -scene.along[which, 0]
        if nx * dx + ny * dy > 0.0:
            nx, ny = -nx, -ny
    if counts[1]:
        which, least = scene.rounds[0], np.inf
        for i in range(counts[1]):
            k = scene.rounds[i]
            t = _touch(scene, k, x, y, dx, dy)
            if t < least:
                which, least = k, t
        if least < distance:
            distance, r, reflectance = least, scene.circles[which, 2], scene.reflectance[1 + which]
            nx = (x + distance * dx - scene.circles[which, 0]) / r
            ny = (y + distance * dy - scene.circles[which, 1]) / r
    return distance, -(nx * dx + ny * dy), x + distance * dx, y + distance * dy, nx, ny, reflectance


@part
def is_clear(scene: Any, x: float, y: float, ax: float, ay: float) -> Any:
    """Whether nothing stands between a point and another, `ax`, `ay` further on (m)."""
    way = math.sqrt(ax * ax + ay * ay) + 1e-12
    dx, dy, far = ax / way, ay / way, way - 1e-9
    for k in range(SIDES, scene.length.shape[0]):
        if _cross(scene, k, x, y, dx, dy) <= far:
            return False
    for k in range(scene.circles.shape[0]):  # noqa: SIM110 - this is compiled
        if _touch(scene, k, x, y, dx, dy) <= far:
            return False
    return True
