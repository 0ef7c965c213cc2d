"""Random steps: whatever networks decide wherever, no robot enters a wall, and every number is a number.

    python -m tests.hostile.steps [--steps 1000000] [--twin-steps 20000] [--seed 1]

Simulated robots with random networks, rooms and levels of noise up to 10; a unit of the twin that is
given random speeds and voltages. Ends with 1 at the first step that cannot be, which it names.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from realitygap.simulation.simulation import Simulation
from realitygap.tasks import load_task
from realitygap.track import Trajectory
from realitygap.twin.body import TwinBody
from realitygap.values import Pose
from realitygap.world.arena import Arena
from tests.kernels.reference.rays import overlap
from tests.kernels.scenes import PAPER, RADIUS, random_scenes
from tests.report.scenes import random_genotype

TRIAL_STEPS = 1000
TOUCHES_CM = 1e-6
SINKS_CM = 0.15
"""How deep the twin may be in what it rams at full voltage, cm."""


def rooms(seed: int, count: int) -> Iterator[tuple[Arena, tuple[float, float, float]]]:
    """Rooms, and where a robot stands free in them."""
    found = ((arena, pose) for _, arena, pose in random_scenes(seed, 3 * count + 10, robots=False))
    return islice((one for one in found if overlap(one[0], *one[1][:2], RADIUS) < -TOUCHES_CM), count)


def complaint(arena: Arena, made: Trajectory) -> str:
    """What is wrong about a simulated trial; "": nothing."""
    numbers = (made.x, made.y, made.heading, made.wheels, made.proximity, made.ambient)
    if not all(np.isfinite(column).all() for column in numbers):
        return "a number that is none"
    for name, counts in (("proximity", made.proximity), ("ambient", made.ambient)):
        if counts.min() < 0 or counts.max() > 1023 or (counts % 1).any():
            return f"{name} readings that are no counts"
    if np.abs(made.inputs).max() > 10 or np.abs(made.commands).max() > 10:
        return "inputs or commands beyond 10"
    for k, (x, y) in enumerate(zip(made.x, made.y, strict=True)):
        if overlap(arena, x, y, RADIUS) > TOUCHES_CM:
            return f"step {k} at ({x!r}, {y!r}) is inside something"
    return ""


def simulated(steps: int, seed: int) -> str:
    """So many steps in simulation, a thousand a trial."""
    draw = np.random.default_rng(seed)
    trials = -(-steps // TRIAL_STEPS)
    for k, (arena, (x, y, heading)) in enumerate(rooms(seed, trials)):
        task = load_task("avoidance" if k % 2 else "light")
        here = replace(task.start, x_cm=x, y_cm=y, radius_cm=0.0)
        task = replace(task, arena=arena, start=here)
        level = float(draw.choice([0.0, 1.0, 2.0, 10.0, draw.uniform(0, 10)]))
        networks = random_genotype(seed * trials + k, hidden=0.3).networks()
        made, _ = Simulation(task, PAPER, level).trajectory(
            networks, stream=k, pose=Pose(x=x, y=y, heading=heading), seconds=TRIAL_STEPS / 10
        )
        if wrong := complaint(arena, made):
            return f"trial {k}, level {level:g}: {wrong}"
    return ""


def on_twin(steps: int, seed: int) -> str:
    """So many steps of the twin, each with a command of its own."""
    draw = np.random.default_rng(seed)
    for k, (arena, (x, y, heading)) in enumerate(rooms(seed, -(-steps // 500))):
        body = TwinBody(arena.plain(), unit=k, noise=float(draw.uniform(0, 3)), seed=seed)
        body.place(x, y, heading)
        for step in range(500):
            left, right = (int(v) for v in draw.integers(-127, 128, 2))
            (body.set_pwm if draw.random() < 0.3 else body.set_speed)(left, right)
            body.advance(100)
            pose, counts = body.truth(), [*body.proximity(), *body.ambient()]
            where = f"the twin, room {k}, step {step}"
            if not all(map(math.isfinite, pose)) or not all(0 <= v <= 1023 for v in counts):
                return f"{where}: a number that is none: {pose}, {counts}"
            if overlap(arena, pose[0], pose[1], 2.75) > SINKS_CM:
                return f"{where}: {pose} is inside something"
    return ""


def main() -> int:
    """Step, look."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--twin-steps", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    told = parser.parse_args()
    wrong = simulated(told.steps, told.seed) or on_twin(told.twin_steps, told.seed)
    print(wrong or f"seed {told.seed}: {told.steps} simulated and {told.twin_steps} twin steps, none wrong")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
