"""Where a step's time goes: steps a second on one core, and the shares of sensing, network, wheels, noise.

    python benchmarks/kernels.py

A part's share is what it costs to do it twice: the same compiled loop runs with and without a
second sensing, network, wheels or noise, in turn, in one process, and the ratios are compared.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from realitygap.cli.bench import random_networks
from realitygap.kernels.jit import kernel
from realitygap.kernels.network import think
from realitygap.kernels.params import Networks, Path
from realitygap.kernels.trial import act, begin, draw_noise, draw_start, feed_network, move, note, sense
from realitygap.kernels.work import new_work
from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.tasks import TASKS, load_task
from realitygap.world.profile import load_profile

PARTS = ("nothing", "sensing", "network", "wheels", "noise")
NOTHING, SENSING, NETWORK, WHEELS, NOISE = range(5)
TRIALS, ROUNDS = 1024, 9


@kernel
def run_with_twice(part, robot, arena, task, nets, which, level, streams, paths, work, twin):
    """run_trials with one part of each step done a second time, on `twin` where it has a memory."""
    for t in range(which.shape[0]):
        stream, n = streams[t], which[t]
        p = paths[t % paths.shape[0]]
        path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
        draw_start(task, stream, work.start)
        begin(nets, n, work.start, work)
        begin(nets, n, work.start, twin)
        for k in range(task.steps):
            draw_noise(level, stream, k, work.readings.shape[0], work)
            if part == NOISE:
                draw_noise(level, stream, k, work.readings.shape[0], work)
            sense(robot, arena, task.feed, level, work)
            if part == SENSING:
                sense(robot, arena, task.feed, level, work)
            feed_network(robot, task, work)
            think(nets, n, work)
            if part == NETWORK:
                for i in range(work.inputs.shape[0]):
                    twin.inputs[i] = work.inputs[i]
                    twin.change[i] = work.change[i]
                think(nets, n, twin)
            if part == WHEELS:
                for w in range(2):
                    for i in range(work.wheel.shape[1]):
                        twin.wheel[w, i] = work.wheel[w, i]
                for i in range(work.pose.shape[0]):
                    twin.pose[i] = work.pose[i]
                for i in range(work.noise.shape[0]):
                    twin.noise[i] = work.noise[i]
                for i in range(work.outputs.shape[0]):
                    twin.outputs[i] = work.outputs[i]
                act(robot, nets, n, level, twin)
                move(robot, arena, twin)
            act(robot, nets, n, level, work)
            move(robot, arena, work)
            note(path, k, work)


def seconds_for(simulation: Simulation, nets: Networks) -> Callable[[int], float]:
    """A function that runs all trials with a part done twice and says how long it took."""
    which = np.arange(TRIALS) % len(nets.neurons)
    work, twin = (new_work(simulation._cores.robot, simulation._cores.trial, nets) for _ in range(2))
    paths = np.zeros((1, 6, simulation._cores.trial.steps))
    streams = batch_streams(7, TRIALS)

    def seconds(part: int) -> float:
        start = time.perf_counter()
        run_with_twice(
            part, simulation._cores.robot, simulation._cores.arena, simulation._cores.trial, nets, which, 1.0,
            streams, paths, work, twin,
        )  # fmt: skip
        return time.perf_counter() - start

    return seconds


def main() -> None:
    for name in TASKS:
        simulation = Simulation(load_task(name), load_profile("paper"), 1.0)
        seconds = seconds_for(simulation, random_networks(simulation, stream=1995))
        seconds(NOTHING)  # warm-up: compiles
        rounds = np.array([[seconds(part) for part in range(len(PARTS))] for _ in range(ROUNDS)])
        speed = TRIALS * simulation._cores.trial.steps / rounds[:, 0] / 1e6
        extra = np.median(rounds[:, 1:] / rounds[:, :1] - 1.0, axis=0)
        print(f"{name}: {np.median(speed):.2f} million steps/s (best {speed.max():.2f})")
        for part, share in zip(PARTS[1:], extra, strict=True):
            print(f"  {part:8s} {100 * share:5.1f} %")
        print(f"  the rest {100 * (1 - extra.sum()):5.1f} %")


if __name__ == "__main__":
    main()
