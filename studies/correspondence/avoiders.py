"""Exemplars of obstacle avoidance: small controllers, one a kind of behaviour of table 1.

Each is a rule from proximity readings to wheel commands, with a few numbers that are drawn anew
for every exemplar, so that a kind is a family and not one robot.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from realitygap.values import Command

Rule = Callable[[NDArray[np.float64]], Command]
"""Eight readings of one step, in the Khepera's order, to wheel commands."""
Draw = np.random.Generator


def one_way_turner(draw: Draw) -> Rule:
    """Straight on; whatever it meets, it turns away to its one side."""
    cruise, spin = int(draw.integers(6, 11)), int(draw.integers(3, 8))
    feels, holds = draw.uniform(150, 450), int(draw.integers(2, 6))
    side, back = draw.choice([-1, 1]), int(draw.integers(0, 3))
    left = 0

    def rule(p: NDArray[np.float64]) -> Command:
        nonlocal left
        left = holds if p[1:5].max() > feels else left - 1
        if left > 0:
            return turning(-back, side * spin)
        return Command(left=cruise, right=cruise)

    return rule


def two_way_turner(draw: Draw) -> Rule:
    """Straight on; it turns away from the side on which it feels more."""
    cruise, spin = int(draw.integers(6, 11)), int(draw.integers(3, 8))
    feels, holds = draw.uniform(150, 450), int(draw.integers(1, 4))
    left, side = 0, 1

    def rule(p: NDArray[np.float64]) -> Command:
        nonlocal left, side
        if p[1:5].max() > feels:
            if left <= 0:  # it does not change its mind in a corner
                side = -1 if p[0:3].sum() > p[3:6].sum() else 1
            left = holds
        else:
            left -= 1
        return turning(0, side * spin) if left > 0 else Command(left=cruise, right=cruise)

    return rule


def wall_follower(draw: Draw) -> Rule:
    """Keeps a surface at its one side; bends towards it where it is lost."""
    cruise, spin = int(draw.integers(4, 9)), int(draw.integers(3, 7))
    target, gain = draw.uniform(250, 600), draw.uniform(0.004, 0.01)
    feels, bend = draw.uniform(250, 500), draw.uniform(0.7, 2.0)
    side = draw.choice([-1, 1])
    met = False

    def rule(p: NDArray[np.float64]) -> Command:
        nonlocal met
        beside, ahead = (p[[0, 1]], p[[1, 2, 3]]) if side > 0 else (p[[5, 4]], p[[4, 3, 2]])
        if ahead[1:].max() > feels:
            met = True
            return turning(0, -side * spin)
        if beside.max() < 60:  # nothing there: straight until the first surface, then round corners
            return turning(cruise, side * bend if met else 0)
        met = True
        off = float(np.clip(gain * (target - beside.max()), -2.5, bend))
        return turning(cruise, side * off)

    return rule


def one_way_looper(draw: Draw) -> Rule:
    """Goes round and round to its one side, and more sharply where it meets something."""
    cruise, spin = draw.uniform(5, 8), int(draw.integers(3, 7))
    bend = cruise * draw.uniform(0.24, 0.5)
    feels, holds = draw.uniform(200, 500), int(draw.integers(1, 4))
    side = draw.choice([-1, 1])
    left = 0

    def rule(p: NDArray[np.float64]) -> Command:
        nonlocal left
        left = holds if p[1:5].max() > feels else left - 1
        return turning(0, side * spin) if left > 0 else turning(cruise, side * bend)

    return rule


AVOIDERS: dict[str, Callable[[Draw], Rule]] = {
    "one way turner": one_way_turner,
    "two way turner": two_way_turner,
    "wall follower": wall_follower,
    "one way looper": one_way_looper,
}
"""Table 1's kinds of behaviour."""


def turning(forward: float, left: float) -> Command:
    """Wheel commands for a speed and a turn to the left."""
    return Command(left=_speed(forward - left), right=_speed(forward + left))


def _speed(wished: float) -> int:
    """The wheel speed next to it: plain Python, since each step of each trial asks twice."""
    return min(max(round(wished), -10), 10)
