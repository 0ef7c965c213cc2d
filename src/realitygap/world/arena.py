"""Arenas: walls, cylinders, lamps, and which of them are near (§4)."""

import math
from dataclasses import dataclass
from functools import lru_cache
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap import lazy
from realitygap.kernels import types
from realitygap.values import Floats
from realitygap.world.sensors import unit
from realitygap.world.toml import Value, load, require, shipped

__all__ = ["MANY", "WHITEST", "Arena", "Cylinder", "Lamp", "arena_names", "load_arena", "nearest"]


MANY = 20
"""Obstacles from which on a room has a grid; before, looking into one costs what it saves."""
CELLS = 1024
ENTRIES = 400_000
"""The most cells of a grid, and the most obstacles in all its cells: some megabytes."""
TOGETHER = 4
"""Cylinders that a ray is held against at once, where none overlap: the one whose middle is nearer is met."""
SPARE_CM = 1e-6
"""Bounds are lower by this: no rounding makes a distance less than its bound."""


@lru_cache(maxsize=8)
def nearest(
    size: tuple[float, float],
    cylinders: tuple[tuple[float, float, float], ...],
    walls: tuple[tuple[float, float, float, float], ...],
) -> dict[str, Any]:
    """The grid of a room as fields of the kernels' `Arena`: cells, and for each its obstacles, nearest first,
    by distances from its middle less half its diagonal.

    A room of few obstacles is one cell, with all of them in their order and no bounds. Lengths cm.
    """
    many, shape, half = len(cylinders) + len(walls), np.ones(2, np.int64), np.inf
    if many >= MANY:
        side = np.sqrt(size[0] * size[1] / min(CELLS, ENTRIES / many))
        shape = np.maximum(np.array(size) // side, 1).astype(np.int64)
        half = 0.5 * np.hypot(*(np.array(size) / shape)) + SPARE_CM
    x, y = ((np.arange(n) + 0.5) * (length / n) for n, length in zip(shape, size, strict=True))
    middles = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 1, 2)
    near_cylinders, cylinder_gap = _sorted(_to_cylinders(middles, np.array(cylinders).reshape(-1, 3)) - half)
    near_segments, segment_gap = _sorted(_to_walls(middles, np.array(walls).reshape(-1, 4)) - half)
    places = np.array(cylinders).reshape(-1, 3)
    gaps = np.linalg.norm(places[:, None, :2] - places[:, :2], axis=2) - places[:, None, 2] - places[:, 2]
    overlap = bool((gaps[~np.eye(len(places), dtype=bool)] < 0.0).any())
    return {
        "together": 1 if overlap else TOGETHER,
        "grid": shape, "cells_per_cm": shape / size,
        "near_cylinders": near_cylinders, "cylinder_gap": cylinder_gap,
        "near_segments": near_segments, "segment_gap": segment_gap,
    }  # fmt: skip


def _sorted(bounds: Floats) -> tuple[NDArray[np.uint64], Floats]:
    """Whose bounds they are, lowest first, and the bounds, none below 0."""
    gaps = np.maximum(bounds, 0.0)
    near = np.argsort(gaps, axis=1, kind="stable")
    return near.astype(np.uint64), np.take_along_axis(gaps, near, axis=1)


def _to_cylinders(places: Floats, cylinders: Floats) -> Floats:
    """Distances [n, C] of places [n, 1, 2]."""
    apart: Floats = np.linalg.norm(places - cylinders[:, :2], axis=2) - cylinders[:, 2]
    return apart


def _to_walls(places: Floats, walls: Floats) -> Floats:
    """Distances [n, S] of places [n, 1, 2]."""
    begin, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    share = np.clip(((places - begin) * along).sum(2) / (along**2).sum(1), 0.0, 1.0)
    apart: Floats = np.linalg.norm(places - begin - share[..., None] * along, axis=2)
    return apart


WHITEST = 10.0
"""Times the surfaces of a calibration."""
LEAST_CM = 5.0
"""Of a room's side: its size is not in metres."""


@dataclass(frozen=True, kw_only=True)
class Cylinder(Value):
    """A round obstacle that also throws shadows; `reflectance` as an arena's."""

    x_cm: float
    y_cm: float
    radius_cm: float
    reflectance: float = 1.0

    def _check(self) -> None:
        require(self.radius_cm > 0, "radius_cm", "more than 0", self.radius_cm)
        require_reflectance(self.reflectance)

    def covers(self, x_cm: float, y_cm: float, margin_cm: float = 0.0) -> bool:
        """Whether a place lies inside, or nearer to it than a margin."""
        return math.hypot(x_cm - self.x_cm, y_cm - self.y_cm) < self.radius_cm + margin_cm


@dataclass(frozen=True, kw_only=True)
class Lamp(Value):
    """Five point sources on a line (§3.3): D = (offset + Σ L_i·k_i)/d², times the brightness."""

    x_cm: float
    y_cm: float
    line_deg: float = 90.0
    spacing_cm: float = 2.5
    weights: tuple[float, float, float, float, float] = (4.19, 4.24, 8.24, 4.24, 4.19)
    offset: float = -4.15
    brightness: float = 1.0

    def _check(self) -> None:
        require(-360 <= self.line_deg <= 360, "line_deg", "degrees from -360 to 360", self.line_deg)
        require(self.spacing_cm >= 0, "spacing_cm", "0 or more", self.spacing_cm)
        require(self.brightness >= 0, "brightness", "0 or more", self.brightness)
        for i, weight in enumerate(self.weights):
            require(weight >= 0, f"weights[{i}]", "0 or more", weight)

    def points(self) -> tuple[tuple[float, float], ...]:
        """Places (x, y) of the point sources, cm."""
        dx, dy = unit(self.line_deg)
        middle = (types.LAMP_POINTS - 1) / 2
        along = [(i - middle) * self.spacing_cm for i in range(types.LAMP_POINTS)]
        return tuple((self.x_cm + s * dx, self.y_cm + s * dy) for s in along)


@dataclass(frozen=True, kw_only=True)
class Arena(Value):
    """A closed room from (0, 0) to `size_cm`, with inner walls [x0, y0, x1, y1], cylinders and lamps.

    `sliding` is the Coulomb coefficient of a body that slides along a surface: 0 slides freely.
    `reflectance` is of the walls: how much more light, infrared or visible, they throw back than the surfaces
    that a robot's constants hold for; 0 is black.
    """

    name: str
    source: str = ""
    size_cm: tuple[float, float]
    walls: tuple[tuple[float, float, float, float], ...] = ()
    cylinders: tuple[Cylinder, ...] = ()
    lamps: tuple[Lamp, ...] = ()
    sliding: float = 1.0
    reflectance: float = 1.0

    def _check(self) -> None:
        require_reflectance(self.reflectance)
        require(bool(self.name.strip()), "name", "a name", self.name)
        require(self.sliding >= 0, "sliding", "0 or more", self.sliding)
        width, depth = self.size_cm
        require(min(width, depth) >= LEAST_CM, "size_cm", f"sides of {LEAST_CM:g} cm or more", self.size_cm)
        room = f"inside the room ({width:g} by {depth:g} cm)"
        for i, (x0, y0, x1, y1) in enumerate(self.walls):
            wall = (x0, y0, x1, y1)
            require(self._holds(x0, y0) and self._holds(x1, y1), f"walls[{i}]", f"both ends {room}", wall)
            require((x0, y0) != (x1, y1), f"walls[{i}]", "two different ends", wall)
        for i, c in enumerate(self.cylinders):
            clear = self._holds(c.x_cm, c.y_cm, c.radius_cm)
            got = f"centre ({c.x_cm:g}, {c.y_cm:g}), radius {c.radius_cm:g}"
            require(clear, f"cylinders[{i}]", f"the whole cylinder {room}", got)
        for i, lamp in enumerate(self.lamps):
            inside = all(self._holds(x, y, -1e-9) for x, y in lamp.points())
            cure = "Turn its line (line_deg), shorten it (spacing_cm) or move the lamp."
            require(inside, f"lamps[{i}]", f"all five points {room}", lamp.points(), cure)
            covered = any(c.covers(x, y) for x, y in lamp.points() for c in self.cylinders)
            require(not covered, f"lamps[{i}]", "no point inside a cylinder", lamp.points(), "Move the lamp.")

    def obstacle_at(self, x: float, y: float, radius: float) -> str | None:
        """What a disc at (x, y) would overlap, in words; None where it is free. Lengths cm."""
        width, depth = self.size_cm
        if not (0 <= x <= width and 0 <= y <= depth):
            return f"the outside of the room ({width:g} by {depth:g} cm)"
        sides = {f"x = {0:g}": x, f"x = {width:g}": width - x, f"y = {0:g}": y, f"y = {depth:g}": depth - y}
        for side, gap in sides.items():
            if gap < radius:
                return f"the wall at {side}"
        for c in self.cylinders:
            if c.covers(x, y, radius):
                return f"the cylinder at ({c.x_cm:g}, {c.y_cm:g})"
        gaps = _to_walls(np.array([[[x, y]]]), np.reshape(self.walls, (-1, 4)))[0]
        for gap, (x0, y0, x1, y1) in zip(gaps, self.walls, strict=True):
            if gap < radius:
                return f"the wall from ({x0:g}, {y0:g}) to ({x1:g}, {y1:g})"
        return None

    def reflectances(self) -> list[float]:
        """Of the walls, and of each cylinder."""
        return [self.reflectance, *(c.reflectance for c in self.cylinders)]

    @property
    def tinted(self) -> bool:
        """Whether any surface differs from those that robots' constants hold for."""
        return any(value != 1.0 for value in self.reflectances())

    def to_dict(self) -> dict[str, Any]:
        """As in a file: surfaces like those of the constants have no reflectance there."""
        table = super().to_dict()
        for part in (table, *table["cylinders"]):
            if part["reflectance"] == 1.0:
                del part["reflectance"]
        return table

    def _repr_html_(self) -> str:
        return str(lazy.notebook().arena_html(self))

    def to_kernel(self) -> types.Arena:
        """The arena as the kernels' arrays."""
        lamps, walls, points = self.lamps, np.array(self.walls).reshape(-1, 4), types.LAMP_POINTS
        discs = tuple((c.x_cm, c.y_cm, c.radius_cm) for c in self.cylinders)
        along = walls[:, 2:] - walls[:, :2]
        length = np.sqrt((along**2).sum(axis=1, keepdims=True))
        weights = [[k * lamp.brightness for k in lamp.weights] for lamp in lamps]
        return types.Arena(
            size=np.array(self.size_cm),
            segments=walls,
            segment_along=np.hstack([along / length, length]),
            cylinders=np.array(discs).reshape(-1, 3),
            lamp_points=np.array([lamp.points() for lamp in lamps]).reshape(-1, points, 2),
            lamp_weights=np.array(weights).reshape(-1, points),
            lamp_offset=np.array([lamp.offset * lamp.brightness for lamp in lamps]),
            lamp_centre=np.array([(lamp.x_cm, lamp.y_cm) for lamp in lamps]).reshape(-1, 2),
            sliding=self.sliding,
            reflectance=np.array(self.reflectances() if self.tinted else []),
            **nearest(self.size_cm, discs, self.walls),
        )

    def plain(self) -> dict[str, Any]:
        """The arena as plain numbers in cm: all that a robot's stand-in may know of it; "reflectance" of the
        walls and of each cylinder only where some differ."""
        return {
            "size_cm": list(self.size_cm),
            "cylinders": [[c.x_cm, c.y_cm, c.radius_cm] for c in self.cylinders],
            "walls": [list(wall) for wall in self.walls],
            "lamps": [[lamp.x_cm, lamp.y_cm] for lamp in self.lamps],
            **({"reflectance": self.reflectances()} if self.tinted else {}),
        }

    def _holds(self, x: float, y: float, margin: float = 0.0) -> bool:
        width, depth = self.size_cm
        return margin <= x <= width - margin and margin <= y <= depth - margin


def load_arena(name_or_path: str | PathLike[str] | Arena) -> Arena:
    """An arena: "obstacle-avoidance", "light-seeking", or the path of a TOML file (an Arena stays itself).

    Raises:
        ConfigError: names the file and the key, what was expected and what came.
    """
    return load(Arena, name_or_path, folder="arenas")


def arena_names() -> tuple[str, ...]:
    """Names of the arenas that come with the package."""
    return shipped("arenas")


def require_reflectance(value: float) -> None:
    """Refuse a reflectance that no surface has."""
    require(0 <= value <= WHITEST, "reflectance", f"a number from 0 to {WHITEST:g}", value)
