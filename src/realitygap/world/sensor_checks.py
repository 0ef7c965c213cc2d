"""What both kinds of sensors have in common: their places and tables for the kernels, and what is refused."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import ConfigError
from realitygap.world.files import Value, require

__all__ = ["Sensor", "check_alike", "check_bands", "check_radians", "places", "table"]

FEWEST_TURNED, OUTWARDS_DEG = 2, 35.0
"""So many sensors that look aside tell radians from degrees; and how nearly a sensor looks outwards."""


@dataclass(frozen=True, kw_only=True)
class Sensor(Value):
    """Its place and direction in the robot's frame; both kinds end with the same tables."""

    x_cm: float
    y_cm: float
    direction_deg: float

    def _check(self) -> None:
        require(-360 <= self.direction_deg <= 360, "direction_deg", "degrees from -360 to 360",
                self.direction_deg)  # fmt: skip
        own: Any = self
        for key, values in (("curve", own.curve), ("noise", own.noise)):
            require(len(values) != 1, key, "two values or more, or none", values)
            require(all(value >= 0 for value in values), key, "values of 0 or more", values)
        require(own.noise_rise >= 0, "noise_rise", "0 or more", own.noise_rise)


def table(rows: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """[sensors, n] one row a sensor."""
    return np.array(rows, float).reshape(len(rows), len(rows[0]) if rows else 0)


def check_alike(sensors: Sequence[Sensor], top: float) -> None:
    """Refuse tables of several lengths, and values above the full scale."""
    for key in ("curve", "noise"):
        lengths = {len(getattr(sensor, key)) for sensor in sensors}
        require(len(lengths) <= 1, f"sensors.{key}", "as many values for every sensor", sorted(lengths))
        for i, sensor in enumerate(sensors):
            most = max(getattr(sensor, key), default=0.0)
            require(most <= top, f"sensors[{i}].{key}", f"at most top ({top:g})", most)


def places(sensors: Sequence[Sensor]) -> NDArray[np.float64]:
    """[sensors, 2] cm, in the robot's frame."""
    return np.array([(s.x_cm, s.y_cm) for s in sensors]).reshape(-1, 2)


def check_radians(sensors: Sequence[Sensor]) -> None:
    """Refuse directions that look outwards only if they are in radians."""
    turned = [s for s in sensors if s.direction_deg and math.hypot(s.x_cm, s.y_cm) > 0]
    if len(turned) < FEWEST_TURNED or any(abs(s.direction_deg) > math.tau + 1e-3 for s in sensors):
        return
    places = [math.degrees(math.atan2(s.y_cm, s.x_cm)) for s in turned]
    here = [_apart(s.direction_deg, place) for s, place in zip(turned, places, strict=True)]
    there = [_apart(math.degrees(s.direction_deg), place) for s, place in zip(turned, places, strict=True)]
    if max(there) < OUTWARDS_DEG < min(here):
        key = f"sensors[{sensors.index(turned[0])}].direction_deg"
        cure = "These look like radians: sensors would look where they sit. Convert all of them."
        require(False, key, "degrees", turned[0].direction_deg, cure)


def _apart(a_deg: float, b_deg: float) -> float:
    return abs((a_deg - b_deg + 180.0) % 360.0 - 180.0)


def check_bands(bands: tuple[float, float]) -> tuple[float, float]:
    """An input range; one without extent is refused."""
    if bands[0] == bands[1]:
        raise ConfigError(
            f"bands: expected two different readings (they become inputs -10 and +10), got {list(bands)}."
        )
    return bands
