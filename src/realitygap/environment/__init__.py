"""The simulation, the twin, Enki and robots as Gymnasium's environments (extra `[gymnasium]`).

Importing this tells Gymnasium their names:

    import gymnasium
    import realitygap.environment

    gymnasium.register_envs(realitygap.environment)  # the import has done this
    gymnasium.make("realitygap/ObstacleAvoidance-v0", noise="double")
    gymnasium.make_vec("realitygap/LightSeeking-v0", num_envs=64, vectorization_mode="vector_entry_point")
    gymnasium.make("realitygap/Task-v0", task="my_task.py")
"""

from realitygap.lazy import names_of, needed

__all__, __getattr__ = names_of(__name__, {
    "vector": "RobotVectorEnv",
    "sb3": "stable_baselines",
    "single": "RobotEnv",
})  # fmt: skip

__all__ += ["register"]

NAMES = {"ObstacleAvoidance": "obstacle-avoidance", "LightSeeking": "light-seeking", "Task": None}
"""Environments and their tasks; `Task` needs a user's own task."""


def register() -> None:
    """Tell Gymnasium of them, if it does not know them yet.

    Raises:
        UsageError: it is not installed.
    """
    gymnasium = needed("gymnasium", "gymnasium")
    for name, task in NAMES.items():
        if f"realitygap/{name}-v0" not in gymnasium.registry:
            gymnasium.register(
                id=f"realitygap/{name}-v0",
                entry_point="realitygap.environment.single:RobotEnv",
                vector_entry_point="realitygap.environment.vector:RobotVectorEnv",
                kwargs={"task": task},
            )


register()
