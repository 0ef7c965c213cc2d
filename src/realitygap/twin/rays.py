"""Rays of light in the plane: against faces (segments) and cylinders (circles), many at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.arithmetic import hypot

__all__ = ["Scene"]

Array = NDArray[np.float64]
FAR = 100.0
"""A ray that meets nothing goes this far (m); in a closed arena none does."""


class Scene:
    """Faces [n, 4] (x0, y0, x1, y1, in m) and circles [k, 3] (x, y, radius) that stop light."""

    def __init__(self, faces: Array, circles: Array) -> None:
        self._p = faces[:, :2].T.copy()
        along = (faces[:, 2:] - faces[:, :2]).T
        self._length = hypot(*along)
        self._u = along / self._length
        self._circles = circles

    def _distances(self, x: float, y: float) -> tuple[Array, Array]:
        """From a point to each face and to each circle (m)."""
        rx, ry = x - self._p[0], y - self._p[1]
        along = np.minimum(np.maximum(rx * self._u[0] + ry * self._u[1], 0.0), self._length)
        cx, cy, r = self._circles.T
        return hypot(rx - along * self._u[0], ry - along * self._u[1]), hypot(x - cx, y - cy) - r

    def clearance(self, x: float, y: float) -> float:
        """How far it is from a point to the nearest thing (m)."""
        return float(np.concatenate(self._distances(x, y)).min())

    def near(self, x: float, y: float, reach: float) -> Scene | None:
        """Only what comes nearer than `reach` (m) to a point; None if nothing does."""
        faces, circles = self._distances(x, y)
        some, others = faces < reach, circles < reach
        if not (some.any() or others.any()):
            return None
        part = object.__new__(Scene)
        part._p, part._u, part._length = self._p[:, some], self._u[:, some], self._length[some]
        part._circles = self._circles[others]
        return part

    def _cross(self, x: Array, y: Array, dx: Array, dy: Array) -> Array:
        """[faces, ...] distances to the faces' lines (inf if missed); ... are the rays' own axes."""
        wide = (slice(None),) + (None,) * dx.ndim
        ux, uy = self._u[0][wide], self._u[1][wide]
        rx, ry = self._p[0][wide] - x, self._p[1][wide] - y
        turn = dx * uy - dy * ux
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (rx * uy - ry * ux) / turn
            s = (rx * dy - ry * dx) / turn
        hit = (t > 0.0) & (s >= -1e-9) & (s <= self._length[wide] + 1e-9)
        return np.asarray(np.where(hit, t, np.inf))

    def _touch(self, x: Array, y: Array, dx: Array, dy: Array) -> Array:
        """[circles, ...] distances to the circles (inf if missed); directions of length 1."""
        wide = (slice(None),) + (None,) * dx.ndim
        cx, cy, r = (c[wide] for c in self._circles.T)
        rx, ry = cx - x, cy - y
        middle = rx * dx + ry * dy
        room = r * r - (rx * dy - ry * dx) ** 2
        t = middle - np.sqrt(np.maximum(room, 0.0))
        return np.asarray(np.where((room > 0.0) & (t > 0.0), t, np.inf))

    def meet(self, x: Array, y: Array, dx: Array, dy: Array) -> tuple[Array, ...]:
        """The first thing each ray meets.

        Args:
            x, y: [n] starts (m).
            dx, dy: [n, rays] directions of length 1.

        Returns:
            [n, rays] each: distance, cosine of the incidence, x, y of the point, its normal's x and y
            (towards the ray's side).
        """
        x, y = x[:, None], y[:, None]
        distance, nx, ny = np.full(dx.shape, FAR), -dx, -dy
        if len(self._length):
            t = self._cross(x, y, dx, dy)
            distance = np.minimum(t.min(axis=0), FAR)
            which = t.argmin(axis=0)
            nx, ny = self._u[1][which], -self._u[0][which]
            flip = np.where(nx * dx + ny * dy > 0.0, -1.0, 1.0)
            nx, ny = nx * flip, ny * flip
        if len(self._circles):
            t = self._touch(x, y, dx, dy)
            near = t.min(axis=0)
            closer = near < distance
            cx, cy, r = (c[t.argmin(axis=0)] for c in self._circles.T)
            distance = np.where(closer, near, distance)
            nx = np.where(closer, (x + distance * dx - cx) / r, nx)
            ny = np.where(closer, (y + distance * dy - cy) / r, ny)
        incidence = -(nx * dx + ny * dy)
        return distance, incidence, x + distance * dx, y + distance * dy, nx, ny

    def clear(self, x: Array, y: Array, ax: Array, ay: Array) -> NDArray[np.bool_]:
        """Whether nothing stands between a point and another, `ax`, `ay` further on.

        Args:
            x, y: from where, m.
            ax, ay: the way to the other point, m.
        """
        way = hypot(ax, ay) + 1e-12
        dx, dy = ax / way, ay / way
        free = np.ones(np.shape(dx), dtype=np.bool_)
        if len(self._length) > 4:  # the four sides of the floor never stand between two points inside
            t = self._cross(x, y, dx, dy)
            free &= (t[4:] > way - 1e-9).all(axis=0)
        if len(self._circles):
            free &= (self._touch(x, y, dx, dy) > way - 1e-9).all(axis=0)
        return free
