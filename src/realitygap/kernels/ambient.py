"""The ambient light sensors (§3.3): direct light, and light reflected from what the rays meet."""

import math

from realitygap.kernels.jit import apart, step
from realitygap.kernels.light import (
    first_sensor,
    follow_rays,
    light_on_places,
    rays_of_fan,
    reflected_light,
    stand_by_sensors,
)
from realitygap.kernels.light_beyond import goes_beyond, illuminate_beyond
from realitygap.kernels.response import respond


@step
def illuminate(robot, arena, enough, work, out):
    """Illumination of all ambient sensors into `out`: A_i = D_i + Σ_j D_ij cos² β_ij · 1.5 / d_ij².

    The paper's equation has a separate path, free of the cost of extensions.
    """
    for k in range(out.shape[0]):
        out[k] = 0.0
    if goes_beyond(robot):
        illuminate_beyond(robot, arena, enough, work, out)
        return
    follow_rays(robot, arena, work)
    stand_by_sensors(robot, work)
    sensors, used = first_sensor(robot, work), rays_of_fan(robot, work)
    for lamp in range(arena.lamp_points.shape[0]):
        light_on_places(robot, arena, lamp, 0, work)
        for k in range(out.shape[0]):
            out[k] += work.light[sensors + k] + reflected_light(k * used, (k + 1) * used, work)


@apart
def ambient(robot, arena, work, out):
    """Noise-free readings of all ambient sensors into `out` ([A], counts, unrounded).

    V = 55 + 1/√A, clipped at the dark reading; or, linear in the light, V = dark − A, clipped at 55; or by
    each sensor's measured curve.
    """
    illuminate(robot, arena, True, work, out)
    answer(robot, out)


@step
def answer(robot, out):
    """Turn the illumination of all ambient sensors into their readings, in place."""
    if robot.ambient_curve.shape[1] > 0:
        for k in range(out.shape[0]):
            out[k] = respond(robot.ambient_curve, k, robot.ambient_knee, out[k] * robot.ambient_gain[k])
        return
    linear = robot.light_linear > 0.0
    for k in range(out.shape[0]):
        total = out[k] * robot.ambient_gain[k]
        floor = robot.ambient_floor[k]
        dark = robot.ambient_dark[k]
        out[k] = dark
        if linear:
            out[k] = max(dark - total, floor)
        elif total > 0.0:
            out[k] = min(floor + 1.0 / math.sqrt(total), dark)
