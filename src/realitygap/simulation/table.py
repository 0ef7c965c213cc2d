"""A real robot's readings as a reality: a profile with look-up tables, replayed, as a robot that is driven.

Its readings of proximity are those that were recorded of a robot (`calibrate --form lookup`), with the noise
measured there. What stands where, how the readings of several objects add up, and the wheels are simulated.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from realitygap.errors import UsageError
from realitygap.robots.body import Body, Channel, SteppedClock
from realitygap.simulation.body import SimulatedBody
from realitygap.simulation.simulation import Simulation
from realitygap.tasks.load import load_task
from realitygap.tasks.task import Start
from realitygap.values import Command, Pose, Readings
from realitygap.world.arena import Arena, Cylinder
from realitygap.world.robot import Profile, load_profile

__all__ = ["TableBody", "opened"]

TASK = "obstacle-avoidance"
EVERYWHERE = 41
"""Places along each side at which a free one is looked for."""


class TableBody(Body):
    """It places itself in any room and knows its pose, but not what its wheels turned: nobody recorded that.

    Args:
        profile: has a table of its infrared.
        noise: its scale, 1 for what was measured.
        base: what a recording of it names as its base.
    """

    def __init__(self, profile: Profile, *, noise: float = 1.0, base: str) -> None:
        self.profile, self.noise, self._base = profile, noise, base
        self.period_s = profile.period_s
        near = profile.infrared
        self.channels = (Channel(name="proximity", sensors=len(near.sensors), high=int(near.top)),)
        if near.table.wall == near.table.cylinder:  # the one was not recorded, and stands for the other
            self.infrared_objects = ("wall",)
        self._room: Mapping[str, Any] = {}
        self.enter({"size_cm": [100.0, 100.0]}, 0, None)

    @property
    def facts(self) -> dict[str, Any]:
        """What a recording says of it."""
        return {"robot": f"readings of {self.profile.name}, replayed", "base": self._base}

    @property
    def clock(self) -> SteppedClock:  # type: ignore[override]
        """The simulation's."""
        return self._body.clock

    @property
    def pose(self) -> Pose:  # type: ignore[override]
        """Where it is."""
        return self._body.pose

    def enter(self, room: Mapping[str, Any], seed: int, pose: Pose | None) -> None:
        """Stand in a room at `pose`, or at a free place near its middle; the same seed, the same noise."""
        if room != self._room:
            self._room, arena = dict(room), _arena_of(room)
            x, y = _free(arena, self.profile.body.radius_cm)
            task = replace(load_task(TASK), arena=arena, start=Start(x_cm=x, y_cm=y), sensors=())
            self._body = SimulatedBody(Simulation(task, self.profile, self.noise), stream=seed)
            self._start = self._body.pose
        self._body.stream = seed
        self._body.reset(self._start if pose is None else pose)

    def reset(self, pose: Pose | None = None) -> None:
        """Stand still at `pose`; the noise begins anew."""
        self.stop()
        self._body.reset(pose)

    def sense(self) -> Readings:
        """What the table has for this place, with noise."""
        return self._body.sense()

    def act(self, command: Command) -> None:
        """Wheel speeds from now on, in the profile's units."""
        self._body.act(command)

    def stop(self) -> None:
        """Stand."""
        self._body.stop()


def _arena_of(room: Mapping[str, Any]) -> Arena:
    """A room in plain numbers as an arena."""
    if "reflectance" in room:
        raise UsageError(
            "arena: reflectance: expected none for a robot of recorded readings, which are of the surfaces "
            "that were recorded. Leave it out."
        )
    return Arena(
        name="room",
        size_cm=tuple(room["size_cm"]),
        walls=tuple(map(tuple, room.get("walls", ()))),
        cylinders=tuple(Cylinder(x_cm=x, y_cm=y, radius_cm=r) for x, y, r in room.get("cylinders", ())),
    )


def _free(arena: Arena, radius_cm: float) -> tuple[float, float]:
    """The free place nearest to the middle of a room."""
    w, h = arena.size_cm
    ticks = [k / (EVERYWHERE - 1) for k in range(EVERYWHERE)]
    places = sorted(((w * i, h * j) for i in ticks for j in ticks),
                    key=lambda at: (at[0] - w / 2) ** 2 + (at[1] - h / 2) ** 2)  # fmt: skip
    for place in places:
        if arena.obstacle_at(*place, radius_cm) is None:
            return place
    raise UsageError(f"arena: expected room for a robot of radius {radius_cm:g} cm, got none.")


def opened(path: str, *, noise: float = 1.0, **_: Any) -> TableBody:
    """The robot whose readings a profile holds.

    Raises:
        UsageError: the profile has no look-up table.
        ConfigError: it is no profile.
    """
    profile = load_profile(path)
    if not profile.infrared.table:
        raise UsageError(
            f"robot: table: expected a profile with look-up tables of recorded readings, got {path}, which "
            "has none. Make one: realitygap calibrate RECORDING --form lookup --out table.toml"
        )
    return TableBody(profile, noise=noise, base=str(Path(path).resolve()) if Path(path).is_file() else path)
