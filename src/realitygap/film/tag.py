"""Finds a tag: an ArUco or AprilTag marker, a square of black and white cells that anybody can print.

OpenCV finds a marker and reads its number. Where it lies is then taken from all its cells: the marker's own
picture is moved over the film's until the two correlate best (Evangelidis and Psarakis 2008).

Where compression has washed out its edges, or a cable lies over them, its number cannot be read, but its
cells are still lighter and darker. The floor about the place where it was a moment ago is laid out at every
heading, the tag's picture is laid over it (normalised cross-correlation), and the likeliest places are given
to that same fit.
"""

import math
from collections.abc import Iterable, Iterator

import cv2
import numpy as np

from realitygap.errors import FilmError
from realitygap.film.camera import CameraModel
from realitygap.film.disk import Disk
from realitygap.film.finder import REACH_CM, Finder, Look, Sighting
from realitygap.film.marker import Marker, Tag
from realitygap.film.pattern import Grey
from realitygap.values import Floats

__all__ = ["BELIEVED", "TagFinder", "finder_of", "seen_in", "why_not"]

BELIEVED, SIZE_TOLERANCE = 0.8, 0.08
"""Correlation with its own picture from which on a marker is believed, and by how much, as a share, it may
seem larger or smaller than it was described."""

KNOWN_AGAIN, CELLS = 0.7, 0.8
"""Correlation from which on a marker is believed near its last place, and of its cells' brightness where its
number was not read: 0.84 or more of a marker in a film compressed with crf 48, 0.52 at most of another number
(measured on rendered pictures)."""

_LEAST_PX, _FINE_PX = 1.5, 6.0
"""Pixels along a cell: that a film needs; with less, pictures are enlarged to be read."""

STEPS, HEADINGS, CHOSEN = 3, 40, 3
"""Steps of the laid out floor along a cell, headings tried, and places that are looked at closely."""
CELL_PX = 8
"""Pixels along a cell of the tag's own picture."""
SPOTS = 4
"""Places along a cell at which its brightness is taken; the outer ones are left out."""


class TagFinder:
    """Looks for one marker through one camera, as `Finder` does for the disk.

    Args:
        camera: its pictures are 8 bits grey, [height, width].
        tag: what to look for.

    Raises:
        FilmError: a camera that cannot correct for the marker's height, or shows it too small.
    """

    known_again, found_anew = KNOWN_AGAIN, BELIEVED

    def __init__(self, camera: CameraModel, tag: Tag) -> None:
        camera.check_height(tag.height_cm)
        self.camera, self.tag = camera, tag
        scale = camera.pixels_per_cm(camera.to_floor(camera.middle, tag.height_cm), tag.height_cm)
        cell = scale * tag.size / 10 / len(tag.cells)
        if not _LEAST_PX <= cell <= camera.width_px:
            raise FilmError(
                f"marker {tag}: size: its cells are {cell:.3g} pixels wide in this camera's pictures; "
                f"expected {_LEAST_PX:g} or more, and less than the picture. Give mm, or print it larger."
            )
        self._enlarged = math.ceil(_FINE_PX / cell)

    def near(self, picture: Grey | Look, place: Floats, reach_cm: float = REACH_CM) -> Sighting | None:
        """The marker of a robot whose centre lies within `reach_cm` of a place (cm), or None."""
        reach = reach_cm + 1.5 * self.tag.radius_cm
        square = place + reach * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
        pixels = self.camera.to_pixels(square, self.tag.height_cm)
        pixels = pixels.clip(0, (self.camera.width_px - 1, self.camera.height_px - 1))
        left, top = np.floor(pixels.min(0)).astype(int).tolist()
        right, bottom = np.ceil(pixels.max(0)).astype(int).tolist()
        window = slice(top, bottom + 1), slice(left, right + 1)
        shown = picture(window) if callable(picture) else picture
        corner = np.array([left, top])

        def within(seen: Iterable[Sighting]) -> list[Sighting]:
            return [one for one in seen if math.dist((one.pose.x, one.pose.y), place) <= reach_cm]

        mine, others = _read(shown[window], self.tag, self._enlarged)
        seen = within(self._sightings(shown[window], corner, mine))
        if seen or others:  # another number stands there
            return _only(seen)
        rough = self._likeliest(shown[window], corner, place, reach_cm)
        alike = within(self._sightings(shown[window], corner, rough, CELLS))
        return max(alike, key=lambda one: one.quality, default=None)

    def anywhere(self, picture: Grey) -> Sighting | None:
        """The marker in the whole picture, or None: of two alike neither is believed."""
        whole = np.zeros(2)
        for bold, cells in ((False, -1.0), (True, CELLS)):  # misread cells are told by their brightness
            mine, _ = _read(picture, self.tag, self._enlarged, bold=bold)
            if seen := list(self._sightings(picture, whole, mine, cells)):
                return _only(seen)
        return None

    def why_not(self, picture: Grey) -> str:
        """Why the marker is not found in a picture, in words, if known; else nothing."""
        return why_not(picture, self.tag, self.camera)

    def _likeliest(self, window: Grey, corner: Floats, place: Floats, reach_cm: float) -> list[Floats]:
        """Rough corners of what looks most like the tag about a place (cm), [4, 2] px of a window that
        begins at `corner` (px), the likeliest first."""
        tag, camera = self.tag, self.camera
        own = np.kron(np.pad(tag.cells, 1, constant_values=1), np.ones((STEPS, STEPS))).astype(np.float32)
        step = tag.size / 10 / len(tag.cells) / STEPS
        half = math.ceil((reach_cm + 1.5 * tag.radius_cm) / step)
        first, last = STEPS - 0.5 - half, len(own) - STEPS - 0.5 - half
        square = np.array([(first, first), (last, first), (last, last), (first, last)])
        side = np.arange(-half, half + 1)
        grid = np.stack(np.meshgrid(side, side), -1)
        found: list[tuple[float, Floats]] = []
        for turn in np.arange(HEADINGS) * (math.tau / HEADINGS):
            # Columns go to the right and rows back, as the tag's cells do if its upper side looks to `turn`.
            across = step * np.array([(math.sin(turn), -math.cos(turn)), (-math.cos(turn), -math.sin(turn))])
            x, y = np.moveaxis(grid @ across + place, -1, 0)
            columns, rows = camera.columns_rows(x, y, tag.height_cm)
            at = (columns - corner[0]).astype(np.float32), (rows - corner[1]).astype(np.float32)
            flat = cv2.remap(window, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            likeness = cv2.matchTemplate(flat.astype(np.float32), own, cv2.TM_CCOEFF_NORMED)
            _, alike, _, top = cv2.minMaxLoc(likeness)
            spots = (square + top) @ across + place
            found.append((alike, camera.to_pixels(spots, tag.height_cm) - corner))
        found.sort(key=lambda one: -one[0])
        return [pixels for _, pixels in found[:CHOSEN]]

    def _sightings(
        self, picture: Grey, corner: Floats, rough: list[Floats], cells: float = -1.0
    ) -> Iterator[Sighting]:
        """What is of its size, and its cells; `corner` is where the picture begins in the whole one, px."""
        for pixels, quality in _fitted(picture, self.tag, rough):
            points = self.camera.to_floor(pixels + corner, self.tag.height_cm)
            alike = cells < 0 or _cells_seen(picture, self.tag, pixels) >= cells
            if alike and abs(_size(points) / self.tag.size - 1) <= SIZE_TOLERANCE:
                yield Sighting(points, self.tag.pose_of(points), quality)


def finder_of(camera: CameraModel, marker: Marker) -> Finder | TagFinder:
    """What looks for a marker through a camera.

    Raises:
        FilmError: a camera that does not fit the marker.
    """
    return Finder(camera, marker) if isinstance(marker, Disk) else TagFinder(camera, marker)


def seen_in(picture: Grey, tag: Tag, enlarged: int) -> list[tuple[Floats, float]]:
    """Corners [4, 2] px, and correlation up to 1, of all markers of the tag's number in a picture.

    `enlarged` is by how much the picture is enlarged to be read.
    """
    return list(_fitted(picture, tag, _read(picture, tag, enlarged)[0]))


def why_not(picture: Grey, tag: Tag, camera: CameraModel | None = None) -> str:
    """Why a marker is not found in a picture, in words, if known; else nothing."""
    mine, others = _read(picture, tag, 2)
    if len(mine) > 1:
        return f"Marker {tag} is seen {len(mine)} times in one picture: cover all but the robot's."
    if mine:
        size = tag.size if camera is None else _size(camera.to_floor(mine[0], tag.height_cm))
        cure = "Give its size and height as measured, and the camera that filmed it."
        off = abs(size / tag.size - 1) > SIZE_TOLERANCE
        return f"Marker {tag} is seen {size:.3g} mm wide, not {tag.size:g} mm. {cure}" if off else ""
    if others:
        numbers = ", ".join(map(str, sorted(set(others))))
        return f"What is seen is number {numbers} of {tag.dictionary}: give the robot's number."
    if _read(picture[:, ::-1], tag, 2)[0]:
        return (
            f"Marker {tag} is seen as in a mirror: turn off the camera's mirroring; film and calibrate again."
        )
    return ""


def _read(picture: Grey, tag: Tag, enlarged: int, *, bold: bool = False) -> tuple[list[Floats], list[int]]:
    """Rough corners [4, 2] px of all markers of the tag's number, which others of its dictionary are seen;
    `bold`: with as many cells misread as lie between two numbers."""
    larger = cv2.resize(picture, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_CUBIC)
    how = cv2.aruco.DetectorParameters()
    how.errorCorrectionRate = 1.0 if bold else how.errorCorrectionRate
    found, ids, _ = cv2.aruco.ArucoDetector(tag.known, how).detectMarkers(larger)
    numbers = [] if ids is None else ids.ravel().tolist()
    mine = [one[0] for number, one in zip(numbers, found, strict=True) if number == tag.number]
    others = [number for number in numbers if number != tag.number]
    return [(corners.astype(float) + 0.5) / enlarged - 0.5 for corners in mine], others


def _only(seen: list[Sighting]) -> Sighting | None:
    return seen[0] if len(seen) == 1 else None


def _size(points: Floats) -> float:
    """The side of a square of which these are the corners (cm), mm."""
    return 10 * float(np.hypot(*(points - np.roll(points, 1, 0)).T).mean())


def _fitted(picture: Grey, tag: Tag, rough: list[Floats]) -> Iterator[tuple[Floats, float]]:
    """The tag's corners [4, 2] px, and its correlation up to 1, where rough ones lie: its own picture is
    moved over the film's until the two are most alike."""
    cells = np.pad(tag.cells, 1, constant_values=1).astype(np.float32)
    own = np.kron(cells, np.full((CELL_PX, CELL_PX), 255, np.float32))
    low, high = CELL_PX - 0.5, len(own) - CELL_PX - 0.5
    square = np.array([(low, low, 1), (high, low, 1), (high, high, 1), (low, high, 1)])
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-5)
    for corners in rough:
        onto = np.linalg.lstsq(square, corners, rcond=None)[0].T.astype(np.float32, order="C")
        try:
            light = picture.astype(np.float32)
            quality, onto = cv2.findTransformECC(own, light, onto, cv2.MOTION_AFFINE, stop, None, 1)
        except cv2.error:  # it does not converge
            continue
        yield square @ onto.T.astype(float), float(quality)


def _cells_seen(picture: Grey, tag: Tag, corners: Floats) -> float:
    """How well the brightness of what lies between corners [4, 2] px follows the tag's cells within its rim,
    a correlation up to 1: of another number's cells it is far less, the rim being the same."""
    n = len(tag.cells)
    share = (np.arange(n * SPOTS) + 0.5) / (n * SPOTS)
    u, v = share[None, :, None], share[:, None, None]
    upper, lower = (1 - u) * corners[0] + u * corners[1], (1 - u) * corners[3] + u * corners[2]
    columns, rows = np.moveaxis((1 - v) * upper + v * lower, -1, 0).astype(np.float32)
    seen = cv2.remap(picture, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    means = seen.reshape(n, SPOTS, n, SPOTS)[1:-1, 1:-1, 1:-1, 1:-1].mean((1, 3)).ravel()
    known = tag.cells[1:-1, 1:-1].ravel()
    return float(np.corrcoef(means, known)[0, 1]) if means.std() > 0 and known.std() > 0 else 0.0
