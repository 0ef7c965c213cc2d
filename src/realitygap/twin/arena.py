"""The twin's arenas: plain numbers, checked once at the door."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import ConfigError
from realitygap.twin.arithmetic import hypot

__all__ = ["WALL_HALF", "check_arena", "edges"]

WALL_HALF = 0.003
"""A partition is a board of 6 mm (m, half of it)."""

WHITE, WHITEST = "reflectance", 10
"""Of surfaces, in those that the twin's own constants hold for."""
_PARTS = {"cylinders": ("x, y, radius", 3), "walls": ("x0, y0, x1, y1", 4), "lamps": ("x, y", 2)}


def _numbers(values: Any) -> list[float]:
    """None of them where they are something else."""
    try:
        return [float(value) for value in values]
    except (TypeError, ValueError):
        return []


def _rows(arena: Mapping[str, Any], key: str) -> list[list[float]]:
    words, width = _PARTS[key]
    rows = arena.get(key, [])
    out = [_numbers(row) for row in rows] if isinstance(rows, Iterable) else [[]]
    if any(len(row) != width or not np.isfinite(row).all() for row in out):
        raise ConfigError(f"arena: {key} is a list of [{words}] in cm, got {rows!r}")
    return out


def check_arena(arena: Mapping[str, Any]) -> dict[str, Any]:
    """The same arena with every key there and every number a float.

    Raises:
        ConfigError: a key is unknown or a value is not what the key means.
    """
    unknown = set(arena) - {"size_cm", *_PARTS, WHITE}
    if unknown:
        key = sorted(unknown)[0]
        raise ConfigError(f"arena: unknown key {key!r}; known are size_cm, {', '.join(_PARTS)}, {WHITE}")
    size = _numbers(arena.get("size_cm"))
    if len(size) != 2 or not all(8.0 <= side <= 1000.0 for side in size):
        raise ConfigError(f"arena: size_cm is [width, depth], 8 to 1000 cm, got {arena.get('size_cm')!r}")
    out: dict[str, Any] = {"size_cm": size, **{key: _rows(arena, key) for key in _PARTS}}
    if any(row[2] <= 0 for row in out["cylinders"]):
        raise ConfigError("arena: a cylinder's radius is above 0 cm")
    if any(row[:2] == row[2:] for row in out["walls"]):
        raise ConfigError("arena: a wall has two different ends")
    if WHITE in arena:
        out[WHITE], count = _numbers(arena[WHITE]), 1 + len(out["cylinders"])
        if len(out[WHITE]) != count or not all(0 <= value <= WHITEST for value in out[WHITE]):
            what = f"{count} numbers from 0 to {WHITEST}: of the walls, and of each cylinder"
            raise ConfigError(f"arena: {WHITE} is {what}, got {arena[WHITE]!r}")
    return out


def edges(arena: Mapping[str, Any]) -> NDArray[np.float64]:
    """[n, 4] x0, y0, x1, y1 (m): the faces that light and infrared meet, round the floor and partitions."""
    w, h = (v / 100.0 for v in arena["size_cm"])
    faces = [(0, 0, w, 0), (w, 0, w, h), (w, h, 0, h), (0, h, 0, 0)]
    for x0, y0, x1, y1 in (np.array(wall) / 100.0 for wall in arena["walls"]):
        length = float(hypot(x1 - x0, y1 - y0))
        ux, uy = (x1 - x0) / length * WALL_HALF, (y1 - y0) / length * WALL_HALF
        a, b = (x0 - ux + uy, y0 - uy - ux), (x1 + ux + uy, y1 + uy - ux)
        c, d = (x1 + ux - uy, y1 + uy + ux), (x0 - ux - uy, y0 - uy + ux)
        faces += [(*a, *b), (*b, *c), (*c, *d), (*d, *a)]
    return np.array(faces, dtype=np.float64)
