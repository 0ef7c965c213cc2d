"""Plans: where the robot or the object has to stand while its sensors are recorded."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from realitygap.calibration.recorder.grid import Grid
from realitygap.calibration.recordings import BODY_RADIUS_CM, check_object, cylinder_radius
from realitygap.errors import RecordingError
from realitygap.values import Pose
from realitygap.world.arena import Arena, load_arena
from realitygap.world.robot import Body

__all__ = ["KHEPERA", "Part", "Place", "SensorPlan", "ambient_plan", "infrared_plan", "sensor_plans"]

ROOM_CM, NEAR_CM = 100.0, 8.0
"""A room so large that only an object that is so near is in reach of the infrared; it grows with
farther ones."""
KHEPERA = Body(radius_cm=BODY_RADIUS_CM)
"""Of a robot of which nothing is said."""
CYLINDER = "cylinder:4"
"""The paper's obstacles (§4)."""

GRID_X = (8, 24, 40, 56, 72, 88, 102)
GRID_Y = (8, 22, 35, 48, 62)
HEADINGS = 5
TURNED_DEG = (0, 12, 24, 36, 48, 60)
"""Places over the arena of light seeking (cm), and five headings at each, turned from place to place."""


@dataclass(frozen=True, kw_only=True)
class Place:
    """One place of a plan.

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


@dataclass(frozen=True, kw_only=True)
class SensorPlan:
    """Places at which sensors of one kind are read.

    Attributes:
        name: its folder's name where several plans share one.
        kind, object: as in a recording.
        columns: names of the numbers in `Place.where`.
        room: the room in plain numbers (cm), for a twin.
        arena: the room that the poses belong to, None if distances say it all.
        places: in the order in which they are visited.
        begins: what a person prepares.
        reflectance: of the object's surface; NaN: not known.
        facts: what recording.toml says of the places.
        at: the place at a distance (cm) and a bearing (degrees), if these tell the places.
    """

    name: str
    kind: str
    object: str
    columns: tuple[str, ...]
    room: Mapping[str, Any]
    arena: Arena | None
    places: tuple[Place, ...]
    begins: str
    reflectance: float = 1.0
    facts: Mapping[str, Any] = field(default_factory=dict)
    at: Callable[[float, float], Place] | None = None


class Part(NamedTuple):
    """A part of a plan: its `stops`, named by the columns `key` of its table.

    `own`: facts for its recording.toml; `rows`: how many rows a finished stop has, by its key; `read`: brings
    the robot to a stop and returns its rows, none if the stop is skipped; `fine`: whether places between the
    stops are read, too, where readings jump, which `at` makes of a distance and a bearing.
    """

    name: str
    own: dict[str, Any]
    room: Mapping[str, Any]
    begins: str
    channel: str
    columns: tuple[str, ...]
    key: tuple[str, ...]
    stops: Mapping[tuple[str, ...], Any]
    rows: Callable[[tuple[str, ...]], int]
    read: Callable[..., list[tuple[str, ...]]]
    arena: Arena | None = None
    at: Callable[[float, float], Place] | None = None
    fine: bool = False


def infrared_plan(
    name: str, body: Body = KHEPERA, reflectance: float = 1.0, grid: Grid | None = None
) -> SensorPlan:
    """A wall or a cylinder at all bearings, at several distances from the body's edge.

    Args:
        name: "wall" or "cylinder:RADIUS_CM".
        body: the robot's.
        reflectance: of its surface; NaN: not known.
        grid: the distances and bearings; the usual ones if None.

    Raises:
        RecordingError: another object.
    """
    check_object("infrared", name, "--object")
    radius = cylinder_radius(name)
    if radius is not None and radius > ROOM_CM / 4:
        most = f"a cylinder of at most {ROOM_CM / 4:g} cm"
        raise RecordingError(f"--object: expected {most}, got {radius:g} cm.")
    grid = grid or Grid()
    size = ROOM_CM + 2.0 * max(0.0, max(grid.distances_cm) - NEAR_CM)
    # the object lies towards −x: the room's own wall at x = 0, or a cylinder in its middle
    edge = 0.0 if radius is None else size / 2 + radius
    room: dict[str, Any] = {"size_cm": [size, size]}
    if radius is not None:
        room["cylinders"] = [[size / 2, size / 2, radius]]
    if math.isfinite(reflectance) and reflectance != 1.0:
        room["reflectance"] = [reflectance] if radius is None else [1.0, reflectance]
    short = "wall" if radius is None else "cylinder"
    what = "a wall, longer than 30 cm" if radius is None else f"a cylinder of radius {radius:g} cm"

    def at(distance: float, bearing: float) -> Place:
        return _before((edge, size / 2), radius, distance, bearing, body)

    return SensorPlan(
        name=f"infrared-{short}",
        kind="infrared",
        object=name,
        columns=("distance_cm", "bearing_deg"),
        room=room,
        arena=None,
        places=tuple(
            at(distance, k * 360.0 / grid.bearings)
            for distance in grid.distances_cm
            for k in range(grid.bearings)
        ),
        begins=f"Put up {what}, with nothing else within 20 cm, and keep lamps away.",
        reflectance=reflectance,
        facts=grid.facts,
        at=at,
    )


def ambient_plan() -> SensorPlan:
    """Poses all over the arena of light seeking."""
    arena = load_arena("light-seeking")
    places = []
    for number, (x, y) in enumerate((x, y) for x in GRID_X for y in GRID_Y):
        for k in range(HEADINGS):
            heading = (k * 360 / HEADINGS + TURNED_DEG[number % len(TURNED_DEG)] + 180) % 360 - 180
            says = f"the robot's centre at x = {x:g} cm, y = {y:g} cm, looking to {heading:g}°"
            places.append(Place(pose=Pose.from_degrees(x, y, heading), where=(x, y, heading), says=says))
    lamp, (width, depth) = arena.lamps[0], arena.size_cm
    return SensorPlan(
        name="ambient",
        kind="ambient",
        object="lamp",
        columns=("x_cm", "y_cm", "heading_deg"),
        room=arena.plain(),
        arena=arena,
        places=tuple(places),
        begins=f"Build the arena of light seeking: {width:g} by {depth:g} cm, the lamp at ({lamp.x_cm:g}, "
        f"{lamp.y_cm:g}), no other light. x and y count from the lower left corner, headings "
        "counter-clockwise from +x.",
    )


def sensor_plans(
    plan: str,
    name: str | None = None,
    body: Body = KHEPERA,
    reflectance: float = 1.0,
    grid: Grid | None = None,
) -> tuple[SensorPlan, ...]:
    """The sensors' part of the plan "infrared", "ambient", "wheels" or "all".

    Args:
        plan: which.
        name: the infrared's one object; None: a wall and a cylinder.
        body: the robot's.
        reflectance: of the objects' surfaces; NaN: not known.
        grid: the infrared's distances and bearings; the usual ones if None.
    """
    out = []
    if plan in ("infrared", "all"):
        names = (name,) if name else ("wall", CYLINDER)
        out += [infrared_plan(one, body, reflectance, grid) for one in names]
    if plan in ("ambient", "all"):
        out.append(ambient_plan())
    return tuple(out)


def _before(
    edge: tuple[float, float], radius: float | None, distance: float, bearing: float, body: Body
) -> Place:
    """The place before an object with this edge, x and y: a wall, or round."""
    bearing = 180.0 - (180.0 - bearing) % 360.0
    what = "wall" if radius is None else "cylinder"
    gap = None if radius is None else np.array([distance + radius])
    reach = float(body.reach_cm(np.radians([bearing]), gap)[0])
    pose = Pose(x=edge[0] + distance + reach, y=edge[1], heading=math.radians(180.0 - bearing))
    return Place(
        pose=pose,
        where=(distance, bearing),
        says=f"{distance:g} cm between body and {what}, the {what} {_side(bearing)}",
    )


def _side(bearing: float) -> str:
    """A bearing in words."""
    if bearing == 0:
        return "straight ahead"
    if bearing == 180:
        return "straight behind"
    return f"{abs(bearing):g}° to the {'left' if bearing > 0 else 'right'} of its front"
