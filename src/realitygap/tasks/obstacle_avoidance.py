"""Obstacle avoidance (§4, §6.1): cover ground, fast and straight, without crashing."""

import math

from realitygap.kernels.params import Path, Room
from realitygap.tasks.task import Start, Task
from realitygap.world.arena import load_arena


def score(path: Path, room: Room) -> float:
    """F = V·(1 − √D), equation 2, on ground speeds (docs/readings.md).

    V is the signed mean speed of both wheels over the top speed, not below 0; D is the absolute
    mean of the signed differences between the wheels over twice the top speed, not above 1.
    """
    forward = 0.0
    turning = 0.0
    for i in range(path.left.size):
        forward += (path.left[i] + path.right[i]) / 2.0
        turning += path.left[i] - path.right[i]
    v = max(0.0, forward / (path.left.size * room.top_speed))
    d = min(1.0, abs(turning) / (path.left.size * 2.0 * room.top_speed))
    return v * (1.0 - math.sqrt(d))


task = Task(
    name="obstacle-avoidance",
    title="Obstacle avoidance",
    arena=load_arena("obstacle-avoidance"),  # figure 1
    feeds="proximity",
    start=Start(x_cm=25, y_cm=25, radius_cm=3),  # "near the centre": a reading
    seconds=20,  # §6.1: "The trial time was twenty simulated seconds"
    trials=2,  # §6.1: "Each evaluation consisted of two trials"
    score=score,
)
