"""A tag by its own picture: where it lies to a fraction of a pixel, and near which place it may be.

Where compression has washed out its edges, or a cable lies over them, its number cannot be read, but its
cells are still lighter and darker. The floor about the place where it was a moment ago is laid out at every
heading, the tag's picture is laid over it (normalised cross-correlation), and the likeliest places are given
to the fit of all its cells (Evangelidis and Psarakis 2008).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.film.pattern import Grey
from realitygap.values import Floats

if TYPE_CHECKING:
    from realitygap.film.camera import CameraModel

__all__ = ["cells_seen", "fitted", "likeliest"]

STEPS, HEADINGS, CHOSEN = 3, 40, 3
"""Steps of the laid out floor along a cell, headings tried, and places that are looked at closely."""
CELL_PX = 8
"""Pixels along a cell of the tag's own picture."""
SPOTS = 4
"""Places along a cell at which its brightness is taken; the outer ones are left out."""


class Printed(Protocol):
    """What a tag's picture is made of."""

    @property
    def cells(self) -> NDArray[Any]:
        """[n, n] white 1, black 0."""

    @property
    def size(self) -> float:
        """mm."""

    @property
    def radius_cm(self) -> float:
        """Of the circle about it."""

    @property
    def height_cm(self) -> float:
        """Above the floor."""


def likeliest(
    window: Grey, corner: Floats, camera: CameraModel, tag: Printed, around: tuple[Floats, float]
) -> list[Floats]:
    """Rough corners of what looks most like the tag about a place, [4, 2] px of the window, the likeliest
    first.

    Args:
        window: part of the camera's picture.
        corner: where it begins in the whole one, px.
        camera: which took it.
        tag: what to look for.
        around: where the robot's centre is, cm, and how far from there it may be.
    """
    place, reach_cm = around
    own = np.kron(np.pad(tag.cells, 1, constant_values=1), np.ones((STEPS, STEPS))).astype(np.float32)
    step = tag.size / 10 / len(tag.cells) / STEPS
    half = math.ceil((reach_cm + 1.5 * tag.radius_cm) / step)
    first, last = STEPS - 0.5 - half, len(own) - STEPS - 0.5 - half
    square = np.array([(first, first), (last, first), (last, last), (first, last)])
    side = np.arange(-half, half + 1)
    grid = np.stack(np.meshgrid(side, side), -1)
    found: list[tuple[float, Floats]] = []
    for turn in np.arange(HEADINGS) * (math.tau / HEADINGS):
        # Columns go to the right and rows back, as the tag's cells do while its upper side looks to `turn`.
        across = step * np.array([(math.sin(turn), -math.cos(turn)), (-math.cos(turn), -math.sin(turn))])
        x, y = np.moveaxis(grid @ across + place, -1, 0)
        columns, rows = camera.columns_rows(x, y, tag.height_cm)
        at = (columns - corner[0]).astype(np.float32), (rows - corner[1]).astype(np.float32)
        flat = cv2.remap(window, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
        _, alike, _, top = cv2.minMaxLoc(cv2.matchTemplate(flat, own, cv2.TM_CCOEFF_NORMED))
        spots = (square + top) @ across + place
        found.append((alike, camera.to_pixels(spots, tag.height_cm) - corner))
    found.sort(key=lambda one: -one[0])
    return [pixels for _, pixels in found[:CHOSEN]]


def fitted(picture: Grey, tag: Printed, rough: list[Floats]) -> Iterator[tuple[Floats, float]]:
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


def cells_seen(picture: Grey, tag: Printed, corners: Floats) -> float:
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
