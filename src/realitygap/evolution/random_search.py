"""A baseline: every evaluation a fresh random individual, of which the best are kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from realitygap.evolution.algorithm import (
    Candidate,
    State,
    Variation,
    check_size,
    empty,
    event_of,
    first,
    told,
)

__all__ = ["RandomSearch"]


@dataclass(frozen=True, kw_only=True)
class RandomSearch:
    """No selection and no inheritance; the cells hold the best `size` so far, for a retest."""

    variation: Variation
    size: int = 64

    def __post_init__(self) -> None:
        check_size(self.size, 1, "size of the random search")

    @property
    def cells(self) -> int:
        """How many individuals are kept."""
        return self.size

    def init(self, stream: np.uint64) -> State:
        """Nobody yet."""
        return empty(self.variation, stream, self.size)

    def ask(self, state: State) -> Candidate:
        """A random individual, for an empty cell or that of the least fit."""
        event = event_of(state, self.size)
        return first(self.variation, state, event, int(np.argmin(state.fitness)))

    def tell(self, state: State, candidate: Candidate, fitness: float) -> State:
        """The candidate takes its cell only if it is fitter than who lives there."""
        return told(state, candidate, fitness, placed=fitness > state.fitness[candidate.cell])
