"""Simulation steps a second, on one core and on all.

    python benchmarks/steps.py [--profile khepera] [--noise double] [--seconds 3]

Both tasks, with networks of a run's random start (11 to 12 slots, about ten live links), after a warm-up.
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from realitygap import Genotype, Simulation, load_task, noise_level
from realitygap.kernels.types import Networks
from realitygap.tasks import TASKS
from realitygap.work.pool import cores

NETWORKS, TRIALS = 64, 4


def random_networks(simulation: Simulation, *, stream: int, count: int = NETWORKS) -> Networks:
    """`count` networks of a run's random start."""
    inputs = len(simulation.task.sensors)
    genes = [Genotype.random(stream * count + k, inputs=inputs).genes for k in range(count)]
    return Genotype.decode(np.stack(genes), inputs)


def steps_per_second(task: str, profile: str, noise: float, seconds: float, threads: int) -> float:
    """What all threads make together, each with its own simulation and networks."""
    simulations = [Simulation(load_task(task), profile, noise) for _ in range(threads)]
    simulations[0].compile()
    networks = [random_networks(one, stream=k) for k, one in enumerate(simulations)]

    def batch(k: int, key: int) -> int:
        """Evaluate a thread's networks once; kernels release the interpreter's lock."""
        streams = np.random.default_rng(key).integers(0, 2**63, (NETWORKS, TRIALS), np.uint64)
        simulations[k].scores(networks[k], streams)
        return streams.size * simulations[k].task.steps

    def until_end(k: int) -> int:
        made, number = 0, 0
        while time.perf_counter() < begun + seconds:
            number += 1
            made += batch(k, k * 1_000_003 + number)
        return made

    for k in range(threads):
        batch(k, k)  # warm-up
    with ThreadPoolExecutor(threads) as pool:
        begun = time.perf_counter()
        return sum(pool.map(until_end, range(threads))) / (time.perf_counter() - begun)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--profile", default="paper", help="a shipped robot, or its file")
    parser.add_argument(
        "--noise", type=noise_level, default="observed", help="zero, observed, double or a number"
    )
    parser.add_argument("--seconds", type=float, default=3.0, help="for each figure")
    given = parser.parse_args()
    print(f"{'steps a second':<20}{'one core':>12}{f'{cores()} cores':>12}")
    for task in TASKS:
        rates = [
            steps_per_second(task, given.profile, given.noise, given.seconds, threads)
            for threads in (1, cores())
        ]
        print(f"{task:<20}" + "".join(f"{rate:>12,.0f}" for rate in rates))


if __name__ == "__main__":
    main()
