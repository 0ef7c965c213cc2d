"""The simulated robot at a task: networks in, scores and trajectories out (§3.2).

Batches of trials run on a core, or on an engine: whatever has `scores`, `tracks` and `compile` and is made of
a task, a robot and a noise level. `realitygap.testing.EngineContract` tests one of a user's own.
"""

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from os import PathLike
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from realitygap.compiled import routine
from realitygap.control.encoding import count_networks
from realitygap.control.origin import origin_of
from realitygap.errors import TaskError, UsageError
from realitygap.kernels import trial as loop
from realitygap.kernels.rng import substream, uniform
from realitygap.kernels.trial import (
    NO_NETWORK,
    NO_RECORD,
    Record,
    Scratch,
    new_noise,
    new_record,
    new_scratch,
    unfed,
)
from realitygap.kernels.types import Networks, Path, Proximity, Robot, Room, Trial, World
from realitygap.streams import CONSTANTS
from realitygap.tasks.load import load_task
from realitygap.tasks.score import CompiledScore
from realitygap.tasks.task import MAX_INPUTS, Task
from realitygap.track import Trajectory
from realitygap.values import Floats, Pose, as_count, as_stream, shown, steps_in
from realitygap.world.arena import Arena, load_arena
from realitygap.world.robot import Profile, load_profile, noise_level
from realitygap.world.sensors import within_reach

__all__ = ["Engine", "Simulation", "Streams", "batch_streams", "drawn", "engine_named"]

CHUNK = 64
"""Trials carried out before their scores are taken: bounds the memory of a batch."""
LONGEST_S = 100_000
MOST_READINGS = 10**6
"""Limits on a trajectory's length and on one probe's repetitions."""
MOST_RAD = 1e6
"""Beyond, a heading has lost its digits."""
Streams = NDArray[np.uint64]


class Engine(Protocol):
    """Batches of trials; each trial is a function of its network and its stream alone."""

    def scores(self, networks: Networks, streams: Streams) -> Floats:
        """Scores of trials of N networks: streams [N, trials] → scores [N, trials].

        Raises:
            UsageError: networks of another task's layout, or streams that are not a row for each.
            TaskError: a score was not a finite number.
        """

    def tracks(self, networks: Networks, streams: Streams) -> Path:
        """What the scores are taken from: arrays [N, trials, steps] of where the robots were.

        Raises:
            UsageError: networks of another task's layout, or streams that are not a row for each.
        """

    def compile(self) -> None:
        """Compile what evolution needs, or load it from the cache; the first time takes seconds."""


MakeEngine = Callable[[Task, Profile, float], Engine]


def engine_named(name: str | MakeEngine) -> Any:
    """What makes the engine "cuda" (of a simulation) or one of one's own; None for "cores".

    Raises:
        UsageError: another name, or there is no GPU that it could use.
    """
    if callable(name):
        return name
    if not isinstance(name, str) or name not in ("cores", "cuda"):
        raise UsageError(f"engine: expected cores or cuda, got {name!r}.")
    if name == "cores":
        return None
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

    Attributes:
        robot, arena, trial, world, room, score: what the kernels are told, and the compiled score.

    Task, profile and arena may be given by name or file too.

    Probing needs only the room and the robot. Everything else needs a robot that has the sensors
    which the task feeds and can stand at its start: else a TaskError says what is missing.
    """

    def __init__(
        self,
        task: Task | str | PathLike[str],
        profile: Profile | str | PathLike[str] = "paper",
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
        self.robot, self.arena = self.profile.to_kernel(), self.task.arena.to_kernel()
        if self.profile.infrared.table:
            self._refuse_what_no_table_knows()
        self._scratch = _Scratch()
        make, made_of = engine_named(engine), (self.task, self.profile, self.noise)
        self.engine: Engine | None = make and (make(self) if engine == "cuda" else make(*made_of))

    def __setattr__(self, name: str, value: object) -> None:
        if name in vars(self):  # what follows from it is compiled or laid out
            raise UsageError(
                f"simulation.{name}: it cannot change. Make another: Simulation(task, profile, …)."
            )
        super().__setattr__(name, value)

    @cached_property
    def trial(self) -> Trial:
        """The task's, without its score."""
        return self.task.to_kernel(self.profile)

    @cached_property
    def world(self) -> World:
        """All that trials happen in, with constants as the profile has them."""
        return World(robot=self.robot, arena=self.arena, task=self.trial, level=self.noise)

    @cached_property
    def room(self) -> Room:
        """What the score sees besides the path."""
        return self.task.room(self.profile)

    @cached_property
    def score(self) -> CompiledScore:
        """The task's, compiled."""
        return self.task.compiled_score()

    def world_of(self, stream: int) -> World:
        """All that the trial on a stream happens in."""
        if not self.task.spread:
            return self.world
        return self.world._replace(robot=drawn(self.robot, stream, self.task.spread, self.task.spread_wheels))

    def worlds(self, streams: Streams) -> list[tuple[World, slice]]:
        """Those that trials happen in, and of each world its trials."""
        if not self.task.spread:
            return [(self.world, slice(None))]
        return [(world, slice(t, t + 1)) for t, world in enumerate(map(self.world_of, streams))]

    def scores(self, networks: Networks, streams: Streams) -> Floats:
        """Scores of trials of N networks: streams [N, trials] → scores [N, trials].

        Each trial is a function of its network and its stream alone. Streams [trials] are every network's.

        Raises:
            UsageError: networks of another task's layout, streams that are not a row for each, or an engine
                of one's own that answers with something else.
            TaskError: a score was not a finite number.
        """
        streams = self._rows(networks, streams)
        if self.engine is not None:
            scores = np.asarray(self.engine.scores(networks, streams))
            if not (scores.shape == streams.shape and np.isfinite(scores).all()):
                raise UsageError(
                    f"engine {type(self.engine).__name__}: expected finite scores "
                    f"float64{list(streams.shape)}, a row for each network, got {shown(scores)}."
                )
            return scores
        which, flat = self.checked(networks, streams)
        scores = np.empty(flat.shape[0])
        for first in range(0, flat.shape[0], CHUNK):
            some = slice(first, first + CHUNK)
            paths = self._paths[: len(flat[some])]
            self.run(loop.run_trials, networks, which[some], flat[some], paths, self.scratch(networks))
            scores[some] = self.score.over(paths, self.room)
        self.require_finite(scores)
        return scores.reshape(streams.shape)

    def tracks(self, networks: Networks, streams: Streams) -> Path:
        """What the scores of trials are taken from: streams [N, trials] → arrays [N, trials, steps]; streams
        [trials] are every network's.

        Raises:
            UsageError: as of `scores`.
        """
        streams = self._rows(networks, streams)
        if self.engine is None:
            which, flat = self.checked(networks, streams)
            paths = np.zeros((flat.shape[0], len(Path._fields), self.trial.steps))
            self.run(loop.run_trials, networks, which, flat, paths, self.scratch(networks))
            return Path(*(paths[:, i].reshape(*streams.shape, paths.shape[2]) for i in range(paths.shape[1])))
        return self.engine.tracks(networks, streams)

    def _rows(self, networks: Networks, streams: Any) -> Any:
        """Streams as `checked` takes them: whole numbers of other types, or one row for every network."""
        self._warn_of(networks)
        whole = isinstance(streams, np.ndarray) and streams.dtype.kind in "iu" and streams.ndim in (1, 2)
        if not whole or (streams.dtype.kind == "i" and (streams < 0).any()):
            return streams
        rows = streams if streams.ndim == 2 else np.tile(streams, (len(networks.inputs), 1))
        return rows.astype(np.uint64, copy=False)

    def _warn_of(self, networks: Networks) -> None:
        """Warn of networks that a study evolved at another task, or on other sensors."""
        origin = origin_of(networks) if isinstance(networks, Networks) else None
        if origin is not None:
            origin.warn(self.task.name, self.task.feeds)

    def checked(self, networks: Networks, streams: Streams) -> tuple[NDArray[np.int64], Streams]:
        """Which network each trial of a batch is of, and its stream.

        Raises:
            UsageError: networks of another task's layout, or streams that are not a row for each.
        """
        count = count_networks(networks, self.trial.channels.shape[0])
        fits = type(streams) is np.ndarray and streams.dtype == np.uint64 and streams.ndim == 2
        if not fits or len(streams) != count:
            expected = f"an array uint64[{count}, trials], a row for each network"
            raise UsageError(f"streams: expected {expected}, got {shown(streams)}.")
        return np.repeat(np.arange(count), streams.shape[1]), streams.reshape(-1)

    def run(
        self,
        run_trials: Any,
        brain: Any,
        which: NDArray[np.int64],
        streams: Streams,
        paths: Floats,
        scratch: Scratch,
        worlds: list[tuple[World, slice]] | None = None,
    ) -> None:
        """Carry out trials in this thread, as of `kernels.trial.run_each`; `run_trials` is compiled for the
        brain, `worlds` are those of the streams, if they are known."""
        for world, some in self.worlds(streams) if worlds is None else worlds:
            run_trials(world, brain, which[some], streams[some], paths[some], NO_RECORD, scratch)
        self.require_finite_path(paths)

    def scratch(self, networks: Networks, *, whole: bool = False) -> Scratch:
        """This thread's scratch for networks of this size, kept for its next batch; `whole`: also for sensors
        that feed none."""
        key, kept = (networks.thresholds.shape[1], networks.links.shape[1], whole), self._scratch.kept
        if key not in kept:
            kept[key] = new_scratch(self.robot, self.trial, networks, whole=whole)
        return kept[key]

    @property
    def _paths(self) -> Floats:
        """This thread's, of a chunk of trials."""
        if self._scratch.paths is None:
            self._scratch.paths = np.zeros((CHUNK, len(Path._fields), self.trial.steps))
        return self._scratch.paths

    def require_finite_path(self, *arrays: Floats) -> None:
        """Refuse a path or readings that are not finite."""
        if not all(math.isfinite(array.sum()) for array in arrays):
            raise UsageError(
                f"profile {self.profile.name!r} at noise {self.noise:g}: expected a finite path and finite "
                "readings, got some that are not. Look for a constant beyond all measure, or lower the noise."
            )

    def require_finite(self, scores: Floats) -> None:
        """Refuse scores that are not finite."""
        if not np.isfinite(scores).all():
            bad = scores[~np.isfinite(scores)][0]
            raise TaskError(
                f"task {self.task.name!r}: expected its score to be a finite number, got {bad}. "
                "Look for a division by zero or a root of a negative number in the task's score."
            )

    def trajectory(
        self,
        networks: Networks,
        *,
        stream: int = 0,
        pose: Pose | None = None,
        seconds: float | None = None,
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
        self._warn_of(networks)
        if count_networks(networks, self.trial.channels.shape[0]) != 1:
            raise UsageError(f"networks: expected one, got {len(networks.neurons)}. Decode one genotype.")
        steps = self.trial.steps if seconds is None else self.steps_of(seconds)
        world, task = self.world_of(stream), self.trial._replace(steps=steps)
        if pose is not None:  # a disc of starts that has no other place
            free = self.require_free(pose)
            task = task._replace(start=np.array([free.x, free.y, 0.0, free.heading, free.heading], float))
        scratch = self.scratch(networks, whole=True)
        record = new_record(self.robot, len(task.channels), steps)
        paths = np.zeros((1, len(Path._fields), steps))
        one = np.zeros(1, np.int64), np.array([as_stream(stream)]), paths
        loop.run_trials(world._replace(task=task), networks, *one, record, scratch)
        return self.told(record, Path(*paths[0]))

    def told(self, record: Record, path: Path) -> tuple[Trajectory, float]:
        """What a record of a trial tells, and its score."""
        self.require_finite_path(*path, record.proximity, record.ambient)
        score = np.array([self.score(path, self.room)])
        self.require_finite(score)
        x, y, heading = record.pose.T
        trajectory = Trajectory(
            t=np.arange(len(x), dtype=np.float64) * self.profile.period_s,
            x=x, y=y, heading=heading,
            proximity=record.proximity, ambient=record.ambient, inputs=record.inputs,
            commands=record.commands, wheels=record.wheels, contact=path.contact > 0,
            end=Pose.reached(float(path.x[-1]), float(path.y[-1]), float(path.heading[-1])),
            period_s=self.profile.period_s,
        )  # fmt: skip
        return trajectory, float(score[0])

    def start(self, stream: int) -> Pose:
        """Where a trial on this stream starts."""
        starts = np.zeros((1, 3))
        loop.draw_starts(self.trial, np.array([as_stream(stream)]), starts)
        return Pose(x=float(starts[0, 0]), y=float(starts[0, 1]), heading=float(starts[0, 2]))

    def probe(self, pose: Pose, *, stream: int = 0, repeat: int = 1) -> tuple[Floats, Floats]:
        """What the robot's sensors read at a pose: proximity [repeat, P] and ambient [repeat, A].

        With noise as the robot reads them (whole counts); without, as the model gives them.

        Raises:
            UsageError: the pose is not free, or `repeat` is no whole number from 1 to a million.
        """
        repeat = as_count(repeat, "repeat", most=MOST_READINGS)
        proximity_n, ambient_n = len(self.profile.infrared.sensors), len(self.profile.ambient.sensors)
        world = World(robot=self.robot, arena=self.arena, task=unfed(), level=self.noise)
        scratch, free = new_scratch(world.robot, world.task), self.require_free(pose)
        scratch.start[:] = free.x, free.y, free.heading
        proximity, ambient = np.zeros((repeat, proximity_n)), np.zeros((repeat, ambient_n))
        streams = batch_streams(stream, repeat)
        loop.probe(world, streams, scratch, new_noise(max(proximity_n, ambient_n)), proximity, ambient)
        self.require_finite_path(proximity, ambient)
        return proximity, ambient

    def compile(self) -> None:
        """Compile what evolution needs, or load it from the cache; the first time takes seconds."""
        if self.engine is not None:
            self.engine.compile()
            return
        none = np.zeros(0, np.int64), np.zeros(0, np.uint64)
        self.run(loop.run_trials, NO_NETWORK, *none, self._paths[:0], self.scratch(NO_NETWORK))
        self.score.over(self._paths[:1], self.room)

    def steps_of(self, seconds: float) -> int:
        """Of a trial of that length: it ends at the nearest one.

        Raises:
            UsageError: it is no length, or shorter than half a step.
        """
        number, period = isinstance(seconds, int | float | np.number), self.profile.period_s
        if not number or not period / 2 <= seconds <= LONGEST_S:
            expected = f"a number from {period:g} (one step) to {LONGEST_S}"
            raise UsageError(f"seconds: expected {expected}, got {seconds!r}.")
        return steps_in(seconds, period)

    def require_free(self, pose: object) -> Pose:
        """A pose at which nothing stands.

        Raises:
            UsageError: it is none, not finite, or the robot would stand in something.
        """
        if not isinstance(pose, Pose):
            cure = "Pose.from_degrees(25, 25, 90) makes one."
            raise UsageError(f"pose: expected a Pose, got {shown(pose)}. {cure}")
        if not all(map(math.isfinite, (pose.x, pose.y, pose.heading))):
            raise UsageError(f"pose: expected finite numbers, got {pose}.")
        place = float(pose.x), float(pose.y), float(pose.heading)
        if abs(place[2]) > MOST_RAD:
            raise UsageError(
                f"pose: expected a heading in radians, got {place[2]:g}. Pose.from_degrees takes degrees."
            )
        if not loop.is_clear(self.robot, self.arena, *place):
            radius = self.profile.body.radius_cm
            arena = self.task.arena
            where = arena.obstacle_at(pose.x, pose.y, radius) or "an obstacle"
            raise UsageError(
                f"pose: expected a free place for a robot of radius {radius:g} cm in arena "
                f"{arena.name!r}, got ({pose.x:g}, {pose.y:g}) cm, which overlaps {where}. "
                f"The arena reaches from (0, 0) to ({arena.size_cm[0]:g}, {arena.size_cm[1]:g}) cm."
            )
        return pose

    def _refuse_what_no_table_knows(self) -> None:
        """A look-up table has no constants to draw, and knows the surfaces that were recorded only."""
        where = f"profile {self.profile.name!r} has a look-up table (infrared.table); task {self.task.name!r}"
        if self.task.spread:
            raise TaskError(
                f"{where}: spread: expected 0, for a table has no constants to draw anew, got "
                f"{self.task.spread:g}. Leave the spread out, or calibrate in another form."
            )
        if len(self.arena.reflectance):
            raise TaskError(
                f"{where}: expected an arena without reflectances, for a table holds the surfaces that were "
                "recorded. Leave them out, or calibrate in another form."
            )


def batch_streams(stream: int, count: int) -> Streams:
    """`count` streams under one: substream(stream, 0), substream(stream, 1), …"""
    named = as_stream(stream)
    return np.array([substream(named, i) for i in range(count)], np.uint64)


class _Scratch(threading.local):
    """Arrays of one thread, by the size of its networks; they go with the thread."""

    def __init__(self) -> None:
        self.kept: dict[tuple[int, int, bool], Scratch] = {}
        self.paths: Floats | None = None

    def __reduce__(self) -> tuple[type, tuple[()]]:
        return _Scratch, ()


def drawn(robot: Robot, stream: int, spread: float, wheels: float | None = None) -> Robot:
    """The robot of one trial, its constants drawn anew within a spread (domain randomisation): a function of
    the trial's stream.

    Factors uniform in 1 ± spread, each drawn by itself: on what every proximity sensor gets back (its `a`),
    on every ambient sensor's gain, on each wheel's speed a unit, and on the track.

    Args:
        robot: the profile's.
        stream: the trial's.
        spread: 0 to below 1.
        wheels: that of wheels and track, if it is another.
    """
    many, light = len(robot.proximity.a), len(robot.ambient.gain)
    under = np.uint64(substream(np.uint64(stream), np.uint64(CONSTANTS)))
    draws = _draws(under, many + light + 3)
    shares = np.repeat([spread, spread if wheels is None else wheels], [many + light, 3])
    factors = 1.0 + shares * (2.0 * draws - 1.0)
    a, gain, turns, track = np.split(factors, [many, many + light, many + light + 2])
    near = robot.proximity
    own = within_reach(near.place, near.facing, _reach(near, a), near.a * a, near.b, near.offset)
    return robot._replace(
        proximity=near._replace(a=near.a * a, **own),
        ambient=robot.ambient._replace(gain=robot.ambient.gain * gain),
        wheels=robot.wheels._replace(
            speed_per_unit=robot.wheels.speed_per_unit * turns, track=robot.wheels.track * float(track[0])
        ),
    )


@routine
def _draws(stream: np.uint64, count: int) -> Floats:
    """[count] uniform, 0 to 1."""
    out = np.empty(count)
    for i in range(count):
        out[i] = uniform(stream, i)
    return out


def _reach(near: Proximity, factors: Floats) -> Floats:
    """How far sensors notice anything once more or less comes back: the d of the same a / ((d + o)² + w²)."""
    square = (near.reach + near.offset) ** 2 + near.width2
    far = np.sqrt(np.maximum(square * factors - near.width2, 0.0)) - near.offset
    end = 1.0 / near.least if near.least else np.inf
    reach: Floats = np.clip(far, 0.0, end)
    return reach
