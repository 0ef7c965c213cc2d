"""The overhead camera: from places on the floor (cm) to places in the picture (px) and back.

A homography takes the plane in which the disk moves to an ideal picture; two radial terms bend
that as the lens does (Brown 1966, without the tangential ones):

    bent = v (1 + k1 |v|² + k2 |v|⁴),   v from the picture's middle in half diagonals

The homography holds at one height above the floor. Things at another height are moved along the
ray to the lens first, for which the lens's place must be known.
Pixels are counted from the middle of the picture's upper left one: x to the right, y down.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from realitygap.errors import FilmError
from realitygap.files import atomic_write, read_json, refuse_unknown
from realitygap.values import Floats

__all__ = ["CameraModel", "load_camera"]

FORMAT = "realitygap camera 1"
KEYS = ("format", "width_px", "height_px", "homography", "radial", "plane_cm", "lens_cm")
LARGEST_PX, LARGEST_CM, LARGEST_CONDITION = 10**5, 1e5, 1e14
"""Of a picture's sides, of lengths in a room, and of a homography whose inverse means something."""
OUTSIDE = -1e6
"""Place in the picture, px, of what no ray brings into it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraModel:
    """One camera at one place.

    Attributes:
        width_px, height_px: size of its pictures.
        homography: [3, 3], from (x, y, 1) in cm on the plane to ideal pixels.
        radial: k1 and k2, no unit.
        plane_cm: height of the homography's plane above the floor.
        lens_cm: where the lens is, (x, y, height), if known.

    Raises:
        FilmError: numbers that make no camera.
    """

    width_px: int
    height_px: int
    homography: Floats
    radial: tuple[float, float] = (0.0, 0.0)
    plane_cm: float = 0.0
    lens_cm: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        matrix, numbers = (
            np.array(self.homography, float),
            (*self.radial, self.plane_cm, *(self.lens_cm or ())),
        )
        size = np.abs(matrix).max(initial=0.0)
        if not (0 < self.width_px <= LARGEST_PX and 0 < self.height_px <= LARGEST_PX):
            raise FilmError(f"width_px, height_px: got {self.width_px}, {self.height_px}.")
        fit = matrix.shape == (3, 3) and np.isfinite(size) and size > 0
        if not fit or not np.linalg.cond(matrix / size) < LARGEST_CONDITION:
            raise FilmError("homography: expected 3 × 3 finite numbers that can be inverted.")
        if len(self.radial) != 2 or not all(abs(number) <= LARGEST_CM for number in numbers):
            raise FilmError(
                f"radial, plane_cm, lens_cm: expected numbers up to {LARGEST_CM:g}, got {numbers}."
            )
        if self.lens_cm is not None and self.lens_cm[2] <= self.plane_cm:
            raise FilmError(
                f"lens_cm: expected above the plane at {self.plane_cm:g} cm, got {self.lens_cm[2]:g}."
            )
        matrix /= size
        if np.linalg.solve(matrix, [*self.middle, 1.0])[2] < 0:
            matrix = -matrix  # points in front of the camera have a positive third coordinate
        matrix.setflags(write=False)
        object.__setattr__(self, "homography", matrix)

    @property
    def middle(self) -> tuple[float, float]:
        """The middle of the picture, px."""
        return (self.width_px - 1) / 2, (self.height_px - 1) / 2

    @property
    def half_diagonal(self) -> float:
        """The unit of the radial terms, px."""
        return math.hypot(self.width_px, self.height_px) / 2

    @property
    def mirrored(self) -> bool:
        """Whether its pictures show the floor as in a mirror."""
        return bool(np.linalg.det(self.homography) > 0)  # rows go down, y goes up

    def to_pixels(self, places: ArrayLike, height_cm: float | None = None) -> Floats:
        """Where places [..., 2] (cm) at a height (default: the plane's) are in the picture, [..., 2] px."""
        points = np.asarray(places, float)
        return np.stack(self.columns_rows(points[..., 0], points[..., 1], height_cm), -1)

    def columns_rows(self, x: Floats, y: Floats, height_cm: float | None = None) -> tuple[Floats, Floats]:
        """The same for separate x and y, which are broadcast: faster for a grid."""
        (x, y), half = self._moved((x, y), height_cm, self.plane_cm), self.half_diagonal
        (k1, k2), (middle_x, middle_y) = self.radial, self.middle
        ideal = np.array([(1 / half, 0, -middle_x / half), (0, 1 / half, -middle_y / half), (0, 0, 1)])
        x, y, depth = (a * x + (b * y + c) for a, b, c in (ideal @ self.homography).tolist())
        seen = depth > 1e-12
        depth = np.where(seen, depth, 1.0)
        x, y = x / depth, y / depth
        square = x * x + y * y
        seen &= square < _turning_point(k1, k2)
        bend = square * (half * k1 + half * k2 * square) + half
        columns, rows = bend * x + middle_x, bend * y + middle_y
        if seen.all():
            return columns, rows
        return np.where(seen, columns, OUTSIDE), np.where(seen, rows, OUTSIDE)

    def to_floor(self, pixels: ArrayLike, height_cm: float | None = None) -> Floats:
        """The places [..., 2] (cm) at a height (default: the plane's) that pixels [..., 2] show."""
        v = _straightened((np.asarray(pixels, float) - self.middle) / self.half_diagonal, *self.radial)
        ideal = self.middle + self.half_diagonal * v
        inverse = np.linalg.inv(self.homography)
        flat = ideal @ inverse[:2, :2].T + inverse[:2, 2]
        flat /= (ideal @ inverse[2, :2] + inverse[2, 2])[..., None]
        return np.stack(self._moved((flat[..., 0], flat[..., 1]), self.plane_cm, height_cm), -1)

    def pixels_per_cm(self, place: ArrayLike, height_cm: float | None = None) -> float:
        """The picture's scale at a place (cm): the root of how much larger an area becomes."""
        x, y = np.asarray(place, float)
        cross = self.to_pixels([[x - 0.1, y], [x + 0.1, y], [x, y - 0.1], [x, y + 0.1]], height_cm)
        along, across = (cross[1] - cross[0]) / 0.2, (cross[3] - cross[2]) / 0.2
        return float(math.sqrt(abs(along[0] * across[1] - along[1] * across[0])))

    def shows(self, pixels: ArrayLike, margin_px: float = 0.0) -> NDArray[np.bool_]:
        """Whether pixels [..., 2] lie in the picture, at least `margin_px` from its edge."""
        p = np.asarray(pixels, float)
        low, high = margin_px - 0.5, np.array([self.width_px, self.height_px]) - 0.5 - margin_px
        return np.asarray(((p >= low) & (p <= high)).all(axis=-1))

    def check_size(self, width_px: int, height_px: int, what: str) -> None:
        """Refuse pictures of another size.

        Raises:
            FilmError: names what came and what the camera was calibrated for.
        """
        if (width_px, height_px) != (self.width_px, self.height_px):
            raise FilmError(
                f"{what}: {width_px} × {height_px} pixels, but the camera was calibrated for "
                f"{self.width_px} × {self.height_px}. Calibrate with frames of this size, "
                "or give the camera that filmed it."
            )

    def check_height(self, height_cm: float) -> None:
        """Refuse a height that this camera cannot correct for.

        Raises:
            FilmError: another height than the plane's, while the lens's place is unknown.
        """
        if abs(height_cm - self.plane_cm) > 1e-6 and self.lens_cm is None:
            raise FilmError(
                f"height: the disk or marker is {height_cm:g} cm above the floor, but the camera was "
                f"calibrated at {self.plane_cm:g} cm and does not know where its lens is. Calibrate with it, "
                "or say where the lens is: `realitygap camera calibrate … --lens-height CM`."
            )

    def to_dict(self) -> dict[str, Any]:
        """The camera as in its JSON file."""
        lens = None if self.lens_cm is None else list(self.lens_cm)
        lists = {"homography": self.homography.tolist(), "radial": list(self.radial), "lens_cm": lens}
        return {"format": FORMAT, **vars(self), **lists}

    def save(self, path: str | Path) -> None:
        """Write the camera as JSON."""
        atomic_write(path, json.dumps(self.to_dict(), indent=2) + "\n")

    def _moved(
        self, sides: tuple[Floats, Floats], from_cm: float | None, to_cm: float | None
    ) -> tuple[Floats, Floats]:
        """x and y of places at one height, moved along the rays to the lens to another height."""
        low, high = (self.plane_cm if height is None else height for height in (from_cm, to_cm))
        if abs(low - high) <= 1e-9:
            return sides
        self.check_height(low if high == self.plane_cm else high)
        assert self.lens_cm is not None
        *lens, above = self.lens_cm
        x, y = (
            at + (side - at) * (above - high) / (above - low) for side, at in zip(sides, lens, strict=True)
        )
        return x, y


def load_camera(path: str | Path) -> CameraModel:
    """The camera of a JSON file, as `realitygap camera calibrate` writes it.

    Raises:
        FilmError: unreadable file, broken JSON, a missing or refused key.
    """
    cure = "Make it with `realitygap camera calibrate`."
    table = read_json(path, FilmError, cure)
    if not isinstance(table, dict) or table.get("format") != FORMAT:
        raise FilmError(f'{path}: expected a camera ("format": "{FORMAT}"), got another file. {cure}')
    refuse_unknown(table, KEYS, FilmError, where=str(path))
    try:
        lens = table.get("lens_cm")
        return CameraModel(
            width_px=int(table["width_px"]),
            height_px=int(table["height_px"]),
            homography=np.array(table["homography"], dtype=np.float64),
            radial=tuple(float(k) for k in table["radial"]),  # type: ignore[arg-type]
            plane_cm=float(table["plane_cm"]),
            lens_cm=None if lens is None else (float(lens[0]), float(lens[1]), float(lens[2])),
        )
    except (FilmError, KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
        what = f"{error.args[0]}: missing." if isinstance(error, KeyError) else error
        raise FilmError(f"{path}: {what} {cure}") from None


def _straightened(v: Floats, k1: float, k2: float) -> Floats:
    """The ideal points that the lens puts at points [..., 2]: Newton's steps on the distance."""
    far = np.sqrt(np.einsum("...i,...i->...", v, v))
    limit = math.sqrt(min(_turning_point(k1, k2), 1e6))
    r = np.minimum(far, 0.999 * limit)
    for _ in range(20):
        square = r * r
        slope = np.maximum(1 + 3 * k1 * square + 5 * k2 * square * square, 0.05)
        r = np.clip(r - (r * (1 + k1 * square + k2 * square * square) - far) / slope, 0, limit)
    return np.asarray(v * np.where(far > 0, r / np.where(far > 0, far, 1.0), 1.0)[..., None])


def _turning_point(k1: float, k2: float) -> float:
    """The squared distance at which the lens would fold the picture back; infinite if it never does."""
    spread = 9 * k1 * k1 - 20 * k2  # of 1 + 3 k1 s + 5 k2 s², the slope of the bent distance
    if spread < 0:
        return math.inf
    below = (-3 * k1 + math.sqrt(spread), -3 * k1 - math.sqrt(spread))
    return min((2 / b for b in below if b > 1e-9), default=math.inf)
