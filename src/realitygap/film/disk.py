"""The black and white disk that the robot carries (§6), and what finds it in a picture.

A white patch is found by a difference-of-Gaussians centre-surround mask (§6, footnote 3 of the paper): "a
three dimensional mask constructed from the rotation of the difference between two Gaussian curves, of
appropriate widths, around the vertical axis". Both curves have the volume 1, so that even light gives no
response.

Near a place, the picture is first laid out on the disk's plane, a square of so many steps a centimetre,
where masks have one size and a distance is a distance. Anywhere, the masks run over the picture itself with
the size that the patches have at its middle, and the likeliest places are then looked at closely.
"""

import heapq
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from importlib.resources import files
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.files import read_toml, refuse_unknown
from realitygap.film.camera import CameraModel
from realitygap.values import Floats, Pose

__all__ = ["CLOSE_CM", "REACH_CM", "Disk", "DiskFinder", "Grey", "Sighting", "first_look", "load_disk"]

Grey = NDArray[np.uint8]
Response = NDArray[np.float32]

WIDEST = 25.0
"""In radii of the front patch: a wider disk is compared at more places than OpenCV looks up at once."""

INNER, OUTER = 0.56, 0.90
"""Widths (standard deviations) of the two Gaussian curves in radii of the patch: their difference
responds most to a disc of just that radius (a Laplacian of width r / √2 does)."""

_TAIL = 3.0
"""Widths from its middle at which a curve is cut off."""

REACH_CM, CLOSE_CM = 1.5, 0.7
"""How far from its last place the disk's centre is looked for, and from one that the masks found or that its
last two places foretell."""

_RING_SLACK, _LOOSE = 0.35, 0.6
"""How far off its ring about the centre the front patch may seem, in its radii; and while the scale is known
only roughly."""

KNOWN_AGAIN = 0.7
"""Quality from which a disk near its last place is believed."""

FOUND_ANEW = 0.9
"""Quality from which a disk anywhere in a picture is believed: the likeliest place of a spotted
floor reaches 0.84, of a page of print 0.92; a disk under strong noise, blur, glare, compression or
a cable stays above 0.94 (measured on rendered pictures)."""

_LEAST_RESPONSE, _SMALLEST_PX = 0.5, 0.5
"""Response from which a mask's maximum counts, and the smallest radius of a patch: it is one pixel."""

_CANDIDATES, _CLOSER_LOOKS, _PEAKS, _GOOD = 40, 6, 5, 0.95
"""Places looked at, maxima about a place, and the quality from which no other candidate is looked at."""

_SCALES, _LEAST_FRONT_PX = 1.1, 1.4
"""Step between the scales that a first look tries, and the smallest front patch's radius worth trying."""

_RIM, _GRAIN = 1.0, 0.35
"""In radii of the front patch: how much of the disk's rim, into which the floor blurs, is not compared,
and how far apart compared places are."""

_HIDDEN = 0.25
"""Part of the disk's black face that may be hidden by something bright."""

_ANGLES = np.arange(72) * (math.tau / 72)
_RING = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], 1)


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


class Sighting(NamedTuple):
    """A marker as it was seen: its points on its plane [n, 2] (cm), the robot's pose, quality 0 to 1."""

    points: Floats
    pose: Pose
    quality: float


class DiskFinder:
    """Looks for one kind of disk through one camera.

    Args:
        camera: its pictures are 8 bits grey, [height, width].
        disk: what to look for.
        slack: how far off its ring about the centre the front patch may seem, in its radii.

    Raises:
        FilmError: a camera that cannot correct for the disk's height, or shows it too small.
    """

    known_again, found_anew = KNOWN_AGAIN, FOUND_ANEW

    def __init__(self, camera: CameraModel, disk: Disk, slack: float = _RING_SLACK) -> None:
        camera.check_height(disk.height_cm)
        self.camera, self.disk, self._slack = camera, disk, slack
        middle, front = camera.to_floor(camera.middle, disk.height_cm), disk.front_radius_cm
        self._scale = camera.pixels_per_cm(middle, disk.height_cm)
        if not _SMALLEST_PX <= front * self._scale <= max(camera.width_px, camera.height_px):
            raise FilmError(
                f"front_radius_cm: the disk's front patch, {front:g} cm, has a radius of "
                f"{front * self._scale:.3g} pixels in this camera's pictures; expected {_SMALLEST_PX:g} or "
                "more, and less than the picture. Give the camera that filmed this disk, lengths in cm."
            )
        self._step = min(max(1 / self._scale, front / 9), front / 4)
        self._shrink = max(1, int(front * self._scale / 2.5))
        self._pattern = _pattern_of(disk)

    def near(self, picture: Grey, place: Floats, reach_cm: float = REACH_CM) -> Sighting | None:
        """The disk whose centre lies within `reach_cm` of a place (cm), or None."""
        disk, step = self.disk, self._step
        half = math.ceil((reach_cm + disk.front_distance_cm + 2 * OUTER * disk.front_radius_cm) / step)
        side = np.arange(-half, half + 1.0)
        columns, rows = self.camera.columns_rows(
            place[0] + step * side, (place[1] + step * side)[:, None], disk.height_cm
        )
        window = _sampled(picture, columns, rows).astype(np.float32)
        for_centre, for_front, fine = _responses(window, disk, 1 / step)
        squares, ring, slack = side * side, disk.front_distance_cm, self._slack * disk.front_radius_cm
        nearest, farthest = (max(ring - slack, 0.0) / step) ** 2, ((ring + slack) / step) ** 2
        best: Sighting | None = None
        first = half - math.ceil(reach_cm / step) - 1  # of what is compared with its neighbours
        middle, inside = slice(first, len(side) - first), squares[first : len(side) - first]
        tops = _maxima(for_centre[middle, middle], 1, inside + inside[:, None] <= (reach_cm / step) ** 2)
        for row, column in tops[:_PEAKS]:
            if (centre := _peak(for_centre, (first + row, first + column))) is None:
                continue
            away = (side - centre[0] + half) ** 2 + ((side - centre[1] + half) ** 2)[:, None]
            on_ring = (nearest <= away) & (away <= farthest)
            highest = int(np.where(on_ring, for_front, -np.inf).argmax())
            if (front := _peak(for_front, divmod(highest, len(side)))) is None:
                continue
            found = np.array([centre, front])
            quality = _correlation(self._seen(fine, found), self._pattern)
            if best is None or quality > best.quality:
                points, (column, row) = place + step * (found - half), np.rint(found).astype(int).T
                best = Sighting(points, disk.pose_of(points), quality)
                pixels = np.stack([columns[row, column], rows[row, column]], 1)
        return best if best is not None and self.camera.shows(pixels, 1.0).all() else None

    def anywhere(self, picture: Grey) -> Sighting | None:
        """The likeliest disk in the whole picture, or None."""
        best: Sighting | None = None
        for place in self._candidates(picture):
            seen = self.near(picture, place, CLOSE_CM)
            if seen is not None and (best is None or seen.quality > best.quality):
                best = seen
                if best.quality > _GOOD:
                    break
        return best

    def why_not(self, picture: Grey) -> str:
        """Why the disk is not found in a picture: unknown."""
        return ""

    def _seen(self, fine: Response, found: Floats) -> Floats:
        """What a window shows at the pattern's places [n] of a disk whose patches are there (column, row)."""
        ahead_x, ahead_y = (found[1] - found[0]) / (math.dist(*found) * self._step)
        spots = found[0] + self._pattern.places @ np.array([(ahead_x, ahead_y), (-ahead_y, ahead_x)])
        return _sampled(fine, spots[:, :1], spots[:, 1:])[:, 0].astype(np.float64)

    def _candidates(self, picture: Grey) -> Floats:
        """Places (cm) where both masks respond together, the likeliest first, [n, 2]."""
        disk, shrink, scale = self.disk, self._shrink, self._scale / self._shrink
        height, width = (n // shrink for n in picture.shape)
        small = picture[: height * shrink, : width * shrink].astype(np.float32)
        if shrink > 1:
            small = np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_AREA), np.float32)
        for_centre, for_front, _ = _responses(small, disk, scale)
        reach = max(1, round(0.6 * disk.centre_radius_cm * scale))
        tops = np.array(_maxima(for_centre, reach)[:_CANDIDATES]).reshape(-1, 2)
        places = self.camera.to_floor((tops[:, ::-1] + 0.5) * shrink - 0.5, disk.height_cm)
        ring = places[:, None] + disk.front_distance_cm * _RING
        around = np.rint((self.camera.to_pixels(ring, disk.height_cm) + 0.5) / shrink - 0.5).astype(int)
        column, row = around[..., 0].clip(0, width - 1), around[..., 1].clip(0, height - 1)
        fronts = for_front[row, column].max(axis=1)
        together = np.minimum(for_centre[tops[:, 0], tops[:, 1]], 1.5 * fronts)
        order = np.argsort(-together, kind="stable")[:_CLOSER_LOOKS]
        return np.asarray(places[order[together[order] > 0]])


def first_look(pictures: list[Grey], disk: Disk, report: Callable[[int], None]) -> list[Floats | None]:
    """Where the disk's points are in each picture, [2, 2] px, found without knowing the camera.

    A camera straight above is assumed, and its scale is the one at which some of the pictures show the disk
    best. `report` is called with the number of pictures done.
    """
    height, width = pictures[0].shape
    least, largest = _LEAST_FRONT_PX / disk.front_radius_cm, min(height, width) / (4 * disk.radius_cm)
    count = max(1, math.ceil(math.log(largest / least, _SCALES)))
    finders = []
    for scale in least * _SCALES ** np.arange(count):
        flat = np.diag([scale, scale, 1.0])
        camera = CameraModel(width_px=width, height_px=height, homography=flat, plane_cm=disk.height_cm)
        finders.append(DiskFinder(camera, disk, slack=_LOOSE))
    some = [pictures[i] for i in np.unique(np.linspace(0, len(pictures) - 1, 4).astype(int))]
    # Most promising scale first: what its likeness can still become, its number, pictures looked at.
    heap = [(-float(len(some)), i, 0) for i in range(len(finders))]
    while heap[0][2] < len(some):
        bound, i, done = heap[0]
        likeness = _quality(finders[i].anywhere(some[done])) ** 4
        heapq.heapreplace(heap, (bound + 1 - likeness, i, done + 1))
    best = heap[0][1]
    looks: list[Floats | None] = []
    for done, picture in enumerate(pictures):
        seen = [(finder, finder.anywhere(picture)) for finder in finders[max(best - 1, 0) : best + 2]]
        finder, one = max(seen, key=lambda pair: _quality(pair[1]))
        looks.append(finder.camera.to_pixels(one.points) if one and one.quality >= KNOWN_AGAIN else None)
        report(done + 1)
    return looks


def _quality(seen: Sighting | None) -> float:
    return 0.0 if seen is None else seen.quality


def _sampled(picture: NDArray[Any], columns: Floats, rows: Floats) -> NDArray[Any]:
    """The picture between its pixels, and beyond its edge as at its edge."""
    at = columns.astype(np.float32), rows.astype(np.float32)
    return np.asarray(cv2.remap(picture, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _responses(picture: Response, disk: Disk, px_per_cm: float) -> tuple[Response, Response, Response]:
    """Both masks' responses, to the centre patch and to the front patch, and the picture under the front
    mask's inner curve."""

    def blurred(picture: Response, sigma_cm: float) -> Response:
        sigma = sigma_cm * px_per_cm
        size = 2 * math.ceil(_TAIL * sigma) + 1
        return np.asarray(cv2.GaussianBlur(picture, (size, size), sigma, borderType=cv2.BORDER_REPLICATE))

    # Gaussian curves of Gaussian curves: the squares of their widths add up
    centre, front, further = disk.centre_radius_cm, disk.front_radius_cm, math.sqrt(OUTER**2 - INNER**2)
    fine = blurred(picture, INNER * front)
    inner = blurred(picture, INNER * centre)
    return inner - blurred(inner, further * centre), fine - blurred(fine, further * front), fine


def _maxima(response: Response, reach: int, where: NDArray[np.bool_] | bool = True) -> list[tuple[int, int]]:
    """The places (row, column) that nothing within `reach` pixels surpasses, the highest first."""
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    top = (response >= cv2.dilate(response, kernel)) & (response > _LEAST_RESPONSE) & where
    rows, columns = np.nonzero(top)
    order = np.argsort(-response[rows, columns], kind="stable")
    return list(zip(rows[order].tolist(), columns[order].tolist(), strict=True))


def _peak(response: Response, top: tuple[int, int]) -> tuple[float, float] | None:
    """The top (column, row) of the quadratic through the 3 × 3 values about a place (row, column), or None.

    Least squares over the nine values, so that it is exact for any quadratic.
    """
    row, column = top
    if not (0 < row < response.shape[0] - 1 and 0 < column < response.shape[1] - 1):
        return None
    (a, b, c), (d, e, f), (g, h, i) = response[row - 1 : row + 2, column - 1 : column + 2].tolist()
    dx, dy = (c + f + i - a - d - g) / 6, (g + h + i - a - b - c) / 6
    dxx, dyy = (a + c + d + f + g + i - 2 * (b + e + h)) / 3, (a + b + c + g + h + i - 2 * (d + e + f)) / 3
    dxy = (a + i - c - g) / 4
    bend = dxx * dyy - dxy * dxy
    if dxx >= 0 or bend <= 0:
        return None
    x, y = (dxy * dy - dyy * dx) / bend, (dxy * dx - dxx * dy) / bend
    return (column + x, row + y) if max(abs(x), abs(y)) <= 1 else None


class _Pattern(NamedTuple):
    """The disk as a correlation judges it: places on it [n, 2] (disk's axes, cm) and how white they are [n];
    which of them are nearer to the centre patch than to the front one, and which are black; the terms of
    light that grows evenly, [n, 4]: 1, how white, the place."""

    places: Floats
    white: Floats
    inner: NDArray[np.bool_]
    black: NDArray[np.bool_]
    terms: Floats


def _pattern_of(disk: Disk) -> _Pattern:
    """What the disk looks like under the front mask's inner curve, without its rim."""
    front, parts = disk.front_radius_cm, 4  # of a step, for the blur
    reach, step = disk.radius_cm - _RIM * front, _GRAIN * front
    count = math.ceil((reach + 2 * front) / step)  # the front patch reaches into the rim
    side = np.arange(-count * parts, count * parts + 1) * (step / parts)
    away, ahead = np.hypot(side, side[:, None]), np.hypot(side - disk.front_distance_cm, side[:, None])
    sharp = ((away < disk.centre_radius_cm) | (ahead < front)).astype(np.float32)
    white = cv2.GaussianBlur(sharp, (0, 0), INNER * front / (step / parts))[::parts, ::parts]
    away, (y, x) = away[::parts, ::parts], np.meshgrid(side[::parts], side[::parts], indexing="ij")
    keep, between = away <= reach, (disk.centre_radius_cm + disk.front_distance_cm - front) / 2
    white, places = white[keep].astype(np.float64), np.stack([x[keep], y[keep]], 1)
    terms = np.column_stack([np.ones(len(white)), white, places])
    return _Pattern(places, white, away[keep] < between, white < 0.15, terms)


def _correlation(seen: Floats, pattern: _Pattern) -> float:
    """How much what is seen at the pattern's places looks like the disk, 0 to 1.

    The correlation is taken for the centre patch and for the front patch with their surroundings
    apart, and the worse one counts: a lone white spot is no robot. Of the black face the brightest
    quarter is left out, whatever it is, so that a hand or a cable may lie there. Light that grows
    evenly across the disk, as a lamp's reflection does, is taken away first.
    """

    def unhidden() -> NDArray[np.bool_]:
        black = seen[pattern.black]
        last = int((1 - _HIDDEN) * (len(black) - 1))
        return np.asarray(~pattern.black | (seen <= np.partition(black, last)[last]))

    use = unhidden()
    terms = pattern.terms[use]
    slope = np.linalg.solve(terms.T @ terms, terms.T @ seen[use])[2:]
    seen = seen - pattern.places @ slope
    use, worst = unhidden(), 1.0
    for part in (pattern.inner & use, ~pattern.inner & use):
        a, b = seen[part], pattern.white[part]
        a, b = a - a.sum() / len(a), b - b.sum() / len(b)
        strength = math.sqrt((a @ a) * (b @ b))
        worst = min(worst, float(a @ b) / strength if strength > 0 else 0.0)
    return max(worst, 0.0)
