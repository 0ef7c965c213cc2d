"""Lines in the room that something blocks, without a division for each."""

from realitygap.kernels.jit import step


@step
def covers(wx, wy, radius):
    """Whether a circle at (wx, wy) from a point lies over it."""
    return wx * wx + wy * wy < radius * radius


@step
def circle_blocks(wx, wy, ex, ey, radius):
    """1.0 if the line from a point along (ex, ey) passes through the circle at (wx, wy) from it.

    Lines that end within the circle are excluded: `covers` tests that once for all lines with the same end.
    No division: the centre's distance to the line, |w × e| / |e|, is compared squared.
    """
    ahead = wx * ex + wy * ey
    aside = wx * ey - wy * ex
    span = ex * ex + ey * ey
    hidden = 1.0 if aside * aside < radius * radius * span else 0.0
    hidden = hidden if ahead > 0.0 else 0.0
    return hidden if ahead < span else 0.0


@step
def segment_blocks(arena, j, hx, hy, ex, ey):
    """1.0 if the line from (hx, hy) along (ex, ey) crosses inner wall `j`."""
    ax = arena.segments[j, 0] - hx
    ay = arena.segments[j, 1] - hy
    bx = arena.segments[j, 2] - hx
    by = arena.segments[j, 3] - hy
    side_a = ex * ay - ey * ax
    side_b = ex * by - ey * bx
    area = ax * by - ay * bx
    # Where it crosses: the share u = area / (e × (b − a)) of e lies between 0 and 1.
    turn = side_b - side_a
    crossed = 1.0 if side_a * side_b < 0.0 else 0.0
    crossed = crossed if area * turn > 0.0 else 0.0
    return crossed if abs(area) < abs(turn) else 0.0
