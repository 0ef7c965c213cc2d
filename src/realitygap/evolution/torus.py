"""The paper's algorithm (§5.1): a population spread over a grid, breeding with its neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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
from realitygap.evolution.selection import torus_event

__all__ = ["DistributedGA"]


@dataclass(frozen=True, kw_only=True)
class DistributedGA:
    """The distributed genetic algorithm on a torus of rows × columns cells.

    The first rows · columns evaluations are random individuals, cell by cell. Then, at each
    evaluation: a cell is drawn; a mate, by linear rank of fitness, from its eight neighbours; the
    offspring takes one of the nine cells, by linear inverse rank: perhaps one of its parents'.
    """

    variation: Variation
    rows: int = 8
    columns: int = 8

    def __post_init__(self) -> None:
        for name in ("rows", "columns"):
            check_size(getattr(self, name), 3, f"{name} of the torus")  # a cell has eight neighbours
        check_size(self.cells, 9, "rows · columns of the torus")

    @cached_property
    def cells(self) -> int:
        """How many individuals live on the grid."""
        return self.rows * self.columns

    def init(self, stream: np.uint64) -> State:
        """An empty grid."""
        return empty(self.variation, stream, self.cells)

    def ask(self, state: State) -> Candidate:
        """A random individual while cells are empty, then an offspring."""
        event = event_of(state, self.cells)
        if state.evaluations < self.cells:
            return first(self.variation, state, event, state.evaluations)
        cells = torus_event(state.fitness, self.rows, self.columns, event)
        return bred(self.variation, state, event, cells)

    def tell(self, state: State, candidate: Candidate, fitness: float) -> State:
        """The candidate lives in its cell, whatever its fitness."""
        return told(state, candidate, fitness)
