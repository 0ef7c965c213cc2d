"""More controllers for Enki's robots, written when names of large robots were mended, before any was named.

Nothing was chosen by them: reach, temperature, descriptors and exemplars were settled by simulated exemplars
and by the vehicles of `vehicles.py`. Two are others' (their published numbers): the obstacle avoidance of
Aseba's example for the Thymio II, and the Python example of its D-Bus interface, which seeks what it sees.
Both take the Thymio's own counts and units; other robots' readings and speeds are brought to them.
"""

from __future__ import annotations

import math

import numpy as np
from studies.correspondence.vehicles import FULL, TOP_CM_S, Hand, Rule, Vehicles, turn

from realitygap.correspondence.names import NONE

BEARINGS = np.radians([75, 45, 12, -12, -45, -75])
"""About where six sensors look, from the left to the right."""
COUNTS, UNITS = FULL["thymio2"], TOP_CM_S["thymio2"] / 16.6 * 500


def five(p: np.ndarray) -> np.ndarray:
    """A Thymio's five readings ahead, left to right, in counts."""
    return COUNTS * np.array([p[0], p[1], (p[2] + p[3]) / 2, p[4], p[5]])


def aseba_explorer(hand: Hand) -> Rule:
    speed = hand.draw.uniform(120, 240)

    def rule(p: np.ndarray) -> tuple[float, float]:
        near = five(p)
        ahead, aside = float(near @ [1, 2, 3, 2, 1]), float(near @ [-4, -3, 0, 3, 4])
        slower, aside = ahead * speed / 2000, aside * speed / 2000
        return (speed - slower - aside) / UNITS, (speed - slower + aside) / UNITS

    return rule


def repelled(hand: Hand) -> Rule:
    pace, reference = hand.draw.uniform(0.4, 0.8), hand.sight(hand.draw.uniform(0.8, 2.0))
    gain = hand.draw.uniform(0.5, 1.0)

    def rule(p: np.ndarray) -> tuple[float, float]:
        felt = np.minimum(p[:6] / reference, 2.0)
        to_x, to_y = 1.0 - float(felt @ np.cos(BEARINGS)) / 2, -float(felt @ np.sin(BEARINGS)) / 2
        toward = math.atan2(to_y, to_x)
        return turn(pace * max(0.0, math.cos(toward)), gain * pace * float(np.clip(toward, -1, 1)))

    return rule


def turns_for_a_while(hand: Hand) -> Rule:
    draw, left, way = hand.draw, 0, 1
    pace, feels, spin = draw.uniform(0.4, 0.8), hand.sight(draw.uniform(0.8, 2)), draw.uniform(0.25, 0.45)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal left, way
        if left <= 0 and p[:6].max() > feels:
            left, way = int(draw.integers(5, 16)), -1 if p[:3].sum() > p[3:6].sum() else 1
        left -= 1
        return turn(0.1 * pace, way * spin) if left >= 0 else (pace, pace)

    return rule


def slows_and_turns(hand: Hand) -> Rule:
    pace, far, near = hand.draw.uniform(0.45, 0.8), hand.sight(2.5), hand.sight(0.6)
    side, spin = hand.side(), hand.draw.uniform(0.5, 0.9)

    def rule(p: np.ndarray) -> tuple[float, float]:
        close = float(np.clip(np.log(max(p[:6].max(), 1e-6) / far) / np.log(near / far), 0, 1))
        return turn(pace * (1 - close), side * spin * pace * min(1.0, 2 * close))

    return rule


def stops_then_turns(hand: Hand) -> Rule:
    draw, side, k = hand.draw, hand.side(), 0
    pace, feels, spin = draw.uniform(0.4, 0.8), hand.sight(draw.uniform(0.7, 1.8)), draw.uniform(0.25, 0.45)
    stands, least = int(draw.integers(2, 6)), int(draw.integers(4, 10))

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal k
        near = p[:6].max() > feels
        k = k + 1 if near or 0 < k < stands + least else 0
        return (pace, pace) if k == 0 else (0.0, 0.0) if k <= stands else turn(0, side * spin)

    return rule


def spiral(hand: Hand) -> Rule:
    pace, side, feels = hand.draw.uniform(0.4, 0.8), hand.side(), hand.sight(hand.draw.uniform(0.7, 1.6))
    tight, grows, k = hand.draw.uniform(0.5, 0.7), hand.draw.uniform(0.97, 0.99), 0

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal k
        k = 0 if p[:6].max() > feels else k + 1
        return turn(0.4 * pace, side * 0.4 * pace) if k == 0 else turn(pace, side * pace * tight * grows**k)

    return rule


def three_states(hand: Hand) -> Rule:
    draw, side, met = hand.draw, hand.side(), False
    pace, ahead = draw.uniform(0.35, 0.65), hand.sight(draw.uniform(1.2, 2.2))
    near, far = hand.sight(1.0, beside=True), hand.sight(draw.uniform(1.8, 2.6), beside=True)
    bend = draw.uniform(0.15, 0.3)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal met
        q = p[:6][::side]
        beside = float(q[:2].max())
        if q[2:4].max() > ahead:
            met = True
            return turn(0.0, -0.6 * side * pace)
        met = met or beside > far
        off = 0.0 if not met or far < beside < near else -1.0 if beside >= near else 1.0
        return turn(pace, side * off * bend * pace)

    return rule


def arcs(hand: Hand) -> Rule:
    draw, side, met, away = hand.draw, hand.side(), False, 0.0
    pace, feels = draw.uniform(0.4, 0.7), hand.sight(draw.uniform(0.8, 1.8))
    bend, keeps = draw.uniform(0.15, 0.3), draw.uniform(0.5, 0.8)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal met, away
        felt = min(float(p[:6][::side][:4].max()) / feels, 1.5)
        met = met or felt > 0.5
        away = max(felt, keeps * away)
        return turn(pace * max(0.1, 1 - 0.7 * away), -side * pace * (0.8 * away - bend * met))

    return rule


def dbus_example(hand: Hand) -> Rule:
    speed, gain = hand.draw.uniform(50, 200), hand.draw.uniform(1, 3)

    def rule(p: np.ndarray) -> tuple[float, float]:
        near = gain * five(p)
        left, right = (
            near @ [-0.01, -0.005, -0.0001, 0.006, 0.015],
            near @ [0.012, 0.007, -0.0002, -0.0055, -0.011],
        )
        return (speed + float(left)) / UNITS, (speed + float(right)) / UNITS

    return rule


def waits(hand: Hand) -> Rule:
    pace, feels = hand.draw.uniform(0.3, 0.8), hand.sight(hand.draw.uniform(0.6, 2))
    return lambda p: (0.0, 0.0) if p[:6].max() > feels else (pace, pace)


def strolls(hand: Hand) -> Rule:
    draw, left, what = hand.draw, 0, (0.0, 0.0)
    pace = draw.uniform(0.3, 0.7)

    def rule(_: np.ndarray) -> tuple[float, float]:
        nonlocal left, what
        if left <= 0:
            straight = draw.random() < 0.5
            left = int(draw.integers(5, 25 if straight else 12))
            what = (pace, pace) if straight else turn(0, float(draw.choice([-1, 1])) * draw.uniform(0.1, 0.3))
        left -= 1
        return what

    return rule


LATER: Vehicles = {
    "two way turner": {
        "Aseba's example": aseba_explorer, "repelled": repelled, "turns for a while": turns_for_a_while,
    },
    "one way turner": {"slows and turns": slows_and_turns, "stops, then turns": stops_then_turns},
    "one way looper": {"spiral": spiral},
    "wall follower": {"three states": three_states, "arcs": arcs},
    NONE: {"D-Bus example": dbus_example, "waits": waits, "strolls": strolls},
}  # fmt: skip
"""By what they are written to do."""
