"""A measured sensor's response to light: a curve, a dead zone, noise by the reading.

All three are tables for each sensor, with values at equal steps and linear interpolation.
"""

import math

import numpy as np

from realitygap.kernels.jit import step


@step
def between(table, k, at):
    """Row `k` of a table, interpolated at `at` steps from its first value: 0 to the number of its steps."""
    j = min(int(at), table.shape[1] - 2)
    # An unsigned index needs no test for counting from the end.
    here = np.uint64(j)
    return table[k, here] + (at - j) * (table[k, here + np.uint64(1)] - table[k, here])


@step
def respond(curve, k, knee, light):
    """Counts of sensor `k` under a light: its curve at √light / (√light + knee)."""
    root = math.sqrt(max(light, 0.0))
    return between(curve, k, root / (root + knee) * (curve.shape[1] - 1))


@step
def weigh(table, rise, readings, top, speed, noise):
    """Turn normal numbers into each sensor's noise: by its reading's share of the full scale `top`, and the
    wheels' speed (cm/s)."""
    last = np.float64(table.shape[1] - 1)
    steps = last / top
    for k in range(readings.shape[0]):
        at = min(max(readings[k] * steps, 0.0), last)
        noise[k] *= between(table, k, at) * (1.0 + rise[k] * speed)
