"""A sheet of paper with a marker on it, to print, measure and cut out."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from realitygap.errors import FilmError
from realitygap.files import atomic_path, atomic_write
from realitygap.film.disk import Disk
from realitygap.film.marker import Marker

__all__ = ["save_sheet", "sheet"]

LARGEST_MM = 180.0
A4_MM, MIDDLE_MM = (210.0, 297.0), (105.0, 150.0)
"""The page, and where on it, from its upper left corner, the marker's middle lies."""
RULER_MM, RULER_AT_MM = 100.0, 118.0
RULER = "100 mm: print at 100 %, then measure this line"
DPI, MM_PER_INCH = 300, 25.4
"""Of a picture in pixels: a cell of 5 mm is 59 of them."""


class Drawn(NamedTuple):
    """What is on the page, mm from the marker's middle, y down.

    Attributes:
        discs: ahead, radius, colour; squares: left, top, side, all black.
        half: half of its width; turn: of the line to the robot's front, degrees clockwise.
        rim: whether a line runs round it, to cut along.
        words: what it is.
    """

    discs: list[tuple[float, float, str]]
    squares: list[tuple[float, float, float]]
    half: float
    turn: float
    rim: bool
    words: str


def save_sheet(path: Path, marker: Marker) -> None:
    """Write a page as SVG, PDF or PNG, by the file's suffix, in its true size (PNG: 300 dots an inch).

    Raises:
        FilmError: a marker larger than the page.
    """
    if path.suffix.lower() == ".svg":
        atomic_write(path, sheet(marker))
        return
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Rectangle

    drawn, (width, height), (left, top) = _drawn(marker), A4_MM, MIDDLE_MM
    figure = Figure(figsize=(width / MM_PER_INCH, height / MM_PER_INCH))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(-left, width - left), ylim=(height - top, -top))
    axes.axis("off")
    thin: dict[str, Any] = {"color": "#999", "lw": 0.2 * 72 / MM_PER_INCH}
    for ahead, radius, fill in drawn.discs:
        axes.add_patch(Circle((0, -ahead), radius, fc=fill, ec="none"))
    for x, y, side in drawn.squares:
        axes.add_patch(Rectangle((x, y), side, side, fc="black", ec="none", antialiased=False))
    half, turn = drawn.half, np.radians(drawn.turn)
    if drawn.rim:
        axes.plot([-half, half, half, -half, -half], [-half, -half, half, half, -half], **thin)
    away = np.array([half * 1.45 + 1, half * 1.45 + 8])
    axes.plot(away * np.sin(turn), -away * np.cos(turn), **thin)
    ends = np.array([-RULER_MM, RULER_MM]) / 2
    axes.plot(ends, [RULER_AT_MM + 2] * 2, **thin)
    for end in ends:
        axes.plot([end] * 2, [RULER_AT_MM, RULER_AT_MM + 4], **thin)
    for y, words in ((-127, drawn.words), (-120, "The line points to the robot's front"), (129, RULER)):
        axes.text(0, y, words, ha="center", fontsize=4 * 72 / MM_PER_INCH)
    stamp = {".pdf": "CreationDate", ".png": "Software"}[path.suffix.lower()]
    with atomic_path(path) as spare:
        figure.savefig(spare, format=path.suffix[1:].lower(), dpi=DPI, metadata={stamp: None})


def sheet(marker: Marker) -> str:
    """A page of A4 as SVG, in mm: the marker in its true size, its rim to cut along, a line to the robot's
    front, and a ruler to check that it was printed to scale.

    Raises:
        FilmError: a marker larger than the page.
    """
    drawn = _drawn(marker)
    half = drawn.half
    shapes = [
        f'<circle cy="{-ahead:g}" r="{radius:g}" fill="{fill}"/>' for ahead, radius, fill in drawn.discs
    ]
    if drawn.rim:
        shapes.append(
            f'<path class="thin" d="M{-half:g} {-half:g}h{2 * half:g}v{2 * half:g}h{-2 * half:g}z"/>'
        )
    for x, y, side in drawn.squares:
        shapes.append(f'<rect x="{x:.4f}" y="{y:.4f}" width="{side:.4f}" height="{side:.4f}"/>')
    inside = "\n".join(shapes)
    return f"""<svg xmlns="http://www.w3.org/2000/svg"
viewBox="-105 -150 210 297" width="210mm" height="297mm"><style>
.thin {{fill: none; stroke: #999; stroke-width: 0.2}}
text {{font: 4px sans-serif; text-anchor: middle}}
rect {{shape-rendering: crispEdges}}</style>
<line class="thin" y1="{-half * 1.45 - 1:g}" y2="{-half * 1.45 - 8:g}" transform="rotate({drawn.turn:g})"/>
{inside}
<text y="-122">{drawn.words}. The line points to the robot's front.</text>
<path class="thin" d="M-50 118v4v-2h100v2v-4"/>
<text y="129">{RULER}</text>
</svg>
"""


def _drawn(marker: Marker) -> Drawn:
    if isinstance(marker, Disk):
        discs = [
            (0.0, 10 * marker.radius_cm, "black"),
            (0.0, 10 * marker.centre_radius_cm, "white"),
            (10 * marker.front_distance_cm, 10 * marker.front_radius_cm, "white"),
        ]
        words = f"disk, {20 * marker.radius_cm:g} mm across"
        drawn = Drawn(discs, [], 10 * marker.radius_cm, 0.0, False, words)
    else:
        cell = marker.size / len(marker.cells)
        corners = np.argwhere(marker.cells == 0)[:, ::-1] * cell - marker.size / 2
        squares = [(float(x), float(y), cell) for x, y in corners]
        words = f"{marker}: the black square is {marker.size:g} mm wide"
        drawn = Drawn([], squares, marker.size / 2 + cell, marker.angle, True, words)
    if 2 * drawn.half > LARGEST_MM:
        raise FilmError(f"size: expected up to {LARGEST_MM:g} mm with the rim, got {2 * drawn.half:g} mm.")
    return drawn
