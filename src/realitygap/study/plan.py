"""The runs of a study: their names, their order and their random streams."""

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from realitygap.compiled import routine
from realitygap.kernels.rng import substream
from realitygap.study.folder import Materials
from realitygap.world.robot import noise_level, noise_name

__all__ = ["Plan", "named", "plans", "run_stream", "trial_streams"]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A planned run.

    Attributes:
        id: from 1; name: task/noise/index; condition: its number, from 0.
        noise: level (0 zero, 1 observed, 2 double); index: from 1 among the runs of its condition.
        seed: the study's; with task, noise and index it makes the run's own stream.
    """

    id: int
    name: str
    condition: int
    task: str
    noise: float
    index: int
    seed: int

    @property
    def stream(self) -> np.uint64:
        """Where the run's randomness comes from; made where a run is, for it takes compiled code."""
        return run_stream(self.seed, self.task, self.noise, self.index)


def plans(materials: Materials) -> tuple[Plan, ...]:
    """All runs of a study, condition by condition."""
    config = materials.config
    made: list[Plan] = []
    for position, (condition, task) in enumerate(zip(config.conditions, materials.tasks, strict=True)):
        for index in range(1, config.runs + 1):
            plan = Plan(
                id=len(made) + 1,
                name=f"{task.name}/{named(condition.noise)}/{index}",
                condition=position,
                task=task.name,
                noise=condition.noise,
                index=index,
                seed=config.seed,
            )
            made.append(plan)
    return tuple(made)


def run_stream(seed: int, task: str, noise: float, index: int) -> np.uint64:
    """A run's random stream, independent of what else is in the study.

    Args:
        seed: the study's.
        task: its name.
        noise: level.
        index: from 1 among the runs of the condition.
    """
    digest = hashlib.blake2b(f"{task}/{noise!r}".encode(), digest_size=8).digest()
    condition = substream(np.uint64(seed), np.uint64(int.from_bytes(digest, "little")))
    return np.uint64(substream(np.uint64(condition), np.uint64(index)))


def named(noise: float) -> str:
    """A noise level's name, or all its digits."""
    name = noise_name(noise)
    return name if noise_level(name) == noise else repr(noise)


@routine
def trial_streams(stream: np.uint64, first: int, count: int, trials: int) -> NDArray[np.uint64]:
    """Streams [count, trials] of the trials of `count` evaluations from `first`, under a run's TRIALS.

    Args:
        stream: the parent stream.
        first: number of the first evaluation.
        count: evaluations.
        trials: of each.
    """
    out = np.empty((count, trials), np.uint64)
    for e in range(count):
        evaluation = substream(stream, np.uint64(first + e))
        for t in range(trials):
            out[e, t] = substream(evaluation, np.uint64(t))
    return out
