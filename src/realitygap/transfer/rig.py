"""A robot that places itself, in a task's arena, and the camera above a twin: one rig for many trials.

    with Rig(load_task("avoidance"), profile, robot="twin:1", folder_for_camera="cameras") as rig:
        track, recording = rig.drive(controller, stream=5, pose=Pose(x=25, y=25, heading=0.5))

A trial on the twin is a function of unit, noise, stream, pose and controller alone: before each the unit is
switched off and on again.
"""

import math
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.errors import RealityGapError, UsageError
from realitygap.film.tag import Marker
from realitygap.kernels.rng import substream
from realitygap.robots.address import BAUD, Address
from realitygap.robots.body import Body
from realitygap.robots.drive import Controller, Recorder, Recording
from realitygap.streams import TWIN_NOISE
from realitygap.tasks.task import Task
from realitygap.track import Track, read_track
from realitygap.transfer.driven import Driven, driven
from realitygap.transfer.film import Watcher
from realitygap.transfer.paths import of_track
from realitygap.values import Closing, Pose
from realitygap.world.robot import Profile

__all__ = ["Rig"]

PLACED_CM, PLACED_RAD = 2.0, 0.17
"""A robot that places itself stands as near as this."""


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
        """A trial from a pose: the track by the camera or as reported by the robot, a row a step from the
        start, and the recording.

        Args:
            controller: the driver.
            stream: of all of the trial's noise, the camera's too.
            pose: where it begins.
            seconds: its length, the task's own if None.

        Raises:
            UsageError: a pose where something stands, a length that is not whole steps.
            FilmError: the camera cannot be calibrated.
        """
        length = self.task.seconds if seconds is None else seconds
        if self.robot.unit is None:
            made = self.trial(controller, stream, pose, length)
            track = made.known(self.task, self.profile) if made.poses else made.counted(pose, self.profile)
            return track, made.recording
        with tempfile.TemporaryDirectory(prefix="realitygap-") as folder:
            sealed = Path(folder) / "sealed.csv"
            recording = self.trial(controller, stream, pose, length, sealed=sealed).recording
            track = self.watcher.track(self.truth(sealed, length), stream)
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
        """Where the robot was in a drive, as the camera is shown it: from the beginning, for its length."""
        truth = read_track(sealed, seen_by="truth")
        return truth.only(truth.t <= truth.t[0] + seconds + 1e-6)

    @property
    def watcher(self) -> Watcher:
        """The camera above a twin, calibrated when it is first needed."""
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
        """The robot in the arena with noise of a seed, unaffected by earlier trials."""
        if not self.body.places_itself:
            raise UsageError(f"robot {self.robot}: expected one that places itself, by `enter`.")
        self.body.enter(self._arena, seed, None)
        return self.body

    def close(self) -> None:
        """Release the robot and the camera."""
        self._watcher, body, self._body = None, self._body, None
        if body is not None:
            with suppress(RealityGapError):
                body.close()

    def _leave(self) -> None:
        body, self._body = self._body, None
        if body is not None:
            body.abandon()


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
