"""Hand-written controllers for Enki's robots, none of which any exemplar was made with; each by its rule.

What a controller is called was settled by what it is written to do, before any of its tracks was named:

- two way turner: straight on; away from the side on which it feels more;
- one way turner: straight on; always round to the one side;
- one way looper: in a curve to one side, which it only tightens;
- wall follower: keeps a surface at one side, and bends back to it;
- none of these: heeds nothing, or seeks what it feels.

Three are others' (their published weights): the e-puck library's avoider (Bonani and Besuchet, EPFL 2007),
the e-puck example of Webots (Cyberbotics) and pyePuck's `braitenberg.py` (M. Martín-Ortiz), run on either
robot with readings brought to the robot's own; so is the pattern of the library's follower of walls.

A rule takes readings, a share of full scale each, from the left by the front to the right, then behind, and
gives both wheels' speeds as shares of the top speed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from realitygap.correspondence.names import NONE, Name, namer, tells
from realitygap.correspondence.setting import setting_of
from realitygap.correspondence.trials import Trial, resampled
from realitygap.robots.enki import EnkiBody
from realitygap.tasks.load import load_task
from realitygap.tasks.task import Task
from realitygap.track import Track
from realitygap.values import Command, Pose
from realitygap.world.arena import Arena, load_arena

Rule = Callable[[np.ndarray], tuple[float, float]]
ORDER = {
    "khepera": [0, 1, 2, 3, 4, 5, 6, 7],
    "epuck": [5, 6, 7, 0, 1, 2, 3, 4],
    "thymio2": [0, 1, 2, 2, 3, 4, 6, 5],
}
"""A Thymio has five sensors ahead, the middle one between left and right, and two behind."""
TOP_CM_S = {"khepera": 9.0, "epuck": 12.0, "thymio2": 14.0}
RADIUS_CM = {"khepera": 2.6, "epuck": 3.7, "thymio2": 8.0}
FULL = {"khepera": 1023.0, "epuck": 4095.0, "thymio2": 4505.0}
"""Enki's own; its top commands are never reached."""
TRACK_CM = {"khepera": 5.3, "epuck": 5.3, "thymio2": 9.4}
FARTHER = {"khepera": 1.0, "epuck": 1.0, "thymio2": 2.0}
"""How many times the clearances of a small robot, which sees 5 cm, a rule is tuned to."""
SMALL = ("khepera", "epuck")
ROOMS = {"thymio2": "obstacle-avoidance-large"}
"""Where a robot drives that is too large for the paper's arena."""


class Sight:
    """What a model of robot reads before a plain wall: what a person who tunes a threshold looks at."""

    def __init__(self, model: str) -> None:
        self.model = model

    def __call__(self, clearance: float, *, beside: bool = False) -> float:
        """The reading, a share of full scale, of what looks at a wall so far (cm) from the body's edge."""
        with closing(EnkiBody(self.model, 0, noise=0.0)) as body:
            away = RADIUS_CM[self.model] + FARTHER[self.model] * clearance
            heading = math.pi / 2 if beside else math.pi
            body.enter({"size_cm": [200.0, 200.0]}, 1, Pose(x=away, y=100.0, heading=heading))
            near = body.sense().proximity[ORDER[self.model]] / FULL[self.model]
        return float(max(near[:2].max(), near[4:6].max()) if beside else near[2])


class Hand(NamedTuple):
    """What a rule is made of: chances, and the robot's readings at a clearance."""

    draw: np.random.Generator
    sight: Sight

    def side(self) -> int:
        """Left is 1."""
        return int(self.draw.choice([-1, 1]))


def turn(speed: float, left: float) -> tuple[float, float]:
    """Both wheels."""
    return speed - left, speed + left


def weighed(weights: np.ndarray, hand: Hand, clearance: float) -> Rule:
    """Speeds that fall by weights [8, 2] of what is felt, the e-puck's order and wheels (left, right)."""
    reference, pace = hand.sight(clearance), hand.draw.uniform(0.6, 0.95)
    order = ORDER["epuck"]

    def rule(p: np.ndarray) -> tuple[float, float]:
        felt = np.zeros(8)
        felt[order] = np.minimum(p / reference, 2.0)
        left, right = pace * (1 - felt) @ weights / weights.sum(axis=0)
        return float(left), float(right)

    return rule


def webots(hand: Hand) -> Rule:
    table = [[0.942, -0.22], [0.63, -0.1], [0.5, -0.06], [-0.06, -0.06],
             [-0.06, -0.06], [-0.06, 0.5], [-0.19, 0.63], [-0.13, 0.942]]  # fmt: skip
    return weighed(np.array(table), hand, 1.5)


def pyepuck(hand: Hand) -> Rule:
    table = [[150, -35], [100, -15], [80, -10], [-10, -10], [-10, -10], [-10, 80], [-30, 100], [-20, 150]]
    return weighed(np.array(table), hand, 1.0)


def library_avoider(hand: Hand) -> Rule:
    base, gain = 0.55 * hand.draw.uniform(0.7, 1.2), hand.draw.uniform(0.7, 1.4)
    near, far = np.array([2.0, 4, 8]), np.array([4.0, 8, 16])

    def rule(p: np.ndarray) -> tuple[float, float]:
        left = base + gain * float(near @ p[:3] - far @ p[5:2:-1])
        right = base + gain * float(near @ p[5:2:-1] - far @ p[:3])
        jammed = max(abs(left), abs(right)) < 0.05
        return (20 * left, 20 * right) if jammed else (left, right)

    return rule


def explorer(hand: Hand) -> Rule:
    draw, way = hand.draw, 1
    far, near = hand.sight(draw.uniform(2, 3)), hand.sight(draw.uniform(0.6, 1.2))
    spin = draw.uniform(0.3, 0.5)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal way
        left, right = p[:3].max(), p[3:6].max()
        if max(left, right) > near:
            if abs(left - right) > 0.05 * near:
                way = -1 if left > right else 1
            return turn(0, way * spin)
        if max(left, right) > far:
            return (0.6, 0.2) if left > right else (0.2, 0.6)
        return 0.5, 0.5

    return rule


def backs_off(hand: Hand, *, one_way: bool) -> Rule:
    draw = hand.draw
    pace, feels, spin = draw.uniform(0.4, 0.8), hand.sight(draw.uniform(0.6, 1.5)), draw.uniform(0.25, 0.5)
    back, round_, left, way = int(draw.integers(3, 7)), int(draw.integers(4, 12)), 0, hand.side()

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal left, way
        if left == 0 and p[1:5].max() > feels:
            left = back + round_
            way = way if one_way else -1 if p[:3].sum() > p[3:6].sum() else 1
        if left > 0:
            left -= 1
            return turn(-0.4 * pace, 0) if left >= round_ else turn(0, way * spin)
        return pace, pace

    return rule


def by_distance(hand: Hand) -> Rule:
    draw, far, near = hand.draw, hand.sight(3.0), hand.sight(0.5)
    pace, gain = draw.uniform(0.5, 0.8), draw.uniform(1.0, 1.8)

    def rule(p: np.ndarray) -> tuple[float, float]:
        close = np.clip(np.log(np.maximum(p, 1e-6) / far) / np.log(near / far), 0, 1)
        left, right = float(close[:3].max()), float(close[3:6].max())
        undecided = abs(left - right) <= 0.05 and max(left, right) >= 0.6
        away = 0.7 if undecided else right - left
        return turn(pace * (1 - 0.8 * max(left, right)), gain * pace * away)

    return rule


def pivots(hand: Hand) -> Rule:
    pace, feels, side = hand.draw.uniform(0.4, 0.8), hand.sight(hand.draw.uniform(0.8, 2.2)), hand.side()
    return lambda p: turn(0.35 * pace, 0.35 * pace * side) if p[1:5].max() > feels else (pace, pace)


def fixed_turns(hand: Hand) -> Rule:
    draw, left, side = hand.draw, 0, hand.side()
    pace, feels, spin = draw.uniform(0.4, 0.8), hand.sight(draw.uniform(0.8, 2)), draw.uniform(0.3, 0.5)
    model = hand.sight.model
    lasts = round(draw.uniform(1.2, 2.4) * TRACK_CM[model] / (2 * spin * TOP_CM_S[model]) * 10)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal left
        left = lasts if left <= 0 and p[1:5].max() > feels else left - 1
        return turn(0, spin * side) if left > 0 else (pace, pace)

    return rule


def circles(hand: Hand) -> Rule:
    draw, side = hand.draw, hand.side()
    pace, less, feels = draw.uniform(0.4, 0.8), draw.uniform(0.35, 0.65), hand.sight(draw.uniform(0.8, 2))

    def rule(p: np.ndarray) -> tuple[float, float]:
        inner, outer = (-0.2, 0.8) if p[1:5].max() > feels else (less, 1.0)
        return (inner * pace, outer * pace) if side > 0 else (outer * pace, inner * pace)

    return rule


def unequal(hand: Hand) -> Rule:
    draw, side = hand.draw, hand.side()
    pace, less = draw.uniform(0.5, 0.8), draw.uniform(0.4, 0.65)
    gain = draw.uniform(1, 2) * pace / hand.sight(draw.uniform(1, 2))

    def rule(p: np.ndarray) -> tuple[float, float]:
        inner = less * pace - gain * float(p[1:5].mean())
        return (inner, pace) if side > 0 else (pace, inner)

    return rule


def library_follower(hand: Hand) -> Rule:
    draw, side, met = hand.draw, hand.side(), False
    pace, reference = draw.uniform(0.35, 0.6), hand.sight(draw.uniform(0.8, 1.6), beside=True)
    gain = draw.uniform(0.5, 1.0) * pace

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal met
        q = np.minimum(p[:6] / reference, 2.5)[::side]
        met = met or q.max() > 0.15
        if not met:
            return pace, pace
        away = gain * float(0.8 * (q[2] + q[3]) + 0.4 * q[4])
        off = float(np.clip(away + 0.6 * gain * (0.6 * (q[0] + q[1]) - 0.9), -0.45 * pace, 1.2 * pace))
        return turn(pace - 0.3 * away, -side * off)

    return rule


def by_slope(hand: Hand) -> Rule:
    draw, side, met, last = hand.draw, hand.side(), False, 0.0
    pace, target = draw.uniform(0.35, 0.7), hand.sight(draw.uniform(0.8, 1.8), beside=True)
    ahead, gain, slope = hand.sight(draw.uniform(1.2, 2.4)), draw.uniform(0.15, 0.4), draw.uniform(0.2, 1.0)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal met, last
        q = p[:6][::side]
        beside = float(q[:2].max())
        if q[2:4].max() > ahead:
            met, last = True, 0.0
            return turn(0, -0.6 * pace * side)
        met = met or beside >= 0.1 * target
        if not met:
            return pace, pace
        error = float(np.clip(np.log(max(beside, 1e-6) / target), -1.2, 1.2))
        off, last = float(np.clip(gain * error + slope * (error - last), -0.4, 0.5)), error
        return turn(pace, -side * off * pace)

    return rule


def zigzags(hand: Hand) -> Rule:
    draw, side, met, left = hand.draw, hand.side(), False, 0
    pace, feels, lasts = draw.uniform(0.4, 0.7), hand.sight(draw.uniform(0.7, 1.4)), int(draw.integers(2, 5))
    bend = draw.uniform(0.2, 0.35)

    def rule(p: np.ndarray) -> tuple[float, float]:
        nonlocal met, left
        near = p[:6][::side][:4].max() > feels
        met, left = met or near, lasts if near else left - 1
        if left > 0:
            return turn(0.1 * pace, -0.48 * pace * side)
        return turn(pace, side * bend * pace if met else 0)

    return rule


def lover(hand: Hand) -> Rule:
    pace, reference = hand.draw.uniform(0.4, 0.8), hand.sight(hand.draw.uniform(0.5, 2))
    return lambda p: tuple(pace * max(0.0, 1 - half.max() / reference) for half in (p[:3], p[3:6]))


def aggressor(hand: Hand) -> Rule:
    pace, reference = hand.draw.uniform(0.2, 0.5), hand.sight(1.5)
    return lambda p: tuple(pace + 0.5 * min(1.0, half.max() / reference) for half in (p[3:6], p[:3]))


def drifter(hand: Hand) -> Rule:
    pace, drift = hand.draw.uniform(0.2, 0.7), 0.0

    def rule(_: np.ndarray) -> tuple[float, float]:
        nonlocal drift
        drift = 0.9 * drift + 0.12 * hand.draw.standard_normal()
        return turn(pace, drift)

    return rule


def back_and_forth(hand: Hand) -> Rule:
    pace, lasts, k = hand.draw.uniform(0.2, 0.6), int(hand.draw.integers(5, 20)), 0

    def rule(_: np.ndarray) -> tuple[float, float]:
        nonlocal k
        k += 1
        return turn(pace if k // lasts % 2 == 0 else -pace, 0)

    return rule


VEHICLES: dict[str, dict[str, Callable[[Hand], Rule]]] = {
    "two way turner": {
        "e-puck library": library_avoider, "Webots": webots, "pyePuck": pyepuck, "explorer": explorer,
        "backs off": lambda hand: backs_off(hand, one_way=False), "by distance": by_distance,
    },
    "one way turner": {
        "pivots": pivots, "fixed turns": fixed_turns, "backs off": lambda hand: backs_off(hand, one_way=True),
    },
    "one way looper": {"circles": circles, "unequal wheels": unequal},
    "wall follower": {"e-puck library": library_follower, "by slope": by_slope, "zigzags": zigzags},
    NONE: {"lover": lover, "aggressor": aggressor, "drifter": drifter, "back and forth": back_and_forth},
}  # fmt: skip
"""By what they are written to do."""
NEEDS = {
    "one way turner": ("straight", "turn"), "two way turner": ("straight", "left", "right"),
    "wall follower": ("forward", "turn"), "one way looper": ("turn",),
}  # fmt: skip


class Driven(NamedTuple):
    """A trial and by whom.

    Attributes:
        ordered: its commands hold, for half a second, all that its name says.
        shown: so does its track (`tells`).
    """

    kind: str
    family: str
    model: str
    trial: Trial
    ordered: bool
    shown: bool


Vehicles = dict[str, dict[str, Callable[[Hand], Rule]]]


def driven(
    kind: str, family: str, model: str, seed: int, *, seconds: float = 20.0, of: Vehicles = VEHICLES
) -> Driven:
    """One trial in the robot's arena, from anywhere, of a robot of its own."""
    draw = np.random.default_rng([seed, *f"{kind} {family} {model}".encode()])
    arena = task_of(model).arena
    room = {
        "size_cm": list(arena.size_cm), "cylinders": [[c.x_cm, c.y_cm, c.radius_cm] for c in arena.cylinders]
    }  # fmt: skip
    rule = of[kind][family](Hand(draw, Sight(model)))
    with closing(EnkiBody(model, 1 + seed % 50)) as body:
        body.enter(room, int(draw.integers(2**31)), _somewhere(arena, RADIUS_CM[model], draw))
        poses, said = [body.pose], []
        for _ in range(round(seconds / body.period_s)):
            near = body.sense().proximity[ORDER[model]] / FULL[model]
            said.append(np.clip(rule(near), -1, 1) * TOP_CM_S[model])
            left, right = (round(v / body._is.unit_cm_s) for v in said[-1])
            body.act(Command(left=left, right=right))
            body.clock.sleep_until(body.clock.now() + body.period_s)
            poses.append(body.pose)
    track = Track(
        t=np.arange(len(poses)) * 0.1, x=np.array([p.x for p in poses]), y=np.array([p.y for p in poses]),
        heading=np.array([p.heading for p in poses]), seen_by="truth",
    )  # fmt: skip
    trial = resampled(track, start=str(seed), radius_cm=RADIUS_CM[model])
    ordered = _ordered(kind, *np.array(said).T)
    return Driven(kind, family, model, trial, ordered, ordered and tells(trial, arena).get(kind, True))


def task_of(model: str) -> Task:
    """Obstacle avoidance, in the arena that a robot fits."""
    task = load_task("obstacle-avoidance")
    return replace(task, arena=load_arena(ROOMS[model])) if model in ROOMS else task


def called_by_name(drives: Sequence[Driven]) -> list[Name]:
    """What the trials are called, each in its robot's arena."""
    found: dict[int, Name] = {}
    for room in {one.model in ROOMS for one in drives}:
        here = [k for k, one in enumerate(drives) if (one.model in ROOMS) == room]
        model = drives[here[0]].model
        setting = setting_of([], task_of(model))
        names = namer(setting, RADIUS_CM[model])
        found |= dict(zip(here, names.name([drives[k].trial for k in here], setting), strict=True))
    return [found[k] for k in range(len(drives))]


def everybody(
    seeds: range, models: Sequence[str] = SMALL, *, seconds: float = 20.0, of: Vehicles = VEHICLES
) -> Iterator[Driven]:
    """Each vehicle on each robot, a trial a seed."""
    for kind, families in of.items():
        for family, model in itertools.product(families, models):
            yield from (driven(kind, family, model, seed, seconds=seconds, of=of) for seed in seeds)


def _somewhere(arena: Arena, radius_cm: float, draw: np.random.Generator) -> Pose:
    """A place where it touches nothing, whichever way it looks."""
    room, (width, depth) = radius_cm + 0.7, arena.size_cm
    while True:
        x, y = draw.uniform(room, width - room), draw.uniform(room, depth - room)
        if all(math.hypot(x - c.x_cm, y - c.y_cm) > c.radius_cm + room for c in arena.cylinders):
            return Pose(x=float(x), y=float(y), heading=float(draw.uniform(-math.pi, math.pi)))


def _ordered(kind: str, left: np.ndarray, right: np.ndarray) -> bool:
    turns = np.abs(left - right) > 0.1 * np.maximum(np.abs(left), np.abs(right)) + 1e-9
    done = {
        "forward": left + right > 0, "straight": ~turns & (left + right > 0), "turn": turns,
        "left": turns & (right > left), "right": turns & (left > right),
    }  # fmt: skip
    return all(done[thing].sum() >= 5 for thing in NEEDS.get(kind, ()))
