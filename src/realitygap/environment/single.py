"""One robot as an environment of Gymnasium: simulated, on the twin, in Enki, or real."""

from __future__ import annotations

from contextlib import ExitStack
from os import PathLike
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from realitygap.environment.vector import (
    SETTINGS,
    Info,
    RobotVectorEnv,
    checked_options,
    commands_of,
    observations_of,
    pose_of,
    require_same,
    spaces_of,
)
from realitygap.errors import UsageError
from realitygap.kernels.rng import substream
from realitygap.robots.address import Address
from realitygap.robots.body import Body
from realitygap.robots.drive import MOVING, NUMBERS, StopOnSignal, raise_pending
from realitygap.simulation.simulation import Simulation
from realitygap.tasks.load import load_task
from realitygap.tasks.task import Task
from realitygap.track import Track
from realitygap.transfer.paths import of_counters, of_poses, score
from realitygap.transfer.rig import turned
from realitygap.transfer.spec import check_fit
from realitygap.values import Command, Pose, as_stream, fed
from realitygap.world.arena import Arena, load_arena
from realitygap.world.robot import Profile

__all__ = ["RobotEnv"]

SIMULATION = "simulation"
Seen32 = NDArray[np.float32]


class RobotEnv(gymnasium.Env[Seen32, Seen32]):
    """A robot at a task: observations, actions and rewards as in `RobotVectorEnv`.

    On another reality than the simulation its path is what the robot itself knows: its pose if it reports it
    (Enki, a body of your own), else what its wheels count, or the speeds that they measure (a Thymio),
    both of which miss slip. A robot that does not place itself (one on a line) stands where you put it
    before each reset; `options={"pose": …}` says where that is.

    Args:
        task, profile, arena: as of `RobotVectorEnv`.
        noise: zero, observed (None), double or a number; of the simulation alone.
        spread: share, 0 to 0.9, within which each trial draws the robot's constants anew; None: the
            task's own. Of the simulation alone.
        reality: "simulation", or a robot's address: twin:1, enki:epuck, khepera:/dev/ttyUSB0, my.py:Class.

    Raises:
        RealityGapError: no such task, profile, noise, arena or robot; noise or a spread for a robot that has
            its own.
    """

    def __init__(
        self,
        task: Task | str | PathLike[str],
        *,
        profile: Profile | str | PathLike[str] = "paper",
        noise: str | float | None = None,
        arena: Arena | str | PathLike[str] | None = None,
        spread: float | None = None,
        reality: str = SIMULATION,
    ) -> None:
        self._settings: Info = {"profile": profile, "noise": noise, "reality": reality}
        room = None if arena is None else load_arena(arena)
        self._fixed: Info = {"task": load_task(task), "arena": room, "spread": spread}
        self._inner = _made(**self._settings, **self._fixed)
        self.simulation = self._inner.simulation
        self._settings["profile"] = self.simulation.profile  # what its file holds later counts no more
        self.observation_space, self.action_space = spaces_of(self.simulation)

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Seen32, Info]:
        """Begin a trial.

        Args:
            seed: of its start and its noise; None: the trial after the last.
            options: "pose": (x cm, y cm, heading in degrees); "noise", "profile", "reality": from now on.

        Raises:
            RealityGapError: an invalid seed, pose or setting, a pose where something stands, or a
                robot that does not answer.
        """
        seed = None if seed is None else int(as_stream(seed, "seed"))
        given = checked_options(options, {"pose", "reality", *SETTINGS})
        pose = given.pop("pose", None)
        if given:
            self._change(given, pose)
        super().reset(seed=seed)
        if seed is None and self._inner._seeds is None:
            seed = int(self.np_random.integers(0, 2**62))
        seen, info = self._inner.reset(seed=seed, options={"pose": pose})
        return seen[0], info

    def _change(self, given: Info, pose: object) -> None:
        """Another robot, or another noise: the next trial is the one that it would have been.

        Noise and spread of the simulation wait while another reality, which has its own, is stepped.
        """
        settings = self._settings | given
        own = {} if settings["reality"] == SIMULATION else {"noise": given.get("noise"), "spread": 0.0}
        inner = _made(**{**self._fixed, **settings, **own})
        require_same(inner.simulation, self.observation_space)
        pose_of(inner.simulation, pose)  # a refusal leaves all as it was
        self._inner.close()
        inner._seeds, inner._trial = self._inner._seeds, self._inner._trial
        self._inner, self.simulation = inner, inner.simulation
        self._settings = {**settings, "profile": inner.simulation.profile}

    def step(self, action: Seen32) -> tuple[Seen32, float, bool, bool, Info]:
        """One step of the robot's period.

        Args:
            action: float[2], the wheels' speeds, left and right, −1 … 1.

        Raises:
            UsageError: before the first reset, after the trial's end, or an action that is not finite.
            RobotError: the robot was lost; it was told to stop.
        """
        seen, rewards, terminated, truncated, info = self._inner.step([action])  # type: ignore[arg-type]
        ended = {"score": float(info["score"][0])} if "score" in info else {}
        return seen[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), ended

    def close(self) -> None:
        """Release the robot, which stands still."""
        self._inner.close()


def _made(
    *, noise: str | float | None, reality: str, spread: float | None, **settings: Any
) -> RobotVectorEnv | _Situated:
    if reality == SIMULATION:
        level = "observed" if noise is None else noise
        mode = AutoresetMode.DISABLED
        return RobotVectorEnv(noise=level, spread=spread, autoreset_mode=mode, **settings)
    if noise is not None or spread:
        key, got = ("spread", spread) if noise is None else ("noise", noise)
        raise UsageError(f"{key}: expected none with reality {reality!r}, which has its own; got {got!r}.")
    return _Situated(Simulation(**settings), Address.parse(str(reality)))


class _Situated:
    """A robot that is not simulated, as a vector environment of one."""

    def __init__(self, simulation: Simulation, robot: Address) -> None:
        self.simulation, self.robot = simulation, robot
        self._seeds: NDArray[np.uint64] | None = None
        self._trial = np.zeros(1, np.int64)
        self._body: Body | None = None
        self._moving = ExitStack()
        self._driving = False

    @property
    def body(self) -> Body:
        """The robot, opened when it is first needed; one of another kind than the profile's is refused."""
        if self._body is None:
            kinds = self.simulation.task.kinds
            self._body = self.robot.open(kinds=kinds)
            try:
                check_fit(self._body, self.simulation.profile, kinds)
            except BaseException:
                self.close()
                raise
        return self._body

    def reset(self, *, seed: int | None, options: Info) -> tuple[Seen32, Info]:
        """Place it, or assume that somebody has."""
        pose = pose_of(self.simulation, options["pose"])
        self._rest()
        if seed is not None:
            self._seeds, self._trial[0] = np.array([as_stream(seed, "seed")]), 0
        assert self._seeds is not None
        stream = substream(self._seeds[0], np.uint64(self._trial[0]))
        self._trial += 1
        self._start = pose or self.simulation.start(int(stream))
        body = self.body
        if body.places_itself:
            body.enter(self.simulation.task.arena.plain(), int(stream) % 2**63, None)
        body.reset(self._start)
        body.attend(*self.simulation.task.kinds)
        clock = body.clock
        self._moving.enter_context(StopOnSignal(NUMBERS if clock.waits else MOVING))
        self._driving = True
        self._due, self._worth = clock.now(), 0.0
        self._poses, self._odometry = list[Pose](), list[tuple[float, ...]]()
        try:
            seen = self._look()
            self._track()
        except BaseException:
            self.close()
            raise
        return seen, {}

    def step(self, actions: object) -> tuple[Seen32, Any, Any, Any, Info]:
        """Act, wait for the step's end, look."""
        if not self._driving:
            raise UsageError("step: expected a reset first, also after a trial's end.")
        (left, right), profile = commands_of(actions, (1, 2))[0].tolist(), self.simulation.profile
        wheels, period = profile.wheels, profile.period_s
        try:
            self.body.act(Command(left=wheels.command(left), right=wheels.command(right)))
            clock = self.body.clock
            now = clock.now()
            self._due += period if now - self._due <= period else period + (now - self._due)
            clock.sleep_until(self._due)
            seen = self._look()
            raise_pending()
            scored = score(self._track(), self.simulation.task, profile)
        except BaseException:
            self.close()
            raise
        done, steps = len(self._odometry) - 1, self.simulation.task.steps_of(profile)
        worth = done / steps * scored
        reward, self._worth = worth - self._worth, worth
        info: Info = {}
        if done == steps:
            self._rest()
            info = {"score": np.array([worth])}
        return seen, np.array([reward]), np.zeros(1, bool), np.array([done == steps]), info

    def _look(self) -> Seen32:
        body, task, unknown = self.body, self.simulation.task, (np.nan, np.nan)
        readings = body.sense()
        if body.knows_pose:
            self._poses.append(body.known_pose())
        told = body.odometry
        now = body.clock.now()
        self._odometry.append((now, *(told.counters or unknown), *(told.speeds or unknown)))
        return observations_of(self.simulation, fed(readings, task.feeds)[np.newaxis])

    def _track(self) -> Track:
        """The path so far, as it is known."""
        body, profile = self.body, self.simulation.profile
        told = np.array(self._odometry)
        if self._poses:
            return of_poses(self._poses, profile.period_s, told[:, 0])
        ways, unit = turned(body, profile, told[:, 1:3], told[:, 3:], told[:, 0])
        if unit is None or not (body.counts_turns or body.measures_speeds):
            expected = "one that reports its pose or its wheels' speeds, or counts pulses of a known length"
            raise UsageError(f"robot {self.robot}: expected {expected}.")
        return of_counters(
            ways, self._start, cm_per_pulse=unit, axle_cm=profile.wheels.track_cm, period_s=profile.period_s,
            t=told[:, 0],
        )  # fmt: skip

    def _rest(self) -> None:
        """Stand, if it drives."""
        if self._driving:
            self._driving = False
            try:
                self.body.stop()
            finally:
                self._moving.close()

    def close(self) -> None:
        """Release it."""

        try:
            self._rest()
        finally:
            body, self._body = self._body, None
            if body is not None:
                body.abandon()
