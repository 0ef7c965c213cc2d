"""A baseline: the paper's algorithm without its grid, everyone a neighbour of everyone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from realitygap.evolution.algorithm import (
    Candidate,
    State,
    Variation,
    bred,
    check_size,
    empty,
    event_of,
    first,
    told,
)
from realitygap.evolution.selection import panmictic_event

__all__ = ["Panmictic"]


@dataclass(frozen=True, kw_only=True)
class Panmictic:
    """As the torus, but the mate is drawn from all others and the replaced cell from all."""

    variation: Variation
    size: int = 64

    def __post_init__(self) -> None:
        check_size(self.size, 2, "size of the population")

    @property
    def cells(self) -> int:
        """How many individuals the population has."""
        return self.size

    def init(self, stream: np.uint64) -> State:
        """An empty population."""
        return empty(self.variation, stream, self.size)

    def ask(self, state: State) -> Candidate:
        """A random individual while cells are empty, then an offspring."""
        event = event_of(state, self.size)
        if state.evaluations < self.size:
            return first(self.variation, state, event, state.evaluations)
        return bred(self.variation, state, event, panmictic_event(state.fitness, event))

    def tell(self, state: State, candidate: Candidate, fitness: float) -> State:
        """The candidate lives in its cell, whatever its fitness."""
        return told(state, candidate, fitness)
