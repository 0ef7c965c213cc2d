"""The forward model of the fits: what the simulation reads where a recording was made.

A table's wall, cylinder or lamp becomes a room of its own with the robot at each row's distance and bearing;
a recording in an arena keeps its poses. The kernels compute the readings.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.recordings import SensorRecording, WheelRecording
from realitygap.kernels.trial import Scratch, new_scratch, unfed
from realitygap.kernels.types import Arena as KernelArena
from realitygap.kernels.types import Robot
from realitygap.values import Floats
from realitygap.world.arena import Arena, Cylinder, Lamp
from realitygap.world.robot import Profile

__all__ = [
    "Scene", "illumination", "light_readings", "lit_places", "lit_readings", "proximity", "received",
    "rows_of", "scene_of", "table_at", "up_curve", "wheel_speeds", "work_of",
]  # fmt: skip

ROOM_CM = 1000.0
"""A room so large that its other walls are out of every sensor's range."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Where a recording's rows were read; each place is listed once.

    poses [m, 3] x, y (cm), heading (rad); row [n] the place of each row of the recording; bare: nothing but
    the object is near; paint: key of the constant that is the object's reflectance, if it is unknown.
    """

    arena: KernelArena
    poses: Floats
    row: NDArray[np.int64]
    bare: bool = False
    paint: str = ""

    def painted(self, reflectance: float) -> Self:
        """A copy in which all surfaces have this reflectance."""
        surfaces = np.full(1 + len(self.arena.cylinders), reflectance)
        return replace(self, arena=self.arena._replace(reflectance=surfaces))

    def tried(self, values: Mapping[str, Floats]) -> Self:
        """A copy with the reflectance among the fit's values, if there is one."""
        return self.painted(float(values[self.paint][0])) if self.paint in values else self

    def turned(self, degrees: float, away_cm: float = 0.0) -> Floats:
        """The poses [m, 3] with the rig turned further counter-clockwise, or further away, than stated."""
        return np.asarray(self.poses + np.array([-away_cm, 0.0, math.radians(degrees)]))


def scene_of(recording: SensorRecording, paint: str = "") -> Scene:
    """The room of a recording, with the robot at each of its places; `paint` is the key of the reflectance if
    that is unknown."""
    row = recording.place()
    first = np.unique(row, return_index=True)[1]
    if recording.pose is not None and recording.arena is not None:
        return Scene(arena=recording.arena.to_kernel(), poses=recording.pose[first], row=row)
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
    return scene.painted(recording.reflectance) if known and recording.reflectance != 1.0 else scene


def proximity(profile: Profile, scene: Scene, turn_deg: float = 0.0, away_cm: float = 0.0) -> Floats:
    """Noise-free proximity readings [n, P] of a recording's rows, counts.

    Args:
        profile: the robot.
        scene: the recording's room and places.
        turn_deg: rotation of the set-up, degrees.
        away_cm: extra distance of the object, cm.
    """
    from realitygap.kernels.trial import sweep_infrared

    robot = _robot(profile)
    out = np.zeros((len(scene.poses), len(profile.infrared.sensors)))
    sweep_infrared(robot, scene.arena, scene.turned(turn_deg, away_cm), work_of(robot), out)
    return np.where(out < profile.infrared.dead, 0.0, out)[scene.row]


def received(robot: Robot, rigs: Sequence[tuple[Scene, float, float]], work: Scratch | None = None) -> Floats:
    """What reaches measured proximity sensors [m, P] before their curves, at the places of several scenes,
    each with its rig's rotation (degrees) and extra distance (cm).

    `work`: scratch arrays of a robot with as many sensors; None: new ones.
    """
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
    """Readings [n, P] of measured proximity sensors' curves at a recording's rows, ignoring the dead zone,
    counts.

    Args:
        profile, scene, turn_deg, away_cm: as of `proximity`.
        more: light of the room beyond the profile's own, 1/cm², [P] or one for all.
    """
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
    """Speeds [n, 2] (cm/s) of noise-free wheels in the step that follows each row."""
    from realitygap.kernels.trial import sweep_wheels

    robot = _robot(profile)
    speeds = np.zeros(recording.commands.shape)
    first = np.concatenate([[1], (np.diff(recording.trial) != 0).astype(np.int64)]).astype(np.int64)
    sweep_wheels(robot, np.ascontiguousarray(recording.commands, np.float64), first, work_of(robot), speeds)
    return speeds


@lru_cache(maxsize=1)  # one profile is asked for the readings of several recordings
def _robot(profile: Profile) -> Robot:
    return profile.to_kernel()


def work_of(robot: Robot) -> Scratch:
    """Scratch arrays for its sensors and wheels."""
    return new_scratch(robot, unfed())
