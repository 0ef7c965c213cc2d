"""Values that every package shares: a pose, readings, a command.

Lengths cm, angles rad, times s, readings counts, commands Khepera units. One boundary
where a person's degrees become radians is here.
"""

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import UsageError

__all__ = [
    "Closing", "Command", "Floats", "Pose", "Readings", "as_count", "as_stream", "fed", "shown",
    "steps_in",
]  # fmt: skip

Floats = NDArray[np.float64]


class Closing:
    """What is closed when its `with` ends."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Release what is held."""


def as_stream(value: object, name: str = "stream") -> np.uint64:
    """A whole number from 0 to 2⁶⁴ − 1 as the name of a stream of random numbers.

    Raises:
        UsageError: anything else, under the name it was given by.
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or not 0 <= value < 2**64:  # type: ignore[operator]
        raise UsageError(f"{name}: expected a whole number from 0 to 2**64 - 1, got {value!r}.")
    return np.uint64(value)  # type: ignore[arg-type]


def as_count(value: object, name: str, least: int = 1, most: int | None = None) -> int:
    """A whole number in limits, both allowed.

    Raises:
        UsageError: anything else, under the name it was given by.
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or not least <= value <= (value if most is None else most):  # type: ignore[operator]
        limits = f", {least} or more" if most is None else f" from {least} to {most}"
        raise UsageError(f"{name}: expected a whole number{limits}, got {value!r}.")
    return int(value)  # type: ignore[call-overload, no-any-return]


def steps_in(seconds: float, period_s: float) -> int:
    """Steps of a trial of this length, s: the nearest whole number, one at least."""
    return max(1, round(seconds / period_s))


def shown(value: object) -> str:
    """A value that is refused, in few words: an array's type and shape, or what else it is."""
    return f"{value.dtype}{list(value.shape)}" if type(value) is np.ndarray else type(value).__name__


@dataclass(frozen=True)
class Pose:
    """Where a robot's centre is, cm, and where it looks, radians counter-clockwise from +x.

    Raises:
        UsageError: a heading that is in degrees: beyond a turn, and a whole number or a half.
    """

    x: float
    y: float
    heading: float

    def __post_init__(self) -> None:
        heading = self.heading
        if isinstance(heading, int | float) and abs(heading) > math.tau and 2 * heading % 1 == 0:
            cure = f"Pose.from_degrees({self.x}, {self.y}, {heading:g}) takes degrees."
            raise UsageError(f"pose: expected a heading in radians, got {heading:g}. {cure}")

    @classmethod
    def from_degrees(cls, x_cm: float, y_cm: float, heading_deg: float) -> Self:
        """A pose as a person writes it.

        Raises:
            UsageError: something else than numbers.
        """
        try:
            return cls(x=float(x_cm), y=float(y_cm), heading=math.radians(heading_deg))
        except (TypeError, ValueError):
            given = f"{x_cm!r}, {y_cm!r}, {heading_deg!r}"
            raise UsageError(f"pose: expected three numbers, cm, cm and degrees, got {given}.") from None

    @classmethod
    def reached(cls, x: float, y: float, heading: float) -> Self:
        """Where a robot came to: its heading may count any number of turns."""
        made = cls(x, y, 0.0)
        object.__setattr__(made, "heading", heading)
        return made

    @property
    def heading_deg(self) -> float:
        """Heading in degrees, −180 < h ≤ 180."""
        return 180.0 - (180.0 - math.degrees(self.heading)) % 360.0

    def to_dict(self) -> dict[str, float]:
        """As a person reads it, ready for JSON and TOML."""
        return {"x_cm": self.x, "y_cm": self.y, "heading_deg": self.heading_deg}


@dataclass(frozen=True, kw_only=True)
class Readings:
    """What a robot's sensors say, in its own counts: [P] proximity, [A] ambient."""

    proximity: Floats
    ambient: Floats


def fed(sensed: Any, feeds: str) -> Floats:
    """The readings [..., S] that a task feeds, of Readings, a Trajectory or a Recording: "proximity" or
    "ambient" alone, or "proximity+ambient" in this order."""
    return np.concatenate([getattr(sensed, kind) for kind in feeds.split("+")], axis=-1)


@dataclass(frozen=True, kw_only=True)
class Command:
    """Requested wheel speeds, in Khepera units."""

    left: int
    right: int
