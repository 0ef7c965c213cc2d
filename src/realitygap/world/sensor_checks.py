"""What both kinds of sensors have in common: their places and tables for the kernels, and what is refused."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.world.files import Value, require
from realitygap.world.rays import unit

__all__ = ["Sensor", "check_both", "kernel_both"]

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


def kernel_both(kind: str, own: Any) -> dict[str, Any]:
    """What the kernels' `Robot` has of either kind, "proximity" or "ambient"; `own` is the profile's part."""
    sensors = own.sensors
    return {
        f"{kind}_place": np.array([(s.x_cm, s.y_cm) for s in sensors]).reshape(-1, 2),
        f"{kind}_facing": np.array([unit(s.direction_deg) for s in sensors]).reshape(-1, 2),
        f"{kind}_curve": _table([s.curve for s in sensors]),
        f"{kind}_noise": _table([s.noise for s in sensors]),
        f"{kind}_rise": np.array([s.noise_rise for s in sensors]),
        f"{kind}_top": own.top,
        f"{kind}_low": own.bands[0],
        f"{kind}_high": own.bands[1],
    }


def _table(rows: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """[sensors, n] one row a sensor."""
    return np.array(rows, float).reshape(len(rows), len(rows[0]) if rows else 0)


def check_both(own: Any) -> None:
    """Refuse of either part of a profile what neither may have."""
    require(own.matt in (0.0, 1.0), "matt", "0 (as in the paper) or 1", own.matt)
    told = "two different readings (they become inputs -10 and +10)"
    require(own.bands[0] != own.bands[1], "bands", told, own.bands)
    _check_alike(own.sensors, own.top)
    _check_radians(own.sensors)


def _check_alike(sensors: Sequence[Sensor], top: float) -> None:
    """Refuse tables of several lengths, and values above the full scale."""
    for key in ("curve", "noise"):
        lengths = {len(getattr(sensor, key)) for sensor in sensors}
        require(len(lengths) <= 1, f"sensors.{key}", "as many values for every sensor", sorted(lengths))
        for i, sensor in enumerate(sensors):
            most = max(getattr(sensor, key), default=0.0)
            require(most <= top, f"sensors[{i}].{key}", f"at most top ({top:g})", most)


def _check_radians(sensors: Sequence[Sensor]) -> None:
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
