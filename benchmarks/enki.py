"""How much faster than its clock a robot of Enki's drives: with tracks as it knows them, and by the camera.

python benchmarks/enki.py [--models khepera,epuck,thymio2] [--seconds 60] [--rounds 3]

An avoider drives among four cylinders as in `transfer`: sensed, decided, recorded, tracked.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from dataclasses import replace

from realitygap.robots.address import Address
from realitygap.robots.enki import MODELS
from realitygap.tasks import load_task
from realitygap.tasks.task import Task
from realitygap.transfer.rig import Rig
from realitygap.values import Command, Pose
from realitygap.world.arena import Arena, Cylinder
from realitygap.world.robot import load_profile

SIDE_CM, START = 100.0, Pose.from_degrees(50, 25, 90)


class Avoider:
    """Straight on, and away from whatever is on one side."""

    def reset(self) -> None:
        """It remembers nothing."""

    def decide(self, inputs: list[int]) -> Command:
        """Turn in proportion to what all sensors read more than in the dark."""
        near = sum(inputs) + 10 * len(inputs)
        return Command(left=8 - min(16, near), right=8)


def main() -> None:
    """Print one line a model."""
    words = argparse.ArgumentParser()
    words.add_argument("--models", default=",".join(MODELS))
    words.add_argument("--seconds", type=float, default=60.0)
    words.add_argument("--rounds", type=int, default=3)
    given = words.parse_args()
    pillars = tuple(Cylinder(x_cm=x, y_cm=y, radius_cm=4.0) for x in (30, 70) for y in (30, 70))
    arena = Arena(name="wide", size_cm=(SIDE_CM, SIDE_CM), cylinders=pillars)  # a Thymio fits, too
    task = replace(load_task("obstacle-avoidance"), arena=arena)
    for model in given.models.split(","):
        own, camera = measured(task, model, given.seconds, given.rounds)
        print(f"{model:8} {own:5.0f} times real time as it knows its place, {camera:4.0f} by the camera")


def measured(task: Task, model: str, seconds: float, rounds: int) -> tuple[float, float]:
    """Medians over the rounds, of a drive alone and of one whose track is the camera's."""
    own, camera = [], []
    with tempfile.TemporaryDirectory(prefix="realitygap-") as folder:
        robot = Address.parse(f"enki:{model}")
        profile = load_profile(MODELS[model].profile)
        with Rig(task, profile, robot=robot, folder_for_camera=folder) as rig:
            rig.drive(Avoider(), 1, START, 2.0)  # compiles Enki's program, calibrates the camera
            for k in range(rounds):
                begun = time.perf_counter()
                rig.trial(Avoider(), k, START, seconds)
                middle = time.perf_counter()
                rig.drive(Avoider(), k, START, seconds)
                own.append(seconds / (middle - begun))
                camera.append(seconds / (time.perf_counter() - middle))
    return statistics.median(own), statistics.median(camera)


if __name__ == "__main__":
    main()
