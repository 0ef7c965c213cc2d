"""A task: what is to be done, where, and how it is scored (§6)."""

import inspect
import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from realitygap.errors import TaskError, UsageError
from realitygap.kernels import types
from realitygap.kernels.types import STEP_S
from realitygap.tasks.score import CompiledScore, Score, tried
from realitygap.values import as_count, steps_in
from realitygap.world.arena import Arena, arena_names, load_arena
from realitygap.world.robot import FEEDS, Profile
from realitygap.world.toml import Value, require

__all__ = ["MAX_INPUTS", "Start", "Task", "check_spread"]


def check_spread(spread: float, wheels: float | None) -> None:
    """Refuse invalid shares, and the wheels' alone.

    Raises:
        ConfigError: names the key.
    """
    require(_is_share(spread), "spread", "a share from 0 to 0.9", spread)
    fits = wheels is None or (_is_share(wheels) and spread > 0)
    require(fits, "spread_wheels", "a share from 0 to 0.9, beside a spread", wheels)


def _is_share(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= 0.9


def _ending(spread: float, wheels: float | None = None) -> str:
    """What a name says of a spread: -spread-10, of 10 %."""
    of_wheels = "" if wheels is None else f"-wheels-{100 * wheels:g}"
    return f"-spread-{100 * spread:g}{of_wheels}".replace(".", "-") if spread else ""


MAX_INPUTS = 16
DRAWN = ", constants drawn within "


@dataclass(frozen=True)
class Start(Value):
    """Where a trial starts: uniform in a disc, uniform between two headings (lengths cm, degrees)."""

    x_cm: float
    y_cm: float
    radius_cm: float = 0.0
    heading_deg: tuple[float, float] = (0.0, 360.0)

    def _check(self) -> None:
        require(self.radius_cm >= 0, "radius_cm", "0 or more", self.radius_cm)
        low, high = self.heading_deg
        turns = -360 <= low <= high <= 720
        require(turns, "heading_deg", "(lowest, highest) in degrees", self.heading_deg)


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a controller is to do, and how well it does it: `score`, larger is better.

    Attributes:
        name: lower-case letters, digits and hyphens; names runs and files.
        title: for people, on figures and tables.
        arena: an Arena, the name of one that comes with the package, or the path of a TOML file
            (relative to the file that defines `score`).
        feeds: "proximity", "ambient", or both: which of the robot's sensors the network reads. Both are
            written ("proximity", "ambient"), in any order, and kept as "proximity+ambient".
        sensors: which of them feeds each input of the network; none named: all that the robot has. Of
            both kinds the numbers continue: a Khepera's 0 to 7 are proximity sensors, 8 to 15 ambient.
        start: where a trial begins.
        seconds: length of a trial, a multiple of 0.1; it ends at the nearest step of the robot's period.
        trials: trials in one evaluation; fitness is the mean of their scores.
        spread: share, 0 to 0.9, within which the robot's constants are drawn anew for each simulated trial:
            each sensor's sensitivity, each wheel's speed, the track (domain randomisation).
        spread_wheels: that of wheels and track, if it is another.
        score: a function of (path, room) that returns a float.
        fitness_unit: what figures write at the axis; fitness_scale: what they divide by.
        source: the user's file, None for the paper's tasks; arena_file: its arena's path, where it
            names one. Both are filled in when the file is loaded.

    Raises:
        TaskError: names the field, what was expected, what came, and the cure.
    """

    name: str
    title: str = ""
    arena: Arena
    feeds: str
    sensors: tuple[int, ...] = ()
    start: Start
    seconds: float = 20.0
    trials: int = 2
    spread: float = 0.0
    spread_wheels: float | None = None
    score: Score
    fitness_unit: str = ""
    fitness_scale: float = 1.0
    source: str | None = None
    arena_file: str | None = None

    def __post_init__(self) -> None:
        try:
            self._convert()
            self._check()
        except TaskError:
            raise
        except UsageError as error:
            raise self._wrong(str(error)) from None

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of sensors that are fed: "proximity", "ambient" or both."""
        return tuple(self.feeds.split("+"))

    @property
    def plain_name(self) -> str:
        """Its name without what `under` adds."""
        return self.name.removesuffix(_ending(self.spread, self.spread_wheels))

    def under(self, spread: float | None, wheels: float | None = None) -> Self:
        """The same task with constants drawn anew, under a name and a title that say so.

        Args:
            spread: share, 0 to 0.9, as the attribute; None leaves the task as it is, 0 draws nothing anew.
            wheels: that of wheels and track, if it is another; None keeps the task's.

        Raises:
            ConfigError: no such share.
        """
        if spread is None:
            return self
        check_spread(spread, wheels)
        if not (spread or self.spread):
            return self
        wheels = self.spread_wheels if wheels is None and spread else wheels
        within = f"±{100 * spread:g} %" + (f", the wheels' ±{100 * wheels:g} %" if wheels is not None else "")
        name = self.plain_name + _ending(spread, wheels)
        title = self.title.partition(DRAWN)[0] + (DRAWN + within if spread else "")
        return replace(self, name=name, title=title, spread=spread, spread_wheels=wheels)

    @property
    def steps(self) -> int:
        """Steps of 0.1 s in one trial."""
        return round(self.seconds / STEP_S)

    def steps_of(self, profile: Profile) -> int:
        """Steps of the robot's period in one trial, which ends at the one nearest to its length."""
        return steps_in(self.seconds, profile.period_s)

    def of(self, profile: Profile) -> Self:
        """The task for a robot: fed by all its sensors of the kind, if it names none.

        Raises:
            TaskError: these are more than a network takes.
        """
        there = len(profile.bands(self.feeds))
        if self.sensors or not there:
            return self
        if there > MAX_INPUTS:
            raise self._wrong(
                f"sensors: expected at most {MAX_INPUTS} for a network, got all {there} {self.feeds} sensors "
                f"of profile {profile.name!r}. Name some: sensors=(0, 1, 2) in a task file of your own, or "
                "`realitygap evolve --set task.sensors=[0,1,2]`."
            )
        return replace(self, sensors=tuple(range(there)))

    def to_kernel(self, profile: Profile) -> types.Trial:
        """The trial as the kernels' arrays.

        Raises:
            TaskError: the robot lacks a sensor that the task feeds, or cannot stand at its start.
        """
        count, sensors = len(profile.bands(self.feeds)), self.of(profile).sensors
        for kind in self.kinds:
            if not profile.channel(kind).sensors:
                cure = "Choose another task, or add sensors to the profile."
                raise self._wrong(f"feeds: profile {profile.name!r} has no {kind} sensors. {cure}")
        if lacking := [sensor for sensor in sensors if sensor >= count]:
            told = f"expected {self.feeds} sensors of profile {profile.name!r}, which has {count}"
            raise self._wrong(f"sensors: {told}, got number {lacking[0]} (they count from 0).")
        start, body = self.start, profile.body.radius_cm
        obstacle = self.arena.obstacle_at(start.x_cm, start.y_cm, start.radius_cm + body)
        low, high = (math.radians(angle) for angle in start.heading_deg)
        if obstacle and not (low == high and start.radius_cm == 0 and self._fits(profile, low)):
            raise self._wrong(
                f"start: a robot of radius {body:g} cm that starts within {start.radius_cm:g} cm of "
                f"({start.x_cm:g}, {start.y_cm:g}) may overlap {obstacle}. Move the start, or make its disc "
                "smaller."
            )
        return types.Trial(
            steps=self.steps_of(profile),
            feed=FEEDS.index(self.feeds),
            channels=np.array(sensors, dtype=np.int64),
            start=np.array([start.x_cm, start.y_cm, start.radius_cm, low, high]),
        )

    def _fits(self, profile: Profile, heading: float) -> bool:
        """Whether the robot's very outline is free at the start's middle."""
        from realitygap.kernels.trial import is_clear

        place = map(float, (self.start.x_cm, self.start.y_cm, heading))
        return bool(is_clear(profile.to_kernel(), self.arena.to_kernel(), *place))

    def room(self, profile: Profile) -> types.Room:
        """What the score sees of the world, apart from the path."""
        arena = self.arena.to_kernel()
        speeds = profile.wheels.speed_per_unit_cm_s
        return types.Room(
            lamps=arena.lamp_centre,
            size=arena.size,
            cylinders=arena.cylinders,
            top_speed=profile.wheels.top_command * (speeds[0] + speeds[1]) / 2,
            radius=profile.body.radius_cm,
        )

    def compiled_score(self) -> CompiledScore:
        """The score, compiled (or as it is where the compiler is off) and tried on examples.

        Raises:
            TaskError: the score cannot be compiled or used; says why, in one line.
        """
        return tried(self.score, self.arena, self.steps)

    def to_dict(self) -> dict[str, Any]:
        """The task as data, without its score, ready for JSON."""
        return {
            "name": self.name, "title": self.title, "arena": self.arena.to_dict(), "feeds": self.feeds,
            "sensors": list(self.sensors), "start": self.start.to_dict(), "seconds": self.seconds,
            "trials": self.trials,
            **({"spread": self.spread} if self.spread else {}),
            **({"spread_wheels": self.spread_wheels} if self.spread_wheels is not None else {}),
            "fitness_unit": self.fitness_unit, "fitness_scale": self.fitness_scale,
        }  # fmt: skip

    def _wrong(self, told: str) -> TaskError:
        return TaskError(f"task {self.name!r}: {told}")

    def _convert(self) -> None:
        """What a user may write more shortly becomes what is declared."""
        put = object.__setattr__
        tidy = isinstance(self.name, str) and re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", self.name)
        require(bool(tidy), "name", "lower-case letters, digits and single hyphens", self.name)
        put(self, "score", getattr(self.score, "py_func", self.score))
        cure = "Write `def score(path, room): …`."
        require(inspect.isfunction(self.score), "score", "a function", self.score, cure)
        arena: Any = self.arena
        if isinstance(arena, str | Path):
            shipped = str(arena) in arena_names()
            near = Path(inspect.getfile(self.score)).parent / arena
            put(self, "arena_file", None if shipped else str(arena))
            put(self, "arena", load_arena(near if near.is_file() and not shipped else arena))
        feeds: Any = self.feeds
        if isinstance(feeds, list | tuple):
            put(self, "feeds", "+".join(sorted(set(map(str, feeds)), reverse=True)))
        put(self, "title", self.title or self.name.replace("-", " ").capitalize())
        require(isinstance(self.sensors, list | tuple | range), "sensors", "a tuple of numbers", self.sensors)
        put(self, "sensors", tuple(self.sensors))
        for key in ("seconds", "fitness_scale", "spread"):
            value = getattr(self, key)
            require(isinstance(value, int | float) and math.isfinite(value), key, "a number", value)
            put(self, key, float(value))

    def _check(self) -> None:
        require(isinstance(self.start, Start), "start", "a Start(x_cm=…, y_cm=…)", self.start)
        require(self.feeds in FEEDS, "feeds", " or ".join(map(repr, FEEDS)), self.feeds)
        require(len(self.sensors) <= MAX_INPUTS, "sensors", f"at most {MAX_INPUTS} sensors", self.sensors)
        whole = all(isinstance(sensor, int) and sensor >= 0 for sensor in self.sensors)
        require(whole, "sensors", "whole numbers, 0 or more", self.sensors)
        exact = abs(self.steps * STEP_S - self.seconds) < 1e-9 * max(1.0, self.seconds)
        fits = exact and 1 <= self.steps <= 1_000_000
        require(fits, "seconds", "a multiple of 0.1 from 0.1 to 100000", self.seconds)
        as_count(self.trials, "trials")
        check_spread(self.spread, self.spread_wheels)
        require(self.fitness_scale > 0, "fitness_scale", "more than 0", self.fitness_scale)
        start = self.start
        if obstacle := self.arena.obstacle_at(start.x_cm, start.y_cm, start.radius_cm):
            place = f"{start.radius_cm:g} cm about ({start.x_cm:g}, {start.y_cm:g})"
            told = f"got a disc of {place}, which overlaps {obstacle}."
            raise self._wrong(f"start: expected a free place in arena {self.arena.name!r}, {told}")
