"""What an environment's robots observe, which actions and reset options they take: of one and of many."""

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from realitygap.errors import UsageError
from realitygap.kernels.network import LIMIT
from realitygap.simulation.simulation import Simulation
from realitygap.values import Floats, Pose

__all__ = [
    "SETTINGS", "Info", "checked_options", "commands_of", "observations_of", "pose_of", "require_same",
    "spaces_of",
]  # fmt: skip

Info = dict[str, Any]
SETTINGS = ("noise", "profile")
"""What a reset may change."""


def spaces_of(simulation: Simulation) -> tuple[Any, Any]:
    """Of one robot's observations and actions."""
    sensors = len(simulation.task.sensors)
    return Box(-1.0, 1.0, (sensors,), np.float32), Box(-1.0, 1.0, (2,), np.float32)


def checked_options(options: Info | None, known: set[str]) -> Info:
    """A reset's options, as a copy.

    Raises:
        UsageError: an unknown option.
    """
    if not isinstance(options, dict | None):
        raise UsageError(f"options: expected a dictionary, got {options!r}.")
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
    if given is None:
        return None
    try:
        pose = Pose.from_degrees(*given)
    except (TypeError, ValueError):
        expected = "three numbers (x cm, y cm, heading in degrees)"
        raise UsageError(f"pose: expected {expected}, got {given!r}.") from None
    return simulation.require_free(pose)


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
    try:
        given = np.asarray(actions).astype(np.float64, casting="same_kind")  # no text, no complex numbers
    except (TypeError, ValueError):
        given = np.empty(0)
    if given.shape != shape or not np.isfinite(given).all():
        raise UsageError(f"action: expected finite numbers, float{list(shape)}, got {actions!r}.")
    return np.rint(np.clip(given, -1.0, 1.0) * LIMIT).astype(np.int64)
