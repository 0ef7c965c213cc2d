"""§5.1: the paper's algorithm, a population spread over a grid, and two baselines beside it.

Evaluation e of a run is the event `substream(state.stream, e)`; its streams are named in `streams.py`:
OFFSPRING is the one that the variation draws from. A state and an event's number thus decide every bit
of an individual.
"""

import operator
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import StudyError, UsageError
from realitygap.evolution.algorithm import NOBODY, Batch, Variation
from realitygap.evolution.population import Population
from realitygap.evolution.selection import panmictic_event, torus_event
from realitygap.kernels.rng import substream
from realitygap.streams import OFFSPRING
from realitygap.text import must_be

__all__ = ["DistributedGA", "Panmictic", "RandomSearch"]

LARGEST = 4096
"""Most individuals of a population: every evaluation copies it."""


@dataclass(frozen=True, kw_only=True)
class _Cellular(ABC):
    """Random individuals, cell by cell, until all cells are full; then one offspring at a time."""

    encoding: Variation

    @property
    @abstractmethod
    def cells(self) -> int:
        """How many individuals live at a time."""

    def init(self, stream: np.uint64) -> Population:
        """Empty cells."""
        return Population.empty(stream, self.encoding.random(np.uint64(0)), self.cells)

    def ask(self, state: Population, n: int) -> Batch:
        """Random individuals while cells are empty, n at most; then one offspring.

        Raises:
            StudyError: a state of another number of cells than the algorithm's, or not of one number.
        """
        must_be(state, Population, "state", "`init` makes the first, `tell` the next.")
        cells = self.cells
        if len(state.fitness) != cells:
            there = len(state.fitness)
            raise StudyError(f"the algorithm has {cells} cells, but the state to continue from {there}")
        if not state.genes.shape[:1] == state.numbers.shape == state.fitness.shape:
            raise StudyError(f"a state's genes, fitness and numbers must each have {cells} cells")
        first = state.evaluations
        if first < cells:
            numbers = range(first, min(first + max(1, n), cells))
            genes = np.stack([self.encoding.random(_event(state, k, OFFSPRING)) for k in numbers])
            return state.batch(genes, cells=numbers)
        return self._next(state, np.uint64(substream(state.stream, first)))

    def tell(self, state: Population, batch: Batch, fitness: NDArray[np.float64]) -> Population:
        """Each lives in its cell, whatever its fitness."""
        return state.told(batch, fitness)

    def from_bytes(self, data: bytes) -> Population:
        """The state that was saved."""
        return Population.from_bytes(data)

    @abstractmethod
    def _next(self, state: Population, event: np.uint64) -> Batch:
        """One individual more, when all cells are full."""

    def _offspring(self, state: Population, event: np.uint64, places: tuple[int, int, int]) -> Batch:
        """A child of the cell that breeds and its mate, for the cell that it takes."""
        cell, mate, replaced = places
        stream = np.uint64(substream(event, OFFSPRING))
        genes = self.encoding.offspring(state.genes[cell], state.genes[mate], stream)
        second = state.numbers[mate] if self.encoding.crosses(stream) else NOBODY
        return state.batch(genes[np.newaxis], [(state.numbers[cell], second)], [replaced])


@dataclass(frozen=True, kw_only=True)
class DistributedGA(_Cellular):
    """The distributed genetic algorithm on a torus of rows × columns cells.

    The first rows · columns evaluations are random individuals, cell by cell. Then, at each
    evaluation: a cell is drawn; a mate, by linear rank of fitness, from its eight neighbours; the
    offspring takes one of the nine cells, by linear inverse rank: perhaps one of its parents'.
    """

    rows: int = 8
    columns: int = 8

    def __post_init__(self) -> None:
        for name in ("rows", "columns"):
            _check_size(getattr(self, name), 3, f"{name} of the torus")  # a cell has eight neighbours
        _check_size(self.cells, 9, "rows · columns of the torus")

    @cached_property
    def cells(self) -> int:
        """How many individuals live on the grid."""
        return self.rows * self.columns

    def _next(self, state: Population, event: np.uint64) -> Batch:
        return self._offspring(state, event, torus_event(state.fitness, self.rows, self.columns, event))


@dataclass(frozen=True, kw_only=True)
class _Sized(_Cellular):
    """So many cells, beside no others."""

    size: int = 64

    @property
    def cells(self) -> int:
        """How many individuals there are."""
        return self.size


@dataclass(frozen=True, kw_only=True)
class Panmictic(_Sized):
    """As the torus, but the mate is drawn from all others and the replaced cell from all."""

    def __post_init__(self) -> None:
        _check_size(self.size, 2, "size of the population")

    def _next(self, state: Population, event: np.uint64) -> Batch:
        return self._offspring(state, event, panmictic_event(state.fitness, event))


@dataclass(frozen=True, kw_only=True)
class RandomSearch(_Sized):
    """No selection and no inheritance; the cells hold the best `size` so far, for a retest."""

    def __post_init__(self) -> None:
        _check_size(self.size, 1, "size of the random search")

    def tell(self, state: Population, batch: Batch, fitness: NDArray[np.float64]) -> Population:
        """Each takes its cell only if it is fitter than who lives there."""
        return state.told(batch, fitness, operator.gt)

    def _next(self, state: Population, event: np.uint64) -> Batch:
        genes = self.encoding.random(np.uint64(substream(event, OFFSPRING)))
        return state.batch(genes[np.newaxis], cells=[int(np.argmin(state.fitness))])


def _event(state: Population, number: int, name: int) -> np.uint64:
    """A stream of an evaluation."""
    return np.uint64(substream(np.uint64(substream(state.stream, number)), name))


def _check_size(size: object, low: int, what: str) -> None:
    """Refuse a size that is no whole number from `low` to LARGEST."""
    if isinstance(size, bool) or not isinstance(size, int) or not low <= size <= LARGEST:
        raise UsageError(f"{what}: expected a whole number from {low} to {LARGEST}, got {size!r}.")
