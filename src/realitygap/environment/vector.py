"""Many simulated robots as one vector environment of Gymnasium: a compiled step for all of them."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from os import PathLike
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from realitygap.errors import TaskError, UsageError
from realitygap.kernels import trial as loop
from realitygap.kernels.network import LIMIT
from realitygap.kernels.rng import substream
from realitygap.kernels.trial import new_robots, new_scratch
from realitygap.kernels.types import Path, World
from realitygap.simulation.simulation import Simulation
from realitygap.tasks.load import load_task
from realitygap.tasks.score import CompiledScore
from realitygap.tasks.task import Task
from realitygap.values import Floats, Pose, as_count, as_stream
from realitygap.world.arena import Arena, load_arena
from realitygap.world.robot import Profile

__all__ = [
    "SETTINGS", "Info", "RobotVectorEnv", "checked_options", "commands_of", "observations_of", "pose_of",
    "require_same", "spaces_of",
]  # fmt: skip

Info = dict[str, Any]
SETTINGS = ("noise", "profile")
"""What a reset may change."""
NOWHERE, STILL = np.zeros((0, 3)), np.zeros((0, 2))
"""No robot begins; none is commanded."""


def spaces_of(simulation: Simulation) -> tuple[Any, Any]:
    """Of one robot's observations and actions."""
    sensors = len(simulation.task.sensors)
    return Box(-1.0, 1.0, (sensors,), np.float32), Box(-1.0, 1.0, (2,), np.float32)


def checked_options(options: Info | None, known: set[str]) -> Info:
    """A reset's options, as a copy.

    Raises:
        UsageError: an unknown option.
    """
    given = dict(options or {})
    if strange := given.keys() - known:
        expected = ", ".join(sorted(known))
        raise UsageError(f"options: expected {expected}, got {', '.join(map(str, strange))}.")
    return given


def require_same(simulation: Simulation, space: Any) -> None:
    """Refuse a robot with other observations.

    Raises:
        UsageError: it has another number of sensors that the task feeds.
    """
    if spaces_of(simulation)[0] != space:
        there, had = len(simulation.task.sensors), space.shape[0]
        raise UsageError(f"profile: expected one with {had} sensors that the task feeds, got {there}.")


def pose_of(simulation: Simulation, given: Any) -> Pose | None:
    """Where a reset's options set the robot down, if they do.

    Raises:
        UsageError: no pose, or one where something stands.
    """
    return None if given is None else simulation.require_free(Pose.from_degrees(*given))


def observations_of(simulation: Simulation, readings: Floats) -> NDArray[np.float32]:
    """Readings [N, all sensors of the kind] of those that are fed, −1 … 1 over the input range."""
    task = simulation.task
    bands: Floats = np.array(simulation.profile.bands(task.feeds))
    low, high = bands[list(task.sensors)].T
    shares = (readings[:, list(task.sensors)] - low) / (high - low)
    seen: NDArray[np.float32] = np.clip(2.0 * shares - 1.0, -1.0, 1.0).astype(np.float32)
    return seen


def commands_of(actions: object, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Actions −1 … 1 as whole units −10 … 10; what lies beyond is clipped.

    Raises:
        UsageError: another shape, or a number that is not finite.
    """
    given = np.asarray(actions, np.float64)
    if given.shape != shape or not np.isfinite(given).all():
        raise UsageError(f"action: expected finite numbers, float{list(shape)}, got {actions!r}.")
    return np.rint(np.clip(given, -1.0, 1.0) * LIMIT).astype(np.int64)


@lru_cache(maxsize=16)
def _prefix_scores(score: CompiledScore) -> Callable[..., None]:
    return score.around(_take)


def _take(paths: Any, done: Any, which: Any, room: Any, scores: Any) -> None:
    """Scores of the first rows of paths."""
    for i in range(which.shape[0]):
        p, k = paths[which[i]], done[which[i]]
        path = Path(p[0, :k], p[1, :k], p[2, :k], p[3, :k], p[4, :k], p[5, :k])
        scores[i] = score(path, room)  # type: ignore[name-defined]  # noqa: F821


class RobotVectorEnv(gymnasium.vector.VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """N robots, each in a room of its own.

    Observations are the fed sensors' readings, −1 … 1 over the profile's input range (float32[N, sensors]);
    actions are the wheels' speeds, left and right, −1 … 1 of the robot's top command (float32[N, 2]), rounded
    to the whole units that the network has too, tenths of it. A trial lasts the task's steps, and is then
    truncated. Rewards add up to the task's score: after step k of K it is k/K of the score of the path so
    far, less what that was a step before. `info["score"]` has the score of a trial at its end.

    Args:
        task: one that comes with the package, or a Python file of your own.
        num_envs: robots.
        profile: the robot: a shipped profile's name or a TOML file.
        noise: zero, observed, double or a number.
        arena: in place of the task's.
        spread: share, 0 to 0.9, within which each trial draws the robot's constants anew (`Task.spread`);
            None: the task's own.
        autoreset_mode: what happens to a robot whose trial is over: it starts again with the next step
            (Gymnasium's default), with the same one, or when `reset` is called with `reset_mask`.

    Raises:
        RealityGapError: no such task, profile, noise or arena; says what was expected.
    """

    def __init__(
        self,
        task: Task | str | PathLike[str],
        num_envs: int = 1,
        *,
        profile: Profile | str | PathLike[str] = "paper",
        noise: str | float = "observed",
        arena: Arena | str | PathLike[str] | None = None,
        spread: float | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        self.num_envs = num_envs = as_count(num_envs, "num_envs")
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self._task = load_task(task).under(spread)
        self._arena = None if arena is None else load_arena(arena)
        self._seeds: NDArray[np.uint64] | None = None
        self._trial = np.zeros(num_envs, np.int64)
        self._settle(Simulation(self._task, profile, noise, self._arena))
        self.single_observation_space, self.single_action_space = spaces_of(self.simulation)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def _settle(self, simulation: Simulation) -> None:
        """Room for robots of a simulation, none of which has begun."""
        self.simulation, robots = simulation, self.num_envs
        self._worlds: dict[int, tuple[World, slice]] = {}
        self._scratch = new_scratch(simulation.robot, simulation.trial)
        steps = simulation.trial.steps
        self._robots = new_robots(robots, steps, self._scratch)
        self._worth = np.zeros(robots)  # of each trial so far: at its end its score
        self._over = np.ones(robots, bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Info | None = None
    ) -> tuple[NDArray[np.float32], Info]:
        """Begin trials. Robot i with seed s draws what a single environment with seed s + i draws.

        Args:
            seed: of the first robot, or one of each; None: the trial after the last.
            options: "reset_mask", bool[N]: which robots; "pose": (x cm, y cm, heading in degrees) of all;
                "noise", "profile": from now on, of all.

        Raises:
            RealityGapError: an invalid seed, mask, pose, noise or profile, or a pose where something
                stands.
        """
        given = checked_options(options, {"pose", "reset_mask", *SETTINGS})
        which = self._masked(given.get("reset_mask"))
        seeds = self._streams(seed, which)
        simulation = self.simulation
        if changed := {key: given[key] for key in SETTINGS if key in given}:
            if len(which) < self.num_envs:
                raise UsageError(
                    f"{next(iter(changed))}: expected a reset of all robots. Leave the mask out."
                )
            kept = {"profile": simulation.profile, "noise": simulation.noise, "arena": self._arena}
            simulation = Simulation(self._task, **{**kept, **changed})
            require_same(simulation, self.single_observation_space)
        pose = pose_of(simulation, given.get("pose"))
        if changed:
            self._settle(simulation)
        if self._seeds is None:
            super().reset(seed=int(seed) if isinstance(seed, int | np.integer) else None)
            self._seeds = self.np_random.integers(0, 2**63, self.num_envs, np.uint64)
        for i, stream in seeds.items():
            self._seeds[i], self._trial[i] = stream, 0
        self._begin(which, pose)
        return self._seen(), {}

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], Floats, NDArray[np.bool_], NDArray[np.bool_], Info]:
        """One step of the robot's period for every robot.

        Args:
            actions: float[N, 2].

        Raises:
            UsageError: before the first reset; an action that is not finite; or a trial that is over where
                nothing starts again by itself.
        """
        if self._seeds is None:
            raise UsageError("step: expected a reset first.")
        begun = np.flatnonzero(self._over)
        if len(begun) and self.autoreset_mode is AutoresetMode.DISABLED:
            raise UsageError(
                f"step: trials {begun.tolist()} are over. Call reset(options={{'reset_mask': …}}) first, or "
                "choose another autoreset_mode."
            )
        moving = np.flatnonzero(~self._over)
        commands = commands_of(actions, (self.num_envs, 2))[moving].astype(np.float64)
        self._advance(moving, NOWHERE, commands)
        self._begin(begun)
        rewards = np.zeros(self.num_envs)
        rewards[moving] = self._rewards(moving)
        self._over = self._robots.step == self._robots.path.shape[2]
        truncated = self._over.copy()
        infos: Info = {}
        if truncated.any():
            ended = np.flatnonzero(truncated)
            score = {"score": np.where(truncated, self._worth, 0.0), "_score": truncated.copy()}
            infos = score
            if self.autoreset_mode is AutoresetMode.SAME_STEP:
                infos = self._restarted(ended, truncated, score)
        return self._seen(), rewards, np.zeros(self.num_envs, bool), truncated, infos

    def _rewards(self, which: NDArray[np.int64]) -> Floats:
        """Of the steps that robots `which` have just done.

        Raises:
            TaskError: the score failed on a part of a path, or was not a finite number.
        """
        score, room = self.simulation.score, self.simulation.room
        paths, done, scores = self._robots.path, self._robots.step, np.zeros(len(which))
        try:
            _prefix_scores(score)(paths, done, which, room, scores)
        except Exception:
            for r in which:
                score(Path(*(row[: done[r]] for row in paths[r])), room)  # names the user's line that failed
            raise
        if not np.isfinite(scores).all():
            raise TaskError("score: expected a finite number for every part of a path from its beginning.")
        worth = scores * done[which] / paths.shape[2]
        rewards: Floats = worth - self._worth[which]
        self._worth[which] = worth
        return rewards

    def _restarted(self, ended: NDArray[np.int64], truncated: NDArray[np.bool_], score: Info) -> Info:
        """Begin anew; what was seen and known at the ends."""
        last, final = self._seen(), np.full(self.num_envs, None, object)
        for i in ended:
            final[i] = last[i].copy()
        self._begin(ended)
        mask = truncated.copy()
        return {"final_obs": final, "_final_obs": mask, "final_info": score, "_final_info": mask.copy()}

    def _masked(self, mask: object) -> NDArray[np.int64]:
        if mask is None:
            return np.arange(self.num_envs)
        fits = isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (self.num_envs,)
        if isinstance(mask, np.ndarray) and fits and mask.any():
            return np.flatnonzero(mask)
        raise UsageError(
            f"reset_mask: expected an array bool[{self.num_envs}] with at least one True, got {mask!r}."
        )

    def _streams(
        self, seed: int | Sequence[int | None] | None, which: NDArray[np.int64]
    ) -> dict[int, np.uint64]:
        """Of the seeds, by robot; robots without one keep those that they have."""
        if seed is None:
            return {}
        first = isinstance(seed, int | np.integer) and not isinstance(seed, bool)
        given: Any = [int(as_stream(seed, "seed")) + i for i in range(self.num_envs)] if first else seed
        if not (isinstance(given, Sequence) or np.ndim(given)) or len(given) != self.num_envs:
            expected = f"a whole number, or {self.num_envs} of them, one for each robot"
            raise UsageError(f"seed: expected {expected}, got {seed!r}.")
        return {i: as_stream(given[i], "seed") for i in which.tolist() if given[i] is not None}

    def _begin(self, which: NDArray[np.int64], pose: Pose | None = None) -> None:
        """The next trial of these robots: each a function of its robot's seed and of how many came before."""
        if not len(which):
            return
        assert self._seeds is not None
        streams = np.array([substream(self._seeds[i], np.uint64(self._trial[i])) for i in which], np.uint64)
        starts = np.empty((len(which), 3))
        if pose is None:
            loop.draw_starts(self.simulation.trial, streams, starts)
        else:
            starts[:] = pose.x, pose.y, pose.heading
        self._robots.stream[which] = streams
        self._trial[which] += 1
        if self.simulation.task.spread:
            self._worlds.update(zip(which, self.simulation.worlds(streams), strict=True))
        self._advance(which, starts, STILL)
        self._worth[which] = 0.0
        self._over[which] = False

    def _advance(self, which: NDArray[np.int64], starts: Floats, commands: Floats) -> None:
        """As of `loop.advance`: all robots at once, or each with the constants of its trial."""
        if not self.simulation.task.spread:
            world = self.simulation.world
            loop.advance(world, self._robots, which, starts, commands, self._scratch)
            return
        for i, r in enumerate(which):
            world, _ = self._worlds[r]
            one = slice(i, i + 1)
            loop.advance(world, self._robots, which[one], starts[one], commands[one], self._scratch)

    def _seen(self) -> NDArray[np.float32]:
        return observations_of(self.simulation, self._robots.readings)
