"""A robot's body, seen from above: a disc, or a convex polygon about the axle's middle."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from realitygap.world.files import Value, require

__all__ = ["Body"]

LEAST_WIDTH = 0.25
"""Of an outline, over its radius: the kernels move it in pieces of a quarter of that."""


@dataclass(frozen=True, kw_only=True)
class Body(Value):
    """A disc, or a convex polygon, and how high its top is above the floor; 0: endlessly, as in the paper.

    `outline_cm` has the polygon's corners, counter-clockwise, from the axle's middle (x ahead, y left); then
    `radius_cm` is that of the circle about it, and need not be given.
    """

    radius_cm: float = 0.0
    outline_cm: tuple[tuple[float, float], ...] = ()
    height_cm: float = 0.0

    def _check(self) -> None:
        if self.outline_cm:
            self._check_outline()
        require(self.radius_cm > 0, "radius_cm", "more than 0", self.radius_cm, "Or give outline_cm.")
        require(self.height_cm >= 0, "height_cm", "0 (no end) or more", self.height_cm)

    def _check_outline(self) -> None:
        """Refuse what is no convex polygon about the axle's middle; find its radius."""
        corners = np.array(self.outline_cm)
        require(len(corners) >= 3, "outline_cm", "three corners or more", self.outline_cm)
        edges = np.roll(corners, -1, axis=0) - corners
        after = np.roll(edges, -1, axis=0)
        left = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
        cure = "Turn their order round." if (left < 0).all() else "Leave out corners that lie within."
        for i, turn in enumerate(np.roll(left, 1)):
            told = "a corner that turns left: corners of a convex polygon, counter-clockwise"
            require(turn > 1e-9, f"outline_cm[{i}]", told, self.outline_cm[i], cure)
        once = abs(np.arctan2(left, (edges * after).sum(axis=1)).sum() - math.tau) < 1e-6
        require(once, "outline_cm", "corners that go round once", self.outline_cm)
        require(self.depth_cm(0, 0) >= 0, "outline_cm", "the axle's middle (0, 0) inside", self.outline_cm)
        radius = float(np.hypot(*corners.T).max())
        width = float(np.ptp(corners @ self.edges()[:, 2:].T, axis=0).min())
        least = f"a body at least {radius * LEAST_WIDTH:.3g} cm wide, a quarter of its radius"
        require(width >= radius * LEAST_WIDTH, "outline_cm", least, width)
        given = self.radius_cm or radius
        told = f"{radius:.6g}, of the circle about the outline, or none"
        require(abs(given - radius) <= 1e-3 * radius, "radius_cm", told, given)
        object.__setattr__(self, "radius_cm", radius)

    def edges(self) -> NDArray[np.float64]:
        """The outline as the kernels take it, [corners, 4]: corner, outward normal of the edge after it."""
        corners = np.array(self.outline_cm).reshape(-1, 2)
        ahead = np.roll(corners, -1, axis=0) - corners
        normals = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1) / np.hypot(*ahead.T)[:, None]
        return np.hstack([corners, normals])

    def reach_cm(
        self, bearing: NDArray[np.float64], gap_cm: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """How far the edge stands out from the axle's middle, towards what lies in a direction.

        Args:
            bearing: [n] of the direction, rad from the robot's front.
            gap_cm: [n] from the edge to the middle of what lies there; None: a wall, square to the direction.

        Returns:
            [n] cm: the thing is this much, and the gap, from the axle's middle.
        """
        if not self.outline_cm:
            return np.full(len(bearing), self.radius_cm)
        corners, normals = np.hsplit(self.edges(), 2)
        ahead = np.stack([np.cos(bearing), np.sin(bearing)])
        out = corners @ ahead
        if gap_cm is None:
            return np.asarray(out.max(axis=0))
        # Whatever is within the gap of the edge: a disc about each corner, a strip before each edge.
        aside = corners @ np.stack([-ahead[1], ahead[0]])
        with np.errstate(invalid="ignore", divide="ignore"):
            discs = out + np.sqrt(gap_cm**2 - aside**2)
            strips = ((normals * corners).sum(axis=1)[:, None] + gap_cm) / (normals @ ahead)
            along = strips * (np.stack([-normals[:, 1], normals[:, 0]], axis=1) @ ahead)
        begin = (corners[:, 1] * normals[:, 0] - corners[:, 0] * normals[:, 1])[:, None]
        lengths = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)[:, None]
        before = (strips > 0) & (along >= begin) & (along <= begin + lengths)
        last = np.fmax(np.fmax.reduce(discs), np.where(before, strips, -np.inf).max(axis=0))
        return np.asarray(last - gap_cm)

    def grown(self, by_cm: float) -> Self:
        """The body with its edge farther out."""
        corners, normals = np.hsplit(self.edges(), 2)
        sums = normals + np.roll(normals, 1, axis=0)
        moved = corners + by_cm * 2 * sums / (sums**2).sum(axis=1, keepdims=True)
        radius = 0.0 if len(corners) else self.radius_cm + by_cm
        return replace(self, radius_cm=radius, outline_cm=moved.tolist())

    def depth_cm(self, x_cm: float, y_cm: float) -> float:
        """How far a place in the robot's frame is from the body's edge; below 0: it is outside."""
        if not self.outline_cm:
            return self.radius_cm - math.hypot(x_cm, y_cm)
        x, y, nx, ny = self.edges().T
        return float((nx * (x - x_cm) + ny * (y - y_cm)).min())
