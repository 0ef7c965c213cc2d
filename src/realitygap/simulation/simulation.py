"""The simulated robot at a task: networks in, scores and trajectories out (§3.2)."""

import math
from collections.abc import Callable
from dataclasses import replace
from numbers import Real
from os import PathLike

import numpy as np

from realitygap.controller.layout import Layout
from realitygap.controller.network import check_networks
from realitygap.errors import UsageError
from realitygap.kernels import batch
from realitygap.kernels.params import Networks, Path, World
from realitygap.kernels.rng import substream
from realitygap.kernels.work import (
    Record,
    Work,
    new_aside,
    new_noise,
    new_work,
    quiet,
    unfed,
)
from realitygap.simulation.engine import Cores, Engine, Streams
from realitygap.tasks.load import load_task
from realitygap.tasks.task import MAX_INPUTS, Task
from realitygap.track import Trajectory
from realitygap.values import Floats, Pose, as_count, as_stream, shown
from realitygap.world.arena import Arena, load_arena
from realitygap.world.noise import noise_level
from realitygap.world.profile import Profile, load_profile

__all__ = ["Simulation", "engine_named"]

LONGEST_S = 100_000
MOST_READINGS = 10**6
"""Limits on a trajectory's length and on one probe's repetitions."""
MOST_RAD = 1e6
"""Beyond, a heading has lost its digits."""
MakeEngine = Callable[[Task, Profile, float], Engine]


def engine_named(name: str | MakeEngine) -> MakeEngine:
    """What makes the engine "cores" or "cuda", or one of one's own.

    Raises:
        UsageError: another name, or there is no GPU that it could use.
    """
    if callable(name):
        return name
    if not isinstance(name, str) or name not in ("cores", "cuda"):
        raise UsageError(f"engine: expected cores or cuda, got {name!r}.")
    if name == "cores":
        return Cores
    from realitygap.simulation.cuda import Cuda, require_gpu

    require_gpu()
    return Cuda


class Simulation:
    """A task, a robot and a noise level, ready to run; none of them can change.

    Args:
        task: what is to be done, and where.
        profile: the robot.
        noise: zero, observed, double, or any level (1 = observed).
        arena: another arena than the task's.
        engine: what carries out batches: "cores", "cuda" (an NVIDIA GPU; in each thread another), or whatever
            makes one of task, profile and noise.

    Task, profile and arena may be given by name or file too.

    Probing needs only the room and the robot. Everything else needs a robot that has the sensors
    which the task feeds and can stand at its start: else a TaskError says what is missing.
    """

    def __init__(
        self,
        task: Task | str | PathLike[str],
        profile: Profile | str | PathLike[str],
        noise: str | float = 1.0,
        arena: Arena | str | PathLike[str] | None = None,
        engine: str | MakeEngine = "cores",
    ) -> None:
        task = load_task(task)
        self.profile = load_profile(profile)
        if len(self.profile.bands(task.feeds)) <= MAX_INPUTS:  # else it can still be probed
            task = task.of(self.profile)
        self.task = task if arena is None else replace(task, arena=load_arena(arena))
        self.noise = noise_level(noise)
        self._cores = Cores(self.task, self.profile, self.noise)
        make = engine_named(engine)
        self.engine = self._cores if make is Cores else make(self.task, self.profile, self.noise)
        lacking = [way for way in ("scores", "tracks", "compile") if not hasattr(self.engine, way)]
        if lacking:
            raise UsageError(f"engine: got {shown(self.engine)}, which has no {', '.join(lacking)}.")

    def __setattr__(self, name: str, value: object) -> None:
        if name in vars(self):  # what follows from it is compiled or laid out
            raise UsageError(
                f"simulation.{name}: it cannot change. Make another: Simulation(task, profile, …)."
            )
        super().__setattr__(name, value)

    @property
    def layout(self) -> Layout:
        """Of a genotype for the task and the robot.

        Raises:
            TaskError: the robot lacks what the task needs.
        """
        return Layout(inputs=len(self._cores.trial.channels))

    def scores(self, networks: Networks, streams: Streams) -> Floats:
        """Scores of trials of N networks: streams [N, trials] → scores [N, trials].

        Each trial is a function of its network and its stream alone.

        Raises:
            UsageError: networks of another task's layout, streams that are not a row for each, or an engine
                of one's own that answers with something else.
            TaskError: a score was not a finite number.
        """
        found = self.engine.scores(networks, streams)
        self._require("scores", found, streams.shape)
        return found

    def tracks(self, networks: Networks, streams: Streams) -> Path:
        """What the scores of trials are taken from: streams [N, trials] → arrays [N, trials, steps].

        Raises:
            UsageError: as of `scores`.
        """
        found = self.engine.tracks(networks, streams)
        if not isinstance(found, Path):
            raise UsageError(
                f"engine {type(self.engine).__name__}: expected tracks as a Path, got {shown(found)}."
            )
        for name, one in zip(Path._fields, found, strict=True):
            self._require(f"tracks' {name}", one, (*streams.shape, self._cores.trial.steps))
        return found

    def _require(self, what: str, found: object, shape: tuple[int, ...]) -> None:
        """No engine of one's own is taken at its word."""
        fits = isinstance(found, np.ndarray) and found.dtype == np.float64 and found.shape == shape
        if not (fits and np.isfinite(found).all()):  # type: ignore[call-overload]
            came = "some that are not" if fits else shown(found)
            raise UsageError(
                f"engine {type(self.engine).__name__}: expected finite {what} float64{list(shape)}, a row "
                f"for each network, got {came}."
            )

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
            UsageError: more than one network, another task's, a pose that is not free, a wrong length.
        """
        if check_networks(networks, self._cores.trial.channels.shape[0]) != 1:
            raise UsageError(f"networks: expected one, got {len(networks.neurons)}. Decode one genotype.")
        named = as_stream(stream)
        steps = self._cores.trial.steps if seconds is None else self._steps(seconds)
        world, record = self._cores.world_of(stream), self._blank(steps)
        work = self._cores.scratch(networks)
        self._place(work, self.start(stream) if pose is None else pose)
        world = world._replace(task=world.task._replace(steps=steps))
        batch.record_trial(world, networks, named, work, new_aside(world.robot, world.task), record)
        return self._lived(record)

    def _blank(self, steps: int) -> Record:
        return Record(
            path=Path(*np.zeros((len(Path._fields), steps))), pose=np.zeros((steps, 3)),
            proximity=np.zeros((steps, len(self.profile.infrared.sensors))),
            ambient=np.zeros((steps, len(self.profile.ambient.sensors))),
            inputs=np.zeros((steps, len(self.task.sensors)), np.int64),
            commands=np.zeros((steps, 2), np.int64), wheels=np.zeros((steps, 2)),
        )  # fmt: skip

    def _lived(self, record: Record) -> tuple[Trajectory, float]:
        """What a record tells, and its score."""
        path = record.path
        self._cores.require_finite_path(*path, record.proximity, record.ambient)
        score = np.array([self._cores.score(path, self._cores.room)])
        self._cores.require_finite(score)
        trajectory = Trajectory(
            t=np.arange(record.pose.shape[0], dtype=np.float64) * self.profile.period_s,
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
        return trajectory, float(score[0])

    def start(self, stream: int) -> Pose:
        """Where a trial on this stream starts."""
        starts = np.zeros((1, 3))
        batch.draw_starts(self._cores.trial, np.array([as_stream(stream)]), starts)
        return Pose(x=float(starts[0, 0]), y=float(starts[0, 1]), heading=float(starts[0, 2]))

    def probe(self, pose: Pose, *, stream: int = 0, repeat: int = 1) -> tuple[Floats, Floats]:
        """What the robot's sensors read at a pose: proximity [repeat, P] and ambient [repeat, A].

        With noise as the robot reads them (whole counts); without, as the model gives them.

        Raises:
            UsageError: the pose is not free, or `repeat` is no whole number from 1 to a million.
        """
        repeat = as_count(repeat, "repeat", most=MOST_READINGS)
        proximity_n, ambient_n = len(self.profile.infrared.sensors), len(self.profile.ambient.sensors)
        world = World(robot=self._cores.robot, arena=self._cores.arena, task=unfed(), level=self.noise)
        work = new_work(world.robot, world.task, quiet())
        self._place(work, pose)
        proximity, ambient = np.zeros((repeat, proximity_n)), np.zeros((repeat, ambient_n))
        streams = batch_streams(stream, repeat)
        batch.probe(world, streams, work, new_noise(max(proximity_n, ambient_n)), proximity, ambient)
        self._cores.require_finite_path(proximity, ambient)
        return proximity, ambient

    def compile(self) -> None:
        """Compile what evolution needs, or load it from the cache; the first time takes seconds."""
        self.engine.compile()

    def _steps(self, seconds: float) -> int:
        number = isinstance(seconds, int | float) and 0 < seconds <= LONGEST_S
        period = self.profile.period_s
        steps = round(seconds / period) if number else 0
        if steps < 1 or abs(steps * period - seconds) > 1e-6:
            expected = f"a positive multiple of {period:g} (one step), {LONGEST_S} at most"
            raise UsageError(f"seconds: expected {expected}, got {seconds!r}.")
        return steps

    def require_free(self, pose: object) -> Pose:
        """A pose at which nothing stands.

        Raises:
            UsageError: it is none, not finite, or the robot would stand in something.
        """
        if not isinstance(pose, Pose):
            cure = "Pose.from_degrees(25, 25, 90) makes one."
            raise UsageError(f"pose: expected a Pose, got {shown(pose)}. {cure}")
        numbers: tuple[object, ...] = pose.x, pose.y, pose.heading
        plain = all(isinstance(one, Real) and not isinstance(one, bool) for one in numbers)
        place = tuple(map(float, numbers)) if plain else (math.nan,)  # type: ignore[arg-type]
        if not all(map(math.isfinite, place)):
            raise UsageError(f"pose: expected finite numbers, got {pose}.")
        if abs(place[2]) > MOST_RAD or (abs(place[2]) > math.tau and place[2].is_integer()):
            raise UsageError(
                f"pose: expected a heading in radians, got {place[2]:g}. Pose.from_degrees takes degrees."
            )
        if not batch.is_clear(self._cores.robot, self._cores.arena, *place):
            radius = self.profile.body.radius_cm
            arena = self.task.arena
            where = arena.obstacle_at(pose.x, pose.y, radius) or "an obstacle"
            raise UsageError(
                f"pose: expected a free place for a robot of radius {radius:g} cm in arena "
                f"{arena.name!r}, got ({pose.x:g}, {pose.y:g}) cm, which overlaps {where}. "
                f"The arena reaches from (0, 0) to ({arena.size_cm[0]:g}, {arena.size_cm[1]:g}) cm."
            )
        return pose

    def _place(self, work: Work, pose: object) -> None:
        free = self.require_free(pose)
        work.start[:] = free.x, free.y, free.heading


def batch_streams(stream: int, count: int) -> Streams:
    """`count` streams under one: substream(stream, 0), substream(stream, 1), …"""
    named = as_stream(stream)
    return np.array([substream(named, i) for i in range(count)], np.uint64)
