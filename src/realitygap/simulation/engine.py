"""What carries out batches of trials, and the engine of the processor's cores.

An engine is made of a task, a robot and a noise level; `Simulation(…, engine=Mine)` and
`realitygap.testing.EngineContract` take one of a user's own.
"""

import math
from collections.abc import Callable
from functools import cached_property
from threading import get_ident
from typing import Any, Protocol, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from realitygap.controller.network import check_networks
from realitygap.errors import TaskError, UsageError
from realitygap.kernels import batch
from realitygap.kernels.infrared import infrared
from realitygap.kernels.light import ambient
from realitygap.kernels.network import think
from realitygap.kernels.params import Networks, Path, Room, Trial, World
from realitygap.kernels.pointed import met
from realitygap.kernels.trial import move
from realitygap.kernels.work import Work, new_work, quiet
from realitygap.simulation.spread import drawn
from realitygap.tasks.scoring import CompiledScore
from realitygap.tasks.task import Task
from realitygap.values import Floats, shown
from realitygap.world.profile import Profile

__all__ = ["Cores", "Engine", "Streams"]

CHUNK = 64
"""Trials carried out before their scores are taken: bounds the memory of a batch."""
Streams = NDArray[np.uint64]
T = TypeVar("T")


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


class Cores:
    """The compiled kernels, one trial after the other.

    Attributes:
        robot, arena, trial, world, room: what the kernels and the score are told. The last three need a robot
            that has the sensors which the task feeds and can stand at its start: else a TaskError.
    """

    def __init__(self, task: Task, profile: Profile, noise: float) -> None:
        self.task, self.profile, self.noise = task, profile, noise
        self.robot, self.arena = profile.to_kernel(), task.arena.to_kernel()
        if profile.infrared.table:
            self._refuse_what_no_table_knows()
        self._scratch: dict[tuple[object, ...], Any] = {}

    @cached_property
    def trial(self) -> Trial:
        """The task's."""
        return self.task.to_kernel(self.profile)

    @cached_property
    def world(self) -> World:
        """All that trials happen in, with constants as the profile has them."""
        return World(robot=self.robot, arena=self.arena, task=self.trial, level=self.noise)

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

    @cached_property
    def room(self) -> Room:
        """What the score sees besides the path."""
        return self.task.room(self.profile)

    @cached_property
    def score(self) -> CompiledScore:
        """The task's, compiled."""
        return self.task.compiled_score()

    @property
    def _paths(self) -> Floats:
        return self._own("paths", (), lambda: np.zeros((CHUNK, len(Path._fields), self.trial.steps)))

    def scores(self, networks: Networks, streams: Streams) -> Floats:
        """As `Engine` has it."""
        which, flat = self.named(networks, streams)
        scores = np.empty(flat.shape[0])
        for first in range(0, flat.shape[0], CHUNK):
            some = slice(first, first + CHUNK)
            paths = self._paths[: len(flat[some])]
            self._run(networks, which[some], flat[some], paths)
            scores[some] = self.score.over(paths, self.room)
        self.require_finite(scores)
        return scores.reshape(streams.shape)

    def tracks(self, networks: Networks, streams: Streams) -> Path:
        """As `Engine` has it."""
        which, flat = self.named(networks, streams)
        paths = np.zeros((flat.shape[0], len(Path._fields), self.trial.steps))
        self._run(networks, which, flat, paths)
        return Path(*(paths[:, i].reshape(*streams.shape, paths.shape[2]) for i in range(paths.shape[1])))

    def compile(self) -> None:
        """Compile what evolution needs, or load it from the cache; the first time takes seconds."""
        nobody = quiet()
        none = np.zeros(0, np.int64), np.zeros(0, np.uint64)
        batch.run_trials(self.world, nobody, *none, self._paths, self.scratch(nobody))
        self.score.over(self._paths[:1], self.room)

    def compile_part(self, name: str) -> None:
        """Compile a part of the kernels alone: "light", or "near", all else but what encloses them."""
        robot, arena, nobody = self.robot, self.arena, quiet()
        work = self.scratch(nobody)
        sensing = (robot, arena, work, work.readings[:])
        calls: list[tuple[Any, tuple[object, ...]]] = [(ambient, sensing)]
        if name == "near":
            calls = [(infrared, sensing), (move, (robot, arena, work)), (think, (nobody, 0, work))]
        for part, arguments in calls:
            part.compile(tuple(met(numba.typeof(one)) for one in arguments))

    def scratch(self, networks: Networks) -> Work:
        """Scratch for networks of this size, kept for the next batch."""
        size = (networks.thresholds.shape[1], networks.links.shape[1])
        return self._own("work", size, lambda: new_work(self.robot, self.trial, networks))

    def _own(self, name: str, size: tuple[int, ...], make: Callable[[], T]) -> T:
        """Scratch of this thread's own."""
        key = name, get_ident(), *size
        if key not in self._scratch:
            self._scratch[key] = make()
        return cast("T", self._scratch[key])

    def require_finite_path(self, *arrays: Floats) -> None:
        """No path or reading that is not finite is ever a result."""
        if not all(math.isfinite(array.sum()) for array in arrays):
            raise UsageError(
                f"profile {self.profile.name!r} at noise {self.noise:g}: expected a finite path and finite "
                "readings, got some that are not. Look for a constant beyond all measure, or lower the noise."
            )

    def require_finite(self, scores: Floats) -> None:
        """Nor is a score."""
        if not np.isfinite(scores).all():
            bad = scores[~np.isfinite(scores)][0]
            raise TaskError(
                f"task {self.task.name!r}: expected its score to be a finite number, got {bad}. "
                "Look for a division by zero or a root of a negative number in the task's score."
            )

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

    def named(self, networks: Networks, streams: Streams) -> tuple[NDArray[np.int64], Streams]:
        """Which network each trial is of, and its stream; refuses what does not fit."""
        count = check_networks(networks, self.trial.channels.shape[0])
        fits = type(streams) is np.ndarray and streams.dtype == np.uint64 and streams.ndim == 2
        if not fits or len(streams) != count:
            expected = f"an array uint64[{count}, trials], a row for each network"
            raise UsageError(f"streams: expected {expected}, got {shown(streams)}.")
        return np.repeat(np.arange(count), streams.shape[1]), streams.reshape(-1)

    def _run(self, networks: Networks, which: NDArray[np.int64], streams: Streams, paths: Floats) -> None:
        work = self.scratch(networks)
        for world, some in self.worlds(streams):
            batch.run_trials(world, networks, which[some], streams[some], paths[some], work)
        self.require_finite_path(paths[: len(streams)])
