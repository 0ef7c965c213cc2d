"""Names by which Gymnasium makes the environments, which it learns from the package's entry point.

gymnasium.make("realitygap/ObstacleAvoidance-v0", noise="double")
gymnasium.make_vec("realitygap/LightSeeking-v0", num_envs=64, vectorization_mode="vector_entry_point")
gymnasium.make("realitygap/Task-v0", task="my_task.py")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from realitygap.environment.robots import RobotVectorEnv
    from realitygap.environment.single import RobotEnv

__all__ = ["NAMES", "make_single", "make_vector", "register"]

NAMES = {"ObstacleAvoidance": "obstacle-avoidance", "LightSeeking": "light-seeking", "Task": None}
"""Environments and their tasks; `Task` takes one of a user's own."""


def register() -> None:
    """Tell Gymnasium of them; as its plug-in this is called when it is imported, under our name space."""
    from gymnasium.envs.registration import namespace
    from gymnasium.envs.registration import register as add

    for name, task in NAMES.items():
        with namespace("realitygap"):
            add(
                id=f"{name}-v0",
                entry_point="realitygap.environment.names:make_single",
                vector_entry_point="realitygap.environment.names:make_vector",
                kwargs={} if task is None else {"task": task},
            )


def make_single(**settings: Any) -> RobotEnv:
    """One robot."""
    from realitygap.environment.single import RobotEnv

    return RobotEnv(**settings)


def make_vector(**settings: Any) -> RobotVectorEnv:
    """Many simulated robots."""
    from realitygap.environment.robots import RobotVectorEnv

    return RobotVectorEnv(**settings)
