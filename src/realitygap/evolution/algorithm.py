"""What an algorithm is: its state a value, asked for individuals and told their fitness.

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
    "NOBODY", "Algorithm", "Batch", "Genes", "State", "Variation", "check_batch", "check_state",
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
        """[cells, ...] the residents; a finished run tests them all once more."""

    @property
    def numbers(self) -> NDArray[np.int64]:
        """[cells] evaluation number of each resident, −1 where a cell is empty."""

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


def check_batch(batch: object, state: State, n: int, one: Genes) -> None:
    """Refuse what cannot be evaluated or stored as an answer to `ask(state, n)`: individuals like `one`."""
    if not isinstance(batch, Batch):
        raise UsageError(f"ask: expected a Batch, got {type(batch).__name__}.")
    count = len(batch.genes)
    _check_array("ask: expected genes", batch.genes, one.dtype, (count, *one.shape))
    _check_array("ask: expected parents", batch.parents, np.int64, (count, 2))
    _check_array("ask: expected cells", batch.cells, np.int64, (count,))
    if one.dtype.kind == "f" and not np.isfinite(batch.genes).all():
        raise UsageError("ask: expected genes that are finite numbers, got NaN or infinity among them.")
    if not 1 <= count <= n or batch.number != state.evaluations:
        there = f"{count} from number {batch.number}"
        raise UsageError(f"ask: expected 1 to {n} individuals from number {state.evaluations}, got {there}.")


def check_state(state: State, cells: int, fitness: NDArray[np.float64], one: Genes) -> None:
    """Refuse a state that cannot be tested or stored, with cells for individuals like `one`; or of an
    algorithm that minimises: `fitness` [n] is what it was told."""
    _check_array("tell: expected genes", state.genes, one.dtype, (cells, *one.shape))
    _check_array("tell: expected numbers", state.numbers, np.int64, (cells,))
    _check_array("tell: expected best_genes", state.best_genes, one.dtype, one.shape)
    best, high = state.best_fitness, float(fitness.max())
    if best < high and not math.isclose(best, high, rel_tol=1e-6):  # perhaps kept in single precision
        raise UsageError(f"tell: expected the highest fitness ever told, {high} or more, got {best}.")


def _check_array(expected: str, array: object, kind: Any, shape: tuple[int, ...]) -> None:
    if not isinstance(array, np.ndarray) or (array.dtype, array.shape) != (kind, shape):
        raise UsageError(f"{expected} {np.dtype(kind)}{list(shape)}, got {shown(array)}.")
