"""What a GPU makes of it: compilation, steps a second beside one core, scores that are equal, and a study.

    python benchmarks/gpu.py [--trials 832 4096 131072 524288] [--rounds 3] [--runs 400]
    python benchmarks/gpu.py --host [--runs 400]

--runs 0 leaves out the study of that many runs of 1000 evaluations of both tasks. Needs an NVIDIA GPU and the
extra `cuda`. --host carries out the study alone, with an engine that takes no time and gives random scores:
what is left is the processor's part. That needs no GPU, only the package numba-cuda.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time

import numpy as np
from steps import random_networks

from realitygap.errors import UsageError
from realitygap.simulation import cuda
from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.study.config import Condition, StudyConfig
from realitygap.study.runner import run_study
from realitygap.tasks import TASKS

NETWORKS = 64
ON_CORE = 1024
"""Trials that one core makes for comparison."""
COMPILE = """
import sys, time
from realitygap.simulation.simulation import Simulation
gpu = Simulation(sys.argv[1], "paper", 1.0, engine="cuda")
begun = time.perf_counter()
gpu.compile()
print(time.perf_counter() - begun)
"""


class Idle:
    """An engine that takes no time: scores are numbers from 0 to 1 that follow from the streams."""

    def __init__(self, simulation: Simulation) -> None:
        pass

    def tracks(self, networks: object, streams: np.ndarray) -> object:
        """Nobody asks for them."""
        raise NotImplementedError

    def scores(self, networks: object, streams: np.ndarray) -> np.ndarray:
        """Scores of trials of N networks: streams [N, trials] → scores [N, trials]."""
        return (streams >> np.uint64(11)) / 2.0**53

    def compile(self) -> None:
        """There is nothing to compile."""


def main() -> None:
    """Print a line for each task and number of trials, and one for the study."""
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--trials", type=int, nargs="+", default=[832, 4096, 131_072, 524_288])
    words.add_argument("--rounds", type=int, default=3)
    words.add_argument("--runs", type=int, default=400)
    words.add_argument("--host", action="store_true")
    given = words.parse_args()
    try:
        if given.host:
            cuda.Cuda, cuda.require_gpu = Idle, lambda: None
        else:
            cuda.require_gpu()
            for name in TASKS:
                compared(name, given.trials, given.rounds)
        if given.runs:
            print(studied(given.runs))
    except UsageError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def compared(name: str, trials: list[int], rounds: int) -> None:
    """Print a task's figures, with observed noise and the networks of a random start."""
    gpu, core = (Simulation(name, "paper", 1.0, engine=engine) for engine in ("cuda", "cores"))
    networks = random_networks(gpu, stream=1995, count=NETWORKS)
    streams = batch_streams(7, ON_CORE).reshape(NETWORKS, -1)
    expected, slow = timed(core, networks, streams, rounds)
    off = np.abs(gpu.scores(networks, streams) - expected)
    print(f"{name}: compiled in {compiling(name):.1f} s")
    print(f"  one core: {slow / 1e6:.2f} million steps/s")
    for count in trials:
        streams = batch_streams(7, max(1, count // NETWORKS) * NETWORKS).reshape(NETWORKS, -1)
        _, fast = timed(gpu, networks, streams, rounds)
        spent = streams.size * gpu.task.steps / fast
        print(f"  {streams.size} trials: {fast / 1e6:.1f} million steps/s, {1000 * spent:.1f} ms a round")
    same = f"{100 * np.mean(off == 0):.1f} % of {off.size} scores have the core's bits"
    print(f"  {same}; the others differ by at most {off.max():.0e}")


def compiling(name: str) -> float:
    """How long a task's kernels take to compile in a process of their own, in seconds."""
    return float(subprocess.check_output([sys.executable, "-c", COMPILE, name]))


def timed(simulation: Simulation, networks: object, streams: np.ndarray, rounds: int) -> tuple:
    """The scores, and the most steps a second of some rounds after one to warm up."""
    scores = simulation.scores(networks, streams)
    spent = []
    for _ in range(rounds):
        begun = time.perf_counter()
        simulation.scores(networks, streams)
        spent.append(time.perf_counter() - begun)
    return scores, streams.size * simulation.task.steps / min(spent)


def studied(runs: int) -> str:
    """How long a study of so many runs of both tasks takes."""
    conditions = tuple(Condition(task=name, noise=1.0) for name in TASKS)
    config = StudyConfig(runs=runs, evaluations=1000, conditions=conditions)
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        run_study(f"{folder}/study", config, engine="cuda", workers=1)
        spent = time.perf_counter() - begun
    return f"{runs} runs of each task, compiling, tests and database included: {spent:.1f} s"


if __name__ == "__main__":
    main()
