"""Distances of two trials that need no camera: of readings, commands, speeds, and replayed commands."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import UsageError
from realitygap.robots.drive import Recording
from realitygap.simulation.body import drive_simulated
from realitygap.simulation.simulation import Simulation
from realitygap.tasks.task import Task
from realitygap.track import Track, Trajectory
from realitygap.values import Command, Floats, Pose, fed
from realitygap.world.robot import TOP_INPUT, Profile

__all__ = ["DISTANCES", "apart", "distances"]

DISTANCES = ("readings", "commands", "speeds", "replay_cm")


def apart(simulated: Trajectory, situated: Recording, profile: Profile, task: Task) -> dict[str, float]:
    """Distances of two trials in readings and commands: Wasserstein's first distance, column by column.

    The distributions over the trial are compared for each sensor's readings and each wheel's commands and
    speeds. Readings are in widths of the input range, commands and speeds in top commands, so that 1 is much.
    NaN where one side has no such column.

    Args:
        simulated: one trial.
        situated: the other.
        profile: of the robot: its input range and top command.
        task: for the fed sensors.
    """
    from scipy.stats import wasserstein_distance

    top = profile.wheels.top_command
    widths = [high - low for low, high in profile.bands(task.feeds)]
    pairs = {
        "readings": (fed(simulated, task.feeds) / widths, fed(situated, task.feeds) / widths),
        "commands": (simulated.commands / TOP_INPUT, situated.commands / top),
        "speeds": (simulated.wheels / top, situated.speeds / top),
    }

    def between(first: Floats, second: Floats) -> float:
        if np.isnan(second).any() or not second.size:
            return math.nan
        return float(np.mean([wasserstein_distance(*pair) for pair in zip(first.T, second.T, strict=True)]))

    return {name: between(*pair) for name, pair in pairs.items()}


def distances(
    simulated: Trajectory, situated: Recording, track: Track, pose: Pose, quiet: Simulation
) -> dict[str, float]:
    """DISTANCES of a pair of trials: the parts of `apart`, and `replay_cm`, the distance of the robot's path
    from the simulation's under the robot's commands.

    Args:
        simulated: the trial in simulation.
        situated: the same on the robot.
        track: where the robot was.
        pose: where both began.
        quiet: the simulation without noise.
    """
    far = apart(simulated, situated, quiet.profile, quiet.task)
    return {**far, "replay_cm": _replayed(quiet, situated, track, pose)}


class _Replayer:
    """Replays a robot's commands, one a step, whatever the inputs."""

    def __init__(self, commands: NDArray[np.int64], profile: Profile) -> None:
        self._outputs = np.rint(commands * (TOP_INPUT / profile.wheels.top_command)).astype(int)
        self._k = 0

    def reset(self) -> None:
        self._k = 0

    def decide(self, inputs: Sequence[int]) -> Command:
        left, right = self._outputs[self._k]
        self._k += 1
        return Command(left=int(left), right=int(right))


def _replayed(simulation: Simulation, situated: Recording, track: Track, pose: Pose) -> float:
    """Mean distance (cm) of a robot's path from the simulation's under its commands; NaN without a path."""
    replayer = _Replayer(situated.commands, simulation.profile)
    seconds = len(situated.t) * simulation.profile.period_s
    try:
        lived, _ = drive_simulated(simulation, replayer, pose=pose, seconds=seconds)
    except UsageError:  # it began where the simulated robot does not fit
        return math.nan
    path = lived.track
    if len(path) != len(track) or not track.found.any():
        return math.nan
    return float(np.nanmean(np.hypot(path.x - track.x, path.y - track.y)))
