"""The infrared proximity sensors (§3.2.3): I = Σ cos β_i (a/d_i² + b), ten rays a sensor.

A sensor reads 0 where nothing is nearer than its reach √(a/−b), for then all terms are ≤ 0. With `shades` a
is multiplied by the surface's reflectance and, if it is Lambertian, by the cosine of incidence.
"""

import math

import numpy as np

from realitygap.compiled import step
from realitygap.kernels.rays import (
    EYE_A,
    EYE_B,
    EYE_OFFSET,
    FAR,
    INVERSE,
    LANES,
    MIRROR,
    NONE,
    ONE,
    SHADE,
    SPARE,
    SUM,
    TOUCHING,
    U,
    cast_rays,
    cell_at,
    f32,
    from_segment,
    hand_over,
    is_beyond,
    is_clear,
    place_sensors,
)
from realitygap.kernels.rng import normal_pair

TURN = 0.15915494309189535
"""1/2π."""


@step
def signal_printed(n, sensors, fan, p, shades):
    """Σ over the rays of cos^m β (a/(d + offset)² + b), outermost pairs first: mirror-image sensors add
    mirror-image rays in the same order."""
    for r in range(fan.shape[1]):
        w, o = fan[2, r], LANES * U(r)
        for i in range(n):
            u, v = p[INVERSE + o + i], p[INVERSE + MIRROR + o + i]
            if shades is None:
                light = u * u + v * v
            else:
                offset = sensors[EYE_OFFSET, i]
                u, v = u / (ONE + offset * u), v / (ONE + offset * v)
                light = u * u * p[SHADE + o + i] + v * v * p[SHADE + MIRROR + o + i]
            b = sensors[EYE_B, i]
            term = w * (sensors[EYE_A, i] * light + (b + b))
            p[SUM + i] = term if r == 0 else p[SUM + i] + term


@step
def intensity(v, a, offset, least, width2):
    """Light of one ray for a measured sensor: a / ((d + offset)² + width²), 0 beyond its range."""
    v = v if v >= least else NONE
    near = max(ONE + offset * v, TOUCHING * v)
    return a * (v * v) / (near * near + width2 * (v * v))


@step
def signal_measured(n, robot, sensors, fan, p):
    """Σ weight ρ cos a / ((d + offset)² + width²), minus the overlap of beams: what a flat surface, at the
    distance of the middle ray, reflects into the outermost."""
    middle = LANES * U(fan.shape[1] - 1)
    least, width2 = f32(robot.proximity.least), f32(robot.proximity.width2)
    overlap, cone = f32(robot.proximity.overlap), f32(robot.proximity.cone)
    for r in range(fan.shape[1]):
        w, o = fan[2, r], LANES * U(r)
        for i in range(n):
            a, offset = sensors[EYE_A, i], sensors[EYE_OFFSET, i]
            u = intensity(p[INVERSE + o + i], a, offset, least, width2)
            v = intensity(p[INVERSE + MIRROR + o + i], a, offset, least, width2)
            term = w * (u * p[SHADE + o + i] + v * p[SHADE + MIRROR + o + i])
            p[SUM + i] = term if r == 0 else p[SUM + i] + term
    for i in range(n):
        a, offset = sensors[EYE_A, i], sensors[EYE_OFFSET, i]
        flat = intensity(p[INVERSE + middle + i] * cone, a, offset, least, width2)
        p[SUM + i] -= overlap * flat * p[SHADE + middle + i]


@step
def is_extended(robot, arena):
    """Whether the light of a ray depends on more than 1/d by the printed law."""
    extended = robot.proximity.lambertian > 0.0 or arena.reflectance.shape[0] > 0
    for k in range(robot.proximity.offset.shape[0]):
        extended = extended or robot.proximity.offset[k] != 0.0
    return extended


@step
def receive(robot, arena, pose, p, out):
    """The signals of all sensors into `out` ([P]): the printed sums, not clipped; or the light of measured
    sensors, before their curves."""
    fan, matt = robot.proximity.fan, f32(robot.proximity.lambertian)
    cell, measured = cell_at(arena, pose[0], pose[1]), robot.proximity.curve.shape[1] > 0
    more, shades = FAR if is_bright(arena) else NONE, (matt, ONE - matt)
    for block in range(robot.proximity.rows.shape[0]):
        sensors = robot.proximity.rows[block]
        n = U(sensors.shape[1])
        place_sensors(n, sensors, arena, pose, p)
        if measured or is_extended(robot, arena):
            cast_rays(n, arena, pose, cell, robot.radius, sensors, more, fan, p, shades)
            if measured:
                signal_measured(n, robot, sensors, fan, p)
            else:
                signal_printed(n, sensors, fan, p, shades)
        else:
            cast_rays(n, arena, pose, cell, robot.radius, sensors, more, fan, p, None)
            signal_printed(n, sensors, fan, p, None)
        hand_over(p, block, out)


@step
def is_bright(arena):
    """Whether sensors may notice a surface from farther away than usual."""
    most = 1.0
    for i in range(arena.reflectance.shape[0]):
        most = max(most, arena.reflectance[i])
    return most > 1.0


@step
def by_rays(robot, arena, pose, p, out):
    """As `infrared`, for a robot without a table."""
    if not is_bright(arena) and is_clear(arena, pose[0], pose[1], robot.proximity.span):
        for k in range(out.shape[0]):
            out[k] = 0.0
    else:
        receive(robot, arena, pose, p, out)
    if robot.proximity.curve.shape[1] > 0:
        for k in range(out.shape[0]):
            out[k] = apply_curve(robot.proximity.curve, k, robot.proximity.knee, out[k])
    else:
        for k in range(out.shape[0]):
            out[k] = min(max(out[k], 0.0), robot.proximity.top)


@step
def by_table_or_rays(table, robot, arena, pose, p, out):
    """As `infrared`. Only one of the two is compiled for a robot, since the table's length is part of the
    type."""
    if len(table) > 0:
        replay(table, robot.radius, robot.proximity.top, arena, pose, out)
    else:
        by_rays(robot, arena, pose, p, out)


@step
def infrared(robot, arena, pose, p, out):
    """Noise-free readings of all proximity sensors into `out` ([P], counts, unrounded)."""
    by_table_or_rays(robot.proximity.table, robot, arena, pose, p, out)


# Measured sensors: tables of each, with values at equal steps, straight between them.


@step
def between(table, k, at):
    """Row `k` of a table, interpolated at `at` steps from its first value: 0 to the number of its steps."""
    j = min(int(at), table.shape[1] - 2)
    # An unsigned index needs no test for counting from the end.
    here = np.uint64(j)
    return table[k, here] + (at - j) * (table[k, here + np.uint64(1)] - table[k, here])


@step
def apply_curve(curve, k, knee, light):
    """Counts of sensor `k` under a light: its curve at √light / (√light + knee)."""
    root = math.sqrt(max(light, 0.0))
    return between(curve, k, root / (root + knee) * (curve.shape[1] - 1))


@step
def scale_noise(table, rise, readings, top, speed, noise):
    """Turn normal numbers into each sensor's noise: by its reading's share of the full scale `top`, and the
    wheels' speed (cm/s)."""
    last = np.float64(table.shape[1] - 1)
    steps = last / top
    for k in range(readings.shape[0]):
        at = min(max(readings[k] * steps, 0.0), last)
        noise[k] *= between(table, k, at) * (1.0 + rise[k] * speed)


@step
def shift_readings(between, stream, first, top, level, readings):
    """Add to noise-free readings what a whole trial has in common (draws `first` …): `between` [n] is its
    deviation at equal steps of the reading."""
    last = between.shape[0] - 1
    for k in range(readings.shape[0]):
        at = min(max(readings[k] / top * last, 0.0), float(last))
        j = min(int(at), last - 1)
        size = between[j] + (at - j) * (between[j + 1] - between[j])
        readings[k] = min(max(readings[k] + level * size * normal_pair(stream, first + k)[0], 0.0), top)


# By a look-up table: readings recorded round each kind of object, replayed (the paper's [15]).


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
def add_object(seen, reach, ex, ey, pose, out):
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
def add_obstacles(table, radius, arena, pose, out):
    """Add the contributions of cylinders and inner walls."""
    x, y = pose[0], pose[1]
    cell = cell_at(arena, x, y)
    span = radius + table.cylinder.at[table.cylinder.at.shape[0] - 1] + SPARE
    for n in range(arena.cylinders.shape[0]):
        if arena.cylinder_gap[cell, n] > span:
            break
        j = arena.near_cylinders[cell, n]
        reach = radius + arena.cylinders[j, 2]
        add_object(table.cylinder, reach, arena.cylinders[j, 0] - x, arena.cylinders[j, 1] - y, pose, out)
    span = radius + table.wall.at[table.wall.at.shape[0] - 1] + SPARE
    for n in range(arena.segments.shape[0]):
        if arena.segment_gap[cell, n] > span:
            break
        j = arena.near_segments[cell, n]
        if not is_beyond(arena, j, x, y, span):
            dx, dy = from_segment(arena, j, x, y)
            add_object(table.wall, radius, -dx, -dy, pose, out)


@step
def replay(table, radius, top, arena, pose, out):
    """Noise-free readings of all proximity sensors of a robot of this radius into `out` ([P], counts from 0
    to `top`, unrounded)."""
    for k in range(out.shape[0]):
        out[k] = table.nothing[k]
    add_object(table.wall, radius, arena.size[0] - pose[0], 0.0, pose, out)
    add_object(table.wall, radius, -pose[0], 0.0, pose, out)
    add_object(table.wall, radius, 0.0, arena.size[1] - pose[1], pose, out)
    add_object(table.wall, radius, 0.0, -pose[1], pose, out)
    add_obstacles(table, radius, arena, pose, out)
    for k in range(out.shape[0]):
        out[k] = min(max(out[k], 0.0), top)
