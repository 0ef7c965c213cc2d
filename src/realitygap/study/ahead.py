"""Compiles what evolution and transfers call, several pieces at a time: it is the same for all robots and
tasks."""

import numpy as np

from realitygap.compiled import lacks
from realitygap.kernels import batch
from realitygap.study.config import StudyConfig
from realitygap.study.materials import gather
from realitygap.study.run import Bench
from realitygap.values import Closing
from realitygap.work.pool import Pool, Processes, Setup, Tell

__all__ = ["Ahead", "compile_ahead", "compile_side_by_side"]

JOBS = "trials", "breeding"
"""The longest first."""


class Ahead(Closing):
    """Carries out compilation jobs, named in JOBS, and keeps the code on disk."""

    def __init__(self) -> None:
        materials = gather(StudyConfig.reproduction())
        self._benches = [Bench(materials, condition) for condition in range(len(materials.tasks))]

    def carry_out(self, job: str, tell: Tell) -> None:
        """Compile one job's functions; sends no messages."""
        bench = self._benches[0]
        if job == "breeding":
            bench.breed()
        else:
            for one in self._benches:  # each task has a score
                one.simulation(one.noise).compile()


def compile_ahead() -> None:
    """Compile everything in this process."""
    ahead = Ahead()
    for job in JOBS:
        ahead.carry_out(job, lambda message: None)


def compile_side_by_side(pool: Pool) -> None:
    """Compile everything in the pool's processes, if there are several and nothing is on disk."""
    if isinstance(pool, Processes) and pool.size > 1 and lacks(batch.run_trials):
        pool.work(Setup(Ahead, ()), JOBS, lambda message: None)
