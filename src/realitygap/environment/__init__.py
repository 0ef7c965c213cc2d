"""The simulation, the twin, Enki and robots as Gymnasium's environments (extra `[gymnasium]`).

Importing this tells Gymnasium their names: "realitygap/ObstacleAvoidance-v0" and the others.
"""

from realitygap.environment.names import register
from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "names": "register",
    "robots": "RobotVectorEnv",
    "sb3": "stable_baselines",
    "single": "RobotEnv",
})  # fmt: skip

register()
