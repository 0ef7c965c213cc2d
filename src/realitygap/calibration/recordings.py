"""Recordings for a calibration: a robot's readings at known places, and drives of its wheels.

load.py reads them from files.

distance_cm: from the body's edge, a disc's or a polygon's, to a wall along its normal, to a round object's
edge, to a lamp's centre. bearing_deg: where the object stands, counter-clockwise from the robot's front.
A row of a place is one of its repeated readings; a row of steps has what was read at t_s and the command
given then.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import CalibrationError, ConfigError, RecordingError
from realitygap.values import Floats
from realitygap.world.arena import Arena
from realitygap.world.robot import Body, Profile, load_profile
from realitygap.world.sensors import Sensor

__all__ = [
    "Recording", "SensorRecording", "WheelRecording", "as_recorded", "check_object", "count_unit",
    "cylinder_radius", "tells_heights",
]  # fmt: skip

HEIGHTS_CM = {"body_height_cm": 3.0, "sensor_height_cm": 1.2}
"""Height of the Khepera's top, as the manufacturer states it (30 mm), and of its sensors, by a ruler."""
CHANNELS = {"infrared": "proximity", "ambient": "ambient"}
"""What a robot's readings and a profile's noise call the sensors of each kind."""
FIRST_NOISE = {"infrared": 21.0, "ambient": 4.5}
"""Initial noise of each kind: counts of the paper's robot."""
BODY_RADIUS_CM = 2.75
"""Half the Khepera's diameter, as the manufacturer states it (55 mm): where nothing else is said."""
PULSES_PER_MM = 12.0
"""Of a Khepera by most sources (0.08 mm per pulse by others): used where nothing was measured."""
FOLLOWED_STEPS = 300
"""Number of successive steps seen by a camera from which on poses can replace counters."""
EXCEEDED = 1.1
"""Readings exceed a robot's full scale by up to this factor: beyond, they are another converter's."""
HALL_CM = 1000.0
"""A room whose other walls are out of every sensor's range."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """Where a recording comes from.

    Attributes:
        source, hash: the path it was read from, and the SHA-256 of its files.
        notes: by the person who made it.
        group: the name of its set; "": that of its folder.
        facts: the whole of recording.toml.
        warnings: about what looks wrong but can be used.
    """

    source: str = ""
    hash: str = ""
    notes: str = ""
    group: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorRecording(Recorded):
    """Readings of the sensors of one kind, one row each, [n].

    Not a Track: its poses are separate places, not a path.

    Attributes:
        kind: "infrared" or "ambient".
        object: "wall", "cylinder:RADIUS_CM" or "lamp".
        distance_cm: [n] from the body's edge to the object as in the module docstring.
        bearing_deg: [n] of the object, counter-clockwise from the robot's front, −180 < b ≤ 180.
        repeat: [n] which of the readings at its place, from 0.
        counts: [n, S] raw readings.
        pose: [n, 3] x, y (cm) and heading (rad) of the robot's centre in `arena`, if known.
        arena: the room, if poses are given.
        body_radius_cm: of the body whose edge distances are measured from.
        body_outline_cm: its corners, as in a profile; empty: it is a disc.
        body_said: whether the recording states the body; else a calibration uses its base's.
        full_scale: the converter's highest count; None: its robot's.
        reflectance: of the wall or cylinder, relative to what constants are for; NaN: unknown, to be fitted.
        gain: how many times as sensitive as others its unit is; NaN: unknown, to be fitted.
        start_cm: NaN if its distances start from an unknown one, to be fitted; else 0.
        from_sensor: the sensor that faced the wall, from which distances are measured; None: from the body's
            edge.
        speed_cm_s: [n] mean absolute speed of both wheels during each reading; None: they stood.
        lines: [n] where each row stands, file and line; empty: unknown.
    """

    kind: str
    object: str
    distance_cm: Floats
    bearing_deg: Floats
    repeat: NDArray[np.int64]
    counts: Floats
    pose: Floats | None = None
    arena: Arena | None = None
    body_radius_cm: float = BODY_RADIUS_CM
    body_outline_cm: tuple[tuple[float, float], ...] = ()
    body_said: bool = True
    full_scale: float | None = None
    speed_cm_s: Floats | None = None
    reflectance: float = 1.0
    gain: float = 1.0
    start_cm: float = 0.0
    from_sensor: int | None = None
    lines: Sequence[str] = ()

    def __post_init__(self) -> None:
        where = self.source or "a recording"
        if self.pose is not None and not np.isfinite(self.pose).all():  # kernels would never come back
            raise RecordingError(f"{where}: expected finite poses.")
        check_object(self.kind, self.object, where)

    def at(self, row: int) -> str:
        """Where a reading stands, for messages."""
        return self.lines[row] if self.lines else f"{self.source}, reading {row + 1}"

    def of_robot(self, robot: Profile) -> Self:
        """A copy as a recording of this robot: with its body, and a warning about that, if it states none.

        Raises:
            RecordingError: the robot has another number of sensors, or another full scale.
        """
        part, whose = robot.channel(self.kind), f"profile {robot.name!r}"
        if self.sensors != len(part.sensors):
            raise RecordingError(
                f"{self.source}: expected {len(part.sensors)} sensors, as {whose} has, got {self.sensors}. "
                f"Give the robot's own profile, or a copy with an [{self.kind}] of its own."
            )
        most = float(np.nanmax(self.counts, initial=0.0))
        got = max(self.full_scale or part.top, most)
        if got != part.top and not part.top / EXCEEDED <= got <= EXCEEDED * part.top:
            raise RecordingError(
                f"{self.source}: expected counts from 0 to {part.top:g}, the full scale of {whose}, got "
                f"{got:g}. Give the robot's own profile, or a copy with another {self.kind}.top."
            )
        if most > part.top:
            said = f"{self.source}: readings go up to {most:g}, beyond the full scale {part.top:g} of {whose}"
            return replace(self, warnings=(*self.warnings, f"{said}: {most:g} is taken"))._of_body(robot)
        return self._of_body(robot)

    def _of_body(self, robot: Profile) -> Self:
        part, whose = robot.channel(self.kind), f"profile {robot.name!r}"
        if self.from_sensor is not None:
            return self._before(part.sensors[self.from_sensor])
        if self.body_said:
            return self
        radius_cm = robot.body.radius_cm
        # Measured distances stay; those from a lamp's centre follow from the poses.
        nearer = radius_cm - self.body_radius_cm if self.pose is not None else 0.0
        taken = f"{self.source}: body_radius_cm: not said; {radius_cm:g} cm are taken, as {whose} has"
        return replace(
            self, body_radius_cm=radius_cm, body_outline_cm=robot.body.outline_cm,
            distance_cm=self.distance_cm - nearer, warnings=(*self.warnings, taken),
        )  # fmt: skip

    def _before(self, sensor: Sensor) -> Self:
        """A copy with poses in a room in which one sensor faces a wall."""
        heading = -math.radians(sensor.direction_deg)
        c, s = math.cos(heading), math.sin(heading)
        hall = Arena(name="hall", size_cm=(HALL_CM, HALL_CM))
        x = HALL_CM - self.distance_cm - (c * sensor.x_cm - s * sensor.y_cm)
        middle = np.full(len(x), HALL_CM / 2)
        pose = np.column_stack([x, middle, np.full(len(x), heading)])
        return replace(self, pose=pose, arena=hall, bearing_deg=np.full(len(x), sensor.direction_deg))

    @property
    def sensors(self) -> int:
        return int(self.counts.shape[1])

    @property
    def radius_cm(self) -> float | None:
        """Of a cylinder; None for other objects."""
        return cylinder_radius(self.object)

    @property
    def by_program(self) -> bool:
        """Whether a program put the robot down, exactly where the table says.

        Recordings made before `placed_by` was written tell it by the noise of a simulated robot.
        """
        return self.facts.get("placed_by") == "program" or "twin_noise" in self.facts

    @property
    def exact(self) -> bool:
        """Whether its places are poses, or a program's: no rig stood turned."""
        return self.pose is not None or self.by_program

    def reach_cm(self) -> Floats:
        """[n] distance from the axle's middle to the body's edge, towards the object."""
        round_cm = 0.0 if self.object == "lamp" else self.radius_cm
        gap = None if round_cm is None else self.distance_cm + round_cm
        body = Body(radius_cm=self.body_radius_cm, outline_cm=self.body_outline_cm)
        return body.reach_cm(np.radians(self.bearing_deg), gap)

    def place(self) -> NDArray[np.int64]:
        """[n] the number of each row's place, from 0 in the order of first appearance."""
        where = np.stack([self.distance_cm, self.bearing_deg], 1) if self.pose is None else self.pose
        numbers: dict[tuple[float, ...], int] = {}
        return np.array([numbers.setdefault(tuple(row), len(numbers)) for row in where.tolist()], np.int64)


@dataclass(frozen=True, kw_only=True, eq=False)
class WheelRecording(Recorded):
    """Commands and movements of the wheels, a row a step, [n].

    Not a Track: its poses belong to many trials, and only to rows with a picture.

    Attributes:
        t_s: [n] time since the trial's start.
        commands: [n, 2] left and right, the robot's units, given at t_s after everything else was read; NaN
            where they were not recorded.
        counters: [n, 2] pulses; NaN for wheels without counters.
        speeds: [n, 2] measured by the robot, its units; NaN if it does not.
        trial: [n] its number.
        kind: [n] one of `STEP_KINDS`.
        pose: [n, 3] x, y (cm) and heading (rad) from the camera; NaN where it took no picture, or saw no
            heading.
        pulses_per_mm: known in advance.
        pulses_said: whether the recording states them; else a calibration uses its base's, if it has any.
        from_commands, from_speeds: whether `counters` are integrated commands or speeds (units times
            seconds), not real counters.
        period_s: of a step.
    """

    t_s: Floats
    commands: Floats
    counters: Floats
    speeds: Floats
    trial: NDArray[np.int64]
    kind: NDArray[np.str_]
    pose: Floats | None = None
    pulses_per_mm: float = PULSES_PER_MM
    pulses_said: bool = True
    from_commands: bool = False
    from_speeds: bool = False
    period_s: float = 0.1

    @property
    def counted(self) -> bool:
        """Whether the wheels have counters."""
        return not self.from_commands and bool(np.isfinite(self.counters).any())

    @property
    def in_units(self) -> bool:
        """Whether `counters` are sums of the robot's own unit of commands and speeds: a pulse is a unit for a
        second."""
        return self.from_commands or (self.from_speeds and "pulses_per_mm" not in self.facts)

    @property
    def commanded(self) -> bool:
        """Whether the commands are known."""
        return bool(np.isfinite(self.commands).all())

    @property
    def followed(self) -> bool:
        """Whether a camera saw successive steps, half a minute or more in all."""
        if self.pose is None:
            return False
        seen = np.asarray(np.isfinite(self.pose[:, :2]).all(axis=1))
        both = seen[1:] & seen[:-1] & (np.diff(self.trial) == 0)
        return int(both.sum()) >= FOLLOWED_STEPS

    def of_robot(self, base: Profile) -> Self:
        """A copy in steps of the base's period; wheels without counters get their integrated commands, and
        counters of which it does not say how long a pulse is the base's."""
        per_mm = 1.0 / sum(5.0 * speed for speed in base.wheels.speed_per_unit_cm_s)
        if self.counted:
            pulses = self.pulses_per_mm
            if not self.pulses_said and self.from_speeds:
                pulses = per_mm
            elif not self.pulses_said and base.provenance.pulses_per_mm:
                pulses = sum(base.provenance.pulses_per_mm) / len(base.provenance.pulses_per_mm)
            return replace(self, pulses_per_mm=pulses, period_s=base.period_s)
        steps = base.wheels.proportional(self.commands[:-1]) * np.diff(self.t_s)[:, None]
        counters = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        return replace(
            self, counters=counters, pulses_per_mm=per_mm, from_commands=True, period_s=base.period_s
        )

    def periods(self) -> NDArray[np.int64]:
        """[n] how many periods each row's step lasts, about; 1 of a trial's last row."""
        step = np.append(np.where(np.diff(self.trial) == 0, np.diff(self.t_s), self.period_s), self.period_s)
        return np.maximum(np.rint(step[: len(self.t_s)] / self.period_s), 1).astype(np.int64)

    def since_change(self) -> NDArray[np.int64]:
        """[n, 2] steps for which each wheel's command has been the same, as far as is known."""
        number, new = np.arange(len(self.commands))[:, None], np.diff(self.trial, prepend=-1)[:, None] != 0
        changed = new | (np.diff(np.nan_to_num(self.commands), axis=0, prepend=np.nan) != 0)
        return np.asarray(number - np.maximum.accumulate(np.where(changed, number, 0), axis=0))

    def trials(self, *kinds: str) -> list[NDArray[np.int64]]:
        """The rows of each trial of these kinds (default: all), in order."""
        wanted = np.isin(self.kind, kinds) if kinds else np.ones(len(self.kind), bool)
        return [np.flatnonzero((self.trial == k) & wanted) for k in np.unique(self.trial[wanted])]


Recording = SensorRecording | WheelRecording


@cache
def count_unit(full_scale: float) -> float:
    """Counts of a converter per count of the paper's robot, in which limits and first guesses are stated."""
    return full_scale / load_profile("paper").infrared.top


def cylinder_radius(name: str) -> float | None:
    """The radius (cm) of "cylinder:RADIUS_CM"; None for any other object."""
    word, _, rest = name.partition(":")
    try:
        radius = float(rest) if word == "cylinder" else math.nan
    except ValueError:
        return None
    return radius if math.isfinite(radius) and radius > 0 else None


def check_object(kind: str, name: str, where: str) -> None:
    """Refuse an object that sensors of this kind cannot be recorded with."""
    if kind not in CHANNELS:
        raise RecordingError(f'{where}: kind: expected "infrared" or "ambient", got {kind!r}.')
    if kind == "ambient" and name != "lamp":
        raise RecordingError(f'{where}: object: ambient light is recorded with a "lamp", got {name!r}.')
    if kind == "infrared" and name != "wall" and cylinder_radius(name) is None:
        raise RecordingError(
            f'{where}: object: expected "wall" or "cylinder:RADIUS_CM" with a radius above 0, got {name!r}. '
            "Say what the sensors saw."
        )


def sets_of(recordings: Sequence[SensorRecording]) -> list[int]:
    """For each recording the number of the first of its set."""
    names = [r.group or str(Path(r.source).parent) for r in recordings]
    return [names.index(name) for name in names]


# The robot that several recordings state together


def tells_heights(recording: Recording) -> bool:
    """Whether it states the heights of body and sensors."""
    return HEIGHTS_CM.keys() <= recording.facts.keys()


def reaching(recordings: Sequence[Recording], base: Profile) -> Profile:
    """The base with the full scales that recordings exceed raised to their highest reading."""
    for kind in CHANNELS:
        counts = [r.counts for r in recordings if isinstance(r, SensorRecording) and r.kind == kind]
        part: Any = base.channel(kind)
        most = max((float(np.nanmax(c, initial=0.0)) for c in counts), default=0.0)
        base = replace(base, **{kind: replace(part, top=most)}) if most > part.top else base
    return base


def as_recorded(recordings: Sequence[Recording], base: Profile) -> Profile:
    """The base with what its recordings state: the body's edge, from which distances are measured, and its
    heights, which decide where light passes over it; and with the full scale that they reach. A .sam table's
    body is the manufacturer's."""
    base = reaching(recordings, base)
    seen = [r for r in recordings if isinstance(r, SensorRecording) and r.from_sensor is None]
    said = [r for r in seen if "body_radius_cm" in r.facts or not r.body_said] or seen
    radius_cm = _same({r.body_radius_cm: r.source for r in said}, "body_radius_cm")
    outline = _same({r.body_outline_cm: r.source for r in said if r.body_outline_cm}, "body_outline_cm")
    if radius_cm is not None:
        shape = {"radius_cm": radius_cm, "outline_cm": outline or base.body.outline_cm}
        try:
            base = replace(base, body=replace(base.body, **shape))
        except ConfigError as error:
            raise CalibrationError(
                f"{said[0].source}: body_radius_cm: {radius_cm:g} cm does not fit profile {base.name!r}: "
                f"{error} Correct it (cm), or give the profile of the robot that was recorded."
            ) from None
    heights = {tuple(r.facts[key] for key in HEIGHTS_CM): r.source for r in recordings if tells_heights(r)}
    if (stated := _same(heights, " and ".join(HEIGHTS_CM))) is not None:
        lower = replace(base.ambient, sensor_height_cm=stated[1])
        base = replace(base, body=replace(base.body, height_cm=stated[0]), ambient=lower)
    return base


def _same(said: Mapping[Any, str], key: str) -> Any:
    """The one value that recordings, by their sources, state; None if none does."""
    if len(said) > 1:
        (one, here), (two, there) = list(said.items())[:2]
        raise CalibrationError(
            f"{key}: expected one robot, got {one} in {here} and {two} in {there}. Correct them; a recording "
            "that does not say it has that of --base."
        )
    return next(iter(said), None)
