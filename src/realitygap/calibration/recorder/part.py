"""What a plan comes to for one robot: stops, and how it is read at each."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from realitygap.calibration.recorder.plans import Place
from realitygap.world.arena import Arena

__all__ = ["Part"]


class Part(NamedTuple):
    """A part of a plan: its `stops`, named by the columns `key` of its table.

    `own`: facts for its recording.toml; `rows`: how many rows a finished stop has, by its key; `read`: brings
    the robot to a stop and returns its rows, none if the stop is skipped; `fine`: whether places between the
    stops are read, too, where readings jump, which `at` makes of a distance and a bearing.
    """

    name: str
    own: dict[str, Any]
    room: Mapping[str, Any]
    begins: str
    channel: str
    columns: tuple[str, ...]
    key: tuple[str, ...]
    stops: Mapping[tuple[str, ...], Any]
    rows: Callable[[tuple[str, ...]], int]
    read: Callable[..., list[tuple[str, ...]]]
    arena: Arena | None = None
    at: Callable[[float, float], Place] | None = None
    fine: bool = False
