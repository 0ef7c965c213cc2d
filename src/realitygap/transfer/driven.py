"""One drive of a robot by a controller: scaled as in the simulation, fed by its profile, recorded."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from realitygap.errors import UsageError
from realitygap.robots.body import Body, Odometry
from realitygap.robots.drive import Controller, Recorder, Recording, drive
from realitygap.simulation.body import SimulatedBody
from realitygap.tasks.task import Task
from realitygap.track import Track, settled
from realitygap.transfer.paths import of_counters, of_poses
from realitygap.values import Command, Floats, Pose, Readings, fed
from realitygap.world.robot import Profile

__all__ = ["Driven", "driven", "turned"]


class Driven(NamedTuple):
    """A drive on a robot: its recording, the wheels' counters at the steps, and its poses if it reports them,
    the end included.

    Attributes:
        counters: [steps + 1, 2] pulses, NaN where not counted; for wheels with measured speeds, speeds times
            seconds.
        cm_per_pulse: of the left and the right wheel, if known.
        poses: as reported; None for a robot that does not.
        period_s: of a step.
        t: [steps + 1] s, when each was read.
    """

    recording: Recording
    counters: Floats
    cm_per_pulse: tuple[float, float] | None
    poses: tuple[Pose, ...]
    period_s: float
    t: Floats

    def known(self, task: Task, profile: Profile) -> Track:
        """The path as reported by the robot itself.

        Raises:
            UsageError: it leaves the task's arena, or is too fast for the profile's wheels.
        """
        (width, depth), radius = task.arena.size_cm, profile.body.radius_cm
        x, y, heading = np.array([(at.x, at.y, at.heading) for at in self.poses]).T
        inside = (np.abs(x - width / 2) <= width / 2 + radius) & (np.abs(y - depth / 2) <= depth / 2 + radius)
        if not inside.all():
            k = int(np.argmin(inside))
            raise UsageError(
                f"robot: pose: expected a place in the task's arena of {width:g} by {depth:g} cm, got "
                f"x = {x[k]:g}, y = {y[k]:g}. Is it in another unit, or from another corner?"
            )
        turns = np.abs(settled(np.diff(heading))) * profile.wheels.track_cm / 2
        ways = np.maximum(np.hypot(np.diff(x), np.diff(y)), turns)
        _refuse_far(ways, self.t, profile, "pose", "Is it in another unit than cm and radians?")
        return of_poses(self.poses, self.period_s, self.t)

    def counted(self, start: Pose, profile: Profile) -> Track:
        """The path by the wheels' counters.

        Raises:
            UsageError: nothing was counted, the length of a pulse is unknown, or counters jump.
        """
        if self.cm_per_pulse is None or np.isnan(self.counters).all():
            uncounted = "a way to know where it is: its `pose`, counters, or `speeds` that it measures."
            pulses = "the length of its pulses: calibrate its wheels, or give it `pulses_per_mm`."
            raise UsageError(f"robot: expected {uncounted if np.isnan(self.counters).all() else pulses}")
        ways = np.nan_to_num(np.abs(np.diff(self.counters, axis=0) * self.cm_per_pulse)).max(axis=1)
        cure = "Do counters jump or wrap, or is `pulses_per_mm` or the unit of speeds another?"
        _refuse_far(ways, self.t, profile, "odometry", cure)
        return of_counters(
            self.counters, start, cm_per_pulse=self.cm_per_pulse, axle_cm=profile.wheels.track_cm,
            period_s=self.period_s, t=self.t,
        )  # fmt: skip


class Scaled:
    """A controller whose outputs −10 … 10 are scaled to a robot's commands, by its profile's top command."""

    def __init__(self, network: Controller, profile: Profile) -> None:
        self._network, self._wheels = network, profile.wheels

    def reset(self) -> None:
        self._network.reset()

    def decide(self, inputs: Sequence[int]) -> Command:
        given = self._network.decide(inputs)
        return Command(left=self._wheels.command(given.left), right=self._wheels.command(given.right))


def driven(
    body: Body,
    controller: Controller,
    *,
    task: Task,
    profile: Profile,
    seconds: float,
    recorder: Recorder | None = None,
) -> Driven:
    """Drive a robot with an evolved controller as in simulation: with `profile`'s input range and units.

    Args:
        body: the robot, at its start.
        controller: the driver.
        task: for the fed sensors.
        profile: the one it was evolved with.
        seconds: length of the trial.
        recorder: records the steps.
    """
    poses: list[Pose] = []
    ended: list[Odometry] = []
    sensors = task.of(profile).sensors
    seen = body if body.knows_pose else None

    def look() -> None:
        if seen is not None:
            poses.append(seen.known_pose())

    def inputs(readings: Readings) -> list[int]:
        look()
        return profile.inputs(fed(readings, task.feeds).tolist(), task.feeds, sensors)

    def look_again() -> None:
        look()
        body.attend()
        body.sense()
        ended.append(body.odometry)

    body.attend(*task.kinds)
    commands = controller if isinstance(body, SimulatedBody) else Scaled(controller, profile)
    made = drive(body, commands, seconds=seconds, inputs=inputs, recorder=recorder, at_end=look_again)
    last, unknown = ended[0], (np.nan, np.nan)
    counters = np.vstack([made.counters, last.counters or unknown])
    speeds = np.vstack([made.speeds, last.speeds or unknown])
    late = made.late[-1] if made.late[-1] <= body.period_s else 0.0  # as in the loop's schedule
    times = np.append(made.t, made.t[-1] - late + body.period_s)
    told = turned(body, profile, counters, speeds, times)
    return Driven(made, *told, tuple(poses), body.period_s, times)


def _refuse_far(ways: Floats, t: Floats, profile: Profile, what: str, cure: str) -> None:
    """Refuse ways (cm) from one row to the next that are longer than wheels can have driven."""
    wheels = profile.wheels
    most = 1.0 + 3.0 * wheels.top_command * max(wheels.speed_per_unit_cm_s) * np.diff(t)
    if (ways > most).any():
        k = int(np.argmax(ways > most))
        raise UsageError(
            f"robot: {what}: expected at most {most[k]:.1f} cm of a wheel from one step to the next, got "
            f"{ways[k]:.1f} at step {k + 1}. {cure}"
        )


def turned(
    body: Body, profile: Profile, counters: Floats, speeds: Floats, times: Floats
) -> tuple[Floats, tuple[float, float] | None]:
    """Rotation of the wheels, as in `Driven`: `counters`, and the length of one (cm).

    Args:
        body: whose wheels.
        profile: its values take precedence over the body's own.
        counters, speeds: [rows, 2] as read, in the body's units, NaN where missing.
        times: [rows] s.
    """
    if not body.counts_turns and body.measures_speeds:
        ways = np.cumsum((speeds[1:] + speeds[:-1]) / 2 * np.diff(times)[:, None], axis=0)
        return np.vstack([np.zeros(2), ways]), profile.wheels.speed_per_unit_cm_s
    told, nominal = profile.provenance, body.pulses_per_mm
    known = told.pulses_per_mm or nominal is not None
    return counters, told.cm_per_pulse(1.0 if nominal is None else nominal) if known else None
