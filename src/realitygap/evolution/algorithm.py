"""What every algorithm is: its state a value, asked for a candidate and told its fitness.

It sees genes and fitness, never a robot. Evaluation e of a run is the event
`substream(state.stream, e)`; its streams are named in `streams.py`: OFFSPRING is the one
that the variation draws from. A state and an event's number thus decide every bit of a candidate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import StudyError, UsageError
from realitygap.evolution import checkpoint
from realitygap.kernels.rng import substream
from realitygap.streams import OFFSPRING

__all__ = ["Algorithm", "Candidate", "Genes", "State", "Variation"]

Genes = NDArray[np.int8]

NOBODY = -1
"""The number of a parent that is not there."""
LARGEST = 4096
"""Most individuals of a population: every evaluation copies it."""


class Variation(Protocol):
    """How individuals begin and change; each method is a function of its arguments."""

    def random(self, stream: np.uint64) -> Genes:
        """A random individual."""

    def crosses(self, stream: np.uint64) -> bool:
        """Whether the offspring of this stream takes from both parents."""

    def offspring(self, first: Genes, second: Genes, stream: np.uint64) -> Genes:
        """A new individual from two, which stay as they are."""


class Candidate(NamedTuple):
    """An individual to be evaluated."""

    number: int
    """Evaluation number, from 0."""
    genes: Genes
    parents: tuple[int, int]
    """Evaluation numbers of the parents; −1: none (the second without crossover)."""
    cell: int
    """The cell it will take."""


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """A population and all that is needed to go on; a value: nothing ever changes one.

    Attributes:
        stream: where all draws of the run come from.
        evaluations: how many were told.
        genes: [cells, ...] int8 individuals.
        fitness: [cells], −inf where no one lives yet.
        numbers: [cells] evaluation number of each resident, −1 where no one lives yet.
        best_genes, best_fitness, best_number: the fittest ever told (the first of equals).
    """

    stream: np.uint64
    evaluations: int
    genes: Genes
    fitness: NDArray[np.float64]
    numbers: NDArray[np.int64]
    best_genes: Genes
    best_fitness: float
    best_number: int

    def to_bytes(self) -> bytes:
        """The state written down, checked on reading."""
        return checkpoint.pack(self)

    @classmethod
    def from_bytes(cls, data: bytes) -> State:
        """The state that `to_bytes` wrote, bit for bit.

        Raises:
            StudyError: the bytes are damaged or of another version.
        """
        return cls(**checkpoint.unpack(data))


class Algorithm(Protocol):
    """init, then ask and tell by turns; pure functions of state."""

    @property
    def cells(self) -> int:
        """How many individuals a state holds."""

    def init(self, stream: np.uint64) -> State:
        """The state before the first evaluation."""

    def ask(self, state: State) -> Candidate:
        """The next individual to evaluate; asking twice gives the same."""

    def tell(self, state: State, candidate: Candidate, fitness: float) -> State:
        """The state after this evaluation; the old one stays as it was."""


def check_size(size: object, low: int, what: str) -> None:
    """Refuse a size that is no whole number from `low` to LARGEST.

    Raises:
        UsageError: says what `what` must be.
    """
    if isinstance(size, bool) or not isinstance(size, int) or not low <= size <= LARGEST:
        raise UsageError(f"{what} must be a whole number from {low} to {LARGEST}, not {size!r}")


def empty(variation: Variation, stream: np.uint64, cells: int) -> State:
    """A state of empty cells for individuals of a variation."""
    blank = np.zeros_like(variation.random(np.uint64(0)))
    return State(
        stream=np.uint64(stream),
        evaluations=0,
        genes=np.zeros((cells, *blank.shape), np.int8),
        fitness=np.full(cells, -np.inf),
        numbers=np.full(cells, NOBODY, np.int64),
        best_genes=blank,
        best_fitness=-math.inf,
        best_number=NOBODY,
    )


def event_of(state: State, cells: int) -> np.uint64:
    """The stream of the state's next event.

    Raises:
        StudyError: a state of another number of cells than the algorithm's, or not of one number.
    """
    if len(state.fitness) != cells:
        raise StudyError(f"the algorithm has {cells} cells, but the state to go on from {len(state.fitness)}")
    if not state.genes.shape[:1] == state.numbers.shape == state.fitness.shape:
        raise StudyError(f"a state's genes, fitness and numbers must each have {cells} cells")
    return np.uint64(substream(state.stream, state.evaluations))


def first(variation: Variation, state: State, event: np.uint64, cell: int) -> Candidate:
    """A candidate without parents."""
    genes = variation.random(np.uint64(substream(event, OFFSPRING)))
    return Candidate(state.evaluations, genes, (NOBODY, NOBODY), cell)


def bred(variation: Variation, state: State, event: np.uint64, cells: tuple[int, int, int]) -> Candidate:
    """The offspring of two cells, for a third: `cells` is (first parent, mate, replaced)."""
    cell, mate, replaced = cells
    stream = np.uint64(substream(event, OFFSPRING))
    genes = variation.offspring(state.genes[cell], state.genes[mate], stream)
    second = int(state.numbers[mate]) if variation.crosses(stream) else NOBODY
    return Candidate(state.evaluations, genes, (int(state.numbers[cell]), second), replaced)


def told(state: State, candidate: Candidate, fitness: float, *, placed: bool = True) -> State:
    """The state after an evaluation; the candidate lives in its cell if it is `placed`.

    Raises:
        UsageError: a fitness that is no finite number, an answer out of turn, or another's candidate.
    """
    try:
        fitness = float(fitness)
    except (TypeError, ValueError):
        fitness = math.nan
    if not math.isfinite(fitness):
        raise UsageError(
            f"the fitness of evaluation {candidate.number} must be a finite number, "
            f"not {fitness}: see to the task's score"
        )
    kind, shape = candidate.genes.dtype, candidate.genes.shape
    cells = len(state.fitness)
    if kind != np.int8 or shape != state.best_genes.shape or not 0 <= candidate.cell < cells:
        expected = f"genes int8{list(state.best_genes.shape)} for a cell of 0 to {cells - 1}"
        raise UsageError(f"the candidate must have {expected}, not {kind}{list(shape)} for {candidate.cell}")
    if candidate.number != state.evaluations:
        raise UsageError(f"expected the fitness of evaluation {state.evaluations}, not of {candidate.number}")
    genes, residents, numbers = state.genes, state.fitness, state.numbers
    if placed:
        genes, residents, numbers = genes.copy(), residents.copy(), numbers.copy()
        genes[candidate.cell] = candidate.genes
        residents[candidate.cell] = fitness
        numbers[candidate.cell] = candidate.number
    better = fitness > state.best_fitness
    return State(
        stream=state.stream,
        evaluations=state.evaluations + 1,
        genes=genes,
        fitness=residents,
        numbers=numbers,
        best_genes=candidate.genes if better else state.best_genes,
        best_fitness=fitness if better else state.best_fitness,
        best_number=candidate.number if better else state.best_number,
    )
