"""Who carries out the trials of a study of noise: this process or several, a controller at a time."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

from realitygap.experiments.noise.config import NoiseConfig
from realitygap.experiments.noise.plan import Controller
from realitygap.experiments.noise.simulated import compare_all
from realitygap.experiments.noise.situated import Rigs, situate
from realitygap.experiments.noise.stage import Stage
from realitygap.study.schema import told
from realitygap.study.workers import Pool, at_work

__all__ = ["Done", "Job", "Worked", "carry_out"]


class Job(NamedTuple):
    """A controller that is to drive the twin's units, or to be compared with the simulations."""

    controller: Controller
    on_twin: bool


class Worked(NamedTuple):
    """Such a share of a job is done."""

    share: float


class Done(NamedTuple):
    """A job is done."""


Tell = Callable[[Worked], None]


def carry_out(folder: Path, jobs: Sequence[Job], workers: int, tell: Tell) -> Generator[Worked | Done]:
    """What comes of the jobs, here (where `tell` hears of shares) or from processes.

    Raises:
        RealityGapError: the first that fails; finished jobs are kept.
    """
    size = min(workers, len(jobs))
    if size > 1:
        with Pool(folder, size, life=_serve, last=Done) as pool:
            yield from pool.work(iter(jobs))
        return
    with closing(Bench(folder)) as bench:
        for job in jobs:
            bench.carry_out(job, tell)
            yield Done()


class Bench:
    """Carries out jobs; made once in a process."""

    def __init__(self, folder: Path) -> None:
        self._stage = Stage(folder, NoiseConfig.from_folder(folder))
        self._rigs = Rigs(self._stage)

    def carry_out(self, job: Job, tell: Tell) -> None:
        """One job; its file is there when this returns."""
        with told(self._stage.folder):
            if job.on_twin:
                situate(self._stage, self._rigs, job.controller, lambda share: tell(Worked(share)))
            else:
                compare_all(self._stage, job.controller, lambda share: tell(Worked(share)))

    def close(self) -> None:
        """Let the twin's units go."""
        self._rigs.close()


def _serve(connection: Connection, folder: str) -> None:
    """Take a job, say how it comes on, until the parent is gone."""
    with at_work(connection), closing(Bench(Path(folder))) as bench:
        while True:
            bench.carry_out(connection.recv(), connection.send)
            connection.send(Done())
