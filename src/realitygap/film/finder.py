"""Finds the disk in one picture: near a place, or anywhere.

Near a place, the picture is first laid out on the disk's plane, a square of so many steps a
centimetre, where masks have one size and a distance is a distance. Anywhere, the masks run over the
picture itself with the size that the patches have at its middle, and the likeliest places are then
looked at closely.

A picture may also be given as a function that shows it (`Look`): then only what is looked at is made.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.film.camera import CameraModel
from realitygap.film.disk import Disk
from realitygap.film.masks import LANES, OUTER, Picture, Room, curves
from realitygap.film.pattern import Grey, correlation, pattern_of, responses, spots
from realitygap.film.window import UPHILL, Aim, lay_out, optics_of, sightings
from realitygap.values import Floats, Pose

__all__ = ["FOUND_ANEW", "KNOWN_AGAIN", "Finder", "Look", "Sighting", "first_look"]

Look = Callable[[tuple[slice, slice] | None], Grey]
"""Shows a picture [height, width]: right in a window (rows, columns), whatever stands elsewhere; or,
asked for None, the whole picture."""

REACH_CM, _CLOSE_CM = 1.5, 0.7
"""How far from the expected place the disk's centre is looked for, and from one that the masks found."""

RING_SLACK = 0.35
"""How far off its ring about the centre the front patch may seem, in radii of the front patch."""

KNOWN_AGAIN = 0.7
"""Quality from which a disk near its last place is believed."""

FOUND_ANEW = 0.9
"""Quality from which a disk anywhere in a picture is believed: the likeliest place of a spotted
floor reaches 0.84, of a page of print 0.92; a disk under strong noise, blur, glare, compression or
a cable stays above 0.94 (measured on rendered pictures)."""

SMALLEST_PX = 0.5
"""A patch of this radius is one pixel."""

_CANDIDATES, _CLOSER_LOOKS, _PEAKS, _GOOD = 40, 6, 5, 0.95
"""Places looked at, tops about a place, and the quality from which on no other candidate is looked at."""

_SCALES, _LEAST_FRONT_PX = 1.1, 1.4
"""Step between the scales that a first look tries, and the smallest front patch's radius worth trying."""

_LOOSE = 0.6
"""`RING_SLACK` while the scale is known only roughly."""

_ANGLES = np.arange(72) * (math.tau / 72)
_RING = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], 1)


class Sighting(NamedTuple):
    """A marker as it was seen: its points on its plane [n, 2] (cm), the robot's pose, quality 0 to 1."""

    points: Floats
    pose: Pose
    quality: float


class _Square(NamedTuple):
    """A window on the disk's plane: its side's places from the middle [n] (cm); and room for its masks, for
    the pixels of each place [2, n, n], for least and largest column and row [4], for tops and finds."""

    aim: Aim
    room: Room
    axis: Floats
    sides: Picture
    ends: Floats
    tops: Floats
    found: Floats


class Finder:
    """Looks for one kind of disk through one camera.

    Args:
        camera: its pictures are 8 bits grey, [height, width].
        disk: what to look for.
        slack: how far off its ring about the centre the front patch may seem, in its radii.

    Raises:
        FilmError: a camera that cannot correct for the disk's height.
    """

    known_again, found_anew = KNOWN_AGAIN, FOUND_ANEW

    def __init__(self, camera: CameraModel, disk: Disk, slack: float = RING_SLACK) -> None:
        camera.check_height(disk.height_cm)
        self.camera, self.disk, self._slack = camera, disk, slack
        self._pattern = pattern_of(disk)
        self._optics = optics_of(camera, disk.height_cm)
        self._squares, self._last = dict[float, _Square](), (camera.width_px - 1.5, camera.height_px - 1.5)
        self._spots, self._sums = np.empty((2, len(self._pattern.white), 1), np.float32), np.empty((4, 5))
        middle = camera.to_floor(camera.middle, disk.height_cm)
        self._scale = camera.pixels_per_cm(middle, disk.height_cm)
        front = disk.front_radius_cm
        if not SMALLEST_PX <= front * self._scale <= max(camera.width_px, camera.height_px):
            raise FilmError(
                f"front_radius_cm: the disk's front patch, {front:g} cm, has a radius of "
                f"{front * self._scale:.3g} pixels in this camera's pictures; expected {SMALLEST_PX:g} or "
                "more, and less than the picture. Give the camera that filmed this disk, lengths in cm."
            )
        self._step = min(max(1 / self._scale, front / 9), front / 4)
        self._shrink = max(1, int(front * self._scale / 2.5))

    def near(self, picture: Grey | Look, place: Floats, reach_cm: float = REACH_CM) -> Sighting | None:
        """The disk whose centre lies within `reach_cm` of a place (cm), or None."""
        disk, square = self.disk, self._square(reach_cm)
        window = self._laid_out(picture, place, square)
        fine = square.room.fine[:, : len(window)]  # beyond it there is only room
        best: Sighting | None = None
        for k in range(sightings(window, square.aim, square.room, square.tops, square.found)):
            quality = self._quality(fine, square.found[k])
            if best is None or quality > best.quality:
                points = place + (square.found[k].reshape(2, 2) - square.aim.half) * self._step
                best = Sighting(points, disk.pose_of(points), quality)
        if best is None or self._shows(square.ends):
            return best
        pixels = self.camera.to_pixels(best.points, disk.height_cm)
        return best if self.camera.shows(pixels, 1.0).all() else None

    def anywhere(self, picture: Grey) -> Sighting | None:
        """The likeliest disk in the whole picture, or None."""
        best: Sighting | None = None
        for place in self._candidates(picture):
            seen = self.near(picture, place, _CLOSE_CM)
            if seen is not None and (best is None or seen.quality > best.quality):
                best = seen
                if best.quality > _GOOD:
                    break
        return best

    def why_not(self, picture: Grey) -> str:
        """Why the disk is not found in a picture: unknown."""
        return ""

    def _square(self, reach_cm: float) -> _Square:
        """What is looked at about a place, for a centre so near to it."""
        if reach_cm not in self._squares:
            disk, step = self.disk, self._step
            half = math.ceil((reach_cm + disk.front_distance_cm + 3 * OUTER * disk.front_radius_cm) / step)
            ring, judged = disk.front_distance_cm / step, np.abs(self._pattern.places).max() / step
            aim = Aim(
                half=half,
                reach=reach_cm / step,
                ring=ring,
                slack=self._slack * disk.front_radius_cm / step,
                round=_RING,
                far=math.ceil(max(ring + UPHILL, judged * math.sqrt(2.0))) + 2,
                centre=curves(disk.centre_radius_cm / step),
                front=curves(disk.front_radius_cm / step),
            )
            wide = 2 * half + 1 + LANES
            line = wide + 2 * max(len(curve) for curve in (*aim.centre, *aim.front))
            self._squares[reach_cm] = _Square(
                aim=aim,
                room=Room(np.empty(line, np.float32), *np.zeros((4, 2 * half + 1, wide), np.float32)),
                axis=np.arange(-half, half + 1) * np.float64(step),
                sides=np.empty((2, 2 * half + 1, 2 * half + 1), np.float32),
                ends=np.empty(4),
                tops=np.empty((4 * _PEAKS, 3)),
                found=np.empty((_PEAKS, 4)),
            )
        return self._squares[reach_cm]

    def _laid_out(self, picture: Grey | Look, place: Floats, square: _Square) -> Picture:
        """A square of the disk's plane about a place."""
        columns, rows = square.sides
        lay_out(self._optics, place, square.axis, columns, rows, square.ends)
        if callable(picture):
            picture = picture(self._window(square.ends.tolist()))
        return _sampled(picture, columns, rows).astype(np.float32)

    def _shows(self, ends: Floats) -> bool:
        """Whether all between these columns and rows is in the picture, a pixel from its edge."""
        left, right, top, bottom = ends
        return bool(min(left, top) >= 0.5 and right <= self._last[0] and bottom <= self._last[1])

    def _window(self, ends: list[float]) -> tuple[slice, slice]:
        """The part of the picture that is looked at between these columns and rows: with the pixels about
        them."""

        def about(least: float, most: float, last: int) -> slice:
            low, high = math.floor(least) - 1, math.ceil(most) + 1
            return slice(min(max(low, 0), last), min(max(high, 0), last) + 1)

        left, right, top, bottom = ends
        return about(top, bottom, self.camera.height_px - 1), about(left, right, self.camera.width_px - 1)

    def _quality(self, fine: Picture, points: Floats) -> float:
        """How much the place looks like the disk."""
        columns, rows = self._spots
        spots(self._pattern, points, self._step, columns, rows)
        seen = _sampled(fine, columns, rows)[:, 0].astype(np.float64)
        return float(correlation(seen, self._pattern, self._sums))

    def _candidates(self, picture: Grey) -> Floats:
        """Places (cm) where both masks respond together, the likeliest first, [n, 2]."""
        shrink = self._shrink
        height, width = (n // shrink for n in picture.shape)
        small = picture[: height * shrink, : width * shrink].astype(np.float32)
        if shrink > 1:
            small = np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_AREA), np.float32)
        for_centre, for_front, _ = responses(small, self.disk, self._scale / shrink)
        reach = max(1, round(0.6 * self.disk.centre_radius_cm * self._scale / shrink))
        tops = _maxima(for_centre, reach, _CANDIDATES)
        if not len(tops):
            return np.empty((0, 2))
        pixels = (tops[:, ::-1] + 0.5) * shrink - 0.5
        places = self.camera.to_floor(pixels, self.disk.height_cm)
        ring = places[:, None] + self.disk.front_distance_cm * _RING
        around = np.rint((self.camera.to_pixels(ring, self.disk.height_cm) + 0.5) / shrink - 0.5).astype(int)
        column, row = around[..., 0].clip(0, width - 1), around[..., 1].clip(0, height - 1)
        fronts = for_front[row, column].max(axis=1)
        together = np.minimum(for_centre[tops[:, 0], tops[:, 1]], 1.5 * fronts)
        order = np.argsort(-together, kind="stable")[:_CLOSER_LOOKS]
        return np.asarray(places[order[together[order] > 0]])


def first_look(pictures: list[Grey], disk: Disk, report: Callable[[int], None]) -> list[Floats | None]:
    """Where the disk's points are in each picture, [2, 2] px, found without knowing the camera.

    `report` is called with the number of pictures done.
    """
    height, width = pictures[0].shape
    scale, largest = _LEAST_FRONT_PX / disk.front_radius_cm, min(height, width) / (4 * disk.radius_cm)
    scales = []
    while scale < largest:
        scales.append(scale)
        scale *= _SCALES
    finders = [_flat(disk, scale, (width, height)) for scale in scales]
    few = [pictures[i] for i in np.unique(np.linspace(0, len(pictures) - 1, 4).astype(int))]
    best = _likeliest(finders, few)
    looks: list[list[tuple[float, Floats | None]]] = []
    for finder in finders[max(best - 1, 0) : best + 2]:
        looks.append([])
        for done, picture in enumerate(pictures):
            looks[-1].append(_at_scale(finder, picture))
            report(done + 1)
    chosen = [max(looks_at_one, key=lambda look: look[0]) for looks_at_one in zip(*looks, strict=True)]
    return [pixels if quality >= KNOWN_AGAIN else None for quality, pixels in chosen]


def _likeliest(finders: list[Finder], pictures: list[Grey]) -> int:
    """Which finds the disk best in the pictures; on one that cannot become the best no more time is spent."""
    first = [_at_scale(finder, pictures[0])[0] ** 4 for finder in finders]
    best, most = 0, -1.0
    for i in sorted(range(len(finders)), key=lambda i: -first[i]):
        found = first[i]
        for done, picture in enumerate(pictures[1:], 1):
            if found + len(pictures) - done < most:  # a quality is 1 at most
                break
            found += _at_scale(finders[i], picture)[0] ** 4
        if found > most or (found == most and i < best):
            best, most = i, found
    return best


def _flat(disk: Disk, scale: float, size: tuple[int, int]) -> Finder:
    """Looks through a camera straight above, with a scale in pixels a centimetre."""
    matrix = np.diag([scale, scale, 1.0])
    flat = CameraModel(width_px=size[0], height_px=size[1], homography=matrix, plane_cm=disk.height_cm)
    return Finder(flat, disk, slack=_LOOSE)


def _at_scale(finder: Finder, picture: Grey) -> tuple[float, Floats | None]:
    """The best disk of a picture: quality and both points in pixels."""
    seen = finder.anywhere(picture)
    return (0.0, None) if seen is None else (seen.quality, finder.camera.to_pixels(seen.points))


def _sampled(picture: NDArray[Any], columns: Picture, rows: Picture) -> NDArray[Any]:
    """The picture between its pixels, and beyond its edge as at its edge."""
    return np.asarray(cv2.remap(picture, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _maxima(response: Picture, reach: int, count: int) -> NDArray[np.int64]:
    """The highest `count` places (row, column) that nothing within `reach` pixels surpasses, [n, 2]."""
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    top = (response >= cv2.dilate(response, kernel)) & (response > 0.5)
    places = np.argwhere(top)
    return places[np.argsort(-response[top], kind="stable")[:count]]
