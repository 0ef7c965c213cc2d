"""The words that every room shares: a pose, readings, a command, a trajectory.

Lengths cm, angles rad, times s, readings counts, commands Khepera units (design: one boundary
where a person's degrees become radians, and it is here).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import UsageError

__all__ = ["Command", "Pose", "Readings", "Trajectory", "as_stream"]


def as_stream(value: object, name: str = "stream") -> np.uint64:
    """A whole number from 0 to 2⁶⁴ − 1 as the name of a stream of random numbers.

    Raises:
        UsageError: anything else, under the name it was given by.
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or not 0 <= value < 2**64:  # type: ignore[operator]
        raise UsageError(f"{name}: expected a whole number from 0 to 2**64 - 1, got {value!r}.")
    return np.uint64(value)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class Pose:
    """Where a robot's centre is and where it looks, counter-clockwise from +x."""

    x: float
    y: float
    heading: float

    @classmethod
    def from_degrees(cls, x_cm: float, y_cm: float, heading_deg: float) -> Pose:
        """A pose as a person writes it."""
        return cls(x=float(x_cm), y=float(y_cm), heading=math.radians(heading_deg))

    @property
    def heading_deg(self) -> float:
        """Heading in degrees, −180 < h ≤ 180."""
        return 180.0 - (180.0 - math.degrees(self.heading)) % 360.0


@dataclass(frozen=True, kw_only=True)
class Readings:
    """What a robot's sensors say, in its own counts: [P] proximity, [A] ambient."""

    proximity: NDArray[np.float64]
    ambient: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Command:
    """Wheel speeds asked for, in Khepera units."""

    left: int
    right: int


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """One trial as it was lived, a row a step; row k holds what the robot read and decided at
    `t[k]`, where it stood then, and what its wheels did in the step that follows.

    Shapes: t, x, y, heading, contact [n]; proximity [n, P]; ambient [n, A]; inputs [n, I];
    commands, wheels [n, 2] (Khepera units, left and right). `end` is the pose after the last step.
    """

    t: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    heading: NDArray[np.float64]
    proximity: NDArray[np.float64]
    ambient: NDArray[np.float64]
    inputs: NDArray[np.int64]
    commands: NDArray[np.int64]
    wheels: NDArray[np.float64]
    contact: NDArray[np.bool_]
    end: Pose

    def to_dict(self) -> dict[str, Any]:
        """The trajectory in the units people read (cm, degrees), ready for JSON."""
        return {
            "t_s": self.t.round(6).tolist(),
            "x_cm": self.x.tolist(),
            "y_cm": self.y.tolist(),
            "heading_deg": np.degrees(self.heading).tolist(),
            "proximity": self.proximity.tolist(),
            "ambient": self.ambient.tolist(),
            "inputs": self.inputs.tolist(),
            "commands": self.commands.tolist(),
            "wheels": self.wheels.tolist(),
            "contact": self.contact.tolist(),
            "end": {"x_cm": self.end.x, "y_cm": self.end.y, "heading_deg": self.end.heading_deg},
        }
