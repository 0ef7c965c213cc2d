"""A drive of a robot by a controller, recorded; and a robot that places itself, rigged for many of them.

    with Rig(load_task("avoidance"), profile, robot="twin:1", folder_for_camera="cameras") as rig:
        track, recording = rig.drive(controller, stream=5, pose=Pose(x=25, y=25, heading=0.5))

A trial on the twin is a function of unit, noise, stream, pose and controller alone: before each the unit is
switched off and on again.
"""

import math
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from realitygap.errors import RealityGapError, UsageError
from realitygap.film.tag import Marker
from realitygap.kernels.rng import substream
from realitygap.robots.address import BAUD, Address
from realitygap.robots.body import Body, Odometry
from realitygap.robots.drive import Controller, Recorder, Recording, drive
from realitygap.robots.wire import STALL_S
from realitygap.streams import TWIN_NOISE
from realitygap.tasks.task import Task
from realitygap.track import Track, read_track, settled
from realitygap.transfer.camera import FPS, OverheadTracker
from realitygap.transfer.paths import of_counters, of_poses, of_track
from realitygap.values import Closing, Command, Floats, Pose, Readings, fed, steps_in
from realitygap.world.robot import Profile

__all__ = ["DriveRecord", "Rig", "driven", "turned"]

PLACED_CM, PLACED_RAD = 2.0, 0.17
"""A robot that places itself stands as near as this."""


class DriveRecord(NamedTuple):
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

    def path(self, start: Pose, task: Task, profile: Profile, *, wheels: bool = False) -> Track:
        """The path as reported by the robot itself; by its `wheels` if asked for, or if it reports none.

        Raises:
            UsageError: it leaves the task's arena, or is too fast for the profile's wheels; nothing was
                counted, or the length of a pulse is unknown.
        """
        if not self.poses or wheels:
            return self._counted(start, profile)
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

    def _counted(self, start: Pose, profile: Profile) -> Track:
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
) -> DriveRecord:
    """Drive a robot with an evolved controller as in simulation: with `profile`'s input range and units.

    Args:
        body: the robot, at its start.
        controller: the driver.
        task: for the fed sensors.
        profile: the one it was evolved with.
        seconds: length of the trial.
        recorder: records the steps.
    """
    poses, read, ended = list[Pose](), list[float](), list[Odometry]()
    sensors = task.of(profile).sensors
    seen = body if body.knows_pose else None

    def look() -> None:
        if seen is not None:
            poses.append(seen.known_pose())

    def inputs(readings: Readings) -> list[int]:
        read.append(body.clock.now())
        look()
        return profile.inputs(fed(readings, task.feeds).tolist(), task.feeds, sensors)

    def look_again() -> None:
        look()
        body.attend()
        body.sense()
        ended.append(body.odometry)

    body.attend(*task.kinds)
    scaled = Scaled(controller, profile)
    made = drive(body, scaled, seconds=seconds, inputs=inputs, recorder=recorder, at_end=look_again)
    last, unknown = ended[0], (np.nan, np.nan)
    counters = np.vstack([made.counters, last.counters or unknown])
    speeds = np.vstack([made.speeds, last.speeds or unknown])
    late = made.late[-1] if made.late[-1] <= body.period_s else 0.0  # as in the loop's schedule
    times = np.append(made.t, made.t[-1] - late + body.period_s)
    waited = np.array(read) - read[0] - (made.t - made.t[0])
    times[:-1] += np.where(waited > STALL_S, waited, 0.0)  # after a stall it was asked anew
    told = turned(body, profile, counters, speeds, times)
    return DriveRecord(made, *told, tuple(poses), body.period_s, times)


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
    """Rotation of the wheels, as in `DriveRecord`: `counters`, and the length of one (cm).

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


class Rig(Closing):
    """One robot in one task's arena; a context manager. The robot is opened with the first drive.

    Args:
        task: for arena, sensors and length.
        profile: the one that the controllers evolved with, for their inputs.
        robot: address of a robot that places itself.
        twin_noise: the twin's noise scale.
        folder_for_camera: for the camera's calibration, under a name of its own for each rig.
        baud: of the line.

    Attributes:
        camera_file: the camera's calibration; may be changed before the first drive.
        marker: what a twin wears, the shipped disk if None; may be changed before the first drive.
        filmed: whether a camera watches a simulated robot, or its track is where it was.
    """

    def __init__(
        self,
        task: Task,
        profile: Profile,
        *,
        robot: str | Address,
        twin_noise: float = 1.0,
        folder_for_camera: str | Path = ".",
        baud: int | None = BAUD,
    ) -> None:
        self.task, self.profile, self.baud = task, profile, baud
        self.robot = Address.parse(robot) if isinstance(robot, str) else robot
        self.twin_noise = twin_noise
        name = f"camera-{task.name}-{self.robot.folder(twin_noise)}.json"
        self.camera_file = Path(folder_for_camera) / name
        self.marker: Marker | None = None
        self.filmed = True
        self._arena = task.arena.plain()
        self._body: Body | None = None
        self._tracker: OverheadTracker | None = None

    def drive(
        self, controller: Controller, stream: int, pose: Pose, seconds: float | None = None
    ) -> tuple[Track, Recording]:
        """A trial from a pose: the track by the camera or as reported by the robot, a row a step from the
        start, and the recording.

        Args:
            controller: the driver.
            stream: of all of the trial's noise, the camera's too.
            pose: where it begins.
            seconds: its length, the task's own if None.

        Raises:
            UsageError: a pose where something stands, a wrong length.
            FilmError: the camera cannot be calibrated.
        """
        period_s = self.profile.period_s
        steps = steps_in(self.task.seconds if seconds is None else seconds, period_s)
        length = round(steps * period_s, 6)
        if self.robot.unit is None:
            made = self.trial(controller, stream, pose, length)
            return made.path(pose, self.task, self.profile), made.recording
        with tempfile.TemporaryDirectory(prefix="realitygap-") as folder:
            sealed = Path(folder) / "sealed.csv"
            recording = self.trial(controller, stream, pose, length, sealed=sealed).recording
            track = self.truth(sealed, length)
            track = self.tracker.track(track, stream) if self.filmed else _begun(track, pose)
        return of_track(track, steps, period_s=period_s), recording

    def trial(
        self,
        controller: Controller,
        stream: int,
        pose: Pose,
        seconds: float,
        *,
        recorder: Recorder | None = None,
        sealed: Path | None = None,
    ) -> DriveRecord:
        """The drive without the camera.

        Args:
            controller: the driver.
            stream: of the robot's noise.
            pose: where it begins.
            seconds: its length.
            recorder: records the steps.
            sealed: file for a twin's true states, for the camera.
        """
        settings: dict[str, Any] = {"task": self.task, "profile": self.profile, "seconds": seconds}
        try:
            body = self._fresh(int(substream(np.uint64(stream), np.uint64(TWIN_NOISE))))
            body.stop()
            body.reset(pose)
            if body.knows_pose:
                _refuse_elsewhere(body.known_pose(), pose)
            if sealed is not None and body.is_filmed:
                body.film(sealed)
            made = driven(body, controller, recorder=recorder, **settings)
            if sealed is not None and body.is_filmed:
                body.film(None)
        except BaseException:
            self._leave()  # its state is unknown
            raise
        return made

    def truth(self, sealed: Path, seconds: float) -> Track:
        """Where the robot was in a drive, as the camera is shown it: from the beginning, for its length, and
        on to the next picture of a film, before which the last step may end."""
        truth = read_track(sealed, seen_by="truth")
        end = truth.t[0] + math.ceil(seconds * FPS - 1e-6) / FPS
        truth = truth.only(truth.t <= end + 1e-6)
        if truth.t[-1] >= end - 1e-6:
            return truth
        stays = truth.only(np.append(np.arange(len(truth)), -1))  # as it was last written, it is shown
        return replace(stays, t=np.append(truth.t, end))

    @property
    def tracker(self) -> OverheadTracker:
        """The camera above a twin, calibrated when it is first needed."""
        if self._tracker is None:
            assert self.robot.unit is not None
            self._tracker = OverheadTracker(
                self.camera_file,
                self.task.arena,
                unit=self.robot.unit,
                noise=self.twin_noise,
                radius_cm=self.profile.body.radius_cm,
                marker=self.marker,
                period_s=self.profile.period_s,
            )
        return self._tracker

    @property
    def body(self) -> Body:
        """The robot, opened when it is first needed."""
        if self._body is None:
            self._body = self.robot.open(baud=self.baud, noise=self.twin_noise, kinds=self.task.kinds)
            self._body.pace(self.profile.period_s)
        return self._body

    def _fresh(self, seed: int) -> Body:
        """The robot in the arena with noise of a seed, unaffected by earlier trials."""
        if not self.body.places_itself:
            raise UsageError(f"robot {self.robot}: expected one that places itself, by `enter`.")
        self.body.enter(self._arena, seed, None)
        return self.body

    def close(self) -> None:
        """Release the robot and the camera."""
        self._tracker, body, self._body = None, self._body, None
        if body is not None:
            with suppress(RealityGapError):
                body.close()

    def _leave(self) -> None:
        body, self._body = self._body, None
        if body is not None:
            body.abandon()


def _begun(track: Track, pose: Pose) -> Track:
    """A true track from the moment the robot was let go: its first state was written some 40 ms later."""
    x, y = np.append(pose.x, track.x), np.append(pose.y, track.y)
    heading = np.append(pose.heading, track.heading)
    return replace(track, t=np.append(0.0, track.t), x=x, y=y, heading=heading)


def _refuse_elsewhere(told: Pose, asked: Pose) -> None:
    """Refuse a robot that is not where it was set down."""
    off = math.hypot(told.x - asked.x, told.y - asked.y)
    turned = abs(math.remainder(told.heading - asked.heading, math.tau))
    if off > PLACED_CM or turned > PLACED_RAD:
        raise UsageError(
            f"robot: pose: expected its start, ({asked.x:.1f}, {asked.y:.1f}) cm at {asked.heading:.2f} rad, "
            f"after reset(pose), got ({told.x:.1f}, {told.y:.1f}) at {told.heading:.2f}. Poses are in cm "
            "from the arena's lower left corner, and in radians."
        )
