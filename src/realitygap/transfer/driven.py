"""A controller drives a robot once: scaled as it was in the simulation, fed by its profile, logged."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from realitygap.errors import UsageError
from realitygap.robots.body import Body, Paced, Seen, attend, odometry_of
from realitygap.robots.loop import Controller, drive
from realitygap.robots.recording import Recorder, Recording
from realitygap.tasks.task import Task
from realitygap.track import Track
from realitygap.transfer.paths import of_counters, of_poses
from realitygap.values import Command, Floats, Pose, Readings, fed
from realitygap.world.profile import Profile

__all__ = ["Driven", "driven", "turned"]


class Driven(NamedTuple):
    """A drive on a robot: its recording, the wheels' counters at the steps, and its poses if it knows them,
    the end included.

    Attributes:
        counters: [steps + 1, 2] pulses, NaN where nothing was counted; of wheels whose speeds are measured
            instead, those times seconds.
        cm_per_pulse: of the left wheel and the right one, if known.
        poses: where it was; None for a robot that does not know.
        period_s: of a step.
        t: [steps + 1] s, when each was read.
    """

    recording: Recording
    counters: Floats
    cm_per_pulse: tuple[float, float] | None
    poses: tuple[Pose, ...]
    period_s: float
    t: Floats

    @property
    def known(self) -> Track:
        """The path as reported by the robot itself."""
        return of_poses(self.poses, self.period_s, self.t)

    def counted(self, start: Pose, axle_cm: float) -> Track:
        """The path by the wheels' counters.

        Raises:
            UsageError: the length of a pulse is unknown.
        """
        if self.cm_per_pulse is None:
            raise UsageError(
                "robot: expected the length of its pulses: calibrate its wheels, or give it `pulses_per_mm`."
            )
        return of_counters(
            self.counters, start, cm_per_pulse=self.cm_per_pulse, axle_cm=axle_cm, period_s=self.period_s,
            t=self.t,
        )  # fmt: skip


class Scaled:
    """A controller whose outputs −10 … 10 become a robot's commands, up to its profile's top command."""

    def __init__(self, network: Controller, profile: Profile) -> None:
        self._network, self._wheels = network, profile.wheels

    def reset(self) -> None:
        """Before a trial."""
        self._network.reset()

    def decide(self, inputs: Sequence[int]) -> Command:
        """One step."""
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
    """Drive a robot with an evolved controller as it drove the simulation's: fed by `profile`'s input range,
    commanding in its units. The robot is at its start; a recorder keeps the steps.

    Args:
        body: the robot, at its start.
        controller: who drives.
        task: which sensors it is fed.
        profile: the one it was evolved with.
        seconds: length of the trial.
        recorder: keeps the steps.
    """
    poses: list[Pose] = []
    sensors = task.of(profile).sensors
    seen = body if isinstance(body, Seen) else None

    def look() -> None:
        if seen is not None:
            poses.append(seen.pose)

    def inputs(readings: Readings) -> list[int]:
        look()
        return profile.inputs(fed(readings, task.feeds).tolist(), task.feeds, sensors)

    attend(body, *task.kinds)
    made = drive(body, Scaled(controller, profile), seconds=seconds, inputs=inputs, recorder=recorder)
    look()
    attend(body)
    body.sense()
    last, unknown = odometry_of(body), (np.nan, np.nan)
    counters = np.vstack([made.counters, last.counters or unknown])
    speeds = np.vstack([made.speeds, last.speeds or unknown])
    late = made.late[-1] if made.late[-1] <= body.period_s else 0.0  # as the loop's time-table has it
    times = np.append(made.t, made.t[-1] - late + body.period_s)
    return Driven(made, *turned(body, profile, counters, speeds, times), tuple(poses), body.period_s, times)


def turned(
    body: Body, profile: Profile, counters: Floats, speeds: Floats, times: Floats
) -> tuple[Floats, tuple[float, float] | None]:
    """What the wheels have turned, as in `Driven`: `counters`, and how long one of them is (cm).

    Args:
        body: whose wheels.
        profile: what is known of them, before what the body itself says.
        counters, speeds: [rows, 2] as read, in the body's units, NaN where they were not.
        times: [rows] when, s.
    """
    if not body.counts_turns and isinstance(body, Paced):
        ways = np.cumsum((speeds[1:] + speeds[:-1]) / 2 * np.diff(times)[:, None], axis=0)
        return np.vstack([np.zeros(2), ways]), profile.wheels.speed_per_unit_cm_s
    told, nominal = profile.provenance, getattr(body, "pulses_per_mm", None)
    known = told.pulses_per_mm or nominal is not None
    return counters, told.cm_per_pulse(nominal or 1.0) if known else None
