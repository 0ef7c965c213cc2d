"""The forward model of the fits: what the simulation reads where a recording was made.

A table's wall, cylinder or lamp becomes a room of its own with the robot at each row's distance and bearing;
a recording in an arena keeps its poses. The kernels compute the readings: no other file of the fits knows
them. Parameters that several forms share are here, too.
"""

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.fit import Parameter, Values, value_of
from realitygap.calibration.recordings import SensorRecording, WheelRecording, sets_of
from realitygap.kernels.trial import Scratch, new_scratch, unfed
from realitygap.kernels.types import Arena as KernelArena
from realitygap.kernels.types import Robot
from realitygap.values import Floats
from realitygap.world.arena import WHITEST, Arena, Cylinder, Lamp
from realitygap.world.robot import MEASURED, Profile
from realitygap.world.sensors import Ambient, Infrared, Sensor

S = TypeVar("S", bound=Sensor)
L = TypeVar("L", Ambient, Infrared)
V = TypeVar("V")

ROOM_CM = 1000.0
"""A room so large that its other walls are out of every sensor's range."""
REFLECTANCE, GAIN, START = "reflectance_", "gain_", "start_"
"""Prefixes of the keys of a recording's reflectance, gain and start; its number follows."""
TURN, BEARINGS = "turn_deg", 3
"""Key of the rotation that recordings with fewer bearings of each sensor have in common."""
OF_CURVES = (MEASURED - {"dead", "table"}) | {"response"}
"""Keys that stand for curves, or with them."""
SAME_CM = 0.2
"""Sensors within this distance of the paper's are taken to be the paper's: a fit moves them by less."""
DIRECTION_PRIOR_DEG = 5.0
"""How accurately sensors are mounted: separates a turned rig from sensors that are all turned."""
TURN_DEG, TURN_PRIOR_DEG = 10.0, 2.0
"""Bound and prior deviation of a rig's rotation."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Where a recording's rows were read; each place is listed once.

    poses [m, 3] x, y (cm), heading (rad); row [n] the place of each row of the recording; bare: nothing but
    the object is near; paint, gain, start, turn: keys of the constants that are the object's reflectance, the
    unit's gain, the distance (cm) from which distances count and the rig's rotation; "": known, or none.
    """

    arena: KernelArena
    poses: Floats
    row: NDArray[np.int64]
    bare: bool = False
    paint: str = ""
    gain: str = ""
    start: str = ""
    turn: str = ""

    def painted(self, reflectance: float) -> Self:
        """A copy in which all surfaces have this reflectance."""
        surfaces = np.full(1 + len(self.arena.cylinders), reflectance)
        return replace(self, arena=self.arena._replace(reflectance=surfaces))

    def brighter(self, gain: float) -> Self:
        """A copy all of whose surfaces throw back so many times as much."""
        known = self.arena.reflectance
        surfaces = known if len(known) else np.ones(1 + len(self.arena.cylinders))
        return replace(self, arena=self.arena._replace(reflectance=gain * surfaces)) if gain != 1.0 else self

    def tried(self, values: Mapping[str, Floats]) -> Self:
        """A copy with the constants among the fit's values."""
        factors = [float(values[key][0]) for key in (self.paint, self.gain) if key in values]
        turn, away = value_of(values, self.turn), value_of(values, self.start)
        moved = replace(self, poses=self.turned(turn, away)) if turn or away else self
        return moved.brighter(math.prod(factors))

    def turned(self, degrees: float, away_cm: float = 0.0) -> Floats:
        """The poses [m, 3] with the rig turned further counter-clockwise, or further away, than stated."""
        return np.asarray(self.poses + np.array([-away_cm, 0.0, math.radians(degrees)]))


def scene_of(recording: SensorRecording, paint: str = "") -> Scene:
    """The room of a recording, with the robot at each of its places; `paint` is the key of the reflectance if
    that is unknown."""
    row = recording.place()
    first = np.unique(row, return_index=True)[1]
    if recording.pose is not None and recording.arena is not None:
        there = Scene(arena=recording.arena.to_kernel(), poses=recording.pose[first], row=row)
        return there.brighter(float(np.nan_to_num(recording.gain, nan=1.0)))
    half, radius = ROOM_CM / 2, recording.radius_cm
    away = recording.reach_cm()[first] + recording.distance_cm[first]
    cylinders: tuple[Cylinder, ...] = ()
    lamps: tuple[Lamp, ...] = ()
    edge = ROOM_CM
    if recording.object == "lamp":
        edge = half
        lamps = (Lamp(x_cm=half, y_cm=half, spacing_cm=0.0),)
    elif radius is not None:
        edge = half
        away = away + radius
        cylinders = (Cylinder(x_cm=half, y_cm=half, radius_cm=radius),)
    room = Arena(name="table", size_cm=(ROOM_CM, ROOM_CM), cylinders=cylinders, lamps=lamps)
    # The object lies towards +x: heading + bearing = 0.
    poses = np.column_stack(
        [edge - away, np.full(len(first), half), -np.radians(recording.bearing_deg[first])]
    )
    known = math.isfinite(recording.reflectance)
    scene = Scene(arena=room.to_kernel(), poses=poses, row=row, bare=True, paint="" if known else paint)
    return scene.brighter((recording.reflectance if known else 1.0) * np.nan_to_num(recording.gain, nan=1.0))


Scenes = Sequence[tuple[str, Scene]]
"""The key of each recording's rotation, and its room and places."""


def scenes_of(recordings: Sequence[SensorRecording]) -> list[tuple[str, Scene]]:
    """The scenes of several recordings of one robot; what a set has of its own is the same in all of it,
    unless a recording states that it is unknown."""
    sets, rigs = sets_of(recordings), rigs_of(recordings)

    def scene(i: int, r: SensorRecording) -> Scene:
        gain = f"{GAIN}{i if r.facts.get('gain') else sets[i]}"
        start = f"{START}{i if r.facts.get('start_cm') else sets[i]}_cm"
        return replace(scene_of(r, f"{REFLECTANCE}{i}"), gain=gain, start=start, turn=rigs[i])

    return [(f"turn_{i}_deg", scene(i, r)) for i, r in enumerate(recordings)]


def rigs_of(recordings: Sequence[SensorRecording]) -> list[str]:
    """The key of each recording's rotation. One with a bearing or two of each sensor tells none: a sensor's
    gain looks the same; all such have one in common if together they have more, else none ("")."""

    def told(some: Sequence[SensorRecording]) -> bool:
        bearings = [
            {b for r in some for b in r.bearing_deg[np.isfinite(r.counts[:, k])].tolist()}
            for k in range(some[0].sensors if some else 0)
        ]
        return max(map(len, bearings), default=0) >= BEARINGS

    own = [r.pose is not None or told([r]) for r in recordings]
    common = TURN if told([r for r, alone in zip(recordings, own, strict=True) if not alone]) else ""
    return [
        f"turn_{i}_deg" if alone else "" if r.exact else common
        for i, (r, alone) in enumerate(zip(recordings, own, strict=True))
    ]


def proximity(profile: Profile, scene: Scene, turn_deg: float = 0.0, away_cm: float = 0.0) -> Floats:
    """Noise-free proximity readings [n, P] of a recording's rows, counts, the set-up turned by `turn_deg`,
    the object `away_cm` further away."""
    from realitygap.kernels.trial import sweep_infrared

    robot = _robot(profile)
    out = np.zeros((len(scene.poses), len(profile.infrared.sensors)))
    sweep_infrared(robot, scene.arena, scene.turned(turn_deg, away_cm), work_of(robot), out)
    return np.where(out < profile.infrared.dead, 0.0, out)[scene.row]


def received(robot: Robot, rigs: Sequence[tuple[Scene, float, float]], work: Scratch | None = None) -> Floats:
    """What reaches measured proximity sensors [m, P] before their curves, at the places of several scenes,
    each with its rig's rotation (degrees) and extra distance (cm)."""
    from realitygap.kernels.trial import sweep_received

    work, parts = work or work_of(robot), []
    for scene, turn_deg, away_cm in rigs:
        out = np.zeros((len(scene.poses), len(robot.proximity.place)))
        sweep_received(robot, scene.arena, scene.turned(turn_deg, away_cm), work, out)
        parts.append(out)
    return np.concatenate(parts)


def lit_readings(
    profile: Profile, scene: Scene, more: Floats | float, turn_deg: float = 0.0, away_cm: float = 0.0
) -> Floats:
    """Readings [n, P] of measured sensors' curves ignoring the dead zone, with `more` light of the room than
    the profile's own (1/cm², [P] or one for all)."""
    robot, law = _robot(profile), profile.infrared
    light = received(robot, [(scene, turn_deg, away_cm)]) + more * robot.proximity.a
    return table_at([s.curve for s in law.sensors], up_curve(light, law.curve_cm))[scene.row]


def up_curve(light: Floats, knee_cm: float) -> Floats:
    """Position on its curve, 0 to 1, of a proximity sensor that receives this light."""
    root = np.sqrt(np.maximum(light, 0.0))
    return np.asarray(root / (root + 1.0 / knee_cm))


def table_at(table: Sequence[Sequence[float]] | Floats, share: Floats) -> Floats:
    """[n, S] each sensor's row of a table [S, steps] at shares [n, S] of its range."""
    steps = np.linspace(0.0, 1.0, len(table[0]))
    return np.stack([np.interp(share[:, k], steps, row) for k, row in enumerate(table)], 1)


def illumination(profile: Profile, scene: Scene, turn_deg: float = 0.0) -> Floats:
    """Illumination A [n, A] of the ambient sensors at a recording's rows, before their gains."""
    robot = _robot(profile)
    return lit_places(robot, [(scene, turn_deg)], work_of(robot))[scene.row]


def lit_places(robot: Robot, rigs: Sequence[tuple[Scene, float]], work: Scratch) -> Floats:
    """Illumination A [m, A] of the ambient sensors at the places of several scenes, each with its rig's
    rotation (degrees)."""
    from realitygap.kernels import trial as loop

    parts = []
    for scene, turn_deg in rigs:
        out = np.zeros((len(scene.poses), len(robot.ambient.place)))
        follow = loop.sweep_direct if scene.bare else loop.sweep_light
        follow(robot, scene.arena, scene.turned(turn_deg), work, out)
        parts.append(out)
    return np.concatenate(parts)


def rows_of(scenes: Sequence[Scene]) -> NDArray[np.int64]:
    """The place [n] of each row of several recordings, among the places of all."""
    first = np.cumsum([0, *(len(scene.poses) for scene in scenes)])
    return np.concatenate([scene.row + begin for scene, begin in zip(scenes, first.tolist(), strict=False)])


def light_readings(profile: Profile, light: Floats, gain: Floats | None = None) -> Floats:
    """Noise-free ambient readings of an illumination [n, A], counts: the kernels' equation for arrays.

    `gain` [A]: the profile's own if None.
    """
    law = profile.ambient
    floor, dark = np.array(law.ranges()).reshape(-1, 2).T
    total = light * (np.array([sensor.gain for sensor in law.sensors]) if gain is None else gain)
    if law.response == "linear":
        return np.asarray(np.maximum(dark - total, floor))
    if law.measured:
        root = np.sqrt(np.maximum(total, 0.0))
        return table_at([s.curve for s in law.sensors], root / (root + math.sqrt(law.curve_light)))
    with np.errstate(divide="ignore"):
        return np.asarray(np.minimum(floor + 1.0 / np.sqrt(np.maximum(total, 0.0)), dark))


def wheel_speeds(profile: Profile, recording: WheelRecording) -> Floats:
    """Mean speeds [n, 2] (cm/s) of noise-free wheels in the step that follows each row, which may last
    several of the robot's periods."""
    from realitygap.kernels.trial import sweep_wheels

    robot, count = _robot(profile), recording.periods()
    begin = np.cumsum(count) - count
    commands = np.repeat(np.asarray(recording.commands, np.float64), count, axis=0)
    speeds = np.zeros(commands.shape)
    first = np.zeros(len(commands), np.int64)
    first[begin] = np.diff(recording.trial, prepend=-1) != 0
    sweep_wheels(robot, commands, first, work_of(robot), speeds)
    return np.asarray(np.add.reduceat(speeds, begin) / count[:, None]) if len(speeds) > len(count) else speeds


@lru_cache(maxsize=1)  # one profile is asked for the readings of several recordings
def _robot(profile: Profile) -> Robot:
    return profile.to_kernel()


def work_of(robot: Robot) -> Scratch:
    """Scratch arrays for its sensors and wheels."""
    return new_scratch(robot, unfed())


def unchecked(value: V, **changes: Any) -> V:
    """A copy of a value with changes, without its checks, which would take a fifth of a fit."""
    made = copy(value)
    vars(made).update(changes)
    return made


def nominal(sensors: Sequence[S], paper: Sequence[S]) -> Sequence[S]:
    """Sensors before any fit: the paper's if they sit in the same places, else the given ones."""
    here, there = ([(s.x_cm, s.y_cm) for s in some] for some in (sensors, paper))
    same = len(here) == len(there) and np.allclose(here, there, rtol=0, atol=SAME_CM)
    return paper if same else sensors


def without_curves(law: L) -> L:
    """Sensors without curves of their own and what goes with them, if they have any: laws begin anew."""

    def unsaid(one: L | Sensor) -> dict[str, Any]:
        own = one.__dataclass_fields__
        return {key: own[key].default for key in OF_CURVES & own.keys()}

    if not law.measured:
        return law
    return replace(law, sensors=tuple(replace(s, **unsaid(s)) for s in law.sensors), **unsaid(law))


def turns(rigs: Sequence[str]) -> list[Parameter]:
    """The rotation of each rig."""
    return [
        Parameter(
            key=rig, start=np.zeros(1), low=-TURN_DEG, high=TURN_DEG, prior=TURN_PRIOR_DEG, step=0.05
        )
        for rig in rigs
    ]  # fmt: skip


def units(recordings: Sequence[SensorRecording]) -> list[Parameter]:
    """The unknown gains and starts (cm) of recordings; series before a wall have shifts instead of starts."""
    keys = [scene for _, scene in scenes_of(recordings)]
    gains = [scene.gain for scene, r in zip(keys, recordings, strict=True) if math.isnan(r.gain)]
    starts = [
        scene.start
        for scene, r in zip(keys, recordings, strict=True)
        if math.isnan(r.start_cm) and r.from_sensor is None
    ]
    scale: dict[str, Any] = {"start": np.ones(1), "low": 0.05, "high": 20.0, "prior": 1.0, "step": 2e-3}
    away: dict[str, Any] = {"start": np.zeros(1), "low": -1.0, "high": 1.0, "prior": 0.5, "step": 2e-3}
    return [
        *(Parameter(key=key, **scale) for key in dict.fromkeys(gains)),
        *(Parameter(key=key, **away) for key in dict.fromkeys(starts)),
    ]


def reflectances(scenes: Scenes) -> list[Parameter]:
    """The unknown reflectances of surfaces."""
    paints = [scene.paint for _, scene in scenes if scene.paint]
    return [Parameter(key=key, start=np.ones(1), low=0.01, high=WHITEST, step=2e-3) for key in paints]


def directions(sensors: Sequence[Sensor], *, tie: float | None = 0.02, jump: float = 0.0) -> Parameter:
    """The direction of each sensor; `tie`: how well their mean is known where rigs may stand turned."""
    start = np.array([s.direction_deg for s in sensors])
    return Parameter(
        key="direction_deg", start=start, low=-360, high=360, prior=DIRECTION_PRIOR_DEG, tie=tie, step=0.05,
        jump=jump,
    )  # fmt: skip


def columns_of(values: Values, keys: Sequence[str], sensors: Sequence[Sensor]) -> dict[str, list[float]]:
    """Fitted per-sensor constants by key; directions are kept within what a profile can hold."""
    n = len(sensors)
    columns = {key: np.broadcast_to(values[key], (n,)).tolist() for key in keys if key in values}
    if "direction_deg" in columns:
        columns["direction_deg"] = [min(360.0, max(-360.0, turned)) for turned in columns["direction_deg"]]
    return columns


def with_columns(sensors: Sequence[S], columns: Mapping[str, Sequence[Any]]) -> tuple[S, ...]:
    """Sensors with fitted constants in place, unchecked."""
    return tuple(
        unchecked(sensor, **{key: column[k] for key, column in columns.items()})
        for k, sensor in enumerate(sensors)
    )


def checked(law: L) -> L:
    """A fitted law, with all the checks that were left out on the way."""
    return replace(law, sensors=tuple(replace(sensor) for sensor in law.sensors))
