"""The simulated robot at a task: networks in, scores and trajectories out (§3.2)."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import TaskError, UsageError
from realitygap.kernels import batch
from realitygap.kernels.params import STEP_S, Networks, Path, Room, Trial
from realitygap.kernels.work import MOTOR_NOISE, Record, Work, new_work
from realitygap.values import Pose, Trajectory
from realitygap.world.noise import noise_level

if TYPE_CHECKING:
    from realitygap.tasks.task import Score, Task
    from realitygap.world.arena import Arena
    from realitygap.world.profile import Profile

__all__ = ["Simulation"]

CHUNK = 64
"""Trials carried out before their scores are taken: bounds the memory of a batch."""
Floats = NDArray[np.float64]
Streams = NDArray[np.uint64]


class Simulation:
    """A task, a robot and a noise level, ready to run; use one in each thread.

    Args:
        task: what is to be done, and where.
        profile: the robot.
        noise: zero, observed, double, or any level (1 = observed).
        arena: another arena than the task's.

    Probing needs only the room and the robot. Everything else needs a robot that has the sensors
    which the task feeds and can stand at its start: else a TaskError says what is missing.
    """

    def __init__(
        self, task: Task, profile: Profile, noise: str | float = 1.0, arena: Arena | None = None
    ) -> None:
        self.task = task if arena is None else replace(task, arena=arena)
        self.profile = profile
        self.noise = noise_level(noise)
        self._robot = profile.to_kernel()
        self._arena = self.task.arena.to_kernel()
        self._work: dict[tuple[int, int], Work] = {}

    @cached_property
    def _trial(self) -> Trial:
        return self.task.to_kernel(self.profile)

    @cached_property
    def _room(self) -> Room:
        return self.task.room(self.profile)

    @cached_property
    def _score(self) -> Score:
        return self.task.compiled_score()

    @cached_property
    def _paths(self) -> Floats:
        return np.zeros((CHUNK, len(Path._fields), self._trial.steps))

    @cached_property
    def _rows(self) -> list[Path]:
        return [Path(*rows) for rows in self._paths]

    def scores(self, networks: Networks, streams: Streams) -> Floats:
        """Scores of trials of N networks: streams [N, trials] → scores [N, trials].

        Each trial is a function of its network and its stream alone.

        Raises:
            TaskError: a score was not a finite number.
        """
        networks_n, trials = streams.shape
        which = np.repeat(np.arange(networks_n), trials)
        flat = streams.reshape(-1)
        scores = np.empty(flat.shape[0])
        work = self._scratch(networks)
        for first in range(0, flat.shape[0], CHUNK):
            some = flat[first : first + CHUNK]
            batch.run_trials(
                self._robot, self._arena, self._trial, networks, which[first : first + CHUNK],
                self.noise, some, self._paths, work,
            )  # fmt: skip
            for i in range(some.shape[0]):
                scores[first + i] = self._score(self._rows[i], self._room)
        self._require_finite(scores)
        return scores.reshape(streams.shape)

    def trajectory(
        self, networks: Networks, *, stream: int, pose: Pose | None = None, seconds: float | None = None
    ) -> tuple[Trajectory, float]:
        """One trial of one network, in full, and its score: the bits that `scores` goes by.

        Args:
            networks: one network.
            stream: the trial's stream.
            pose: where it starts; by default where the stream says.
            seconds: how long it lasts; by default the task's length.

        Raises:
            UsageError: the pose is not free, or the length is not positive.
        """
        steps = self._trial.steps if seconds is None else self._steps(seconds)
        robot, profile, inputs = self._robot, self.profile, self._trial.channels.shape[0]
        proximity_n, ambient_n = len(profile.infrared.sensors), len(profile.ambient.sensors)
        aside = np.zeros(ambient_n if self._trial.feed == 0 else proximity_n)
        record = Record(
            pose=np.zeros((steps, 3)), proximity=np.zeros((steps, proximity_n)),
            ambient=np.zeros((steps, ambient_n)), inputs=np.zeros((steps, inputs), np.int64),
            commands=np.zeros((steps, 2), np.int64), wheels=np.zeros((steps, 2)),
        )  # fmt: skip
        path = Path(*np.zeros((len(Path._fields), steps)))
        work = self._scratch(networks)
        self._place(work, self.start(stream) if pose is None else pose)
        batch.record_trial(
            robot, self._arena, self._trial._replace(steps=steps), networks, self.noise,
            np.uint64(stream), path, work, aside, _noise_for(aside.shape[0]), record,
        )  # fmt: skip
        score = np.array([self._score(path, self._room)])
        self._require_finite(score)
        return _trajectory(record, path), float(score[0])

    def start(self, stream: int) -> Pose:
        """Where a trial on this stream starts."""
        starts = np.zeros((1, 3))
        batch.draw_starts(self._trial, np.array([stream], np.uint64), starts)
        return Pose(x=float(starts[0, 0]), y=float(starts[0, 1]), heading=float(starts[0, 2]))

    def probe(self, pose: Pose, *, stream: int = 0, repeat: int = 1) -> tuple[Floats, Floats]:
        """What the robot's sensors read at a pose: proximity [repeat, P] and ambient [repeat, A].

        With noise as the robot reads them (whole counts); without, as the model gives them.
        """
        proximity_n, ambient_n = len(self.profile.infrared.sensors), len(self.profile.ambient.sensors)
        nothing_fed = Trial(steps=0, feed=0, channels=np.zeros(0, np.int64), start=np.zeros(5))
        work = new_work(self._robot, nothing_fed, _no_networks())
        self._place(work, pose)
        proximity, ambient = np.zeros((repeat, proximity_n)), np.zeros((repeat, ambient_n))
        streams = batch_streams(stream, repeat)
        noise = _noise_for(max(proximity_n, ambient_n))
        batch.probe(self._robot, self._arena, self.noise, streams, work, noise, proximity, ambient)
        return proximity, ambient

    def compile(self) -> None:
        """Compile what evolution needs, or load it from the cache; the first time takes seconds."""
        nobody = np.zeros(0, np.uint64)
        networks = _no_networks()
        batch.run_trials(
            self._robot, self._arena, self._trial, networks, np.zeros(0, np.int64), self.noise,
            nobody, self._paths, self._scratch(networks),
        )  # fmt: skip
        self._score(self._rows[0], self._room)

    def _scratch(self, networks: Networks) -> Work:
        size = (networks.thresholds.shape[1], networks.links.shape[1])
        if size not in self._work:
            self._work[size] = new_work(self._robot, self._trial, networks)
        return self._work[size]

    def _steps(self, seconds: float) -> int:
        steps = round(seconds / STEP_S) if math.isfinite(seconds) else 0
        if steps < 1 or abs(steps * STEP_S - seconds) > 1e-6:
            raise UsageError(
                f"seconds: expected a positive multiple of {STEP_S} (one step), got {seconds:g}."
            )
        return steps

    def _place(self, work: Work, pose: Pose) -> None:
        """Set the robot down, if nothing stands there."""
        if not all(math.isfinite(value) for value in (pose.x, pose.y, pose.heading)):
            raise UsageError(f"pose: expected finite numbers, got {pose.x} {pose.y} {pose.heading_deg}.")
        if not batch.is_clear(self._robot, self._arena, pose.x, pose.y):
            radius = self.profile.body.radius_cm
            arena = self.task.arena
            where = arena.obstacle_at(pose.x, pose.y, radius) or "an obstacle"
            raise UsageError(
                f"pose: expected a free place for a robot of radius {radius:g} cm in arena "
                f"{arena.name!r}, got ({pose.x:g}, {pose.y:g}) cm, which overlaps {where}. "
                f"The arena reaches from (0, 0) to ({arena.size_cm[0]:g}, {arena.size_cm[1]:g}) cm."
            )
        work.start[:] = pose.x, pose.y, pose.heading

    def _require_finite(self, scores: Floats) -> None:
        if not np.isfinite(scores).all():
            bad = scores[~np.isfinite(scores)][0]
            raise TaskError(
                f"task {self.task.name!r}: expected its score to be a finite number, got {bad}. "
                "Look for a division by zero or a root of a negative number in the task's score."
            )


def batch_streams(stream: int, count: int) -> Streams:
    """`count` streams under one: substream(stream, 0), substream(stream, 1), …"""
    from realitygap.kernels.rng import substream

    return np.array([substream(np.uint64(stream), i) for i in range(count)], np.uint64)


def _noise_for(sensors: int) -> Floats:
    return np.zeros(16 * ((sensors + MOTOR_NOISE + 15) // 16))


def _no_networks() -> Networks:
    return Networks(
        neurons=np.zeros(1, np.int64), thresholds=np.zeros((1, 2), np.int16),
        sensor_links=np.zeros((1, 1, 4), np.int16), sensor_count=np.zeros(1, np.int64),
        links=np.zeros((1, 1, 4), np.int16), link_start=np.zeros((1, 3), np.int16),
    )  # fmt: skip


def _trajectory(record: Record, path: Path) -> Trajectory:
    return Trajectory(
        t=np.arange(record.pose.shape[0], dtype=np.float64) * STEP_S,
        x=record.pose[:, 0],
        y=record.pose[:, 1],
        heading=record.pose[:, 2],
        proximity=record.proximity,
        ambient=record.ambient,
        inputs=record.inputs,
        commands=record.commands,
        wheels=record.wheels,
        contact=path.contact > 0,
        end=Pose(x=float(path.x[-1]), y=float(path.y[-1]), heading=float(path.heading[-1])),
    )
