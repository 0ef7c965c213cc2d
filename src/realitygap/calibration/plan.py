"""Plans: where a robot or an object stands while sensors are recorded, and how wheels are driven.

A plan consists of tasks, a recording each; a task of stops: places at which a standing robot's sensors are
read several times, or trials of its wheels.
"""

import itertools
import math
import random
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from realitygap.calibration.load import POLAR, POSE
from realitygap.calibration.recordings import BODY_RADIUS_CM, CHANNELS, check_object, cylinder_radius
from realitygap.errors import RecordingError, UsageError
from realitygap.robots.body import Body
from realitygap.values import Pose
from realitygap.world.arena import Arena, load_arena
from realitygap.world.robot import Body as Shape
from realitygap.world.robot import Profile, Wheels

__all__ = [
    "Place", "Plan", "Task", "Trial", "ambient_task", "camera_places", "check_period", "distances_of",
    "infrared_task", "tasks_of", "wheel_trials",
]  # fmt: skip

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
GRID_X, GRID_Y = (8, 24, 40, 56, 72, 88, 102), (8, 22, 35, 48, 62)
HEADINGS, TURNED_DEG = 5, (0, 12, 24, 36, 48, 60)
"""Places over the arena of light seeking (cm), and five headings at each, turned from place to place."""
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

    def grid(self, body: Body | None) -> tuple[int, tuple[float, ...]]:
        """Bearings and distances (cm) for this robot's infrared, or any robot's.

        Raises:
            RecordingError: no robot can be read at them.
        """
        bearings, distances = (body and body.infrared_grid) or (BEARINGS, DISTANCES_CM)
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
    """Distances as a person types them: "0.5,1,2"."""
    try:
        said = tuple(map(float, text.split(",")))
    except ValueError:
        raise RecordingError(f"distances: expected numbers of cm, as in 0.5,1,2, got {text!r}.") from None
    return Plan(kind="infrared", distances_cm=said).grid(None)[1]


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
    """

    name: str
    kind: str
    key: tuple[str, ...]
    room: Mapping[str, Any]
    stops: Sequence[Place | Trial]
    begins: str
    facts: Mapping[str, Any] = field(default_factory=dict)
    arena: Arena | None = None


def infrared_task(
    name: str,
    body: Shape = KHEPERA,
    reflectance: float = 1.0,
    bearings: int = BEARINGS,
    distances_cm: Sequence[float] = DISTANCES_CM,
) -> Task:
    """An object, "wall" or "cylinder:RADIUS_CM", at `bearings` evenly spaced from straight ahead on, at
    several distances (cm) from the body's edge."""
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
        name=f"infrared-{short}", kind="infrared", key=POLAR, room=room, facts=facts,
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
    """Speed steps of many sizes, standing starts (`repeats` of each size), straight lines and turns, for the
    profile's `wheels` (None: 10 units of about 8 mm/s); `followed`: a camera sees every step."""
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
    """The recordings of a plan for which the robot has sensors."""
    base, kinds, tasks = plan.base, [one.name for one in body.channels], []
    bearings, distances = plan.grid(body)
    if plan.kind in ("infrared", "all"):
        shape = base.body if base else KHEPERA
        whole = {"wall": "wall", "cylinder": CYLINDER}
        names = (plan.object,) if plan.object else tuple(whole[one] for one in body.infrared_objects)
        tasks += [infrared_task(one, shape, plan.reflectance, bearings, distances) for one in names]
    if plan.kind in ("ambient", "all"):
        tasks.append(ambient_task())
    if plan.kind == "all":
        tasks = [task for task in tasks if CHANNELS[task.kind] in kinds]
    for task in tasks:
        body.channel(CHANNELS[task.kind])  # or says that it has none
    if base is not None:
        _check_sensors(body, base, {CHANNELS[task.kind] for task in tasks})
        check_period(body, base)
    followed = not body.counts_turns and (body.knows_pose or body.is_filmed)
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
    """Refuse a robot whose step differs from its base's."""
    if base.period_s != body.period_s:
        raise UsageError(
            f"robot: expected a period of {base.period_s:g} s, as the base {base.name!r} has; this one's is "
            f"{body.period_s:g} s. Set period_s in the base."
        )
