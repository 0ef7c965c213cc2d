"""A variation without robots: individuals are four numbers, fit where they are all 20."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from realitygap.evolution import Algorithm, Population


@dataclass(frozen=True)
class Toy:
    """Individuals int8[4]; offspring mix their parents and take a step."""

    crossover: float = 0.8

    def random(self, stream: np.uint64) -> np.ndarray:
        return np.random.default_rng(int(stream)).integers(-100, 101, 4).astype(np.int8)

    def crosses(self, stream: np.uint64) -> bool:
        return bool(np.random.default_rng(int(stream)).random() < self.crossover)

    def offspring(self, first, second, stream: np.uint64) -> np.ndarray:
        random = np.random.default_rng(int(stream))
        mixed = np.where(random.random(4) < 0.5, first, second) if self.crosses(stream) else first
        return np.clip(mixed + random.integers(-3, 4, 4), -100, 100).astype(np.int8)


def fitness_of(genes: np.ndarray) -> float:
    """The closer to 20 everywhere, the fitter; 0 is best."""
    return -float(np.abs(genes.astype(int) - 20).sum())


def advance(algorithm: Algorithm, state: Population, n: int) -> Population:
    """The state after n more evaluations."""
    for _ in range(n):
        batch = algorithm.ask(state, 1)
        state = algorithm.tell(state, batch, np.array([fitness_of(batch.genes[0])]))
    return state
