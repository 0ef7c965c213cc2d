"""The trials of a study of noise as jobs: a controller at a time, on the twin or in the simulations."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from realitygap.experiments.noise.config import NoiseConfig
from realitygap.experiments.noise.plan import Controller
from realitygap.experiments.noise.simulated import compare_all
from realitygap.experiments.noise.situated import Rigs, Situated, situate
from realitygap.experiments.noise.stage import Stage
from realitygap.study.schema import told
from realitygap.work.pool import Tell

__all__ = ["Bench", "Job", "Made", "bench_in"]


class Job(NamedTuple):
    """A controller that is to drive the twin's units, or to be compared with the simulations."""

    controller: Controller
    on_twin: bool


class Made(NamedTuple):
    """What came of a job: a controller's paths on the twin, or its comparisons. Shares of it come before."""

    controller: Controller
    content: Situated | dict[str, Any]


class Bench:
    """Carries out jobs, and writes nothing but the twin's cameras; made once in a worker."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._rigs = Rigs(stage)

    def carry_out(self, job: Job, tell: Tell) -> None:
        """One job; `tell` hears the share that was done since the last time, then what came of it."""
        with told(self._stage.folder):
            if job.on_twin:
                tell(Made(job.controller, situate(self._stage, self._rigs, job.controller, tell)))
            else:
                tell(Made(job.controller, compare_all(self._stage, job.controller, tell)))

    def close(self) -> None:
        """Let the twin's units go."""
        self._rigs.close()


def bench_in(folder: str) -> Bench:
    """A bench for the study in a folder."""
    return Bench(Stage(Path(folder), NoiseConfig.from_folder(Path(folder))))
