"""Proximity sensors by a look-up table: readings recorded round each kind of object, replayed (the paper's
[15]).

No equation and no rays: an object's distance from the body's edge and its bearing are interpolated linearly
between recorded places. Contributions of objects to a sensor's empty reading add up, even where one hides
another, as in this approach's own simulators; an inner wall counts as a long one at its nearest point. Nearer
than the nearest recorded distance readings are constant; beyond the farthest an object adds nothing.
"""

import math

from realitygap.kernels.jit import step
from realitygap.kernels.near import SPARE, cell_at, from_segment, is_beyond

TURN = 0.15915494309189535
"""1/2π."""


@step
def turned(x, y):
    """The direction of (x, y) in full turns, −½ … ½, to about 1e-8 (Abramowitz and Stegun, 4.4.49)."""
    along, across = abs(x), abs(y)
    t = min(along, across) / max(along, across, 1e-12)
    z = t * t
    series = -0.0752896400 + z * (0.0429096138 + z * (-0.0161657367 + z * 0.0028662257))
    series = 0.1999355085 + z * (-0.1420889944 + z * (0.1065626393 + z * series))
    angle = TURN * t * (1.0 + z * (-0.3333314528 + z * series))
    angle = 0.25 - angle if across > along else angle
    angle = 0.5 - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@step
def meet(seen, reach, ex, ey, pose, out):
    """Add one object's contribution to `out`: its nearest point, or a cylinder's axis, lies at (ex, ey) from
    the robot's centre; `reach` is the part of that distance inside the robot and the cylinder."""
    at, added = seen.at, seen.added
    last = at.shape[0] - 1
    square, most = ex * ex + ey * ey, reach + at[last] + SPARE
    if square > most * most:
        return
    distance = math.sqrt(square) - reach
    i = 0
    while i < last - 1 and at[i + 1] < distance:
        i += 1
    far = min(max((distance - at[i]) / (at[i + 1] - at[i]), 0.0), 1.0)
    c, s, many = pose[3], pose[4], added.shape[1]
    bearing = turned(c * ex + s * ey, c * ey - s * ex) * many
    whole = math.floor(bearing)
    aside, j = bearing - whole, int(whole)
    j = j + many if j < 0 else j
    following = j + 1 if j + 1 < many else 0
    for k in range(out.shape[0]):
        near = added[i, j, k] + aside * (added[i, following, k] - added[i, j, k])
        beyond = added[i + 1, j, k] + aside * (added[i + 1, following, k] - added[i + 1, j, k])
        out[k] += near + far * (beyond - near)


@step
def meet_obstacles(table, radius, arena, pose, out):
    """Add the contributions of cylinders and inner walls."""
    x, y = pose[0], pose[1]
    cell = cell_at(arena, x, y)
    span = radius + table.cylinder.at[table.cylinder.at.shape[0] - 1] + SPARE
    for n in range(arena.cylinders.shape[0]):
        if arena.cylinder_gap[cell, n] > span:
            break
        j = arena.near_cylinders[cell, n]
        reach = radius + arena.cylinders[j, 2]
        meet(table.cylinder, reach, arena.cylinders[j, 0] - x, arena.cylinders[j, 1] - y, pose, out)
    span = radius + table.wall.at[table.wall.at.shape[0] - 1] + SPARE
    for n in range(arena.segments.shape[0]):
        if arena.segment_gap[cell, n] > span:
            break
        j = arena.near_segments[cell, n]
        if not is_beyond(arena, j, x, y, span):
            dx, dy = from_segment(arena, j, x, y)
            meet(table.wall, radius, -dx, -dy, pose, out)


@step
def replay(table, radius, top, arena, pose, out):
    """Noise-free readings of all proximity sensors of a robot of this radius into `out` ([P], counts from 0
    to `top`, unrounded)."""
    for k in range(out.shape[0]):
        out[k] = table.nothing[k]
    meet(table.wall, radius, arena.size[0] - pose[0], 0.0, pose, out)
    meet(table.wall, radius, -pose[0], 0.0, pose, out)
    meet(table.wall, radius, 0.0, arena.size[1] - pose[1], pose, out)
    meet(table.wall, radius, 0.0, -pose[1], pose, out)
    meet_obstacles(table, radius, arena, pose, out)
    for k in range(out.shape[0]):
        out[k] = min(max(out[k], 0.0), top)
