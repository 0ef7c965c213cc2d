"""Bodies: sensors and wheels that a controller drives, simulated, twin or real, all alike.

A robot of your own is a class with these members, in any file (`--robot file.py:Class`). For example,
one with five sensors of 12 bits and no counters, which a person puts down:

    class Five:
        channels = (Channel(name="proximity", sensors=5, high=4095),)
        period_s = 0.1
        counts_turns = False

        def reset(self, pose=None): self.stop()
        def sense(self): return Readings(proximity=self.line.read(5), ambient=np.empty(0))
        def act(self, command): self.line.write(command.left, command.right)
        def stop(self): self.line.write(0, 0)
        def close(self): self.line.close()

Optional members are found by name:

    odometry    an `Odometry`, as read with the last `sense`: of a body that counts turns
    clock       its own time (`Timed`): of a simulated body, say a `SteppedClock`; else the computer's
    enter       enter(room, seed, pose) puts it into a room (`Placing`), where `reset(pose)` may set it
                down again: of a simulated body; else a person builds the room and carries the robot
    pose        where it truly is (`Seen`): the path of a transfer, if no camera sees it; else the
                path is computed from its counters
    speeds      (left, right) that its motors measured, as read with the last `sense` (`Paced`): of a
                body that does not count turns; the path, if nothing else tells it
    inspect     inspect() tries what else it has, for `robot check`; a dict (`Inspected`)
    pulses_per_mm   of its counters, roughly: where the profile has none that were measured
    facts       what recordings say of it: "robot", its name; "units" of its commands, "base", the shipped
                profile of what is known of it, and "pulses_per_mm"; your own needs no more
    read_at     when what `sense` gives arrived, by its clock: of a body whose line may miss a step
    infrared_grid   (bearings, distances in cm) of the infrared's plan (`record`), if not the usual ones: of a
                body that is set down at many places in no time
    attend      attend(kinds, turns) says which channels are read from now on (`Attentive`): of a
                body that cannot read all of them in one period
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

from realitygap.errors import RealityGapError, UsageError
from realitygap.robots.clock import Clock, RealClock
from realitygap.values import Command, Pose, Readings, as_count

__all__ = [
    "KINDS", "Attentive", "Body", "Channel", "Filmed", "Inspected", "Odometry", "Placing", "Seen", "Timed",
    "abandon", "attend", "channel", "clock_of", "facts_of", "known_pose", "odometry_of",
]  # fmt: skip

KINDS = ("proximity", "ambient")
"""The kinds of sensors that there are."""


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


class Body(Protocol):
    """Sensors and wheels, wherever they are."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The sensors that `sense` reads."""

    @property
    def period_s(self) -> float:
        """Time from one step to the next, s."""

    @property
    def counts_turns(self) -> bool:
        """Whether `odometry` tells the wheels' counters and speeds."""

    def reset(self, pose: Pose | None = None) -> None:
        """Stand still, counters at zero, at `pose` (None: where it is)."""

    def sense(self) -> Readings:
        """What the sensors read now, counts; empty for a kind that it lacks, or does not attend to."""

    def act(self, command: Command) -> None:
        """Wheel speeds from now on, in the robot's own units."""

    def stop(self) -> None:
        """Stop the wheels, and make sure of it."""

    def close(self) -> None:
        """Stop the wheels, and release the body."""


@runtime_checkable
class Timed(Protocol):
    """A body with its own time."""

    @property
    def clock(self) -> Clock:
        """The clock that it moves with."""


@runtime_checkable
class Placing(Protocol):
    """A body that needs no person to place it."""

    def enter(self, room: Mapping[str, Any], seed: int, pose: Pose | None) -> None:
        """Stand in a room from now on, at `pose` (None: anywhere), its counters at zero.

        The room is in plain numbers, cm: size_cm, cylinders [x, y, radius], walls [x, y, x, y] and lamps
        [x, y]; where surfaces differ also reflectance, of the walls and of each cylinder, 1 being usual.
        `seed` names the noise of what follows: the same seed, the same bits.
        """


@runtime_checkable
class Filmed(Protocol):
    """A unit of the twin, as the camera above it knows it."""

    unit: int
    noise: float

    def film(self, states: Path | None) -> None:
        """Write where it is, every 20 ms, into a sealed file for the camera; None ends it."""


@runtime_checkable
class Inspected(Protocol):
    """A body that has more to check than sensors and wheels."""

    def inspect(self) -> Mapping[str, Any]:
        """Try it; the results, by name."""


@runtime_checkable
class Seen(Protocol):
    """A body that knows where it is."""

    @property
    def pose(self) -> Pose:
        """Where it is now."""


@runtime_checkable
class Paced(Protocol):
    """A body that does not count its wheels' turns, but measures their speeds."""

    @property
    def speeds(self) -> tuple[int, int] | None:
        """Left and right, its own units, as read with the last `sense`; None before."""


@runtime_checkable
class Attentive(Protocol):
    """A body that reads only what is requested."""

    def attend(self, kinds: tuple[str, ...], turns: bool) -> None:
        """Read these kinds of sensors from now on, and counters and speeds too if `turns`."""


def clock_of(body: Body) -> Clock:
    """The body's own time; the computer's if it has none."""
    return body.clock if isinstance(body, Timed) else RealClock()


def facts_of(body: Body) -> Mapping[str, Any]:
    """What recordings say of it: "robot", which it is, and more."""
    return getattr(body, "facts", {"robot": type(body).__name__})


def odometry_of(body: Body) -> Odometry:
    """As read with the last `sense`; of a body that does not count, only speeds."""
    if body.counts_turns:
        return Odometry(*body.odometry)  # type: ignore[attr-defined]
    return Odometry(speeds=body.speeds if isinstance(body, Paced) else None)


def known_pose(body: Seen) -> Pose:
    """Where a body is in the midst of a drive.

    Raises:
        UsageError: it does not know.
    """
    told: Pose | None = body.pose
    if told is None:
        raise UsageError(
            "robot: expected its `pose` at every step of a drive, got None. A robot that loses its place "
            "needs a camera above it, counters or `speeds`, and no `pose`."
        )
    return told


def abandon(body: Body) -> None:
    """Release a body that has stopped, or can no longer be told to."""
    with suppress(RealityGapError):
        getattr(body, "abandon", body.close)()


def attend(body: Body, *kinds: str, turns: bool = True) -> None:
    """Read these kinds of sensors from now on; a body that reads all of them anyway is left alone."""
    if isinstance(body, Attentive):
        body.attend(kinds, turns)


def channel(body: Body, kind: str) -> Channel:
    """The body's channel of a kind.

    Raises:
        UsageError: it has none.
    """
    for one in body.channels:
        if one.name == kind:
            return one
    has = ", ".join(one.name for one in body.channels) or "none"
    raise UsageError(f"robot: expected {kind} sensors, which this one does not have (its channels: {has}).")
