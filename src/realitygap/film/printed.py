"""What is printed: a sheet with a marker to cut out, and tails, as in the paper's figures 3 and 5."""

import math
from pathlib import Path

import cv2
import numpy as np

from realitygap.errors import FilmError
from realitygap.files import atomic_path, atomic_write
from realitygap.film.camera import CameraModel
from realitygap.film.disk import Disk
from realitygap.film.tag import Marker
from realitygap.film.video import Image
from realitygap.track import Track

__all__ = ["draw_tails", "save_sheet", "save_tails"]

LARGEST_MM = 180.0
A4_MM, MIDDLE_MM = (210.0, 297.0), (105.0, 150.0)
"""The page, and where on it, from its upper left corner, the marker's middle lies."""
RULER_MM, RULER_AT_MM = 100.0, 118.0
DPI, MM_PER_INCH = 300, 25.4
"""Of a picture in pixels: a cell of 5 mm is 59 of them."""

_WIDE_PX = 1200
"""Narrower pictures are drawn larger, by a whole factor, so that the lines are fine."""
_BRIGHTEST = 110
"""The floor is darkened to this, so that white shows on it (0 black, 255 white)."""
_SHIFT = 4
"""OpenCV draws between pixels in units of 1 / 2^shift."""


def save_sheet(path: Path, marker: Marker) -> None:
    """Write a page of A4 as SVG, PDF or PNG, by the file's suffix (PNG: 300 dots an inch): the marker in its
    true size, its rim to cut along, a line to the robot's front, and a ruler to check that it was printed to
    scale.

    Raises:
        FilmError: a marker larger than the page.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Rectangle

    (width, height), (left, top), points = A4_MM, MIDDLE_MM, 72 / MM_PER_INCH
    figure = Figure(figsize=(width / MM_PER_INCH, height / MM_PER_INCH))
    axes = figure.add_axes((0, 0, 1, 1))  # in mm from the marker's middle, y down
    axes.set(xlim=(-left, width - left), ylim=(height - top, -top))
    axes.axis("off")

    def line(x: list[float], y: list[float]) -> None:
        axes.plot(x, y, color="#999", lw=0.2 * points)

    if isinstance(marker, Disk):
        half, turn, words = 10 * marker.radius_cm, 0.0, f"disk, {20 * marker.radius_cm:g} mm across"
        for ahead, radius, colour in (
            (0.0, marker.radius_cm, "black"),
            (0.0, marker.centre_radius_cm, "white"),
            (marker.front_distance_cm, marker.front_radius_cm, "white"),
        ):
            axes.add_patch(Circle((0, -10 * ahead), 10 * radius, fc=colour, ec="none"))
    else:
        cell, turn = marker.size / len(marker.cells), math.radians(marker.angle)
        half, words = marker.size / 2 + cell, f"{marker}: the black square is {marker.size:g} mm wide"
        for row, column in np.argwhere(marker.cells == 0):
            at = column * cell - marker.size / 2, row * cell - marker.size / 2
            axes.add_patch(Rectangle(at, cell, cell, fc="black", ec="none", antialiased=False))
        line([-half, half, half, -half, -half], [-half, -half, half, half, -half])
    if 2 * half > LARGEST_MM:
        raise FilmError(f"size: expected up to {LARGEST_MM:g} mm with the rim, got {2 * half:g} mm.")
    near, far = 1.45 * half + 1, 1.45 * half + 8
    line([near * math.sin(turn), far * math.sin(turn)], [-near * math.cos(turn), -far * math.cos(turn)])
    end = RULER_MM / 2
    line([-end, -end, -end, end, end, end], [RULER_AT_MM + off for off in (0, 4, 2, 2, 0, 4)])
    for y, told in (
        (-127, words),
        (-120, "The line points to the robot's front"),
        (129, f"{RULER_MM:g} mm: print at 100 %, then measure this line"),
    ):
        axes.text(0, y, told, ha="center", fontsize=4 * points)
    kind = path.suffix[1:].lower()
    undated = {{"pdf": "CreationDate", "png": "Software", "svg": "Date"}[kind]: None}
    with atomic_path(path) as spare, rc_context({"svg.fonttype": "none", "svg.hashsalt": words}):
        figure.savefig(spare, format=kind, dpi=DPI, metadata=undated)


def draw_tails(frame: Image, track: Track, camera: CameraModel, marker: Marker) -> Image:
    """A frame [height, width, 3] under the white lines of a track, one for each frame in which the robot was
    found; larger than the frame if that is small. The frame is darkened where its floor is so bright that
    white would not show.

    "After processing an entire sequence, the lines, one per frame, joining the centre of the Khepera to its
    leading edge, were overlaid on the final frame to produce an image of the Khepera with a white 'tail'
    behind it." (§6)

    Args:
        frame: the picture.
        track: of the film, a row a frame.
        camera: calibrated.
        marker: what the robot wears.
    """
    camera.check_size(frame.shape[1], frame.shape[0], "the frame")
    height, width = frame.shape[:2]
    factor, seen = max(1, math.ceil(_WIDE_PX / width)), track.only(track.found)
    picture = cv2.resize(frame, (factor * width, factor * height), interpolation=cv2.INTER_CUBIC)
    centre = np.stack([seen.x, seen.y], 1)
    edge = centre + marker.radius_cm * np.stack([np.cos(seen.heading), np.sin(seen.heading)], 1)
    strokes = camera.to_pixels(np.stack([centre, edge], 1), marker.height_cm)
    if len(strokes):
        columns, rows = np.rint(strokes[:, 0]).astype(int).clip(0, (width - 1, height - 1)).T
        floor = float(np.quantile(frame[rows, columns].mean(axis=1), 0.75))
        picture = np.rint(picture * min(1.0, _BRIGHTEST / max(floor, 1.0))).astype(np.uint8)
    lines = np.rint(((strokes + 0.5) * factor - 0.5) * 2**_SHIFT).astype(np.int32)
    veil = np.zeros(picture.shape[:2], np.uint8)
    thick = max(1, factor // 2)
    for stroke in lines:  # one by one: where two cross, the veil is no thicker
        cv2.polylines(veil, [stroke.reshape(-1, 1, 2)], False, 255, thick, cv2.LINE_AA, _SHIFT)
    part = (veil / 255.0)[..., None]
    return np.asarray(np.rint(picture + (255 - picture) * part), np.uint8)


def save_tails(path: str | Path, picture: Image) -> None:
    """Write a picture [height, width, 3] as PNG.

    Raises:
        FilmError: a name that does not end in .png.
    """
    if Path(path).suffix.lower() != ".png":
        raise FilmError(f"{path}: expected a picture's name ending in .png.")
    _, data = cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))
    atomic_write(path, data.tobytes())
