"""The wheels' plan: speed steps of many sizes, standing starts, straight lines and turns."""

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from realitygap.values import Pose
from realitygap.world.robot import Wheels

__all__ = ["ROOM", "Trial", "camera_places", "wheel_plan"]

FLOOR_CM = 60.0
ROOM: dict[str, Any] = {"size_cm": [FLOOR_CM, FLOOR_CM]}
"""An empty floor under a camera."""

TOP = 10
LEVELS = (1, 2, 3, 5, 7, 10)
STEPS_S = 1.0
START_LEVELS = (1, 2, 3)
RANDOM_TRIALS, RANDOM_PIECES, PIECE_S = 4, 10, 0.5
HASTY_TRIALS, HASTY_STEPS, HASTIEST = 4, 60, (1, 1, 2, 3)
"""Trials, steps and numbers of steps a command lasts, for commands that change as fast as a controller's."""
STRAIGHT = (4, 6, 8, 10)
STRAIGHT_RUNS = 6
"""With a ground that makes a run's length uncertain by 1 %, 24 runs leave 0.2 %."""
WATCHED = {4: 2, 8: 4, 10: 6}
"""Number of runs at a speed that are seen at every step: slip is the deviation of the way of one step. Mostly
fast ones, where it exceeds the camera's error; some slow ones, which measure that error."""
WAY_CM, LONGEST_S = 28.0, 4.0
SPINS = (2, 3, 4, 6, 8, 10)
ARCS = ((10, 6), (6, 10), (8, 3), (3, 8), (10, 2), (2, 10))
TURN_S = 3.0
STAND_S = 0.5
"""Time at rest at each trial's end, s, where a camera looks."""

UNIT_CM_S = 0.8
"""Approximate speed of a command unit, to keep clear of the walls."""
STEPS_A_SECOND = 10
SEEN_EVERY = 10
"""A camera looks at every tenth step (1 s) or at each, and at the first and the last."""

Command = tuple[int, int]


@dataclass(frozen=True)
class Trial:
    """One trial: commands for steps, from standing to standing.

    Attributes:
        kind: "step", "start", "straight" or "turn".
        commands: left and right of each step.
        pose: where a twin starts; a person only needs the space that `says` asks for.
        says: what a person prepares.
        filmed: whether a camera, if there is one, sees it.
        watched: whether it sees every step of it.
        number: from 0.
    """

    kind: str
    commands: Sequence[Command]
    pose: Pose
    says: str
    filmed: bool = False
    watched: bool = False
    number: int = 0

    def seen(self) -> tuple[int, ...]:
        """The steps at which a camera looks."""
        if not self.filmed:
            return ()
        last = len(self.commands) - 1
        return (*range(0, last, 1 if self.watched else SEEN_EVERY), last)


def wheel_plan(
    repeats: int, seed: int, wheels: Wheels | None = None, *, period_s: float = 0.1, followed: bool = False
) -> tuple[Trial, ...]:
    """All trials of the plan.

    Args:
        repeats: standing starts of each size.
        seed: of the random commands and the places.
        wheels: the profile's, for top command and speed; None: 10 units of about 8 mm/s.
        period_s: of a step of the robot.
        followed: whether a camera sees every step, for wheels without counters.
    """
    draw = random.Random(f"wheels/{seed}")
    scale = 1.0 if wheels is None else wheels.top_command / TOP
    unit_cm_s = UNIT_CM_S if wheels is None else scale * math.fsum(wheels.speed_per_unit_cm_s) / 2
    trials = []
    for number, sketch in enumerate([*_without_camera(draw, repeats), *_filmed(draw, unit_cm_s)]):
        scaled = [(round(scale * left), round(scale * right)) for left, right in sketch.commands]
        tenths = (*scaled, *[(0, 0)] * _steps(STAND_S))
        steps = round(len(tenths) / STEPS_A_SECOND / period_s)
        whole = tuple(tenths[int(k * period_s * STEPS_A_SECOND + 1e-6)] for k in range(steps))
        filmed, watched = sketch.filmed or followed, sketch.watched or followed
        trials.append(replace(sketch, number=number, commands=whole, filmed=filmed, watched=watched))
    return tuple(trials)


def _without_camera(draw: random.Random, repeats: int) -> Iterator[Trial]:
    """Steps and standing starts with commands of TOP, in tenths of a second."""
    for level in LEVELS:
        yield Trial("step", _steps_of(level), _anywhere(draw), "15 cm free all round")
    yield Trial("step", _between(), _anywhere(draw), "15 cm free all round")
    for _ in range(RANDOM_TRIALS):
        yield Trial("step", _random(draw), _anywhere(draw), "25 cm free all round")
    for _ in range(HASTY_TRIALS):
        yield Trial("step", _hasty(draw), _anywhere(draw), "25 cm free all round")
    for level in START_LEVELS:
        yield Trial("start", _starts(level, repeats), _anywhere(draw), "10 cm free ahead and behind")


def _filmed(draw: random.Random, unit_cm_s: float) -> Iterator[Trial]:
    """Straight lines and turns in view of the camera."""
    for level in STRAIGHT:
        for run in range(STRAIGHT_RUNS):
            seconds = min(LONGEST_S, WAY_CM / (level * unit_cm_s))
            sign = 1 - 2 * (run % 2)
            pose = _run_through(draw, sign * level * unit_cm_s * seconds)
            ahead = "ahead" if sign > 0 else "behind"
            line = [(sign * level, sign * level)] * _steps(seconds)
            watched = run < WATCHED.get(level, 0)
            yield Trial("straight", line, pose, f"35 cm free {ahead}", filmed=True, watched=watched)
    for level in SPINS:
        for sign in (1, -1):
            spin = [(-sign * level, sign * level)] * _steps(TURN_S)
            yield Trial("turn", spin, _anywhere(draw), "10 cm free all round", filmed=True)
    for arc in ARCS:
        yield Trial("turn", [arc] * _steps(TURN_S), _anywhere(draw), "25 cm free all round", filmed=True)


def _anywhere(draw: random.Random) -> Pose:
    """A start near the middle of the floor, different for each trial."""
    x, y = (FLOOR_CM / 2 + draw.uniform(-8, 8) for _ in range(2))
    return Pose(x=x, y=y, heading=draw.uniform(-math.pi, math.pi))


def camera_places() -> tuple[Pose, ...]:
    """Robot poses for calibrating the camera: all over the floor, at many headings."""
    share = (0.13, 0.37, 0.63, 0.87)
    places = [(x * FLOOR_CM, y * FLOOR_CM) for x in share for y in (0.13, 0.5, 0.87)]
    return tuple(Pose.from_degrees(x, y, (k * 107) % 360) for k, (x, y) in enumerate(places))


def _steps(seconds: float) -> int:
    return round(seconds * STEPS_A_SECOND)


def _steps_of(level: int) -> list[Command]:
    """From rest forward, back, and turning both ways: each wheel makes every step of this size."""
    n, rest = _steps(STEPS_S), [(0, 0)] * _steps(STAND_S)
    pairs = [(level, level), (-level, -level), (0, 0), (level, -level), (-level, level)]
    return [command for pair in pairs for command in ([pair] * n if pair != (0, 0) else rest)]


def _between() -> list[Command]:
    """Steps from one speed to another."""
    levels = (10, 5, 8, 2, 6, -3, -9, -4, -7, -1, -5, 4)
    return [(level, level) for level in levels for _ in range(_steps(PIECE_S))]


def _random(draw: random.Random) -> list[Command]:
    """Pieces of half a second with a random command for each wheel."""
    pieces = [(draw.randint(-TOP, TOP), draw.randint(-TOP, TOP)) for _ in range(RANDOM_PIECES)]
    return [piece for piece in pieces for _ in range(_steps(PIECE_S))]


def _hasty(draw: random.Random) -> list[Command]:
    """Random commands, each for a few steps."""
    commands: list[Command] = []
    while len(commands) < HASTY_STEPS:
        commands += [(draw.randint(-TOP, TOP), draw.randint(-TOP, TOP))] * draw.choice(HASTIEST)
    return commands[:HASTY_STEPS]


def _starts(level: int, repeats: int) -> list[Command]:
    """Repeatedly: rest, forward, rest, back."""
    n = _steps(STAND_S)
    once = [(0, 0)] * n + [(level, level)] * n + [(0, 0)] * n + [(-level, -level)] * n
    return once * repeats


def _run_through(draw: random.Random, way_cm: float) -> Pose:
    """A start from which a way of this length (cm, signed) passes near the middle of the floor."""
    heading = draw.uniform(-math.pi, math.pi)
    x, y = (FLOOR_CM / 2 + draw.uniform(-10, 10) for _ in range(2))
    return Pose(x=x - way_cm / 2 * math.cos(heading), y=y - way_cm / 2 * math.sin(heading), heading=heading)
