"""One robot as an environment of Gymnasium: simulated, on the twin, in Enki, or real."""

from __future__ import annotations

from contextlib import ExitStack
from os import PathLike
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from realitygap.environment.robots import RobotVectorEnv, commands_of, observations_of, spaces_of
from realitygap.errors import UsageError
from realitygap.kernels.network import LIMIT
from realitygap.kernels.rng import substream
from realitygap.robots.address import Address
from realitygap.robots.body import Body, Placing, Seen, attend, clock_of, odometry_of
from realitygap.robots.signals import MOVING, NUMBERS, Stopping
from realitygap.simulation.simulation import Simulation
from realitygap.tasks.task import Task
from realitygap.transfer.paths import of_counters, of_poses, score
from realitygap.values import Command, Pose, as_stream
from realitygap.world.arena import Arena
from realitygap.world.profile import Profile

__all__ = ["RobotEnv"]

SIMULATION = "simulation"
Info = dict[str, Any]
Seen32 = NDArray[np.float32]


class RobotEnv(gymnasium.Env[Seen32, Seen32]):
    """A robot at a task: observations, actions and rewards as in `RobotVectorEnv`.

    On another reality than the simulation its path is what the robot itself knows: its pose where it is told
    (Enki, a body of one's own), else what its wheels count, which misses slip. What nobody places (a robot on
    a line) stands where you put it before each reset; `options={"pose": …}` says where that is.

    Args:
        task, profile, noise, arena: as of `RobotVectorEnv`; noise is the simulation's.
        reality: "simulation", or a robot's address: twin:1, enki:epuck, khepera:/dev/ttyUSB0, my.py:Class.

    Raises:
        RealityGapError: no such task, profile, noise, arena or robot.
    """

    def __init__(
        self,
        task: Task | str | PathLike[str],
        *,
        profile: Profile | str | PathLike[str] = "paper",
        noise: str | float = "observed",
        arena: Arena | str | PathLike[str] | None = None,
        reality: str = SIMULATION,
    ) -> None:
        self._inner: RobotVectorEnv | _Situated
        if reality == SIMULATION:
            self._inner = RobotVectorEnv(
                task, profile=profile, noise=noise, arena=arena, autoreset_mode=AutoresetMode.DISABLED
            )
        else:
            self._inner = _Situated(Simulation(task, profile, noise, arena), Address.parse(reality))
        self.simulation = self._inner.simulation
        self.observation_space, self.action_space = spaces_of(self.simulation)

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Seen32, Info]:
        """Begin a trial.

        Args:
            seed: of its start and its noise; None: the trial after the last.
            options: "pose": (x cm, y cm, heading in degrees).

        Raises:
            UsageError: a seed or a pose that is none, or where something stands.
            RobotError: the robot does not answer.
        """
        super().reset(seed=seed)
        if seed is None and self._inner._seeds is None:
            seed = int(self.np_random.integers(0, 2**62))
        seen, info = self._inner.reset(seed=seed, options=options)
        return seen[0], info

    def step(self, action: Seen32) -> tuple[Seen32, float, bool, bool, Info]:
        """One step of the robot's period.

        Args:
            action: float[2], the wheels' speeds, left and right, −1 … 1.

        Raises:
            UsageError: before the first reset, after the trial's end, or an action that is not finite.
            RobotError: the robot was lost; it was told to stand.
        """
        seen, rewards, terminated, truncated, info = self._inner.step(np.asarray(action)[np.newaxis])
        ended = {"score": float(info["score"][0])} if "score" in info else {}
        return seen[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), ended

    def close(self) -> None:
        """Let go of the robot, which stands."""
        self._inner.close()


class _Situated:
    """A robot that is not simulated, as a vector environment of one."""

    def __init__(self, simulation: Simulation, robot: Address) -> None:
        self.simulation, self.robot = simulation, robot
        self._seeds: np.uint64 | None = None
        self._trial = 0
        self._body: Body | None = None
        self._moving = ExitStack()
        self._driving = False

    @property
    def body(self) -> Body:
        """The robot, opened when it is first needed."""
        if self._body is None:
            self._body = self.robot.open(kinds=(self.simulation.task.feeds,))
            if abs(self._body.period_s - self.simulation.profile.period_s) > 1e-9:
                here, there = self.simulation.profile.period_s, self._body.period_s
                self.close()
                raise UsageError(
                    f"profile: expected the robot's period, {there:g} s, got {here:g} s. Calibrate one."
                )
        return self._body

    def reset(self, *, seed: int | None, options: Info | None) -> tuple[Seen32, Info]:
        """Place it, or take it that somebody has."""
        self._rest()
        if seed is not None:
            self._seeds, self._trial = as_stream(seed, "seed"), 0
        assert self._seeds is not None
        stream = substream(self._seeds, np.uint64(self._trial))
        self._trial += 1
        pose = (options or {}).get("pose")
        start = self.simulation.start(int(stream)) if pose is None else Pose.from_degrees(*pose)
        body = self.body
        if isinstance(body, Placing):
            body.enter(self.simulation.task.arena.plain(), int(stream) % 2**63, None)
        body.reset(start)
        attend(body, self.simulation.task.feeds)
        clock = clock_of(body)
        self._moving.enter_context(Stopping(NUMBERS if clock.waits else MOVING))
        self._driving = True
        self._due = clock.now()
        self._start, self._worth, self._poses = start, 0.0, list[Pose]()
        self._counts = list[tuple[float, float]]()
        return self._look(), {}

    def step(self, actions: object) -> tuple[Seen32, Any, Any, Any, Info]:
        """Act, wait for the step's end, look."""
        if not self._driving:
            raise UsageError("step: expected a reset before it, after a trial's end too.")
        (left, right), profile = commands_of(actions, (1, 2))[0].tolist(), self.simulation.profile
        scale, period = profile.wheels.top_command / LIMIT, profile.period_s
        try:
            self.body.act(Command(left=round(scale * left), right=round(scale * right)))
            clock = clock_of(self.body)
            now = clock.now()
            self._due += period if now - self._due <= period else period + (now - self._due)
            clock.sleep_until(self._due)
            seen = self._look()
        except BaseException:
            self.close()
            raise
        done, steps = len(self._counts) - 1, self.simulation.task.steps_of(profile)
        worth = done / steps * self._scored()
        reward, self._worth = worth - self._worth, worth
        info: Info = {}
        if done == steps:
            self._rest()
            info = {"score": np.array([worth])}
        return seen, np.array([reward]), np.zeros(1, bool), np.array([done == steps]), info

    def _look(self) -> Seen32:
        body, task = self.body, self.simulation.task
        readings = body.sense()
        if isinstance(body, Seen):
            self._poses.append(body.pose)
        self._counts.append(odometry_of(body).counters or (np.nan, np.nan))
        fed = readings.proximity if task.feeds == "proximity" else readings.ambient
        return observations_of(self.simulation, np.asarray(fed, np.float64)[np.newaxis])

    def _scored(self) -> float:
        """The score of the path so far."""
        from realitygap.transfer.rig import _cm_per_pulse

        profile, task = self.simulation.profile, self.simulation.task
        if self._poses:
            track = of_poses(self._poses, profile.period_s)
        else:
            pulse = _cm_per_pulse(self.body, profile)
            if pulse is None:
                raise UsageError(
                    f"robot {self.robot}: expected one that tells its pose or counts its wheels."
                )
            track = of_counters(
                np.array(self._counts), self._start, cm_per_pulse=pulse, axle_cm=profile.wheels.track_cm,
                period_s=profile.period_s,
            )  # fmt: skip
        return score(track, task, profile)

    def _rest(self) -> None:
        """Stand, if it drives."""
        if self._driving:
            self._driving = False
            try:
                self.body.stop()
            finally:
                self._moving.close()

    def close(self) -> None:
        """Let go of it."""
        from realitygap.robots.body import abandon

        try:
            self._rest()
        finally:
            body, self._body = self._body, None
            if body is not None:
                abandon(body)
