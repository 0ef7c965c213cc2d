"""The places of an object while a robot's infrared is recorded: distances, and bearings all round."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from realitygap.errors import RecordingError

__all__ = ["Grid", "distances_of", "given"]

MOST_BEARINGS, NEAREST_CM, FARTHEST_CM = 720, 0.1, 20.0


@dataclass(frozen=True, kw_only=True)
class Grid:
    """The places of the infrared's plan.

    Attributes:
        distances_cm: from the body's edge, increasing. The default ones go from nearly touching to where a
            Khepera sees nothing, and are close together where the curve is steep.
        bearings: their number at each distance, evenly spaced all round, starting straight ahead. The default
            ones are 15 degrees apart: they show the sensors and the gaps between them.

    Raises:
        RecordingError: names the option, what was expected and what came.
    """

    distances_cm: tuple[float, ...] = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 8.0)
    bearings: int = 24

    def __post_init__(self) -> None:
        if isinstance(self.bearings, bool) or self.bearings not in range(1, MOST_BEARINGS + 1):
            expected = f"a whole number from 1 to {MOST_BEARINGS}"
            raise RecordingError(f"bearings: expected {expected}, got {self.bearings!r}.")
        said = np.array(self.distances_cm, np.float64)
        inside = said.size and said.min() >= NEAREST_CM and said.max() <= FARTHEST_CM
        if not (inside and (np.diff(said) > 0).all()):
            expected = f"rising ones from {NEAREST_CM:g} to {FARTHEST_CM:g} cm"
            got = ", ".join(f"{one:g}" for one in said.tolist())
            raise RecordingError(f"distances: expected {expected}, got {got or 'none'}.")

    @property
    def facts(self) -> dict[str, Any]:
        """Its entries in recording.toml; none for the default grid."""
        return {} if self == Grid() else {"bearings": self.bearings, "distances_cm": list(self.distances_cm)}


def given(bearings: int | None, distances_cm: Sequence[float] | None) -> dict[str, Any]:
    """The given parts of a grid, ready for TOML.

    Raises:
        RecordingError: no grid can have them.
    """
    try:
        usual, distances = Grid(), None if distances_cm is None else list(map(float, distances_cm))
    except (TypeError, ValueError):
        raise RecordingError(f"distances: expected a list of numbers, cm, got {distances_cm!r}.") from None
    Grid(
        bearings=usual.bearings if bearings is None else bearings,
        distances_cm=usual.distances_cm if distances is None else tuple(distances),
    )
    said = {"bearings": bearings, "distances_cm": distances}
    return {key: value for key, value in said.items() if value is not None}


def distances_of(text: str) -> tuple[float, ...]:
    """Distances as a person types them: "0.5,1,2".

    Raises:
        RecordingError: names the text that is no such list.
    """
    try:
        said = tuple(map(float, text.split(",")))
    except ValueError:
        raise RecordingError(f"distances: expected numbers of cm, as in 0.5,1,2, got {text!r}.") from None
    return Grid(distances_cm=said).distances_cm
