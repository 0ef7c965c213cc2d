"""Exemplars of light seeking: small controllers, one a kind of behaviour of table 2.

Ambient readings are small in the light: 55 in the brightest, 484 in the dark.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from studies.correspondence.avoiders import Draw, Rule, turning

from realitygap.values import Command

DARK = 484.0
GLARE = 425.0
"""Light (counts below dark) of a lamp that is almost touched."""
AHEAD = {1: (1, 5), -1: (4, 0)}
"""Who turns left (1) takes the lamp as ahead from 0° to 45° at its right, so that it comes out of a
turn with the lamp in front; who turns right (−1), at its left."""


def two_way_turner(draw: Draw) -> Rule:
    """Turns to the brighter side, left or right, and drives on."""
    cruise, gain = int(draw.integers(4, 10)), draw.uniform(0.003, 0.009)
    spin, most = int(draw.integers(2, 6)), draw.uniform(1.0, 2.5)
    way = draw.choice([-1, 1])

    def rule(a: NDArray[np.float64]) -> Command:
        nonlocal way
        lit = DARK - a
        more = lit[[0, 1, 2]].sum() - lit[[5, 4, 3]].sum()
        if abs(more) > 60:
            way = 1 if more > 0 else -1
        if not _ahead(lit, 330):  # the lamp is beside or behind: turn where it was brighter
            return turning(1, way * spin)
        return turning(cruise, float(np.clip(gain * more, -most, most)))

    return rule


def straight_looper(draw: Draw) -> Rule:
    """Straight on while the lamp is ahead; else a loop to its one side until it is again."""
    cruise, loop = int(draw.integers(6, 11)), draw.uniform(4, 7)
    bend, seen = loop * draw.uniform(0.3, 0.6), draw.uniform(310, 360)
    side = draw.choice([-1, 1])
    pair = AHEAD[side]

    def rule(a: NDArray[np.float64]) -> Command:
        lit = DARK - a
        if _ahead(lit, seen, pair) and lit.max() < GLARE:
            return Command(left=cruise, right=cruise)
        return turning(loop, side * bend)

    return rule


def three_point_turner(draw: Draw) -> Rule:
    """Straight on while the lamp is ahead; else backs and turns, as a car does in a lane."""
    cruise, bend = int(draw.integers(5, 10)), draw.uniform(1.0, 2.5)
    back, on = int(draw.integers(6, 12)), int(draw.integers(4, 8))
    pace, seen = draw.uniform(4, 7), draw.uniform(310, 360)
    side = draw.choice([-1, 1])
    pair = AHEAD[side]
    k = 0

    def rule(a: NDArray[np.float64]) -> Command:
        nonlocal k
        lit = DARK - a
        if _ahead(lit, seen, pair) and lit.max() < GLARE and k % (back + on) == 0:
            return Command(left=cruise, right=cruise)
        backing = k % (back + on) < back
        k += 1
        return turning(-pace if backing else pace, side * bend)

    return rule


def bobber(draw: Draw) -> Rule:
    """Goes to the lamp by bobbing: forward for a moment, back for a shorter one, over and over."""
    pace, on = draw.uniform(5, 9), int(draw.integers(6, 12))
    back = max(3, round(on * draw.uniform(0.35, 0.65)))
    gain, most = draw.uniform(0.003, 0.009), draw.uniform(1.0, 3.0)
    way = draw.choice([-1, 1])
    k = 0

    def rule(a: NDArray[np.float64]) -> Command:
        nonlocal k, way
        lit = DARK - a
        more = lit[[0, 1, 2]].sum() - lit[[5, 4, 3]].sum()
        if abs(more) > 60:
            way = 1 if more > 0 else -1
        k += 1
        bend = float(np.clip(gain * more, -most, most)) if _ahead(lit, 330) else way * most
        return turning(pace if k % (on + back) < on else -pace, bend)

    return rule


def _ahead(lit: NDArray[np.float64], seen: float, pair: tuple[int, int] = (1, 4)) -> bool:
    """Whether both of two sensors see the lamp; the oblique ones do within 45° of the front."""
    return bool(min(lit[pair[0]], lit[pair[1]]) > seen)


SEEKERS: dict[str, Callable[[Draw], Rule]] = {
    "three point turner": three_point_turner,
    "straight looper": straight_looper,
    "two way turner": two_way_turner,
    "bobber": bobber,
}
"""Table 2's kinds of behaviour."""
