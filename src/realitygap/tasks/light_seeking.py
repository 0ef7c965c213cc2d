"""Light seeking (§4, §6.2): come near the lamp, and soon."""

from realitygap.kernels.params import Path, Room
from realitygap.tasks.task import Start, Task
from realitygap.world.arena import load_arena


def score(path: Path, room: Room) -> float:
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


task = Task(
    name="light-seeking",
    title="Light seeking",
    arena=load_arena("light-seeking"),  # figure 2
    feeds="ambient",
    start=Start(x_cm=15, y_cm=35),  # §6.2: "a fixed position … near the opposite end": a reading
    seconds=20,  # §6.2: "The trial time was twenty simulated seconds"
    trials=2,  # §6.2: "two separate trials"
    score=score,
    fitness_unit="10⁻⁶ cm⁻²",
    fitness_scale=1e-6,
)
