"""More families of exemplars: each kind by other designs, with its numbers drawn from wide ranges.

A kind is what a controller does, not how: one person lets a robot turn all at once, another the more the
nearer a surface is. Whoever knows one design only takes a smooth avoider for a follower of walls.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from studies.correspondence.avoiders import AVOIDERS, Draw, Rule, turning
from studies.correspondence.seekers import DARK, GLARE, SEEKERS

from realitygap.correspondence.names import LARGE
from realitygap.values import Command

Maker = Callable[[Draw], Rule]
Readings = NDArray[np.float64]


def avoider(draw: Draw, *, sided: bool, bent: bool, smooth: bool) -> Rule:
    """Turns from what it feels, all at once or (`smooth`) the more the nearer.

    Args:
        draw: for its numbers.
        sided: always to its one side, else away from where it feels more.
        bent: where it feels nothing it goes in a curve to that side, else straight.
        smooth: proportional to some power of the readings.
    """
    cruise, side, hard = draw.uniform(4, 10), int(draw.choice([-1, 1])), draw.uniform(1.0, 2.5)
    bend = cruise * draw.uniform(0.2, 0.55) if bent else 0.0
    spin, pace = cruise * draw.uniform(0.3, 1.0), cruise * draw.uniform(-0.4, 0.8)
    feels, power = np.exp(draw.uniform(*np.log([60, 600]))), draw.uniform(0.3, 1.2) if smooth else 1.0
    weights = np.array([draw.uniform(0.1, 0.9), 1.0, draw.uniform(0.5, 1.2)])
    weights *= 1.5 / weights.sum()
    holds, left, way = int(draw.integers(1, 8)), 0, side

    def rule(p: Readings) -> Command:
        nonlocal left, way
        felt = (p[:6] / feels) ** power
        ahead, away = float(felt[1:5].max()), float(weights @ felt[:2:-1] - weights @ felt[:3])
        if smooth:
            amount = min(max(ahead - 0.1, 0.0), hard)
            push = side * amount if sided else float(np.clip(away, -hard, hard))
            if not sided and abs(push) > 0.3:
                way = int(np.sign(push))
            elif not sided and ahead > 1:  # right before a wall: it goes on as it began
                push = way * ahead
        else:
            if ahead > 1 and left <= 0 and not sided:
                way = int(np.sign(away)) or side
            left = holds if ahead > 1 else left - 1
            amount = float(left > 0)
            push = way * amount
        forward = cruise + (pace - cruise) * min(amount, 1.2)
        return turning(forward, push * spin + side * bend * (1 - min(amount, 1)))

    return rule


def vehicle(draw: Draw) -> Rule:
    """Braitenberg's that flees: what a side feels slows the other side's wheel, and speeds its own."""
    cruise, feels = draw.uniform(3, 9), np.exp(draw.uniform(*np.log([60, 600])))
    power = draw.uniform(0.4, 1.2)
    slows, speeds = cruise * draw.uniform(0.4, 2.0, 2) * (1, draw.uniform(0, 0.5))
    weights = np.array([draw.uniform(0.1, 0.9), 1.0, draw.uniform(0.5, 1.2)])
    weights *= draw.uniform(0.97, 1.03) / weights.sum()
    odd = draw.uniform(0.95, 1.05)

    def rule(p: Readings) -> Command:
        felt = (p[:6] / feels) ** power
        left, right = float(weights @ felt[:3]), odd * float(weights @ felt[:2:-1])
        one, other = cruise + speeds * left - slows * right, cruise + speeds * right - slows * left
        return turning((one + other) / 2, (other - one) / 2)

    return rule


def follower(draw: Draw, manner: str) -> Rule:
    """Keeps a surface at its one side: "bang" to and fro, "log" by how far, "bounce" off it and back."""
    cruise, side = draw.uniform(4, 9), int(draw.choice([-1, 1]))
    target, feels = np.exp(draw.uniform(*np.log([120, 700]))), np.exp(draw.uniform(*np.log([80, 500])))
    spin, bend = draw.uniform(2.5, 7), cruise * draw.uniform(0.15, 0.5)
    gain, holds = draw.uniform(0.4, 1.6) * bend, int(draw.integers(1, 4))
    pace, met, left = cruise * draw.uniform(-0.1, 0.4), False, 0

    def rule(p: Readings) -> Command:
        nonlocal met, left
        near = p[:6] if side > 0 else p[5::-1]
        met = met or near[:4].max() > 25
        beside = float(near[:2].max())
        if not met:
            return turning(cruise, 0)
        left = holds if near[:4].max() > target else left - 1
        if left > 0 if manner == "bounce" else near[2:4].max() > feels:
            return turning(pace, -side * spin)
        if manner == "log":
            off = gain * np.log(target / max(beside, 1.0))
            return turning(cruise, side * float(np.clip(off, -1.5 * bend, bend)))
        return turning(cruise, side * bend if manner == "bounce" or beside < target else -side * bend)

    return rule


def seeker(draw: Draw, kind: str) -> Rule:
    """One of table 2's kinds, by how much more light there is at one side and ahead than behind."""
    cruise, side, most = draw.uniform(4, 10), int(draw.choice([-1, 1])), draw.uniform(1.0, 3.0)
    cone, gain = draw.uniform(0.08, 0.2), draw.uniform(4, 20)
    on, back = int(draw.integers(5, 14)), int(draw.integers(4, 12))
    back = back if kind == "three point turner" else max(2, round(on * draw.uniform(0.3, 0.7)))
    bend, k = cruise * draw.uniform(0.25, 0.6), 0

    def rule(a: Readings) -> Command:
        nonlocal k
        lit = np.maximum(DARK - a, 1.0)
        aside = float(lit[:3].sum() - lit[3:6].sum()) / float(lit[:6].sum())
        ahead = lit[2:4].sum() > 1.3 * lit[6:8].sum()
        toward = float(np.clip(gain * aside, -most, most)) if ahead else most * (np.sign(aside) or side)
        seen = ahead and abs(aside) < cone and lit.max() < GLARE
        forward = k % (on + back) < on
        if kind == "two way turner":
            return turning(cruise if ahead else 1, toward)
        if kind == "bobber":
            k += 1
            return turning(cruise if forward else -cruise, toward)
        if seen and (kind == "straight looper" or k % (on + back) == 0):
            return turning(cruise, 0)
        k += 1
        return turning(cruise if forward or kind == "straight looper" else -cruise, side * bend)

    return rule


def standing(draw: Draw) -> Rule:
    """Stands."""
    return lambda _: Command(left=0, right=0)


def spinning(draw: Draw) -> Rule:
    """Turns on the spot, or nearly."""
    spin, on = draw.choice([-1, 1]) * draw.uniform(0.6, 10), int(draw.choice([-1, 0, 0, 1]))
    return lambda _: turning(on, spin)


def random_walker(draw: Draw) -> Rule:
    """Wheels that change by chance, every step or every second or so."""
    lasts, pace = draw.uniform(1, 15), draw.uniform(0, 5)
    bias = draw.uniform(0, 4)
    now = Command(left=0, right=0)

    def rule(_: Readings) -> Command:
        nonlocal now
        if draw.random() < 1 / lasts:
            turn = draw.uniform(-1, 1) * (3 + pace)
            now = turning(draw.uniform(-pace, pace) + bias, turn)
        return now

    return rule


def wanderer(draw: Draw) -> Rule:
    """Goes on at one pace; its turning drifts."""
    pace, keeps, wild, turn = draw.uniform(1.5, 8), draw.uniform(0.8, 0.98), draw.uniform(0.3, 1.5), 0.0

    def rule(_: Readings) -> Command:
        nonlocal turn
        turn = keeps * turn + wild * draw.standard_normal()
        return turning(pace, turn)

    return rule


def blind(draw: Draw) -> Rule:
    """Drives on until it meets a wall, and goes on pushing."""
    pace, bend = int(draw.integers(2, 11)) * int(draw.choice([-1, 1])), int(draw.integers(-1, 2))
    return lambda _: turning(pace, bend if abs(pace) > 5 else 0)


def rocker(draw: Draw) -> Rule:
    """Forward and back, and heeds nothing."""
    pace, lasts, bend, k = draw.uniform(2, 9), int(draw.integers(4, 25)), draw.uniform(-1, 1), 0

    def rule(_: Readings) -> Command:
        nonlocal k
        k += 1
        return turning(pace if k // lasts % 2 else -pace, bend)

    return rule


def drawn(draw: Draw) -> Rule:
    """Braitenberg's vehicles that what they feel attracts: one stops before it, one runs at it."""
    pace, feels, fond = draw.uniform(1, 6), draw.uniform(100, 900), draw.random() < 0.5
    gain = draw.uniform(1, 6)

    def rule(p: Readings) -> Command:
        left, right = p[:3].max() / feels, p[3:6].max() / feels
        most, toward = max(left, right), float(np.clip(left - right, -1, 1))
        if fond:
            return turning(max(0.0, pace * (1 - most)), toward)
        return turning(pace + min(gain * most, 3), gain * toward)

    return rule


def lover(draw: Draw) -> Rule:
    """Braitenberg's that what it feels attracts: each wheel is slowed by what its own side feels."""
    pace, feels, power = draw.uniform(2, 9), np.exp(draw.uniform(*np.log([60, 600]))), draw.uniform(0.4, 1.2)

    def rule(p: Readings) -> Command:
        left, right = pace * np.maximum(0.0, 1 - (np.array([p[:3].max(), p[3:6].max()]) / feels) ** power)
        return turning((left + right) / 2, (right - left) / 2)

    return rule


def stroller(draw: Draw) -> Rule:
    """Straight on, then a turn on the spot, and on again: how long, and which way, by chance."""
    pace, spin, left, turns = draw.uniform(2, 9), draw.uniform(1.5, 7), 0.0, True
    runs, lasts, leftward = draw.uniform(5, 40), draw.uniform(2, 14), draw.uniform(0.2, 0.8)
    way = 1

    def rule(_: Readings) -> Command:
        nonlocal left, turns, way
        if left <= 0:
            turns, way = not turns, 1 if draw.random() < leftward else -1
            left = draw.exponential(lasts if turns else runs)
        left -= 1
        return turning(0, way * spin) if turns else turning(pace, 0)

    return rule


NOBODIES: dict[str, Maker] = {
    "standing": standing,
    "spinning": spinning,
    "random walker": random_walker,
    "wanderer": wanderer,
    "blind": blind,
    "rocker": rocker,
    "drawn": drawn,
}
"""Exemplars of "none of these": robots that heed nothing, do not move, or seek what they should avoid."""
_WAYS = {"one way turner": (True, False), "one way looper": (True, True)}
FAMILIES: dict[str, dict[str, tuple[Maker, ...]]] = {
    "obstacle-avoidance": {
        **{
            kind: (AVOIDERS[kind], *(partial(avoider, sided=s, bent=b, smooth=how) for how in (False, True)))
            for kind, (s, b) in _WAYS.items()
        },
        "two way turner": (
            AVOIDERS["two way turner"], vehicle,
            *(partial(avoider, sided=False, bent=False, smooth=how) for how in (False, True)),
        ),
        "wall follower": (
            AVOIDERS["wall follower"], *(partial(follower, manner=m) for m in ("bang", "log", "bounce"))
        ),
        **{kind: (make,) for kind, make in NOBODIES.items()},
    },
    "light-seeking": {
        **{kind: (make, partial(seeker, kind=kind)) for kind, make in SEEKERS.items()},
        **{kind: (make,) for kind, make in NOBODIES.items() if kind != "drawn"},
    },
}  # fmt: skip
FAMILIES[f"obstacle-avoidance{LARGE}"] = {
    **FAMILIES["obstacle-avoidance"], "lover": (lover,), "stroller": (stroller,)
}  # fmt: skip
"""By task and kind, the designs that exemplars are drawn from; large robots have two more."""
