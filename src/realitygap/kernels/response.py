"""What a sensor makes of what reaches it, as measured: a curve, a dead zone, noise by the reading.

All three are tables of one sensor each, with values at equal steps and straight lines between them.
"""

import math

from realitygap.kernels.jit import step


@step
def between(table, k, share):
    """Row `k` of a table at a share from 0 (its first value) to 1 (its last)."""
    last = table.shape[1] - 1
    at = share * last
    j = min(int(at), last - 1)
    return table[k, j] + (at - j) * (table[k, j + 1] - table[k, j])


@step
def respond(curve, k, knee, light):
    """Counts of sensor `k` under a light: its curve at √light / (√light + knee)."""
    root = math.sqrt(max(light, 0.0))
    return between(curve, k, root / (root + knee))


@step
def deviation(table, rise, k, reading, speed):
    """Noise of sensor `k`: by its reading as a share of the full scale, and the wheels' speed (cm/s)."""
    return between(table, k, min(max(reading, 0.0), 1.0)) * (1.0 + rise[k] * speed)
