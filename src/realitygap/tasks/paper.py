"""The paper's two tasks (§4, §6.1, §6.2)."""

import math

from realitygap.kernels.types import Path, Room
from realitygap.tasks.task import Start, Task
from realitygap.world.arena import load_arena

__all__ = ["avoidance", "light", "light_seeking", "obstacle_avoidance"]


def avoidance(path: Path, room: Room) -> float:
    """F = V·(1 − √D), equation 2, on ground speeds (the paper's: wheel speeds).

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


def light(path: Path, room: Room) -> float:
    """F = 1 / Σ D², equation 3: D from the robot's centre to the nearest lamp's, in cm, each step."""
    total = 0.0
    for i in range(path.x.size):
        nearest = 1e12
        for lamp in range(room.lamps.shape[0]):
            dx = path.x[i] - room.lamps[lamp, 0]
            dy = path.y[i] - room.lamps[lamp, 1]
            nearest = min(nearest, dx * dx + dy * dy)
        total += nearest
    return 1.0 / total


obstacle_avoidance = Task(
    name="obstacle-avoidance",
    title="Obstacle avoidance",
    arena=load_arena("obstacle-avoidance"),  # figure 1
    feeds="proximity",
    start=Start(x_cm=25, y_cm=25, radius_cm=3),  # "near the centre": a reading
    seconds=20,  # §6.1: "The trial time was twenty simulated seconds"
    trials=2,  # §6.1: "Each evaluation consisted of two trials"
    score=avoidance,
)
light_seeking = Task(
    name="light-seeking",
    title="Light seeking",
    arena=load_arena("light-seeking"),  # figure 2
    feeds="ambient",
    start=Start(x_cm=15, y_cm=35),  # §6.2: "a fixed position … near the opposite end": a reading
    seconds=20,  # §6.2: "The trial time was twenty simulated seconds"
    trials=2,  # §6.2: "two separate trials"
    score=light,
    fitness_unit="10⁻⁶ cm⁻²",
    fitness_scale=1e-6,
)
