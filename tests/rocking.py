"""How often light seekers rock beneath the lamp, in simulation and on the twin (docs/noise-level.md).

    python -m tests.rocking STUDY --unit 1      # a study of light seeking whose profile is that unit's

A trial rocks if in its last 6 s the robot is never more than 8 cm from the lamp and turns about between
forwards and backwards four times or more; less than 0.5 mm in 0.1 s is no movement. True poses, no camera.
"""

from __future__ import annotations

import argparse

import numpy as np

from realitygap.controller.layout import Layout
from realitygap.controller.network import NetworkController, decode
from realitygap.simulation.simulation import Simulation
from realitygap.study.load import load_study
from realitygap.tasks import load_task
from realitygap.twin.body import TwinBody
from realitygap.values import Pose
from realitygap.world.profile import load_profile

TASK = load_task("light-seeking").of(load_profile("paper"))
LAMP = TASK.arena.lamps[0]
STEPS, LINE_MS, LAST, NEAR_CM, LITTLE_CM, TURNS = 200, 20, 60, 8.0, 0.05, 4


def rocks(path: np.ndarray) -> bool:
    """Whether poses [steps + 1, 3] of a trial end in rocking."""
    x, y, heading = path[-LAST - 1 :].T
    ahead = np.diff(x) * np.cos(heading[:-1]) + np.diff(y) * np.sin(heading[:-1])
    way = np.sign(ahead[np.abs(ahead) >= LITTLE_CM])
    near = np.hypot(x - LAMP.x_cm, y - LAMP.y_cm).max() <= NEAR_CM
    return bool(near and (way[1:] != way[:-1]).sum() >= TURNS)


def simulated(simulation: Simulation, genes: np.ndarray, pose: Pose, stream: int) -> np.ndarray:
    """Its way in the simulation."""
    way, _ = simulation.trajectory(decode(genes, Layout()), stream=stream, pose=pose)
    end = (way.end.x, way.end.y, way.end.heading)
    return np.vstack([np.column_stack([way.x, way.y, way.heading]), end])


def situated(simulation: Simulation, genes: np.ndarray, pose: Pose, stream: int, unit: int) -> np.ndarray:
    """Its way on the twin: a command reaches the wheels 20 ms after the reading that it answers to."""
    body = TwinBody(TASK.arena.plain(), unit=unit, seed=stream)
    body.place(pose.x, pose.y, pose.heading)
    controller, way = NetworkController(genes, Layout()), [body.truth()]
    for _ in range(STEPS):
        readings = body.ambient()
        body.advance(LINE_MS)
        command = controller.decide(simulation.profile.inputs(readings, TASK.feeds, TASK.sensors))
        body.set_speed(command.left, command.right)
        body.advance(100 - LINE_MS)
        way.append(body.truth())
    return np.array(way)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study")
    parser.add_argument("--unit", type=int, required=True)
    given = parser.parse_args()
    simulation = Simulation(TASK, load_profile(f"{given.study}/profile.toml"), 1.0)
    runs = load_study(given.study).runs
    found = []
    for k, run in enumerate(r for r in runs if r.task == TASK.name and r.champion is not None):
        for j, heading in enumerate((0.5, 2.5)):
            pose, stream = Pose(x=15, y=35, heading=heading), 1000 * k + j
            one = simulated(simulation, run.champion, pose, stream)
            found.append((rocks(one), rocks(situated(simulation, run.champion, pose, stream, given.unit))))
    here, there = np.sum(found, axis=0)
    print(f"{len(found)} trials: {here} rock in simulation, {there} on unit {given.unit}")


if __name__ == "__main__":
    main()
