"""A sheet of paper with a marker on it, to print, measure and cut out."""

from __future__ import annotations

import numpy as np

from realitygap.errors import FilmError
from realitygap.film.disk import Disk
from realitygap.film.marker import Marker

__all__ = ["sheet"]

LARGEST_MM = 180.0


def sheet(marker: Marker) -> str:
    """A page of A4 as SVG, in mm: the marker in its true size, its rim to cut along, a line to the robot's
    front, and a ruler that tells whether it was printed to scale.

    Raises:
        FilmError: a marker larger than the page.
    """
    if isinstance(marker, Disk):
        discs = (
            (0.0, marker.radius_cm, "black"),
            (0.0, marker.centre_radius_cm, "white"),
            (marker.front_distance_cm, marker.front_radius_cm, "white"),
        )
        shapes = [f'<circle cy="{-10 * y:g}" r="{10 * r:g}" fill="{fill}"/>' for y, r, fill in discs]
        half, turn, what = 10 * marker.radius_cm, 0.0, f"disk, {20 * marker.radius_cm:g} mm across"
    else:
        cell = marker.size / len(marker.cells)
        half, turn = marker.size / 2 + cell, marker.angle
        what = f"{marker}: the black square is {marker.size:g} mm wide"
        shapes = [f'<path class="thin" d="M{-half:g} {-half:g}h{2 * half:g}v{2 * half:g}h{-2 * half:g}z"/>']
        for row, column in np.argwhere(marker.cells == 0):
            x, y = column * cell - marker.size / 2, row * cell - marker.size / 2
            shapes.append(f'<rect x="{x:.4f}" y="{y:.4f}" width="{cell:.4f}" height="{cell:.4f}"/>')
    if 2 * half > LARGEST_MM:
        raise FilmError(f"size: expected up to {LARGEST_MM:g} mm with the rim, got {2 * half:g} mm.")
    inside = "\n".join(shapes)
    return f"""<svg xmlns="http://www.w3.org/2000/svg"
viewBox="-105 -150 210 297" width="210mm" height="297mm"><style>
.thin {{fill: none; stroke: #999; stroke-width: 0.2}}
text {{font: 4px sans-serif; text-anchor: middle}}
rect {{shape-rendering: crispEdges}}</style>
<line class="thin" y1="{-half * 1.45 - 1:g}" y2="{-half * 1.45 - 8:g}" transform="rotate({turn:g})"/>
{inside}
<text y="-122">{what}. The line points to the robot's front.</text>
<path class="thin" d="M-50 118v4v-2h100v2v-4"/>
<text y="129">100 mm: print at 100 %, then measure this line</text>
</svg>
"""
