"""The masks that find the disk, over the part of a window that is looked at (compiled).

The masks are difference-of-Gaussians centre-surround masks (§6, footnote 3 of the paper): "a three
dimensional mask constructed from the rotation of the difference between two Gaussian curves, of appropriate
widths, around the vertical axis"; both curves have the volume 1, so that even light gives no response. The
widths are in units of the patch's radius.

The curves end four standard deviations from their middles, as OpenCV's do.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.compiled import compiled
from realitygap.compiled import step as inlined

__all__ = [
    "INNER", "LANES", "OUTER", "Curves", "Picture", "Room", "curves", "jit", "part_about", "respond", "step",
]  # fmt: skip

Picture = NDArray[np.float32]
Curves = tuple[Picture, Picture]
"""Halves [r + 1] of a mask's two Gaussian curves, inner and outer, the middle first."""

INNER = 0.56
OUTER = 0.90
"""Widths (standard deviations) of the two Gaussian curves in radii of the patch: their difference
responds most to a disc of just that radius (a Laplacian of width r / √2 does)."""

LANES = 32
"""Filtered parts are a multiple of so many columns wide: what a compiled loop takes at once."""

jit = partial(compiled, nogil=True, allocates=False)
step = partial(inlined, fastmath=False)


class Room(NamedTuple):
    """For a window [n, n]: a `line` of it, longer by two outer curves; and [n, n + LANES] for it filtered
    along its rows, for both masks' responses, and for it under the last one's inner curve."""

    line: Picture
    across: Picture
    for_centre: Picture
    for_front: Picture
    fine: Picture


def curves(radius_px: float) -> Curves:
    """Halves [r + 1] of the Gaussian curves of a patch's mask, inner and outer, as `blurred` has them."""
    reach = [round(4 * share * radius_px) for share in (INNER, OUTER)]
    inner, outer = (
        np.ascontiguousarray(cv2.getGaussianKernel(2 * r + 1, share * radius_px, cv2.CV_32F)[r:, 0])
        for r, share in zip(reach, (INNER, OUTER), strict=True)
    )
    return inner, outer


@step
def _two(curve: Any, off: int) -> Any:
    """The place after one in a curve, if there is one, and the weights of both."""
    more = min(off + 1, curve.shape[0] - 1)
    return more, (curve[off], curve[more] if more > off else np.float32(0.0))


@step
def _add(first: Any, second: Any, third: Any, fourth: Any, weights: Any, into: Any) -> None:
    """Two pairs of lines, each with its weight, onto a line."""
    near, far = weights
    for k in range(into.shape[0]):
        into[k] += near * (first[k] + second[k]) + far * (third[k] + fourth[k])


@step
def part_about(least: float, most: float, last: int) -> Any:
    """Lines between two places, within the window: the first, and how many, a multiple of LANES."""
    first = max(math.floor(least), 0)
    count = min(math.ceil(most), last) + 1 - first
    return first, (count + LANES - 1) // LANES * LANES


@jit
def respond(picture: Any, curves: Any, part: Any, room: Any, inner: Any, response: Any) -> None:
    """A mask's response to a part of a picture, and that part under its inner curve.

    Beyond its edge the picture is as at its edge.

    Args:
        picture: [n, n] the window.
        curves: of the mask.
        part: first row and its end, first column and how many.
        room: for what is filtered along the rows only.
        inner, response: into the same part of which they go.
    """
    (first, end), (left, wide) = part
    last, line, across = picture.shape[0] - 1, room.line, room.across
    for which in range(2):
        curve, out = curves[which], response if which else inner
        reach = curve.shape[0] - 1
        low, high, start = max(first - reach, 0), min(end - 1 + reach, last), left - reach
        inside, beyond = max(start, 0), min(start + wide + 2 * reach, last + 1)
        for row in range(low, high + 1):
            for column in range(start, inside):
                line[column - start] = picture[row, 0]
            for column in range(inside, beyond):
                line[column - start] = picture[row, column]
            for column in range(beyond, start + wide + 2 * reach):
                line[column - start] = picture[row, last]
            into = across[row, :wide]
            for k in range(wide):
                into[k] = curve[0] * line[reach + k]
            for off in range(1, reach + 1, 2):
                more, weights = _two(curve, off)
                _add(line[reach - off :], line[reach + off :], line[reach - more :], line[reach + more :],
                     weights, into)  # fmt: skip
        for row in range(first, end):
            into = out[row, left : left + wide]
            for k in range(wide):
                into[k] = curve[0] * across[row, k]
            for off in range(1, reach + 1, 2):
                more, weights = _two(curve, off)
                _add(across[max(row - off, low)], across[min(row + off, high)],
                     across[max(row - more, low)], across[min(row + more, high)], weights, into)  # fmt: skip
    for row in range(first, end):
        fine, into = inner[row, left : left + wide], response[row, left : left + wide]
        for k in range(wide):
            into[k] = fine[k] - into[k]
