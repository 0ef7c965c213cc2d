"""Bodies: sensors and wheels that a controller drives, simulated, twin or real, all alike; and their time.

A robot of your own is a subclass of `Body`, in any file (`--robot file.py:Class`). For example, one with five
sensors of 12 bits and no counters, which a person puts down:

    class Five(Body):
        channels = (Channel(name="proximity", sensors=5, high=4095),)

        def reset(self, pose=None): self.stop()
        def sense(self): return Readings(proximity=self.line.read(5), ambient=np.empty(0))
        def act(self, command): self.line.write(command.left, command.right)
        def stop(self): self.line.write(0, 0)
        def close(self): self.line.close()

Everything else has a default. `realitygap.testing.BodyContract` tests what every body must do.
"""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from realitygap.errors import UsageError
from realitygap.plugins import blamed_on, named_object
from realitygap.values import Command, Pose, Readings, as_count

__all__ = [
    "KINDS", "Body", "Channel", "Clock", "Odometry", "RealClock", "SteppedClock",
    "checked_readings", "opened",
]  # fmt: skip

KINDS = ("proximity", "ambient")
"""The kinds of sensors that there are."""

ROUNDING_S = 1e-6
"""A time this little before a step's counts as that step's."""


class Clock(Protocol):
    """What a loop needs of a clock, s."""

    waits: bool
    """Whether it stands still while this process does."""

    def now(self) -> float:
        """The time; only differences mean anything."""

    def sleep_until(self, time_s: float) -> None:
        """Let time pass."""


class RealClock:
    """The computer's own."""

    waits = False

    def now(self) -> float:
        """Seconds since some moment."""
        return time.monotonic()

    def sleep_until(self, time_s: float) -> None:
        """Sleep."""
        left = time_s - time.monotonic()
        if left > 0:
            time.sleep(left)


class SteppedClock:
    """A simulated body's time, s, in which nothing is ever late: it advances by whole steps.

    Args:
        step: advances the simulation by one step.
        period_s: how long that is.
    """

    waits = True

    def __init__(self, step: Callable[[], None], period_s: float) -> None:
        self._step, self._period_s = step, period_s
        self._now = 0.0
        self._begun = 0.0
        self._steps = 0

    def now(self) -> float:
        """Seconds since the body was made."""
        return self._now

    def sleep_until(self, time_s: float) -> None:
        """Advance the simulation by the steps that are due."""
        self._now = max(self._now, time_s)
        due = math.floor((self._now - self._begun + ROUNDING_S) / self._period_s)
        while self._steps < due:
            self._steps += 1
            self._step()

    def begin_step(self) -> None:
        """The robot has been set down: its steps are counted from now on."""
        self._begun, self._steps = self._now, 0


@dataclass(frozen=True, kw_only=True)
class Channel:
    """A body's sensors of one kind.

    Args:
        name: "proximity" or "ambient".
        sensors: how many.
        low, high: the lowest and the highest count that one can read.

    Raises:
        UsageError: another name, no sensors, or an empty range.
    """

    name: str
    sensors: int
    low: int = 0
    high: int

    def __post_init__(self) -> None:
        if self.name not in KINDS:
            raise UsageError(f"channel: name: expected {' or '.join(KINDS)}, got {self.name!r}.")
        object.__setattr__(self, "sensors", as_count(self.sensors, f"channel {self.name!r}: sensors"))
        if not self.low < self.high:
            raise UsageError(
                f"channel {self.name!r}: high: expected more than {self.low}, got {self.high!r}."
            )


class Odometry(NamedTuple):
    """Readings of the wheels: counters in pulses, measured speeds in the robot's units; None: not asked."""

    counters: tuple[int, int] | None = None
    speeds: tuple[int, int] | None = None


class Body(ABC):
    """Sensors and wheels, wherever they are.

    Attributes:
        channels: the sensors that `sense` reads.
        period_s: time from one step to the next, s.
        clock: its own time: of a simulated body, say a `SteppedClock`; else the computer's.
        counts_turns: whether `odometry` has its wheels' counters.
        pulses_per_mm: of its counters, roughly: where the profile has none that were measured.
        speeds: (left, right) that its motors measured, as read with the last `sense`: of a body that does not
            count turns; the path, if nothing else gives it.
        pose: where it truly is: the path of a transfer, if no camera sees it; else the path is computed from
            its counters.
        read_at: when what `sense` gives arrived, by its clock: of a body whose line may miss a step.
        stalls: how long each stall of its line took so far, s, while its wheels stood: of a body whose line
            may stall.
        infrared_grid: (bearings, distances in cm) of the infrared's plan (`record`), if not the usual ones:
            of a body that is set down at many places in no time.
        infrared_objects: of its plan, if not both: of a body that knows of one only.
    """

    channels: tuple[Channel, ...]
    period_s: float = 0.1
    clock: Clock = RealClock()
    counts_turns: bool = False
    pulses_per_mm: float | None = None
    speeds: tuple[int, int] | None = None
    pose: Pose | None = None
    read_at: float | None = None
    stalls: Sequence[float] = ()
    infrared_grid: tuple[int, tuple[float, ...]] | None = None
    infrared_objects: tuple[str, ...] = ("wall", "cylinder")

    @abstractmethod
    def reset(self, pose: Pose | None = None) -> None:
        """Stand still, counters at zero, at `pose` (None: where it is)."""

    @abstractmethod
    def sense(self) -> Readings:
        """What the sensors read now, counts; empty for a kind that it lacks, or does not attend to."""

    @abstractmethod
    def act(self, command: Command) -> None:
        """Wheel speeds from now on, in the robot's own units."""

    @abstractmethod
    def stop(self) -> None:
        """Stop the wheels, and make sure of it."""

    def close(self) -> None:
        """Stop the wheels, and release the body."""
        self.stop()

    def abandon(self) -> None:
        """Release a body that has stopped, or can no longer be told to."""
        with suppress(Exception):  # whatever it is, a failure that came before is told
            self.close()

    @property
    def facts(self) -> Mapping[str, Any]:
        """What recordings say of it: "robot", its name if not the class's; "units" of its commands; "base",
        the shipped profile of what is known of it; "pulses_per_mm"."""
        return {} if self.pulses_per_mm is None else {"pulses_per_mm": self.pulses_per_mm}

    @property
    def odometry(self) -> Odometry:
        """As read with the last `sense`."""
        return Odometry(speeds=self.speeds)

    def attend(self, *kinds: str, turns: bool = True) -> None:
        """Read these kinds of sensors from now on, and counters and speeds too if `turns`: of a body that
        cannot read all of them in one period. Others are left alone."""
        return

    def pace(self, period_s: float) -> None:
        """Take steps of this length from now on: of a body that can, such as those whose loop the computer
        times. Others keep their `period_s`."""
        return

    def enter(self, room: Mapping[str, Any], seed: int, pose: Pose | None) -> None:
        """Stand in a room from now on, at `pose` (None: anywhere), its counters at zero: of a simulated body,
        which `reset(pose)` may set down again; else a person builds the room and carries the robot.

        The room is in plain numbers, cm: size_cm, cylinders [x, y, radius], walls [x, y, x, y] and lamps
        [x, y]; where surfaces differ also reflectance, of the walls and of each cylinder, 1 being usual.
        `seed` names the noise of what follows: the same seed, the same bits.
        """
        raise UsageError("robot: expected one that places itself, by `enter`.")

    def film(self, states: Path | None) -> None:
        """Write where it is, every 20 ms, into a sealed file for the camera above it; None ends it."""
        raise UsageError("robot: expected one with a camera above it, as a twin has.")

    def inspect(self) -> Mapping[str, Any]:
        """Try what else it has, for `robot check`; the results, by name."""
        return {}

    @property
    def places_itself(self) -> bool:
        """Whether it has an `enter`."""
        return type(self).enter is not Body.enter

    @property
    def is_filmed(self) -> bool:
        """Whether it has a `film`; then it also has a `unit` and a `noise`."""
        return type(self).film is not Body.film

    @property
    def knows_pose(self) -> bool:
        """Whether it has a `pose`."""
        return "pose" in vars(self) or type(self).pose is not Body.pose

    @property
    def measures_speeds(self) -> bool:
        """Whether it has `speeds`."""
        return "speeds" in vars(self) or type(self).speeds is not Body.speeds

    def known_pose(self) -> Pose:
        """Where it is in the midst of a drive.

        Raises:
            UsageError: it does not know.
        """
        pose = self.pose
        if pose is None:
            raise UsageError(
                "robot: expected its `pose` at every step of a drive, got None. A robot that loses its place "
                "needs a camera above it, counters or `speeds`, and no `pose`."
            )
        return pose

    def channel(self, kind: str) -> Channel:
        """Its channel of a kind.

        Raises:
            UsageError: it has none.
        """
        for one in self.channels:
            if one.name == kind:
                return one
        has = ", ".join(one.name for one in self.channels) or "none"
        raise UsageError(
            f"robot: expected {kind} sensors, which this one does not have (its channels: {has})."
        )

    def description(self) -> dict[str, Any]:
        """Its facts, with its name."""
        return {"robot": type(self).__name__, **self.facts}


def checked_readings(body: Body, read: Any) -> Readings:
    """What a body has sensed, as its channels say.

    Raises:
        UsageError: no Readings, of another shape, or counts that its sensors cannot have.
    """
    name = type(body).__name__
    if not isinstance(read, Readings):
        raise UsageError(f"{name}.sense: expected Readings, got {read!r}.")
    for kind in KINDS:
        counts = np.asarray(getattr(read, kind), np.float64)
        one = next((one for one in body.channels if one.name == kind), None)
        if counts.shape not in ((0,), (one.sensors if one else 0,)):
            wanted = f"{one.sensors} {kind} readings" if one else f"no {kind} readings"
            raise UsageError(f"{name}.sense: expected {wanted}, as its channels say, got {counts.shape}.")
        if one and not ((counts >= one.low) & (counts <= one.high)).all():
            raise UsageError(
                f"{name}.sense: expected {kind} counts from {one.low} to {one.high}, got {counts}."
            )
    return read


def opened(name: str, **_: Any) -> Body:
    """The body that `file.py:Class` or `module:Class` makes when it is called.

    Raises:
        UsageError: there is no such class, it fails, or it is not a body.
    """
    found, place = named_object(name, UsageError, "robot"), name.rpartition(":")[0]
    place = str(Path(place).expanduser().resolve()) if place.endswith(".py") else place
    if not callable(found):
        raise UsageError(f"robot: {name}: expected a class, or a function that makes a body, got {found!r}.")
    with blamed_on(place, UsageError, f"{name.rpartition(':')[2]}() fails"):
        body = found()
    if not isinstance(body, Body):
        raise UsageError(f"robot: {name}: expected a subclass of realitygap.robots.Body, got {body!r}.")
    if not body.channels or not 0.02 <= body.period_s <= 0.2:
        body.abandon()
        got = f"{body.channels!r} and {body.period_s!r}"
        raise UsageError(f"robot: {name}: expected channels, and a period_s from 0.02 to 0.2 (s), got {got}.")
    return body
