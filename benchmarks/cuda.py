"""What a GPU makes of it: time to compile, steps a second beside one core, and how many scores are equal.

    python benchmarks/cuda.py [--trials 65536] [--rounds 3] [--runs 400]

--runs 0 leaves out the study of that many runs of 1000 evaluations of both tasks. Needs an NVIDIA GPU and the
extra `cuda`.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time

import numpy as np

from realitygap.cli.bench import random_networks
from realitygap.errors import UsageError
from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.study.config import StudyConfig
from realitygap.study.parts import Condition
from realitygap.study.runner import run_study
from realitygap.tasks import TASKS

NETWORKS = 64
ON_CORE = 1024
"""Trials that one core makes for comparison."""


def main() -> None:
    """Print a line for each task, and one for the study."""
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--trials", type=int, default=65_536)
    words.add_argument("--rounds", type=int, default=3)
    words.add_argument("--runs", type=int, default=400)
    given = words.parse_args()
    try:
        for name in TASKS:
            print(compared(name, given.trials // NETWORKS, given.rounds))
    except UsageError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    if given.runs:
        conditions = tuple(Condition(task=name, noise=1.0) for name in TASKS)
        config = StudyConfig(runs=given.runs, evaluations=1000, conditions=conditions)
        with tempfile.TemporaryDirectory() as folder:
            begun = time.perf_counter()
            run_study(f"{folder}/study", config, engine="cuda", workers=1)
            spent = time.perf_counter() - begun
        print(f"{given.runs} runs of each task, compiling, tests and database included: {spent:.1f} s")


def compared(name: str, trials: int, rounds: int) -> str:
    """A task's figures, with observed noise and the networks of a random start."""
    gpu, core = (Simulation(name, "paper", 1.0, engine=engine) for engine in ("cuda", "cores"))
    networks = random_networks(gpu, stream=1995, count=NETWORKS)
    streams = batch_streams(7, NETWORKS * trials).reshape(NETWORKS, trials)
    begun = time.perf_counter()
    gpu.compile()
    compiling = time.perf_counter() - begun
    few = np.ascontiguousarray(streams[:, : max(1, ON_CORE // NETWORKS)])
    scores, fast = timed(gpu, networks, streams, rounds)
    expected, slow = timed(core, networks, few, rounds)
    same = np.mean(scores[:, : few.shape[1]] == expected)
    return (
        f"{name}: compiled in {compiling:.0f} s, {fast / 1e6:.1f} million steps/s, one core "
        f"{slow / 1e6:.2f}; of {few.size} scores {100 * same:.2f} % have the core's bits"
    )


def timed(simulation: Simulation, networks: object, streams: np.ndarray, rounds: int) -> tuple:
    """The scores, and the most steps a second of some rounds after one to warm up."""
    scores = simulation.scores(networks, streams)
    spent = []
    for _ in range(rounds):
        begun = time.perf_counter()
        simulation.scores(networks, streams)
        spent.append(time.perf_counter() - begun)
    return scores, streams.size * simulation.task.steps / min(spent)


if __name__ == "__main__":
    main()
