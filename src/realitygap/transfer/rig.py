"""A unit of the twin in a task's arena, with the camera above it: one rig for many trials.

    with Rig(load_task("avoidance"), profile, unit=1, folder_for_camera="cameras") as rig:
        track, recording = rig.drive(controller, stream=5, pose=Pose(x=25, y=25, heading=0.5))

A trial is a function of unit, noise, stream, pose and controller alone: before each the unit is
switched off and a new one on, in one process that serves them all.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from realitygap import temporary
from realitygap.kernels.params import STEP_S
from realitygap.kernels.rng import substream
from realitygap.robots.clock import VirtualClock
from realitygap.robots.khepera.body import KheperaBody
from realitygap.robots.khepera.driver import Khepera
from realitygap.robots.loop import Controller, drive
from realitygap.robots.recording import Recorder, Recording
from realitygap.streams import TWIN_NOISE
from realitygap.tasks.task import Task
from realitygap.track import Track
from realitygap.transfer.options import Robot
from realitygap.transfer.paths import of_track
from realitygap.values import Pose, Readings
from realitygap.world.profile import Profile

if TYPE_CHECKING:
    from realitygap.transfer.film import Watcher
    from realitygap.twin.process import TwinProcess
    from realitygap.twin.states import States

__all__ = ["Driven", "Rig", "driven"]

Floats = NDArray[np.float64]


class Driven(NamedTuple):
    """A drive on a robot: its recording and the wheels' counters at the steps, the end included."""

    recording: Recording
    counters: Floats


def driven(
    body: KheperaBody,
    controller: Controller,
    *,
    task: Task,
    profile: Profile,
    seconds: float,
    recorder: Recorder | None = None,
) -> Driven:
    """Let an evolved controller drive a robot, fed as its simulation fed it: with `profile`'s bands."""

    def inputs(readings: Readings) -> list[int]:
        fed = readings.proximity if task.feeds == "proximity" else readings.ambient
        return profile.inputs(fed.tolist(), task.feeds, task.of(profile).sensors)

    recording = drive(
        body,
        controller,
        seconds=seconds,
        clock=body.khepera.clock,
        inputs=inputs,
        recorder=recorder,
    )
    return Driven(recording, np.vstack([recording.counters, body.khepera.counters()]))


class Rig:
    """One unit in one task's arena. As a context it is closed; its process starts with the first drive.

    Args:
        task: whose arena, sensors and length.
        profile: the one that the controllers were evolved with: makes their inputs of counts.
        unit: which robot of the population.
        twin_noise: the twin's noise scale.
        folder_for_camera: keeps the camera's calibration, under a name of its own for each rig.
        baud: of the line.
        camera_file: keeps it instead.
    """

    def __init__(
        self,
        task: Task,
        profile: Profile,
        *,
        unit: int,
        twin_noise: float = 1.0,
        folder_for_camera: str | Path = ".",
        baud: int = 38400,
        camera_file: Path | None = None,
    ) -> None:
        self.task, self.profile, self.baud = task, profile, baud
        self.unit, self.twin_noise = unit, twin_noise
        name = f"camera-{task.name}-{Robot(unit=unit).folder(twin_noise)}.json"
        self.camera_file = Path(folder_for_camera) / name if camera_file is None else camera_file
        self._arena = task.arena.plain()
        self._twin: TwinProcess | None = None
        self._watcher: Watcher | None = None

    def drive(
        self, controller: Controller, stream: int, pose: Pose, seconds: float | None = None
    ) -> tuple[Track, Recording]:
        """A trial from a pose, driven through the serial line and seen by the camera: a row a step, the
        first one the start, and what was read and done.

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
        with temporary.Folder("sealed") as folder:
            sealed = Path(folder) / "sealed.csv"
            recording = self.on_line(controller, stream, pose, length, sealed=sealed).recording
            track = self.watcher.track(self.states(sealed, length), stream)
        return of_track(track, round(length / STEP_S)), recording

    def on_line(
        self,
        controller: Controller,
        stream: int,
        pose: Pose,
        seconds: float,
        *,
        recorder: Recorder | None = None,
        sealed: Path | None = None,
    ) -> Driven:
        """The drive alone; where the robot was goes into the file `sealed`, for the camera."""
        settings: dict[str, Any] = {"task": self.task, "profile": self.profile, "seconds": seconds}
        try:
            twin = self._fresh(int(substream(np.uint64(stream), np.uint64(TWIN_NOISE))))
            with closing(VirtualClock(twin.channel)) as clock:
                khepera = Khepera.connect(twin.device, baud=self.baud, clock=clock)
                try:
                    body = KheperaBody(khepera, kinds=(self.task.feeds,), carry=twin.place)
                    body.reset(pose)
                    clock.settle()
                    if sealed is not None:
                        twin.film(sealed)
                    made = driven(body, controller, recorder=recorder, **settings)
                    clock.settle()
                    if sealed is not None:
                        twin.film(None)
                finally:
                    khepera.abandon()
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
        """The camera above, which is calibrated when it is first needed."""
        from realitygap.transfer.film import Watcher

        if self._watcher is None:
            self._watcher = Watcher(
                self.camera_file,
                self.task.arena,
                unit=self.unit,
                noise=self.twin_noise,
                radius_cm=self.profile.body.radius_cm,
            )
        return self._watcher

    @property
    def twin(self) -> TwinProcess | None:
        """Its process, if there is one yet."""
        return self._twin

    def _fresh(self, seed: int) -> TwinProcess:
        """The unit as a process of its own would make it: no trial leaves it a trace."""
        from realitygap.twin.process import start_twin

        if self._twin is None:
            settings: dict[str, Any] = {"unit": self.unit, "noise": self.twin_noise, "seed": seed}
            self._twin = start_twin(self._arena, baud=self.baud, **settings)
        else:
            self._twin.renew(seed)
        return self._twin

    def close(self) -> None:
        """End the process and the camera."""
        self._leave()
        self._watcher = None

    def _leave(self) -> None:
        if self._twin is not None:
            self._twin.close()
            self._twin = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
