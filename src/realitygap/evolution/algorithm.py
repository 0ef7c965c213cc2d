"""What every algorithm is: its state a value, asked for individuals and told their fitness.

It sees genes and fitness, never a robot. What an algorithm of your own looks like is shown by
`examples/`; `realitygap.testing` has the contract that every algorithm passes.
"""

import math
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import UsageError
from realitygap.values import shown

__all__ = [
    "NOBODY", "Algorithm", "Batch", "Genes", "State", "Variation", "check_batch", "check_state", "same",
]  # fmt: skip

Genes = NDArray[Any]
"""Individuals of any type and shape: [n, ...], or one, [...]."""

NOBODY = -1
"""Number of an absent parent or resident."""


class Batch(NamedTuple):
    """n individuals to be evaluated."""

    number: int
    """Evaluation number of the first, from 0; the others follow."""
    genes: Genes
    """[n, ...]."""
    parents: NDArray[np.int64]
    """[n, 2] evaluation numbers of the parents; −1: none (the second without crossover)."""
    cells: NDArray[np.int64]
    """[n] the cell that each will take, or is offered."""


class State(Protocol):
    """How far a run of an algorithm is; a value: nothing ever changes one. `Population` is one."""

    @property
    def evaluations(self) -> int:
        """How many it was told of."""

    @property
    def genes(self) -> Genes:
        """[cells, ...] who lives now; a finished run tests them all once more."""

    @property
    def numbers(self) -> NDArray[np.int64]:
        """[cells] evaluation number of each resident, −1 where no one lives."""

    @property
    def best_genes(self) -> Genes:
        """The fittest ever told (the first of equals)."""

    @property
    def best_fitness(self) -> float:
        """Its fitness, −inf before the first."""

    @property
    def best_number(self) -> int:
        """Its evaluation number, −1 before the first."""

    def to_bytes(self) -> bytes:
        """The state written down, as its algorithm's `from_bytes` reads it; equal states, equal bytes."""


S = TypeVar("S", bound=State)


class Algorithm(Protocol[S]):
    """init, then ask and tell by turns; each a function of its arguments alone."""

    @property
    def cells(self) -> int:
        """How many individuals a state holds."""

    def init(self, stream: np.uint64) -> S:
        """The state before the first evaluation; all of the run's draws come from the stream."""

    def ask(self, state: S, n: int) -> Batch:
        """The next individuals to evaluate: n at most, and at least one.

        Fewer where the next one depends on a fitness that is not known yet: the paper's algorithm gives
        what is left of its random beginning, then one at a time. Asking twice gives the same.
        """

    def tell(self, state: S, batch: Batch, fitness: NDArray[np.float64]) -> S:
        """The state after these evaluations, fitness [n]; the old one stays as it was."""

    def from_bytes(self, data: bytes) -> S:
        """The state that `State.to_bytes` wrote, bit for bit.

        Raises:
            StudyError: the bytes are damaged or of another version.
        """


class Variation(Protocol):
    """How individuals begin and change, where an algorithm leaves that to their encoding."""

    def random(self, stream: np.uint64) -> Genes:
        """A random individual."""

    def crosses(self, stream: np.uint64) -> bool:
        """Whether the offspring of this stream takes from both parents."""

    def offspring(self, first: Genes, second: Genes, stream: np.uint64) -> Genes:
        """A new individual from two, which stay as they are."""


def check_batch(batch: object, state: State, n: int, one: Genes) -> int:
    """Refuse what is not an answer to `ask(state, n)`, of individuals like `one`; return how many there are.

    Args:
        batch: the answer.
        state: that was asked about.
        n: as many as were asked for.
        one: an individual, of the type and shape of all.

    Raises:
        UsageError: says what was expected of the algorithm and what came.
    """
    if not isinstance(batch, Batch):
        raise UsageError(f"ask: expected a Batch, got {type(batch).__name__}.")
    genes, count = batch.genes, len(np.atleast_1d(batch.genes))
    if not isinstance(genes, np.ndarray) or (genes.dtype, genes.shape[1:]) != (one.dtype, one.shape):
        expected = f"{one.dtype}[n{''.join(f', {k}' for k in one.shape)}]"
        raise UsageError(f"ask: expected genes {expected}, got {shown(genes)}.")
    if genes.dtype.kind == "f" and not np.isfinite(genes).all():
        raise UsageError("ask: expected genes that are finite numbers, got NaN or infinity among them.")
    if not 1 <= count <= n or batch.number != state.evaluations:
        there = f"{count} from number {batch.number}"
        raise UsageError(f"ask: expected 1 to {n} individuals from number {state.evaluations}, got {there}.")
    for name, array, shape in (("parents", batch.parents, (count, 2)), ("cells", batch.cells, (count,))):
        if not _is_whole(array, shape):
            raise UsageError(f"ask: expected {name} int64{list(shape)}, got {shown(array)}.")
    return count


def check_state(state: State, cells: int, batch: Batch, fitness: NDArray[np.float64]) -> None:
    """Refuse a state with `cells` cells that does not match the evaluations that it was told of.

    Args:
        state: after them.
        cells: of its algorithm.
        batch: all evaluations since the last checked state.
        fitness: of them, [n].

    Raises:
        UsageError: says what was expected of the algorithm and what came.
    """
    first, told, kind = batch.number, state.evaluations, batch.genes.dtype
    late = batch.parents[(batch.parents < NOBODY) | (batch.parents >= np.arange(first, told)[:, np.newaxis])]
    if len(late):
        raise UsageError(f"ask: expected parents that were evaluated before, or {NOBODY}, got {late[0]}.")
    far = batch.cells[(batch.cells < 0) | (batch.cells >= cells)]
    if len(far):
        raise UsageError(f"ask: expected cells from 0 to {cells - 1}, got {far[0]}.")
    numbers, genes = state.numbers, state.genes
    if not _is_whole(numbers, (cells,)) or not ((numbers >= NOBODY) & (numbers < told)).all():
        expected = f"int64[{cells}], the evaluation in each cell or {NOBODY}"
        raise UsageError(f"tell: expected numbers {expected}, got {shown(numbers)} {numbers!s:.60}.")
    shape = (cells, *batch.genes.shape[1:])
    if not isinstance(genes, np.ndarray) or (genes.dtype, genes.shape) != (kind, shape):
        raise UsageError(f"tell: expected genes {kind}{list(shape)}, a cell each, got {shown(genes)}.")
    best, top, high = state.best_number, state.best_fitness, float(np.max(fitness))
    known = isinstance(best, int | np.integer) and 0 <= best < told
    its = float(fitness[best - first]) if known and best >= first else max(high, top)
    if not known or its < high or not math.isclose(its, top, rel_tol=1e-6):
        expected = "the highest fitness ever told (best_fitness) and its evaluation (best_number)"
        raise UsageError(f"tell: expected {expected}, got {top} of evaluation {best}.")
    for one, number in [*zip(genes, numbers, strict=True), (state.best_genes, best)]:
        if number >= first and not np.array_equal(one, batch.genes[number - first]):
            raise UsageError(f"tell: expected the genes of evaluation {number} with its number, got others.")


def _is_whole(array: object, shape: tuple[int, ...]) -> bool:
    return isinstance(array, np.ndarray) and array.dtype.kind == "i" and array.shape == shape


def same(one: Batch, other: Batch) -> bool:
    """Whether two batches are equal."""
    return all(np.array_equal(np.asarray(a), np.asarray(b)) for a, b in zip(one, other, strict=True))
