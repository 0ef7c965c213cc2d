"""The window that the tracker looks at closely, compiled: where it lies, the masks' responses and their tops.

Responses are made only where they are looked at: about the middle, then about the centres found there.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from realitygap.film.camera import OUTSIDE, CameraModel, turning_point
from realitygap.film.masks import Curves, jit, part_about, respond, step
from realitygap.values import Floats

__all__ = ["UPHILL", "Aim", "Optics", "lay_out", "optics_of", "sightings"]

LEAST, UPHILL = 0.5, 6
"""A mask's response that is a top, and how many steps it is from a place on the ring to one, at most."""


class Optics(NamedTuple):
    """A camera at one height: its homography [3, 3]; the place above which rays end [2] (cm) and the share of
    the way that a point is moved to the homography's plane (numerator, denominator; both 1: not at all);
    middle, half diagonal, radial terms and where they turn back; where goes what no ray brings into the
    picture (px)."""

    homography: Floats
    lens: tuple[float, float]
    move: tuple[float, float]
    middle: tuple[float, float]
    half: float
    radial: tuple[float, float]
    limit: float
    outside: float


class Aim(NamedTuple):
    """What is looked for, in steps of a window whose middle is `half` from its edges: `reach`, how far off
    the middle a centre may be; the `ring` of the front patch about it, and how far off that it may seem;
    directions [n, 2] all round; how `far` from a centre anything is looked at. Of the masks for the `centre`
    and for the `front` patch the inner and the outer Gaussian curve, half of each [r + 1], its middle first.
    """

    half: int
    reach: float
    ring: float
    slack: float
    round: Floats
    far: int
    centre: Curves
    front: Curves


def optics_of(camera: CameraModel, height_cm: float) -> Optics:
    """The camera for what is so high above the floor."""
    move, lens = (1.0, 1.0), (0.0, 0.0)
    if camera.lens_cm is not None and abs(height_cm - camera.plane_cm) > 1e-9:
        *lens, above = camera.lens_cm  # type: ignore[assignment]
        move = above - camera.plane_cm, above - height_cm
    return Optics(
        homography=camera.homography,
        lens=(lens[0], lens[1]),
        move=move,
        middle=camera.middle,
        half=camera.half_diagonal,
        radial=camera.radial,
        limit=turning_point(*camera.radial),
        outside=OUTSIDE,
    )


@step
def _pixel(optics: Any, x: float, y: float) -> Any:
    """As `CameraModel.columns_rows` has it; without branches, so that many are taken at once."""
    h, (up, down) = optics.homography, optics.move
    if up != down:
        x = optics.lens[0] + (x - optics.lens[0]) * up / down
        y = optics.lens[1] + (y - optics.lens[1]) * up / down
    depth = h[2, 0] * x + h[2, 1] * y + h[2, 2]
    column = (h[0, 0] * x + h[0, 1] * y + h[0, 2]) / depth
    row = (h[1, 0] * x + h[1, 1] * y + h[1, 2]) / depth
    seen = depth > 1e-12
    k1, k2 = optics.radial
    if k1 != 0.0 or k2 != 0.0:
        (middle_x, middle_y), half = optics.middle, optics.half
        x, y = (column - middle_x) / half, (row - middle_y) / half
        square = x * x + y * y
        factor = 1 + k1 * square + k2 * square * square
        seen &= square < optics.limit
        column, row = middle_x + half * (x * factor), middle_y + half * (y * factor)
    return column if seen else optics.outside, row if seen else optics.outside


@jit
def lay_out(optics: Any, place: Any, axis: Any, columns: Any, rows: Any, ends: Any) -> None:
    """Where the places of a square about a place are in the picture.

    Args:
        optics: of the camera, at the square's height.
        place: x, y of the middle, cm.
        axis: [n] of the square's sides, from its middle, cm.
        columns, rows: [n, n] into which the pixels go.
        ends: [4] least and largest column, least and largest row.
    """
    count = axis.shape[0]
    for i in range(count):
        for j in range(count):
            columns[i, j], rows[i, j] = _pixel(optics, place[0] + axis[j], place[1] + axis[i])
    ends[0], ends[1], ends[2], ends[3] = np.inf, -np.inf, np.inf, -np.inf
    for k in range(4 * count):  # the ends lie on the square's sides, however a lens bends it
        along, side = k % count, k // count
        i, j = (along, (count - 1) * (side % 2)) if side < 2 else ((count - 1) * (side % 2), along)
        ends[0], ends[1] = min(ends[0], columns[i, j]), max(ends[1], columns[i, j])
        ends[2], ends[3] = min(ends[2], rows[i, j]), max(ends[3], rows[i, j])


@step
def _is_top(response: Any, row: int, column: int, first: int, last: int) -> Any:
    """Whether no neighbour within first … last surpasses a response."""
    value = response[row, column]
    for i in range(max(row - 1, first), min(row + 1, last) + 1):
        for j in range(max(column - 1, first), min(column + 1, last) + 1):
            if response[i, j] > value:
                return False
    return value > LEAST


@step
def _three(response: Any, row: int, column: int, down: int, right: int) -> Any:
    """A value and its neighbours before and behind it."""
    before, here = response[row - down, column - right], response[row, column]
    return np.float64(before), np.float64(here), np.float64(response[row + down, column + right])


@jit
def peak(response: Any, column: int, row: int, top: Any) -> Any:
    """The top of the quadratic through the 3 × 3 values about (column, row), px, into `top` [2].

    Least squares over the nine values, so that it is exact for any quadratic. Returns whether it has one.
    """
    height, width = response.shape
    if not (1 <= column < width - 1 and 1 <= row < height - 1):
        return False
    dx, dy, dxx, dyy = 0.0, 0.0, 0.0, 0.0
    for k in range(-1, 2):
        low, here, high = _three(response, row + k, column, 0, 1)
        dx, dxx = dx + (high - low), dxx + (high - 2 * here + low)
        low, here, high = _three(response, row, column + k, 1, 0)
        dy, dyy = dy + (high - low), dyy + (high - 2 * here + low)
    dx, dy, dxx, dyy = dx / 6, dy / 6, dxx / 3, dyy / 3
    upper, _, right_upper = _three(response, row - 1, column, 0, 1)
    lower, _, right_lower = _three(response, row + 1, column, 0, 1)
    dxy = (right_lower - lower - right_upper + upper) / 4
    bend = dxx * dyy - dxy * dxy
    if dxx >= 0 or bend <= 0:
        return False
    x, y = (dxy * dy - dyy * dx) / bend, (dxy * dx - dxx * dy) / bend
    top[0], top[1] = column + x, row + y
    return abs(x) <= 1 and abs(y) <= 1


@step
def _front(response: Any, aim: Any, centre: Any, front: Any) -> Any:
    """The front patch on its ring about the centre, in steps, into `front`; whether it is there."""
    last = response.shape[0] - 1
    column, row, least = 0, 0, -np.inf
    for k in range(aim.round.shape[0]):
        j = min(max(int(np.rint(centre[0] + aim.ring * aim.round[k, 0])), 0), last)
        i = min(max(int(np.rint(centre[1] + aim.ring * aim.round[k, 1])), 0), last)
        if response[i, j] > least:
            column, row, least = j, i, response[i, j]
    for _ in range(UPHILL):
        to_row, to_column, most = row, column, -np.inf
        for i in range(max(row - 1, 0), min(row + 1, last) + 1):
            for j in range(max(column - 1, 0), min(column + 1, last) + 1):
                if response[i, j] > most:
                    to_row, to_column, most = i, j, response[i, j]
        if to_row == row and to_column == column:
            break
        row, column = to_row, to_column
    if not peak(response, column, row, front):
        return False
    dx, dy = front[0] - centre[0], front[1] - centre[1]
    return abs(math.sqrt(dx * dx + dy * dy) - aim.ring) <= aim.slack


@step
def _enter(tops: Any, count: int, value: float, row: int, column: int) -> Any:
    """Put a top among the highest so far, the highest first; how many there are then."""
    if count == tops.shape[0]:
        if value <= tops[count - 1, 0]:
            return count
    else:
        count += 1
    k = count - 1
    while k > 0 and tops[k - 1, 0] < value:
        tops[k, 0], tops[k, 1], tops[k, 2] = tops[k - 1, 0], tops[k - 1, 1], tops[k - 1, 2]
        k -= 1
    tops[k, 0], tops[k, 1], tops[k, 2] = value, row, column
    return count


@jit
def sightings(picture: Any, aim: Any, room: Any, tops: Any, found: Any) -> Any:
    """Centre and front patches of likely disks in a window, the likeliest first.

    Args:
        picture: [n, n] the window.
        aim: what is looked for.
        room: for its masks' responses.
        tops: [k, 3] room for the highest tops of the centre's; that many are looked at.
        found: [m, 4] columns and rows of both patches, at most so many.

    Returns:
        How many were found. About them, `aim.far` round each centre, `room.fine` is the picture as the front
        mask's inner curve shows it.
    """
    edge = picture.shape[0] - 1
    for_centre, for_front = room.for_centre[:, : edge + 1], room.for_front[:, : edge + 1]
    off = math.ceil(aim.reach)
    first = max(aim.half - off, 1) - 1
    last = min(aim.half + off + 1, edge)
    part = (first, last + 1), part_about(first, last, edge)
    respond(picture, aim.centre, part, room, room.fine, room.for_centre)
    count = 0
    for row in range(first, last + 1):
        for column in range(first, last + 1):
            if _is_top(for_centre, row, column, first, last):
                count = _enter(tops, count, for_centre[row, column], row, column)
    near, many = 0, 0
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    for k in range(count):
        row, column = int(tops[k, 1]), int(tops[k, 2])
        down, across = row - aim.half, column - aim.half
        if math.sqrt(down * down + across * across) > aim.reach or near == found.shape[0]:
            continue
        near += 1
        if peak(for_centre, column, row, found[many, :2]):
            left, right = min(left, found[many, 0]), max(right, found[many, 0])
            top, bottom = min(top, found[many, 1]), max(bottom, found[many, 1])
            many += 1
    if many == 0:
        return 0
    first, count = part_about(top - aim.far, bottom + aim.far, edge)
    part = (first, min(first + count, edge + 1)), part_about(left - aim.far, right + aim.far, edge)
    respond(picture, aim.front, part, room, room.fine, room.for_front)
    kept = 0
    for k in range(many):
        found[kept, 0], found[kept, 1] = found[k, 0], found[k, 1]
        kept += _front(for_front, aim, found[kept, :2], found[kept, 2:])
    return kept
