"""An algorithm of your own: a (1+1)-ES on the paper's encoding.

    realitygap evolve avoidance --set evolution.algorithm=examples/one_plus_one.py:OnePlusOne

There is one individual. Each evaluation changes it a little, and the changed one replaces it
unless it is worse.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from realitygap.evolution import Batch, Population
from realitygap.kernels.rng import substream


@dataclass(frozen=True, kw_only=True)
class OnePlusOne:
    """The parent stays until a child is at least as fit.

    Attributes:
        encoding: creates individuals (`random`) and changes them (`offspring`).
        mutations: how often an individual is changed before it is evaluated.
    """

    encoding: Any
    mutations: int = 1
    cells: int = 1

    def init(self, stream: np.uint64) -> Population:
        """Nobody yet; all draws of the run will come from the stream."""
        return Population.empty(stream, self.encoding.random(np.uint64(0)), cells=1)

    def ask(self, state: Population, n: int) -> Batch:
        """One individual, for the next depends on whether this one stays."""
        event = np.uint64(substream(state.stream, state.evaluations))
        if state.evaluations == 0:
            return state.batch(self.encoding.random(event)[np.newaxis])
        parent = state.genes[0]
        genes = parent
        for k in range(self.mutations):
            # Both parents are the same one: crossing over changes nothing.
            genes = self.encoding.offspring(genes, genes, np.uint64(substream(event, k)))
        return state.batch(genes[np.newaxis], parents=[(state.numbers[0], -1)])

    def tell(self, state: Population, batch: Batch, fitness: np.ndarray) -> Population:
        """The new one takes the cell if it is at least as fit."""
        return state.told(batch, fitness, takes=fitness >= state.fitness[batch.cells])

    def from_bytes(self, data: bytes) -> Population:
        """The state that a study kept."""
        return Population.from_bytes(data)
