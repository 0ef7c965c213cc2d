"""The black and white disk that the robot carries (§6), read from TOML."""

import math
from dataclasses import asdict, dataclass, fields
from importlib.resources import files
from numbers import Real
from pathlib import Path

import numpy as np

from realitygap.errors import FilmError
from realitygap.files import read_toml, refuse_unknown
from realitygap.values import Floats, Pose

__all__ = ["Disk", "load_disk"]

LARGEST_CM = 1e3
"""No robot is as large, and no camera of this project hangs as high."""
WIDEST = 25.0
"""In radii of the front patch: a wider disk is compared at more places than OpenCV looks up at once."""


@dataclass(frozen=True, kw_only=True)
class Disk:
    """A black disk with two white patches, one at its centre and one ahead; lengths in cm.

    Raises:
        FilmError: a length that is not positive, patches that touch or leave the disk.
    """

    name = "disk"
    radius_cm: float = 2.75
    centre_radius_cm: float = 0.7
    front_radius_cm: float = 0.45
    front_distance_cm: float = 1.95
    height_cm: float = 3.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
                raise FilmError(f"{field.name}: expected a number of cm, got {value!r}.")
            if value < 0 or (value == 0 and field.name != "height_cm"):
                raise FilmError(f"{field.name}: expected more than 0 cm, got {value!r}.")
            if float(value) > LARGEST_CM:
                raise FilmError(f"{field.name}: expected at most {LARGEST_CM:g} cm, got {value!r}.")
            object.__setattr__(self, field.name, float(value))
        if self.centre_radius_cm + self.front_radius_cm >= self.front_distance_cm:
            raise FilmError(
                f"front_distance_cm: expected more than both patches' radii together, got "
                f"{self.front_distance_cm:g}: the patches would touch. Move the front patch outwards."
            )
        if self.front_distance_cm + self.front_radius_cm > self.radius_cm:
            raise FilmError(
                f"radius_cm: expected at least {self.front_distance_cm + self.front_radius_cm:g} (the "
                f"front patch's far edge), got {self.radius_cm:g}. Make the disk larger or the patch smaller."
            )

        if self.radius_cm > WIDEST * self.front_radius_cm:
            raise FilmError(
                f"front_radius_cm: expected at least {self.radius_cm / WIDEST:g} (a {WIDEST:g}th of "
                f"radius_cm), got {self.front_radius_cm:g}. Make the front patch larger."
            )

    @property
    def points(self) -> Floats:
        """The middles of both patches, [2, 2] cm ahead and to the left of the robot's centre."""
        return np.array([(0.0, 0.0), (self.front_distance_cm, 0.0)])

    def pose_of(self, points: Floats) -> Pose:
        """The pose of a robot whose patches are seen at these places, [2, 2] cm."""
        (x, y), (front_x, front_y) = points.tolist()
        return Pose(x=x, y=y, heading=math.atan2(front_y - y, front_x - x))

    def to_dict(self) -> dict[str, float]:
        """The disk as a dictionary ready for JSON, keys as in its file."""
        return asdict(self)


def load_disk(path: str | Path | None = None) -> Disk:
    """The disk of a TOML file; without one, the disk that the project ships.

    Raises:
        FilmError: unreadable file, broken TOML, unknown key, or a value that is refused.
    """
    path = str(files("realitygap.film").joinpath("disk.toml")) if path is None else path
    table = read_toml(path, FilmError, "Give the path of a disk's .toml file.")
    try:
        refuse_unknown(table, [field.name for field in fields(Disk)], FilmError)
        return Disk(**table)
    except FilmError as error:
        raise FilmError(f"{path}: {error}") from None
