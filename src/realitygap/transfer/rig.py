"""A robot that places itself, in a task's arena, and the camera above a twin: one rig for many trials.

    with Rig(load_task("avoidance"), profile, robot="twin:1", folder_for_camera="cameras") as rig:
        track, recording = rig.drive(controller, stream=5, pose=Pose(x=25, y=25, heading=0.5))

A trial on the twin is a function of unit, noise, stream, pose and controller alone: before each the unit
is switched off and a new one on, in one process that serves them all.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap import temporary
from realitygap.errors import UsageError
from realitygap.kernels.rng import substream
from realitygap.robots.address import BAUD, Address
from realitygap.robots.body import Body, Filmed, Paced, Placing, Seen, abandon, attend, odometry_of
from realitygap.robots.loop import Controller, drive
from realitygap.robots.recording import Recorder, Recording
from realitygap.streams import TWIN_NOISE
from realitygap.tasks.task import Task
from realitygap.track import Track
from realitygap.transfer.paths import of_counters, of_poses, of_track
from realitygap.values import Closing, Command, Pose, Readings, fed
from realitygap.world.profile import Profile

if TYPE_CHECKING:
    from collections.abc import Sequence

    from realitygap.film.marker import Marker
    from realitygap.transfer.film import Watcher
    from realitygap.twin.states import States

__all__ = ["Driven", "Rig", "driven", "turned"]

Floats = NDArray[np.float64]


class Driven(NamedTuple):
    """A drive on a robot: its recording, the wheels' counters at the steps, and its poses if it knows them,
    the end included.

    Attributes:
        counters: [steps + 1, 2] pulses, NaN where nothing was counted; of wheels whose speeds are measured
            instead, those times seconds.
        cm_per_pulse: of the left wheel and the right one, if anybody knows.
        poses: where it was; none of a robot that does not know.
        period_s: of a step.
    """

    recording: Recording
    counters: Floats
    cm_per_pulse: tuple[float, float] | None
    poses: tuple[Pose, ...]
    period_s: float

    @property
    def known(self) -> Track:
        """The path as the robot itself knows it."""
        return of_poses(self.poses, self.period_s)

    def counted(self, start: Pose, axle_cm: float) -> Track:
        """The path by the wheels' counters.

        Raises:
            UsageError: nobody knows how long a pulse is.
        """
        if self.cm_per_pulse is None:
            raise UsageError(
                "robot: expected the length of its pulses: calibrate its wheels, or give it `pulses_per_mm`."
            )
        pulse, period_s = self.cm_per_pulse, self.period_s
        return of_counters(self.counters, start, cm_per_pulse=pulse, axle_cm=axle_cm, period_s=period_s)


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
    """Let an evolved controller drive a robot as it drove the simulation's: fed by `profile`'s input range,
    commanding in its units.

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
    times = np.append(made.t, made.t[-1] + body.period_s)
    return Driven(made, *turned(body, profile, counters, speeds, times), tuple(poses), body.period_s)


def turned(
    body: Body, profile: Profile, counters: Floats, speeds: Floats, times: Floats
) -> tuple[Floats, tuple[float, float] | None]:
    """What the wheels have turned, as `Driven` has it: `counters`, and how long one of them is (cm).

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


class Rig(Closing):
    """One robot in one task's arena. As a context it is closed; the robot is opened with the first drive.

    Args:
        task: whose arena, sensors and length.
        profile: the one that the controllers were evolved with: makes their inputs of counts.
        robot: its address, of one that places itself.
        twin_noise: the twin's noise scale.
        folder_for_camera: keeps the camera's calibration, under a name of its own for each rig.
        baud: of the line.

    Attributes:
        camera_file: keeps the camera's calibration; another may be named before the first drive.
        marker: what a twin wears, the shipped disk if None; another may be named before the first drive.
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
        self._arena = task.arena.plain()
        self._body: Body | None = None
        self._watcher: Watcher | None = None

    def drive(
        self, controller: Controller, stream: int, pose: Pose, seconds: float | None = None
    ) -> tuple[Track, Recording]:
        """A trial from a pose, seen by the camera, or as the robot knows it: a row a step, the first one
        the start, and what was read and done.

        Args:
            controller: who drives.
            stream: names all of the trial's noise, the camera's too.
            pose: where it begins.
            seconds: its length, the task's own if None.

        Raises:
            UsageError: a pose where something stands, a length of no whole steps.
            FilmError: the camera cannot be calibrated.
        """
        length = self.task.seconds if seconds is None else seconds
        if self.robot.unit is None:
            made = self.trial(controller, stream, pose, length)
            track = made.known if made.poses else made.counted(pose, self.profile.wheels.track_cm)
            return track, made.recording
        with temporary.Folder("sealed") as folder:
            sealed = Path(folder) / "sealed.csv"
            recording = self.trial(controller, stream, pose, length, sealed=sealed).recording
            track = self.watcher.track(self.states(sealed, length), stream)
        period_s = self.profile.period_s
        return of_track(track, round(length / period_s), period_s=period_s), recording

    def trial(
        self,
        controller: Controller,
        stream: int,
        pose: Pose,
        seconds: float,
        *,
        recorder: Recorder | None = None,
        sealed: Path | None = None,
    ) -> Driven:
        """The drive alone; where a twin was goes into the file `sealed`, for the camera.

        Args:
            controller: who drives.
            stream: names the robot's noise.
            pose: where it begins.
            seconds: its length.
            recorder: keeps the steps.
            sealed: the file for the camera, if there is one.
        """
        settings: dict[str, Any] = {"task": self.task, "profile": self.profile, "seconds": seconds}
        try:
            body = self._fresh(int(substream(np.uint64(stream), np.uint64(TWIN_NOISE))))
            body.stop()
            body.reset(pose)
            if sealed is not None and isinstance(body, Filmed):
                body.film(sealed)
            made = driven(body, controller, recorder=recorder, **settings)
            if sealed is not None and isinstance(body, Filmed):
                body.film(None)
        except BaseException:
            self._leave()  # nobody knows how it stands
            raise
        return made

    def states(self, sealed: Path, seconds: float) -> States:
        """What the camera is shown of a drive: from its beginning for its length."""
        from realitygap.twin.states import States

        states = States.from_file(sealed)
        in_time = states.time_ms <= states.time_ms[0] + round(seconds * 1000)
        return States(states.time_ms[in_time], states.pose[in_time])

    @property
    def watcher(self) -> Watcher:
        """The camera above a twin, which is calibrated when it is first needed."""
        from realitygap.transfer.film import Watcher

        if self._watcher is None:
            assert self.robot.unit is not None
            self._watcher = Watcher(
                self.camera_file,
                self.task.arena,
                unit=self.robot.unit,
                noise=self.twin_noise,
                radius_cm=self.profile.body.radius_cm,
                marker=self.marker,
            )
        return self._watcher

    @property
    def body(self) -> Body:
        """The robot, opened when it is first needed."""
        if self._body is None:
            self._body = self.robot.open(baud=self.baud, noise=self.twin_noise, kinds=self.task.kinds)
        return self._body

    def _fresh(self, seed: int) -> Body:
        """The robot in the arena, its noise of a seed: no trial leaves it a trace."""
        if not isinstance(self.body, Placing):
            raise UsageError(f"robot {self.robot}: expected one that places itself, by `enter`.")
        self.body.enter(self._arena, seed, None)
        return self.body

    def close(self) -> None:
        """Let go of the robot and the camera."""
        self._leave()
        self._watcher = None

    def _leave(self) -> None:
        body, self._body = self._body, None
        if body is not None:
            abandon(body)
