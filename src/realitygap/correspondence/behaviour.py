"""The behaviour score: how near to the best that can be done, in simulation, under repeated testing.

The paper's judges marked "how close they came to the ideal strategy", "on the grounds of how robust
and optimal they proved to be in simulation after repeated testing" (§6, §7.1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.trials import STEP_S
from realitygap.errors import UsageError
from realitygap.tasks.task import Task
from realitygap.world.profile import Profile

__all__ = ["behaviour_score", "ends_of"]


def behaviour_score(scores: Sequence[float] | NDArray[np.float64], ends: tuple[float, float]) -> float:
    """0 to 10 from a controller's trial scores: the mean share of the way from worst to best.

    Each trial counts for itself and within the ends, so that a robot that often fails cannot make up
    for it by luck.

    Args:
        scores: of many trials, at the noise that the controller was evolved with.
        ends: the score of doing nothing, and of the ideal (`ends_of`).
    """
    values = np.asarray(scores, np.float64).ravel()
    low, high = ends
    if len(values) == 0 or not np.isfinite(values).all() or not low < high:
        raise UsageError("behaviour score: expected finite trial scores, and ends that grow.")
    return 10 * float(np.clip((values - low) / (high - low), 0, 1).mean())


def ends_of(task: Task, profile: Profile) -> tuple[float, float]:
    """The scores of a robot that stands and of an ideal one, for a task with the paper's scores.

    The ideal drives at top speed all the time: straight to the lamp and stays there (light), or
    straight for ever (obstacles; no arena allows it, so that nobody reaches 10).

    Raises:
        UsageError: another task; give its ends yourself.
    """
    room, n = task.room(profile), task.steps
    if task.name == "obstacle-avoidance":
        return 0.0, 1.0
    if task.name != "light-seeking":
        raise UsageError(
            f"behaviour score: the ideal of task {task.name!r} is not known; expected its ends, the score "
            "of a robot that stands and of an ideal one."
        )
    away = min(math.hypot(x - task.start.x_cm, y - task.start.y_cm) for x, y in room.lamps)
    far = np.maximum(room.radius, away - room.top_speed * STEP_S * np.arange(1, n + 1))
    return 1 / (n * away**2), float(1 / (far**2).sum())
