"""A robot's constants drawn anew for each trial, within a spread (domain randomisation)."""

import numpy as np

from realitygap.kernels.jit import routine
from realitygap.kernels.params import F, Robot
from realitygap.kernels.rng import substream, uniform
from realitygap.streams import CONSTANTS
from realitygap.world.sensors import looks

__all__ = ["drawn"]


def drawn(robot: Robot, stream: int, spread: float, wheels: float | None = None) -> Robot:
    """The robot of one trial: a function of the trial's stream.

    Factors uniform in 1 ± spread, each drawn by itself: on what every proximity sensor gets back (its `a`),
    on every ambient sensor's gain, on each wheel's speed a unit, and on the track.

    Args:
        robot: the profile's.
        stream: the trial's.
        spread: 0 to below 1.
        wheels: that of wheels and track, if it is another.
    """
    near, light = len(robot.proximity_a), len(robot.ambient_gain)
    under = np.uint64(substream(np.uint64(stream), np.uint64(CONSTANTS)))
    draws = _draws(under, near + light + 3)
    shares = np.repeat([spread, spread if wheels is None else wheels], [near + light, 3])
    factors = 1.0 + shares * (2.0 * draws - 1.0)
    a, gain, turns, track = np.split(factors, [near, near + light, near + light + 2])
    return robot._replace(
        proximity_a=robot.proximity_a * a,
        **looks(
            robot.proximity_place,
            robot.proximity_facing,
            _reach(robot, a),
            robot.proximity_a * a,
            robot.proximity_b,
            robot.proximity_offset,
        ),
        ambient_gain=robot.ambient_gain * gain,
        speed_per_unit=robot.speed_per_unit * turns,
        track=robot.track * float(track[0]),
    )


@routine
def _draws(stream: np.uint64, count: int) -> F:
    """[count] uniform, 0 to 1."""
    out = np.empty(count)
    for i in range(count):
        out[i] = uniform(stream, i)
    return out


def _reach(robot: Robot, factors: F) -> F:
    """How far sensors notice anything once more or less comes back: the d of the same a / ((d + o)² + w²)."""
    square = (robot.proximity_reach + robot.proximity_offset) ** 2 + robot.proximity_width2
    far = np.sqrt(np.maximum(square * factors - robot.proximity_width2, 0.0)) - robot.proximity_offset
    end = 1.0 / robot.proximity_least if robot.proximity_least else np.inf
    reach: F = np.clip(far, 0.0, end)
    return reach
