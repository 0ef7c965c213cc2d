"""A room's grid: what is near each part of it."""

from __future__ import annotations

import numpy as np
import pytest

from realitygap.kernels.rays import cell_at, from_segment
from realitygap.world.arena import MANY, Arena, Cylinder
from tests.kernels.scenes import full_room

FROM_SEGMENT = getattr(from_segment, "py_func", from_segment)
"""Uncompiled: to look at all that is in a room takes longer than the arithmetic."""


@pytest.mark.parametrize("things", [MANY, 60, 200])
def test_nothing_is_nearer_than_its_bound(things):
    """Every obstacle stands once in each cell's lists, nearest first, never nearer to a place than its bound
    there; nor to a place just outside the room."""
    random = np.random.default_rng(things)
    room = full_room(random, things=things).to_kernel()
    assert len(room.segment_gap) > 100
    for order, gaps in ((room.near_cylinders, room.cylinder_gap), (room.near_segments, room.segment_gap)):
        assert (np.sort(order, axis=1) == np.arange(order.shape[1])).all()
        assert (np.diff(gaps, axis=1) >= 0).all() and gaps.max() > 20
    for x, y in random.uniform(-0.5, room.size + 0.5, (300, 2)):
        cell = int(cell_at(room, x, y))
        for j, gap in zip(room.near_cylinders[cell], room.cylinder_gap[cell], strict=True):
            cx, cy, radius = room.cylinders[j]
            assert max(np.hypot(x - cx, y - cy) - radius, 0.0) >= gap
        for j, gap in zip(room.near_segments[cell], room.segment_gap[cell], strict=True):
            assert np.hypot(*FROM_SEGMENT(room, int(j), x, y)) >= gap


def test_few_obstacles_need_no_grid():
    """One cell, everything in its order, and nothing left out."""
    pole = Cylinder(x_cm=10, y_cm=10, radius_cm=2)
    room = Arena(name="few", size_cm=(40, 30), cylinders=(pole,), walls=((5, 5, 9, 5), (0, 20, 9, 20)))
    kernel = room.to_kernel()
    assert kernel.near_cylinders.tolist() == [[0]] and kernel.near_segments.tolist() == [[0, 1]]
    assert not kernel.segment_gap.any() and not kernel.cylinder_gap.any()
