"""Makes recordings: brings the robot to each stop of a plan, reads it, and writes its rows at once.

    from realitygap.calibration.record import Plan, record
    from realitygap.robots.address import Address

    record(Plan(kind="all"), "unit-7", Address.parse("twin:7").open())

A stop is a place at which a standing robot's sensors are read several times, or a trial of its wheels. A kill
loses the stop that was being recorded at most; `resume` goes on with the next.
"""

import contextlib
import hashlib
import itertools
import math
import os
import random
import tempfile
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.calibration.record_edges import FINE, TWICE, look_between
from realitygap.calibration.recordings import (
    BODY_RADIUS_CM,
    CHANNELS,
    DRIVE,
    EDGES,
    FACTS,
    HEIGHTS_CM,
    POLAR,
    POSE,
    READINGS,
    STEP_COLUMNS,
    STEPS,
    UNFINISHED,
    UNITS,
    UNKNOWN,
    WHEEL_COUNTS,
    check_object,
    cylinder_radius,
)
from realitygap.errors import BaudError, RecordingError, UsageError
from realitygap.files import atomic_write, naming_errors, read_toml, to_toml
from realitygap.robots.body import (
    Body,
    Filmed,
    Placing,
    Seen,
    attend,
    channel,
    clock_of,
    facts_of,
    known_pose,
    odometry_of,
)
from realitygap.robots.signals import MOVING, Stopping, heed
from realitygap.values import Closing, Command, Pose
from realitygap.world.arena import Arena, load_arena
from realitygap.world.robot import Body as Shape
from realitygap.world.robot import Profile, Wheels, load_profile

__all__ = [
    "Plan",
    "Result",
    "StoppedByUserError",
    "Task",
    "check_period",
    "distances_of",
    "record",
    "tasks_of",
]

Ask = Callable[[str], str]
"""Says something to a person and returns the answer."""
Progress = Callable[[str, int, int], None]
"""Called with the recording's name, the places done, and all places."""

BEARINGS, DISTANCES_CM = 24, (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 8.0)
"""Where an object stands for the infrared: 15 degrees apart, which shows the sensors and the gaps between
them, from nearly touching to where a Khepera sees nothing, close together where the curve is steep."""
MOST_BEARINGS, NEAREST_CM, FARTHEST_CM = 720, 0.1, 20.0
ROOM_CM, NEAR_CM = 100.0, 8.0
"""A room so large that only an object that is so near is in reach of the infrared; it grows with farther
ones."""
KHEPERA = Shape(radius_cm=BODY_RADIUS_CM)
"""Of a robot of which nothing is said."""
CYLINDER = "cylinder:4"
"""The paper's obstacles (§4)."""
ARENA = "arena.toml"
GRID_X, GRID_Y = (8, 24, 40, 56, 72, 88, 102), (8, 22, 35, 48, 62)
HEADINGS, TURNED_DEG = 5, (0, 12, 24, 36, 48, 60)
"""Places over the arena of light seeking (cm), and five headings at each, turned from place to place."""
APART_S = 0.3
"""Time between two readings at a place, s, so that slow noise shows too."""

FLOOR_CM = 60.0
ROOM: dict[str, Any] = {"size_cm": [FLOOR_CM, FLOOR_CM]}
"""An empty floor under a camera."""
TOP, UNIT_CM_S = 10, 0.8
"""Top command of the wheels' plan, and approximate speed of a unit, to keep clear of the walls."""
STEPS_A_SECOND, SEEN_EVERY = 10, 10
"""A camera looks at every tenth step (1 s) or at each, and at the first and the last."""
STAND_S, WAY_CM, LONGEST_S, TURN_S = 0.5, 28.0, 4.0, 3.0
"""Time at rest at each trial's end, where a camera looks; a straight line's length or time; a turn's time."""
STRAIGHT_RUNS = 6
"""With a ground that makes a run's length uncertain by 1 %, 24 runs leave 0.2 %."""
WATCHED = {4: 2, 8: 4, 10: 6}
"""Number of runs at a speed that are seen at every step: slip is the deviation of the way of one step. Mostly
fast ones, where it exceeds the camera's error; some slow ones, which measure that error."""

STUDY = "study.db"
SAME = ("plan", "kind", "object", "robot", "unit", "twin_noise", "marker", "seed", "repeats", "bearings",
        "distances_cm", "places")  # fmt: skip
"""Facts that must not change when a recording is resumed."""


class StoppedByUserError(Exception):
    """The person stops for today."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is to be recorded.

    Attributes:
        kind: "infrared", "ambient", "wheels" or "all" (that the robot has).
        object: the one object of the infrared's plan; None: a wall and a cylinder.
        reflectance: of its surface, relative to the surfaces that the constants are for; NaN: unknown, to be
            fitted.
        repeats: readings at each place; standing starts of each size.
        seed: of what is random in a plan, and of the noise of a robot that places itself.
        notes: kept with the recording.
        base: the robot's approximate profile (radius, heights, top command and speed); None: the robot's own
            base, or a Khepera.
        marker: what the robot wears under a camera over the wheels' floor, as `load_marker` reads it; None:
            the disk.
        bearings: of the infrared's object, evenly spaced, starting straight ahead; None: the robot's own
            (`infrared_grid`), or BEARINGS.
        distances_cm: of the infrared's object from the body's edge, increasing; None: likewise.
    """

    kind: str
    object: str | None = None
    reflectance: float = 1.0
    repeats: int = 10
    seed: int = 0
    notes: str = ""
    base: Profile | None = None
    marker: str | None = None
    bearings: int | None = None
    distances_cm: Sequence[float] | None = None

    def grid(self, body: Any) -> tuple[int, tuple[float, ...]]:
        """Bearings and distances (cm) for this robot's infrared.

        Raises:
            RecordingError: no robot can be read at them.
        """
        bearings, distances = getattr(body, "infrared_grid", (BEARINGS, DISTANCES_CM))
        bearings = bearings if self.bearings is None else self.bearings
        distances = tuple(map(float, distances if self.distances_cm is None else self.distances_cm))
        if bearings not in range(1, MOST_BEARINGS + 1):
            expected = f"a whole number from 1 to {MOST_BEARINGS}"
            raise RecordingError(f"bearings: expected {expected}, got {bearings!r}.")
        rising = all(near < far for near, far in itertools.pairwise(distances))
        if not (distances and rising and distances[0] >= NEAREST_CM and distances[-1] <= FARTHEST_CM):
            expected = f"rising ones from {NEAREST_CM:g} to {FARTHEST_CM:g} cm"
            got = ", ".join(f"{one:g}" for one in distances)
            raise RecordingError(f"distances: expected {expected}, got {got or 'none'}.")
        return bearings, distances


def distances_of(text: str) -> tuple[float, ...]:
    """Distances as a person types them: "0.5,1,2".

    Raises:
        RecordingError: names the text that is no such list.
    """
    try:
        said = tuple(map(float, text.split(",")))
    except ValueError:
        raise RecordingError(f"distances: expected numbers of cm, as in 0.5,1,2, got {text!r}.") from None
    return Plan(kind="infrared", distances_cm=said).grid(None)[1]


@dataclass(frozen=True, kw_only=True)
class Result:
    """A finished recording: how many places of the plan are `done`, how many others between them where
    readings jump, the time it took, and whether the person stopped early."""

    folder: Path
    name: str
    kind: str
    places: int
    done: int
    seconds: float
    between: int = 0
    stopped: bool = False

    @property
    def finished(self) -> bool:
        """Whether every place is recorded."""
        return self.done >= self.places


@dataclass(frozen=True, kw_only=True)
class Place:
    """A place of the plan of sensors.

    Attributes:
        pose: of the robot in the plan's room.
        where: the table's first columns: distance_cm and bearing_deg, or x_cm, y_cm and heading_deg.
        says: what a person does to get the robot there.
    """

    pose: Pose
    where: tuple[float, ...]
    says: str

    @property
    def key(self) -> tuple[str, ...]:
        """`where` as the table has it."""
        return tuple(f"{number:g}" for number in self.where)


@dataclass(frozen=True)
class Trial:
    """A trial of the wheels: commands for steps, from standing to standing.

    Attributes:
        kind: "step", "start", "straight" or "turn".
        commands: left and right of each step.
        pose: where a robot that places itself starts; a person only needs the space that `says` asks for.
        says: what a person prepares.
        filmed: whether a camera, if there is one, sees it.
        watched: whether it sees every step of it.
        number: from 0.
    """

    kind: str
    commands: Sequence[tuple[int, int]]
    pose: Pose
    says: str
    filmed: bool = False
    watched: bool = False
    number: int = 0

    @property
    def key(self) -> tuple[str, ...]:
        return (str(self.number),)

    def seen(self) -> tuple[int, ...]:
        """The steps at which a camera looks."""
        if not self.filmed:
            return ()
        last = len(self.commands) - 1
        return (*range(0, last, 1 if self.watched else SEEN_EVERY), last)


@dataclass(frozen=True, kw_only=True)
class Task:
    """One recording of a plan: its stops, which fill one table.

    Attributes:
        name: its folder's name where a plan has several.
        kind: as in a recording.
        key: the columns of the table that name a stop.
        room: in plain numbers (cm), for a robot that places itself.
        stops: in the order in which they are visited.
        begins: what a person prepares.
        facts: what recording.toml says of them.
        arena: the room that poses belong to; None: distances say it all.
        at: the place at a distance (cm) and a bearing (degrees), where these tell places.
    """

    name: str
    kind: str
    key: tuple[str, ...]
    room: Mapping[str, Any]
    stops: Sequence[Place | Trial]
    begins: str
    facts: Mapping[str, Any] = field(default_factory=dict)
    arena: Arena | None = None
    at: Callable[[float, float], Place] | None = None


# The plan: what is recorded where


def infrared_task(
    name: str,
    body: Shape = KHEPERA,
    reflectance: float = 1.0,
    bearings: int = BEARINGS,
    distances_cm: Sequence[float] = DISTANCES_CM,
) -> Task:
    """A wall or a cylinder ("cylinder:RADIUS_CM") at all bearings, at several distances from the body's edge.

    Raises:
        RecordingError: another object.
    """
    check_object("infrared", name, "--object")
    radius = cylinder_radius(name)
    if radius is not None and radius > ROOM_CM / 4:
        most = f"a cylinder of at most {ROOM_CM / 4:g} cm"
        raise RecordingError(f"--object: expected {most}, got {radius:g} cm.")
    size = ROOM_CM + 2.0 * max(0.0, max(distances_cm) - NEAR_CM)
    # The object lies towards −x: the room's own wall at x = 0, or a cylinder in its middle.
    edge = 0.0 if radius is None else size / 2 + radius
    room: dict[str, Any] = {"size_cm": [size, size]}
    if radius is not None:
        room["cylinders"] = [[size / 2, size / 2, radius]]
    if math.isfinite(reflectance) and reflectance != 1.0:
        room["reflectance"] = [reflectance] if radius is None else [1.0, reflectance]
    short = "wall" if radius is None else "cylinder"
    what = "a wall, longer than 30 cm" if radius is None else f"a cylinder of radius {radius:g} cm"

    def at(distance: float, bearing: float) -> Place:
        bearing = 180.0 - (180.0 - bearing) % 360.0
        gap = None if radius is None else np.array([distance + radius])
        reach = float(body.reach_cm(np.radians([bearing]), gap)[0])
        side = f"{abs(bearing):g}° to the {'left' if bearing > 0 else 'right'} of its front"
        side = {0.0: "straight ahead", 180.0: "straight behind"}.get(bearing, side)
        return Place(
            pose=Pose(x=edge + distance + reach, y=size / 2, heading=math.radians(180.0 - bearing)),
            where=(distance, bearing),
            says=f"{distance:g} cm between body and {short}, the {short} {side}",
        )

    facts: dict[str, Any] = {"object": name}
    if (bearings, tuple(distances_cm)) != (BEARINGS, DISTANCES_CM):
        facts |= {"bearings": bearings, "distances_cm": list(distances_cm)}
    return Task(
        name=f"infrared-{short}", kind="infrared", key=POLAR, room=room, facts=facts, at=at,
        stops=[at(distance, k * 360.0 / bearings) for distance in distances_cm for k in range(bearings)],
        begins=f"Put up {what}, with nothing else within 20 cm, and keep lamps away.",
    )  # fmt: skip


def ambient_task() -> Task:
    """Poses all over the arena of light seeking."""
    arena = load_arena("light-seeking")
    places = []
    for number, (x, y) in enumerate((x, y) for x in GRID_X for y in GRID_Y):
        for k in range(HEADINGS):
            heading = (k * 360 / HEADINGS + TURNED_DEG[number % len(TURNED_DEG)] + 180) % 360 - 180
            says = f"the robot's centre at x = {x:g} cm, y = {y:g} cm, looking to {heading:g}°"
            places.append(Place(pose=Pose.from_degrees(x, y, heading), where=(x, y, heading), says=says))
    lamp, (width, depth) = arena.lamps[0], arena.size_cm
    return Task(
        name="ambient", kind="ambient", key=POSE, room=arena.plain(), arena=arena, stops=places,
        facts={"object": "lamp"},
        begins=f"Build the arena of light seeking: {width:g} by {depth:g} cm, the lamp at ({lamp.x_cm:g}, "
        f"{lamp.y_cm:g}), no other light. x and y count from the lower left corner, headings "
        "counter-clockwise from +x.",
    )  # fmt: skip


def wheel_trials(
    repeats: int, seed: int, wheels: Wheels | None = None, *, period_s: float = 0.1, followed: bool = False
) -> tuple[Trial, ...]:
    """Speed steps of many sizes, standing starts, straight lines and turns.

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
        tenths = (*scaled, *_held((0, 0), STAND_S))
        steps = round(len(tenths) / STEPS_A_SECOND / period_s)
        whole = tuple(tenths[int(k * period_s * STEPS_A_SECOND + 1e-6)] for k in range(steps))
        filmed, watched = sketch.filmed or followed, sketch.watched or followed
        trials.append(replace(sketch, number=number, commands=whole, filmed=filmed, watched=watched))
    return tuple(trials)


def _held(command: tuple[int, int], seconds: float) -> list[tuple[int, int]]:
    """A command for some time, in tenths of a second."""
    return [command] * round(seconds * STEPS_A_SECOND)


def _without_camera(draw: random.Random, repeats: int) -> Iterator[Trial]:
    """Steps and standing starts with commands of TOP, in tenths of a second."""
    near, far = "15 cm free all round", "25 cm free all round"
    rest = _held((0, 0), STAND_S)
    for level in (1, 2, 3, 5, 7, 10):  # from rest forward, back, and turning both ways
        pairs = [(level, level), (-level, -level), (0, 0), (level, -level), (-level, level)]
        steps = [command for pair in pairs for command in (_held(pair, 1.0) if any(pair) else rest)]
        yield Trial("step", steps, _anywhere(draw), near)
    levels = (10, 5, 8, 2, 6, -3, -9, -4, -7, -1, -5, 4)
    between = [command for level in levels for command in _held((level, level), 0.5)]
    yield Trial("step", between, _anywhere(draw), near)
    for _ in range(4):  # pieces of half a second with a random command for each wheel
        pairs = [(draw.randint(-TOP, TOP), draw.randint(-TOP, TOP)) for _ in range(10)]
        yield Trial("step", [each for pair in pairs for each in _held(pair, 0.5)], _anywhere(draw), far)
    for _ in range(4):  # commands that change as fast as a controller's
        hasty: list[tuple[int, int]] = []
        while len(hasty) < 60:
            hasty += [(draw.randint(-TOP, TOP), draw.randint(-TOP, TOP))] * draw.choice((1, 1, 2, 3))
        yield Trial("step", hasty[:60], _anywhere(draw), far)
    for level in (1, 2, 3):  # standing starts, forward and back
        once = rest + _held((level, level), STAND_S) + rest + _held((-level, -level), STAND_S)
        yield Trial("start", once * repeats, _anywhere(draw), "10 cm free ahead and behind")


def _filmed(draw: random.Random, unit_cm_s: float) -> Iterator[Trial]:
    """Straight lines and turns in view of the camera."""
    for level in (4, 6, 8, 10):
        for run in range(STRAIGHT_RUNS):
            seconds = min(LONGEST_S, WAY_CM / (level * unit_cm_s))
            sign = 1 - 2 * (run % 2)
            way = sign * level * unit_cm_s * seconds  # passes near the middle of the floor
            heading = draw.uniform(-math.pi, math.pi)
            x, y = (FLOOR_CM / 2 + draw.uniform(-10, 10) for _ in range(2))
            x, y = x - way / 2 * math.cos(heading), y - way / 2 * math.sin(heading)
            says = f"35 cm free {'ahead' if sign > 0 else 'behind'}"
            yield Trial(
                "straight", _held((sign * level, sign * level), seconds), Pose(x=x, y=y, heading=heading),
                says, filmed=True, watched=run < WATCHED.get(level, 0),
            )  # fmt: skip
    for level in (2, 3, 4, 6, 8, 10):
        for sign in (1, -1):
            spin = _held((-sign * level, sign * level), TURN_S)
            yield Trial("turn", spin, _anywhere(draw), "10 cm free all round", filmed=True)
    for arc in ((10, 6), (6, 10), (8, 3), (3, 8), (10, 2), (2, 10)):
        yield Trial("turn", _held(arc, TURN_S), _anywhere(draw), "25 cm free all round", filmed=True)


def _anywhere(draw: random.Random) -> Pose:
    """A start near the middle of the floor, different for each trial."""
    x, y = (FLOOR_CM / 2 + draw.uniform(-8, 8) for _ in range(2))
    return Pose(x=x, y=y, heading=draw.uniform(-math.pi, math.pi))


def camera_places() -> tuple[Pose, ...]:
    """Robot poses for calibrating the camera over the wheels' floor: all over it, at many headings."""
    share = (0.13, 0.37, 0.63, 0.87)
    places = [(x * FLOOR_CM, y * FLOOR_CM) for x in share for y in (0.13, 0.5, 0.87)]
    return tuple(Pose.from_degrees(x, y, (k * 107) % 360) for k, (x, y) in enumerate(places))


def tasks_of(plan: Plan, body: Body) -> list[Task]:
    """The recordings of a plan for which the robot has sensors.

    Raises:
        UsageError: it lacks the requested sensors, or they or its period differ from the base's.
    """
    base, kinds, tasks = plan.base, [one.name for one in body.channels], []
    bearings, distances = plan.grid(body)
    if plan.kind in ("infrared", "all"):
        shape = base.body if base else KHEPERA
        names = (plan.object,) if plan.object else ("wall", CYLINDER)
        tasks += [infrared_task(one, shape, plan.reflectance, bearings, distances) for one in names]
    if plan.kind in ("ambient", "all"):
        tasks.append(ambient_task())
    if plan.kind == "all":
        tasks = [task for task in tasks if CHANNELS[task.kind] in kinds]
    for task in tasks:
        channel(body, CHANNELS[task.kind])  # or says that it has none
    if base is not None:
        _check_sensors(body, base, {CHANNELS[task.kind] for task in tasks})
        check_period(body, base)
    followed = not body.counts_turns and isinstance(body, Seen | Filmed)
    if plan.kind == "wheels" or (plan.kind == "all" and (body.counts_turns or followed)):
        wheels = base.wheels if base else None
        trials = wheel_trials(plan.repeats, plan.seed, wheels, period_s=body.period_s, followed=followed)
        begins = "Clear a level floor of 60 by 60 cm; a camera above it is welcome."
        tasks.append(
            Task(name="wheels", kind="wheels", key=("trial",), room=ROOM, stops=trials, begins=begins)
        )
    return tasks


def _check_sensors(body: Body, base: Profile, kinds: Collection[str]) -> None:
    """Refuse a robot whose sensors are not its base's: its commands would be another robot's. The base may
    lack sensors but for the `kinds` that are recorded."""
    for one in body.channels:
        theirs = len(base.channel(one.name).sensors)
        if theirs != one.sensors and (theirs or one.name in kinds):
            raise UsageError(
                f"robot: expected {theirs} {one.name} sensors, as the base {base.name!r} has; this one has "
                f"{one.sensors}. Take a base with as many (--base), or a plan without them."
            )


def check_period(body: Body, base: Profile) -> None:
    """Refuse a robot whose step differs from its base's.

    Raises:
        UsageError: names both periods and the cure.
    """
    if base.period_s != body.period_s:
        raise UsageError(
            f"robot: expected a period of {base.period_s:g} s, as the base {base.name!r} has; this one's is "
            f"{body.period_s:g} s. Set period_s in the base."
        )


# Recording


def record(
    plan: Plan,
    folder: str | Path,
    body: Body,
    *,
    ask: Ask | None = None,
    resume: bool = False,
    on_progress: Progress | None = None,
) -> list[Result]:
    """Record a plan into `folder`, or each of several recordings into a folder of its own there.

    Args:
        plan: what, and how.
        folder: created if missing.
        body: the robot; the caller closes it.
        ask: asks the person who places the robot; not needed if it places itself.
        resume: continue the recordings in the folder.
        on_progress: called after each place; an exception raised there stops the recording.

    Raises:
        RecordingError: the folder holds a recording already, or another one, or another process
            records there.
        UsageError: the robot lacks the sensors, or they differ from those of `base`.
    """
    if plan.base is None and "base" in (own := facts_of(body)):
        plan = replace(plan, base=load_profile(own["base"]))
    tasks, folder = tasks_of(plan, body), Path(folder)
    places = [folder / task.name if len(tasks) > 1 else folder for task in tasks]
    made: list[Result] = []
    with _alone(folder):
        for place in places:
            if (place / DRIVE).exists() or (not resume and (place / FACTS).exists()):
                cure = "choose another folder, or go on with --resume."
                raise RecordingError(f"{place}: already holds a recording; {cure}")
        for task, place in zip(tasks, places, strict=True):
            with _site(body, ask, task, plan) as site:
                made.append(
                    _record(task, place, plan, body, site, on_progress or (lambda name, done, total: None))
                )
            if made[-1].stopped:
                break
    return made


def _record(task: Task, folder: Path, plan: Plan, body: Body, site: "Site", report: Progress) -> Result:
    """Bring the robot to each stop that is not done, and write its rows at once."""
    begun, stopped, between = time.perf_counter(), False, 0
    stops = {stop.key: stop for stop in task.stops}
    fine = (
        task.kind == "infrared" and isinstance(body, Placing)
        and plan.grid(body)[0] >= FINE and plan.repeats > 1
    )  # fmt: skip
    facts = {**_facts(task, plan, body), **({"between": UNFINISHED} if fine else {})}
    if task.kind == "wheels":
        one, table = body.channels[0], STEPS
        lacks = () if body.counts_turns else WHEEL_COUNTS
        columns = (*(name for name in STEP_COLUMNS if name not in lacks), *POSE)
    else:
        one, table = channel(body, CHANNELS[task.kind]), READINGS
        columns = (*task.key, "repeat", *(f"s{i}" for i in range(one.sensors)))

    def rows_of(key: tuple[str, ...]) -> int:
        stop = stops.get(key)
        return len(stop.commands) if isinstance(stop, Trial) else 0 if stop is None else plan.repeats

    def read(stop: Place | Trial, repeats: int = plan.repeats) -> list[tuple[str, ...]]:
        if not site.go(stop):
            return []
        if isinstance(stop, Trial):
            rows, poses = drive_trial(body, stop)
            seen = {**poses, **site.poses(stop)}
            return [(*row, *_pose(seen.get(k))) for k, row in enumerate(rows)]
        return [(*stop.key, str(k), *row) for k, row in enumerate(read_standing(body, one.name, repeats))]

    journal = Journal(folder, facts=facts, table=table, columns=columns, key=task.key, rows=rows_of)
    if task.arena is not None:
        atomic_write(folder / ARENA, task.arena.to_toml())
    left = [stop for key, stop in stops.items() if key not in journal.done]
    if left or fine:
        attend(body, one.name, turns=task.kind == "wheels")
    try:
        if left and site.prepare(task.begins):
            for stop in left:
                if rows := read(stop):
                    journal.add(rows)
                report(task.name, len(journal.done), len(stops) + fine)
        if fine and task.at is not None and len(journal.done) == len(stops):
            edges = Journal(
                folder, facts=facts, table=EDGES, columns=columns, key=task.key, rows=lambda key: TWICE
            )
            between = look_between(
                journal, edges, task.at, partial(read, repeats=TWICE), one.high,
                lambda done, many: report(task.name, len(stops) + done, len(stops) + many),
            )  # fmt: skip
            edges.state("between", between)
    except StoppedByUserError:
        stopped = True
    if not journal.done:  # skipped: an empty table would only hinder a calibration
        journal.discard()
    return Result(
        folder=folder, name=task.name, kind=task.kind, places=len(stops), done=len(journal.done),
        seconds=time.perf_counter() - begun, between=between, stopped=stopped,
    )  # fmt: skip


def _facts(task: Task, plan: Plan, body: Body) -> dict[str, Any]:
    """The content of recording.toml."""
    known, facts, base = dict(facts_of(body)), {"kind": task.kind, **task.facts}, plan.base
    if task.kind != "wheels":
        shape, one = base.body if base else KHEPERA, channel(body, CHANNELS[task.kind])
        facts["body_radius_cm"] = shape.radius_cm
        if shape.outline_cm:
            facts["body_outline_cm"] = [list(corner) for corner in shape.outline_cm]
        facts["sensors"] = one.sensors
        if one.high != load_profile("paper").channel(one.name).top:
            facts["full_scale"] = one.high
    elif plan.marker is not None:
        known["marker"] = plan.marker
    if task.kind == "infrared" and plan.reflectance != 1.0:
        facts["reflectance"] = plan.reflectance if math.isfinite(plan.reflectance) else UNKNOWN
    if task.arena is not None:
        heights = (base.body.height_cm, base.ambient.sensor_height_cm) if base else HEIGHTS_CM.values()
        facts |= {"arena": ARENA, **(dict(zip(HEIGHTS_CM, heights, strict=True)) if all(heights) else {})}
    units = UNITS.format(known.pop("units", "units of the robot's own"))
    placed_by = "program" if isinstance(body, Placing) else "person"
    facts |= {"plan": plan.kind, "units": units, "placed_by": placed_by, **known}
    return facts | {
        "notes": plan.notes, "repeats": plan.repeats, "seed": plan.seed, "places": len(task.stops),
    }  # fmt: skip


def drive_trial(body: Body, trial: Trial) -> tuple[list[tuple[str, ...]], dict[int, Pose]]:
    """Drive one trial as a controller would, step by step.

    Returns:
        Its rows as texts, without poses; and the poses that the robot reported, by step, where a camera
        looks.

    Raises:
        BaudError: the line has no room for counters and speeds in a step.
    """
    clock = clock_of(body)
    body.reset()
    rows, poses, looks = [], {}, trial.seen() if isinstance(body, Seen) else ()
    start = due = clock.now()
    with Stopping(() if clock.waits else MOVING) as stopping:
        try:
            for k, command in enumerate(trial.commands):
                clock.sleep_until(due)
                now = clock.now()
                body.sense()
                counters, speeds = odometry_of(body)
                if body.counts_turns and (counters is None or speeds is None):
                    raise BaudError(
                        "robot: expected counters and speeds at each step, got only one of them. A line "
                        "needs 38400 baud or more; a body of your own gives Odometry(counters=…, speeds=…)."
                    )
                if k in looks and isinstance(body, Seen):
                    poses[k] = known_pose(body)
                heed()
                body.act(Command(left=command[0], right=command[1]))
                turned = (*(counters or ()), *(speeds or ())) if body.counts_turns else ()
                numbers = (*command, *turned, trial.number)
                rows.append((f"{now - start:.4f}", *map(str, numbers), trial.kind))
                due = max(due + body.period_s, now)
        finally:
            with stopping.held():
                body.stop()
    return rows, poses


def read_standing(body: Body, kind: str, repeats: int) -> list[list[str]]:
    """Repeated readings [repeats][sensors] of a standing robot, as texts."""
    clock = clock_of(body)
    readings = []
    for _ in range(repeats):
        clock.sleep_until(clock.now() + APART_S)
        asked = clock.now()
        read = body.sense()
        while getattr(body, "read_at", asked) < asked:  # a missing answer is not a reading
            read = body.sense()
        heed()
        counts = read.proximity if kind == "proximity" else read.ambient
        readings.append([f"{count:.10g}" for count in counts.tolist()])
    return readings


def _pose(pose: Pose | None) -> tuple[str, ...]:
    if pose is None:
        return ("", "", "")
    return f"{pose.x:.4f}", f"{pose.y:.4f}", f"{math.degrees(pose.heading):.3f}"


# Who brings the robot to a stop


class OwnSite(Closing):
    """A robot that places itself.

    Args:
        body, room: the robot, and the room in plain numbers (cm).
        seed: of its noise, together with the stop: none affects the next.
        camera: whether to use the camera over the floor, if the robot has one.
        marker: what it wears there, as `load_marker` reads it; None: the disk.
    """

    def __init__(
        self,
        body: Placing,
        room: Mapping[str, Any],
        *,
        seed: int,
        camera: bool = False,
        marker: str | None = None,
    ) -> None:
        self._body, self._room, self._seed = body, room, seed
        self._stack, self._camera = ExitStack(), None
        if camera and isinstance(body, Filmed):
            from realitygap.calibration.floor_camera import FloorCamera
            from realitygap.film.tag import load_marker

            with ExitStack() as stack:
                worn = load_marker(marker) if marker else None
                watching = FloorCamera(room, unit=body.unit, noise=body.noise, seed=seed, marker=worn)
                self._camera = stack.enter_context(watching)
                self._film = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "film.csv"
                self._stack = stack.pop_all()

    def prepare(self, says: str) -> bool:
        """Does nothing: its room is built already."""
        return True

    def go(self, stop: Place | Trial) -> bool:
        """Place the robot, with noise seeded by the stop's name, and film a trial from now on."""
        digest = hashlib.sha256(f"{self._seed}/{'/'.join(stop.key)}".encode()).digest()
        self._body.enter(self._room, int.from_bytes(digest[:7]), stop.pose)
        if self._camera and isinstance(stop, Trial) and stop.filmed and isinstance(self._body, Filmed):
            self._body.film(self._film)
        return True

    def poses(self, trial: Trial) -> Mapping[int, Pose]:
        """The poses that the camera saw in the trial that ends here, by step."""
        if not (self._camera and trial.filmed and isinstance(self._body, Filmed)):
            return {}
        self._body.film(None)
        return self._camera.poses(self._film, trial.seen(), trial.number)

    def close(self) -> None:
        self._stack.close()


class PersonSite(Closing):
    """A person who places the robot as asked: an empty answer continues, "s" skips, "q" stops."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask
        self._start: Pose | None = None

    def prepare(self, says: str) -> bool:
        """Say what is needed, and ask whether it is ready; False: it is left out."""
        while True:
            answer = self._ask(f"{says} [Enter: ready, s: leave out, q: stop here]").strip().lower()
            if answer in ("", "s"):
                return not answer
            if answer == "q":
                raise StoppedByUserError

    def go(self, stop: Place | Trial) -> bool:
        """Say where to place the robot, or how much room a trial needs, and ask where that starts."""
        if isinstance(stop, Place):
            return self.prepare(f"Place: {stop.says}.")
        name = f"Trial {stop.number} ({stop.kind})"
        ready = self.prepare(f"{name}: the robot will move; it needs {stop.says}.")
        self._start = self._measured("Where does it stand?") if ready and stop.filmed else None
        return ready

    def poses(self, trial: Trial) -> Mapping[int, Pose]:
        """Ask where a trial ended."""
        if self._start is None:
            return {}
        end = self._measured("Where does it stand now?")
        return {0: self._start} if end is None else {0: self._start, len(trial.commands) - 1: end}

    def _measured(self, says: str) -> Pose | None:
        """A pose that the person measured or read off the camera's track."""
        while True:
            words = (
                self._ask(f"{says} [x_cm y_cm heading_deg; Enter: not measured]").replace(",", " ").split()
            )
            if words == ["q"]:
                raise StoppedByUserError
            if not words:
                return None
            with contextlib.suppress(ValueError):
                x, y, heading = map(float, words)
                if all(map(math.isfinite, (x, y, heading))):
                    return Pose.from_degrees(x, y, heading)

    def close(self) -> None:
        """No resources to release."""


Site = OwnSite | PersonSite


def _site(body: Body, ask: Ask | None, task: Task, plan: Plan) -> Site:
    if isinstance(body, Placing):
        own = int.from_bytes(hashlib.sha256(f"{plan.seed}/{task.name}".encode()).digest()[:7])
        return OwnSite(body, task.room, seed=own, camera=task.kind == "wheels", marker=plan.marker)
    if plan.marker is not None:
        raise UsageError(
            "marker: expected a robot with a camera of its own over it, as a twin's; this one is filmed by "
            "whoever places it: `realitygap track FILM --marker …`."
        )
    if ask is None:
        raise UsageError("ask: expected a function that asks a person to place the robot, got none.")
    return PersonSite(ask)


# The folder


class Journal:
    """One recording's folder; `done` has the rows of the stops that are finished, by their keys.

    Args:
        folder: the recording's.
        facts: for recording.toml, written at the start.
        table: the table's name; it is made with its first rows if the folder is there already.
        columns: of the table.
        key: the columns that name a stop.
        rows: how many rows a finished stop has, by its key.

    Raises:
        RecordingError: the folder holds another recording.
    """

    def __init__(
        self,
        folder: Path,
        *,
        facts: Mapping[str, Any],
        table: str,
        columns: Sequence[str],
        key: Sequence[str],
        rows: Callable[[tuple[str, ...]], int],
    ) -> None:
        self.folder, self.path, self.columns = folder, folder / table, tuple(columns)
        self._key = [self.columns.index(name) for name in key]
        self.done: dict[tuple[str, ...], Sequence[Sequence[str]]] = {}
        if (folder / FACTS).exists():
            self._check(facts)
            self._take_up(rows)
            return
        folder.mkdir(parents=True, exist_ok=True)
        atomic_write(self.path, ",".join(self.columns) + "\n")
        date = datetime.now().astimezone().isoformat(timespec="seconds")
        atomic_write(folder / FACTS, to_toml({**facts, "date": date}))

    def add(self, rows: Sequence[Sequence[str]]) -> None:
        """Write all rows of a finished stop."""
        head = [] if self.path.exists() else [self.columns]
        text = "".join(",".join(row) + "\n" for row in (*head, *rows))
        with naming_errors(self.path), self.path.open("ab", buffering=0) as file:
            file.write(text.encode("utf-8"))
        self.done[self._name(rows[0])] = rows

    def state(self, name: str, fact: Any) -> None:
        """Put a fact into recording.toml that is known only now."""
        atomic_write(self.folder / FACTS, to_toml({**self._stated(), name: fact}))

    def discard(self) -> None:
        """Remove an empty recording's files, and its folder if nothing else is in it."""
        for name in (self.path.name, ARENA, FACTS):
            (self.folder / name).unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def _name(self, row: Sequence[str]) -> tuple[str, ...]:
        return tuple(row[i] for i in self._key)

    def _stated(self) -> dict[str, Any]:
        return read_toml(self.folder / FACTS, RecordingError, "Begin the recording anew, in another folder.")

    def _check(self, facts: Mapping[str, Any]) -> None:
        there = self._stated()
        for name in SAME:
            if there.get(name) != facts.get(name):
                begun, asked = (repr(said[name]) if name in said else "the usual" for said in (there, facts))
                raise RecordingError(
                    f"{self.folder / FACTS}: {name}: this recording was begun with {begun}, not {asked}; "
                    "resume it as it was begun, or choose another folder."
                )

    def _take_up(self, rows: Callable[[tuple[str, ...]], int]) -> None:
        """Keep the table's finished stops; drop an incomplete one that a kill left."""
        if not self.path.is_file():
            return
        data = self.path.read_bytes()
        lines = data[: data.rfind(b"\n") + 1].decode("utf-8", "replace").splitlines()
        head, stops = ",".join(self.columns), dict[tuple[str, ...], list[list[str]]]()
        for number, line in enumerate(lines, 1):
            row = line.split(",")
            if line != head if number == 1 else len(row) != len(self.columns):
                raise RecordingError(f"{self.path}, line {number}: expected columns {head}, got {line!r}.")
            if number > 1:
                stops.setdefault(self._name(row), []).append(row)
        self.done = {key: kept for key, kept in stops.items() if len(kept) == rows(key)}
        kept = [head, *(",".join(row) for stop in self.done.values() for row in stop)]
        text = "".join(f"{line}\n" for line in kept)
        if text.encode() != data:
            atomic_write(self.path, text)


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """A folder to record into, for one process at a time; an empty one is removed at the end.

    Raises:
        RecordingError: another process holds it, or it is a study's.
    """
    import fcntl

    if (folder / STUDY).exists():
        raise RecordingError(f"{folder}: holds a study ({STUDY}). Choose another folder.")
    folder.mkdir(parents=True, exist_ok=True)
    held = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(held)
        cure = "Wait until it ends, stop it, or choose another folder."
        raise RecordingError(f"{folder}: another process records there. {cure}") from None
    except OSError:
        pass  # a file system without locks
    try:
        yield
    finally:
        os.close(held)
        with contextlib.suppress(OSError):  # something is in it
            folder.rmdir()
