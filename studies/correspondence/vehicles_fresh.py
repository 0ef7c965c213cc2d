"""A third set of controllers for Enki's robots, written and committed before any track of it was named.

Nothing is chosen by them: what names are learnt from was changed after a look at `vehicles.py` and
`vehicles_later.py` only. Each is called after the rule that it follows (`vehicles.py` says which).
Four are the vehicles of Braitenberg (Vehicles, 1984): 2a flees and hastens, 3b flees and slows, 2b runs at
what it feels, 3a rests before it.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from studies.correspondence.vehicles import TOP_CM_S, TRACK_CM, Hand, Rule, Vehicles, turn

from realitygap.correspondence.names import NONE

BEARINGS = np.radians([80, 45, 15, -15, -45, -80])
"""About where six sensors look, from the left to the right."""
CLEARANCES = np.array([0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0])


def gauge(hand: Hand) -> Callable[[np.ndarray], np.ndarray]:
    """From readings to clearances, cm of a small robot."""
    seen = -np.log(np.maximum([hand.sight(c) for c in CLEARANCES], 1e-6))
    return lambda p: np.interp(-np.log(np.maximum(p, 1e-6)), seen, CLEARANCES)


def steps_for(hand: Hand, angle: float, spin: float) -> int:
    """How many steps a turn on the spot by an angle (rad) takes, wheels at plus and minus `spin`."""
    model = hand.sight.model
    return max(1, round(angle * TRACK_CM[model] / (2 * spin * TOP_CM_S[model]) * 10))


def potential_field(hand: Hand) -> Rule:
    draw, clearance = hand.draw, gauge(hand)
    pace, reach, gain = draw.uniform(0.4, 0.8), draw.uniform(2.0, 3.5), draw.uniform(0.3, 0.8)

    def rule(p: np.ndarray) -> tuple[float, float]:
        force = np.maximum(0.0, 1 / clearance(p[:6]) - 1 / reach)
        ahead, aside = 1 - gain * float(force @ np.cos(BEARINGS)), -gain * float(force @ np.sin(BEARINGS))
        return turn(pace * float(np.clip(ahead, -0.2, 1)), pace * float(np.clip(aside, -0.8, 0.8)))

    return rule


def freest_way(hand: Hand) -> Rule:
    draw, heading = hand.draw, 0.0
    pace, near, spin = draw.uniform(0.4, 0.75), hand.sight(draw.uniform(1.0, 2.2)), draw.uniform(0.2, 0.4)
    ways = np.radians([0, 30, -30, 60, -60, 90, -90])

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal heading
        cost = [
            float(p[:6] @ np.maximum(0, np.cos(BEARINGS - way)) ** 4) / near + abs(way) / 2 for way in ways
        ]
        best = float(ways[int(np.argmin(cost))]) if p[:6].max() > near else 0.0
        heading = best if best * heading >= 0 else heading  # it does not swing from one side to the other
        return (
            (pace, pace)
            if heading == 0
            else turn(pace * max(0.0, math.cos(2 * heading)), spin * np.sign(heading))
        )

    return rule


def subsumption(hand: Hand) -> Rule:
    draw, left, way, wander = hand.draw, 0, 1, 0.0
    pace, feels, halts = draw.uniform(0.4, 0.8), hand.sight(draw.uniform(0.8, 2.0)), hand.sight(0.3)
    spin, often = draw.uniform(0.25, 0.45), draw.uniform(0.005, 0.02)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal left, way, wander
        if p[:6].max() > feels:  # the layer below: away
            if left <= 0:
                way = -1 if p[:3].max() > p[3:6].max() else 1
            left = 3
        left -= 1
        if left >= 0:
            return turn(-0.3 * pace if p[1:5].max() > halts else 0.0, way * spin)
        if draw.random() < often:  # the layer above: now and then a little aside
            wander = 5 * float(draw.choice([-1, 1]))
        wander -= np.sign(wander)
        return turn(pace, 0.15 * pace * float(np.sign(wander)))

    return rule


def fuzzy(hand: Hand) -> Rule:
    draw, clearance = hand.draw, gauge(hand)
    pace, far, near = draw.uniform(0.4, 0.75), draw.uniform(2.0, 3.0), draw.uniform(0.4, 0.9)

    def rule(p: np.ndarray) -> tuple[float, float]:
        close = np.clip((far - clearance(p[:6])) / (far - near), 0, 1)
        left, ahead, right = float(close[:2].max()), float(close[2:4].max()), float(close[4:].max())
        rules = [  # how far it holds, and what then: forward, turn to the left
            (1 - max(left, ahead, right), 1.0, 0.0), (left, 0.4, -0.6), (right, 0.4, 0.6),
            (ahead * (left > right), 0.0, -0.7), (ahead * (left <= right), 0.0, 0.7),
        ]  # fmt: skip
        weight = sum(held for held, *_ in rules) + 1e-9
        forward, away = (sum(one[0] * one[k] for one in rules) / weight for k in (1, 2))
        return turn(pace * forward, pace * away)

    return rule


def braitenberg(hand: Hand, *, crossed: bool, excites: bool) -> Rule:
    """Both wheels by a smooth step of what one side feels, the same side's or the other's."""
    draw = hand.draw
    middle, steep = math.log(hand.sight(draw.uniform(0.8, 2.0))), draw.uniform(1.5, 4.0)
    pace, most = (draw.uniform(0.2, 0.4), 0.5) if excites else (draw.uniform(0.4, 0.75), 0.0)
    odd = draw.uniform(0.97, 1.03, 2)

    def rule(p: np.ndarray) -> tuple[float, float]:
        halves = np.array([p[:3].mean(), p[3:6].mean()])
        felt = odd / (1 + np.exp(-steep * (np.log(np.maximum(halves, 1e-6)) - middle)))
        left, right = felt[::-1] if crossed else felt
        return tuple(pace + most * s if excites else pace * (1 - 1.1 * s) for s in (left, right))

    return rule


def backs_round(hand: Hand) -> Rule:
    draw, left, side = hand.draw, 0, hand.side()
    pace, feels = draw.uniform(0.4, 0.8), hand.sight(draw.uniform(0.6, 1.6))
    lasts, bend = int(draw.integers(8, 18)), draw.uniform(0.5, 0.9)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal left
        left = lasts if left <= 0 and p[1:5].max() > feels else left - 1
        return turn(-0.4 * pace, 0.4 * bend * side) if left > 0 else (pace, pace)

    return rule


def any_angle(hand: Hand) -> Rule:
    draw, left, side = hand.draw, 0, hand.side()
    pace, feels, spin = draw.uniform(0.4, 0.8), hand.sight(draw.uniform(0.6, 1.8)), draw.uniform(0.25, 0.5)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal left
        if left <= 0 and p[:6].max() > feels:
            left = steps_for(hand, draw.uniform(1.0, 3.0), spin)
        left -= 1
        return turn(0, side * spin) if left >= 0 else (pace, pace)

    return rule


def leaky(hand: Hand) -> Rule:
    draw, side, kept = hand.draw, hand.side(), 0.0
    pace, reference, keeps = (
        draw.uniform(0.4, 0.75),
        hand.sight(draw.uniform(1.0, 2.2)),
        draw.uniform(0.6, 0.85),
    )

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal kept
        kept = keeps * kept + (1 - keeps) * min(1.5, float(p[:6].max()) / reference)
        held = 0.0 if kept < 0.3 else kept
        return turn(pace * max(0.0, 1 - held), 0.7 * pace * side * held)

    return rule


def rosette(hand: Hand) -> Rule:
    draw, side, k = hand.draw, hand.side(), 0
    pace, feels, lasts = draw.uniform(0.4, 0.75), hand.sight(draw.uniform(0.7, 1.8)), draw.uniform(20, 60)
    bend, swing = draw.uniform(0.35, 0.5), draw.uniform(0.3, 0.6)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal k
        k += 1
        if p[:6].max() > feels:
            return turn(0.0, 0.6 * pace * side)
        return turn(pace, side * pace * bend * (1 + swing * math.sin(2 * math.pi * k / lasts)))

    return rule


def winds_in(hand: Hand) -> Rule:
    draw, side, k = hand.draw, hand.side(), 0
    pace, feels = draw.uniform(0.4, 0.75), hand.sight(draw.uniform(0.7, 1.8))
    wide, tight, lasts = draw.uniform(0.2, 0.3), draw.uniform(0.5, 0.8), int(draw.integers(40, 90))

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal k
        k = (k + 1) % lasts
        if p[1:5].max() > feels:
            k = 0
            return turn(0.1 * pace, 0.6 * pace * side)
        return turn(pace, side * pace * (wide + (tight - wide) * k / lasts))

    return rule


def bug_proportional(hand: Hand) -> Rule:
    draw, side, met, clearance = hand.draw, hand.side(), False, gauge(hand)
    pace, target, ahead = draw.uniform(0.35, 0.65), draw.uniform(0.8, 1.8), draw.uniform(1.0, 2.0)
    gain, most = draw.uniform(0.2, 0.5), draw.uniform(0.25, 0.4)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal met
        away = clearance(p[:6][::side])
        met = met or away.min() < ahead
        if not met:
            return pace, pace
        if away[2:4].min() < ahead:
            return turn(0.0, -0.5 * pace * side)
        return turn(pace, side * pace * float(np.clip(gain * (away[:2].min() - target), -most, most)))

    return rule


def bug_bang_bang(hand: Hand) -> Rule:
    draw, side, met, toward, clearance = hand.draw, hand.side(), False, False, gauge(hand)
    pace, ahead, bend = draw.uniform(0.35, 0.65), draw.uniform(0.8, 1.8), draw.uniform(0.2, 0.4)
    least, most = draw.uniform(0.6, 1.0), draw.uniform(1.3, 2.2)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal met, toward
        away = clearance(p[:6][::side])
        if away[2:4].min() < ahead:
            met, toward = True, False
            return turn(0.0, -0.5 * pace * side)
        beside = away[:2].min()
        met = met or beside < most
        toward = beside > most or (toward and beside > least)
        return turn(pace, (side * bend * pace if toward else -side * bend * pace) if met else 0.0)

    return rule


def by_diagonal(hand: Hand) -> Rule:
    draw, side, met, last = hand.draw, hand.side(), False, 0.0
    pace, target = draw.uniform(0.35, 0.65), hand.sight(draw.uniform(1.2, 2.2))
    gain, damps = draw.uniform(0.15, 0.35), draw.uniform(0.3, 1.0)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal met, last
        q = p[:6][::side]
        felt = float(max(q[1], q[2], 0.7 * q[3]))
        error = float(np.clip(math.log(max(felt, 1e-6) / target), -1.2, 1.5))
        met = met or error > -0.5
        off, last = gain * error + damps * (error - last), error
        return turn(
            pace * (1 - 0.6 * max(0.0, error) / 1.5), -side * pace * float(np.clip(off, -0.3, 0.7)) * met
        )

    return rule


def run_and_tumble(hand: Hand) -> Rule:
    draw, left, spin = hand.draw, 0, 0.0
    pace, mean = draw.uniform(0.3, 0.7), draw.uniform(8, 25)

    def rule(_: np.ndarray) -> tuple[float, float]:
        nonlocal left, spin
        if left <= 0:
            spin = 0.0 if spin else float(draw.choice([-1, 1])) * 0.35
            angle = draw.uniform(0.3, math.pi)
            left = steps_for(hand, angle, 0.35) if spin else 3 + int(mean * draw.pareto(1.8))
        left -= 1
        return turn(0, spin) if spin else (pace, pace)

    return rule


def stop_and_go(hand: Hand) -> Rule:
    draw, k = hand.draw, 0
    pace, bend = draw.uniform(0.3, 0.7), draw.uniform(-0.01, 0.01)
    goes, rests = int(draw.integers(8, 30)), int(draw.integers(4, 15))

    def rule(_: np.ndarray) -> tuple[float, float]:
        nonlocal k
        k += 1
        return turn(pace, bend) if k % (goes + rests) < goes else (0.0, 0.0)

    return rule


def weaves(hand: Hand) -> Rule:
    draw, k = hand.draw, 0
    pace, lasts, swing = draw.uniform(0.3, 0.7), draw.uniform(15, 60), draw.uniform(0.1, 0.35)

    def rule(_: np.ndarray) -> tuple[float, float]:
        nonlocal k
        k += 1
        return turn(pace, swing * math.cos(2 * math.pi * k / lasts))

    return rule


FRESH: Vehicles = {
    "two way turner": {
        "potential field": potential_field, "freest way": freest_way, "subsumption": subsumption,
        "fuzzy": fuzzy, "Braitenberg 2a": lambda hand: braitenberg(hand, crossed=False, excites=True),
        "Braitenberg 3b": lambda hand: braitenberg(hand, crossed=True, excites=False),
    },
    "one way turner": {"backs round": backs_round, "any angle": any_angle, "leaky": leaky},
    "one way looper": {"rosette": rosette, "winds in": winds_in},
    "wall follower": {
        "bug, proportional": bug_proportional, "bug, bang-bang": bug_bang_bang, "by the diagonal": by_diagonal
    },
    NONE: {
        "Braitenberg 2b": lambda hand: braitenberg(hand, crossed=True, excites=True),
        "Braitenberg 3a": lambda hand: braitenberg(hand, crossed=False, excites=False),
        "run and tumble": run_and_tumble, "stop and go": stop_and_go, "weaves": weaves,
    },
}  # fmt: skip
"""By what they are written to do."""
