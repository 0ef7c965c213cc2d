"""The twin's arenas: plain numbers, refused in words where they make no sense."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from realitygap.errors import ConfigError
from realitygap.twin.body import TwinBody
from realitygap.twin.unit import check_arena, faces_of
from realitygap.world.arena import load_arena
from tests.twin.rooms import ARENAS


@pytest.mark.parametrize("name", ARENAS)
def test_a_tasks_arena_is_taken_as_it_is(name: str) -> None:
    """The simulation's plain numbers are what the twin takes, and the paper's."""
    assert check_arena(load_arena(name).plain()) == check_arena(ARENAS[name])


@pytest.mark.parametrize(
    ("arena", "says"),
    [
        ({}, "size_cm"),
        ({"size_cm": [2, 50]}, "size_cm"),
        ({"size_cm": "big"}, "size_cm"),
        ({"size_cm": [50, 50], "trees": []}, "trees"),
        ({"size_cm": [50, 50], "cylinders": [[1, 2]]}, "x, y, radius"),
        ({"size_cm": [50, 50], "cylinders": [[10, 10, 0]]}, "radius is above 0"),
        ({"size_cm": [50, 50], "walls": [[1, 2, 1, 2]]}, "two different ends"),
        ({"size_cm": [50, 50], "lamps": [[1, float("nan")]]}, "lamps"),
        ({"size_cm": [50, 50], "lamps": 3}, "lamps"),
        ({"size_cm": [50, 50], "reflectance": [1.0, 0.5]}, "1 numbers from 0 to 10"),
        ({"size_cm": [50, 50], "reflectance": [-0.1]}, "1 numbers from 0 to 10"),
        ({"size_cm": [50, 50], "reflectance": 0.5}, "1 numbers from 0 to 10"),
    ],
)
def test_nonsense_is_refused(arena: dict[str, Any], says: str) -> None:
    """A wrong key or value is named."""
    with pytest.raises(ConfigError, match=says):
        check_arena(arena)


def test_partition_is_a_closed_board() -> None:
    """A partition has four faces that close on each other, as thick everywhere."""
    faces = faces_of(check_arena({"size_cm": [50, 50], "walls": [[10, 10, 30, 20]]}))[4:]
    assert np.allclose(faces[:, 2:], np.roll(faces[:, :2], -1, axis=0))
    lengths = np.sort(np.hypot(*(faces[:, 2:] - faces[:, :2]).T))
    assert np.allclose(lengths[:2], 0.006)


def test_full_room_is_refused() -> None:
    """A floor without room for a robot is refused before anything explodes."""
    with pytest.raises(ConfigError, match="room for the robot"):
        TwinBody({"size_cm": [10, 10], "cylinders": [[5, 5, 4]]}, unit=0)
    body = TwinBody({"size_cm": [50, 50], "cylinders": [[25, 25, 4]]}, unit=0)
    assert np.hypot(body.truth()[0] - 25, body.truth()[1] - 25) > 6.7
