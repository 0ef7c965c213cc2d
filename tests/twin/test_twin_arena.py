"""The twin's arenas: plain numbers, refused in words where they make no sense."""

from __future__ import annotations

import numpy as np
import pytest

from realitygap.errors import ConfigError
from realitygap.twin.body import TwinBody
from realitygap.twin.unit import plain_arena
from realitygap.world.arena import load_arena
from tests.twin.rooms import ARENAS


@pytest.mark.parametrize("name", ARENAS)
def test_a_tasks_arena_is_taken_as_it_is(name: str) -> None:
    """The simulation's plain numbers are what the twin takes, and the paper's."""
    assert plain_arena(load_arena(name).plain()) == plain_arena(ARENAS[name])


def test_full_room_is_refused() -> None:
    """A floor without room for a robot is refused before anything explodes."""
    with pytest.raises(ConfigError, match="room for the robot"):
        TwinBody({"size_cm": [10, 10], "cylinders": [[5, 5, 4]]}, unit=0)
    body = TwinBody({"size_cm": [50, 50], "cylinders": [[25, 25, 4]]}, unit=0)
    assert np.hypot(body.truth()[0] - 25, body.truth()[1] - 25) > 6.7
