"""What is nearest to each part of a room: for the kernels, which then ask no more than they must."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.values import Floats

__all__ = ["MANY", "nearest"]

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
    many = len(cylinders) + len(walls)
    shape = np.ones(2, np.int64)
    if many >= MANY:
        side = np.sqrt(size[0] * size[1] / min(CELLS, ENTRIES / many))
        shape = np.maximum(np.array(size) // side, 1).astype(np.int64)
    x, y = ((np.arange(n) + 0.5) * (length / n) for n, length in zip(shape, size, strict=True))
    middles = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 1, 2)
    half = 0.5 * np.hypot(*(np.array(size) / shape)) + SPARE_CM if many >= MANY else np.inf
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
