"""The distributed genetic algorithm (§5.1), and two to compare it with.

Who breeds (`select`) and who stays (`takes`) is told of any number of populations side by side: `ask` and
`tell` have one, `study/batched.py` has all runs of a condition.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from io import BytesIO
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from realitygap.compiled import routine, step
from realitygap.errors import StudyError, UsageError
from realitygap.evolution.algorithm import NOBODY, Batch, Genes, Variation
from realitygap.kernels.rng import below, bits, substream
from realitygap.streams import CELL, MATE, OFFSPRING, REPLACED
from realitygap.values import as_count, as_stream

__all__ = ["DistributedGA", "Panmictic", "Population", "RandomSearch", "select"]

LARGEST = 4096
"""Most individuals of a population: every evaluation copies it."""

EVERYBODY = 0
"""In place of a torus's rows: everybody is everybody's neighbour."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Population:
    """A population and all that is needed to continue; a value: nothing ever changes one.

    Attributes:
        stream: where all draws of the run come from.
        evaluations: how many it was told of.
        genes: [cells, ...] individuals.
        fitness: [cells], −inf where no one lives yet.
        numbers: [cells] evaluation number of each resident, −1 where no one lives yet.
        best_genes, best_fitness, best_number: the fittest ever told (the first of equals).
        memory: arrays by name that an algorithm also continues from, such as the size of its steps.
    """

    stream: np.uint64
    evaluations: int
    genes: Genes
    fitness: NDArray[np.float64]
    numbers: NDArray[np.int64]
    best_genes: Genes
    best_fitness: float
    best_number: int
    memory: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    @classmethod
    def empty(cls, stream: np.uint64, like: Genes, cells: int, **memory: ArrayLike) -> Self:
        """Empty cells for individuals of the type and shape of one."""
        return cls(
            stream=as_stream(stream),
            evaluations=0,
            genes=np.zeros((cells, *like.shape), like.dtype),
            fitness=np.full(cells, -np.inf),
            numbers=np.full(cells, NOBODY, np.int64),
            best_genes=np.zeros_like(like),
            best_fitness=-math.inf,
            best_number=NOBODY,
        ).remember(**memory)

    def batch(self, genes: Genes, parents: ArrayLike | None = None, cells: ArrayLike | None = None) -> Batch:
        """The next individuals [n, ...]: without parents and for cells 0 to n − 1 unless they are given."""
        n = len(genes)
        named = np.full((n, 2), NOBODY, np.int64) if parents is None else np.array(parents, np.int64)
        return Batch(self.evaluations, genes, named, np.array(range(n) if cells is None else cells, np.int64))

    def told(self, batch: Batch, fitness: ArrayLike, takes: ArrayLike | None = None) -> Self:
        """The population after some evaluations.

        Args:
            batch: who was evaluated.
            fitness: theirs, [n].
            takes: whether each takes its cell, bool [n]; all do, if left out.

        Raises:
            UsageError: a fitness that is not finite, or an answer out of turn.
        """
        values = np.asarray(fitness, np.float64).reshape(len(batch.genes))
        if not np.isfinite(values).all():
            number = batch.number + int(np.argmin(np.isfinite(values)))
            raise UsageError(f"the fitness of evaluation {number}: expected a finite number from the score.")
        if batch.number != self.evaluations:
            raise UsageError(f"expected the fitness of evaluation {self.evaluations}, not of {batch.number}")
        new = np.arange(len(values)) if takes is None else np.flatnonzero(takes)
        at = batch.cells[new]
        genes, residents, numbers = self.genes.copy(), self.fitness.copy(), self.numbers.copy()
        genes[at], residents[at], numbers[at] = batch.genes[new], values[new], batch.number + new
        return self.after(batch.genes, values, {"genes": genes, "fitness": residents, "numbers": numbers})

    def after(self, genes: Genes, fitness: NDArray[np.float64], residents: Mapping[str, Any]) -> Self:
        """The population after individuals [n, ...] of fitness [n], of which some live now.

        Args:
            genes, fitness: of those who were evaluated.
            residents: genes, fitness and numbers of those who live.
        """
        told, first = {"best_genes": self.best_genes.copy(), **residents}, int(fitness.argmax())
        if fitness[first] > self.best_fitness:
            told["best_genes"] = genes[first].copy()
            told |= {"best_fitness": float(fitness[first]), "best_number": self.evaluations + first}
        return replace(self, evaluations=self.evaluations + len(fitness), **told)

    def remember(self, **memory: ArrayLike) -> Self:
        """The same with other arrays in its memory; those that are not named stay.

        Raises:
            UsageError: something that is not an array of numbers: it could not be saved.
        """
        arrays = {name: np.array(value) for name, value in memory.items()}
        if wrong := [name for name, array in arrays.items() if array.dtype.hasobject]:
            got = f"{wrong[0]}: expected numbers or an array of them, got {memory[wrong[0]]!r}"
            raise UsageError(f"memory: {got}.")
        return replace(self, memory={**self.memory, **arrays})

    def to_bytes(self) -> bytes:
        """The population as an .npz: an array for each field, and `memory.NAME` for what is remembered."""
        arrays = {name: getattr(self, name) for name in self.__dataclass_fields__ if name != "memory"}
        arrays |= {f"memory.{name}": array for name, array in self.memory.items()}
        file = BytesIO()
        np.savez_compressed(file, **arrays)
        return file.getvalue()

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """The population that `to_bytes` wrote, bit for bit.

        Raises:
            StudyError: the bytes are damaged, or of another version.
        """
        try:
            with np.load(BytesIO(data)) as file:
                arrays: dict[str, Any] = dict(file)
            remembered = [name for name in arrays if name.startswith("memory.")]
            memory = {name.removeprefix("memory."): arrays.pop(name) for name in remembered}
            arrays["stream"] = np.uint64(arrays["stream"])
            for name in ("evaluations", "best_fitness", "best_number"):
                arrays[name] = arrays[name].item()
            return cls(**arrays, memory=memory)
        except Exception as why:  # readers of zip and npy raise whatever a wrong byte leads them to
            raise StudyError(
                f"a checkpoint is damaged, or an older realitygap wrote it ({why}). "
                "Continue with the realitygap that wrote it, or begin the study anew."
            ) from None


# mypy: allow-untyped-defs, no-check-untyped-defs


@step
def _by_rank(fitness, cells, n, sign, stream):
    """One of cells[:n] by linear rank of sign · fitness: the winner of a pair out of these and one more, who
    always loses. So rank 1 … n, from the worst, wins with a weight of 1 … n."""
    i = below(stream, 0, n + 1)
    j = below(stream, 1, n)
    if j >= i:
        j += 1
    if i == n:
        return cells[j]
    if j == n:
        return cells[i]
    a = sign * fitness[cells[i]]
    b = sign * fitness[cells[j]]
    if a > b or (a == b and bits(stream, 2) & np.uint64(1)):
        return cells[i]
    return cells[j]


@step
def _neighbours(cell, rows, size, near):
    """Fills `near` with the eight neighbours of a cell on a torus of `rows`, or all others; then itself."""
    if rows == EVERYBODY:
        for other in range(size):
            near[other] = other
        near[cell] = size - 1
        near[size - 1] = cell
        return
    columns = size // rows
    row = cell // columns
    column = cell - row * columns
    n = 0
    for down in range(-1, 2):
        for right in range(-1, 2):
            if down != 0 or right != 0:
                near[n] = (row + down + rows) % rows * columns + (column + right + columns) % columns
                n += 1
    near[8] = cell


@routine
def select(fitness, grid, streams, number):
    """Who breeds at an evaluation, and whose cell the child takes, in each of several populations (§5.1).

    Args:
        fitness: [runs, cells].
        grid: rows of the torus; EVERYBODY, or NOBODY where none breeds.
        streams: [runs], the runs' own.
        number: of the evaluation.

    Returns:
        [runs, 3]: the cell that breeds; its mate, a neighbour; whose cell the child takes, a neighbour's or
        its own. NOBODY in place of both parents: the cell is for a random individual.
    """
    runs, size = fitness.shape
    chosen = np.empty((runs, 3), np.int64)
    near = np.empty(9 if grid > 0 else size, np.int64)
    n = len(near)
    for r in range(runs):
        if number < size or grid == NOBODY:
            taken = number
            if number >= size:
                taken = 0
                for cell in range(1, size):  # the first of the worst; argmin would load SciPy
                    if fitness[r, cell] < fitness[r, taken]:
                        taken = cell
            chosen[r] = NOBODY
            chosen[r, 2] = taken
            continue
        event = np.uint64(substream(streams[r], number))
        cell = below(substream(event, CELL), 0, size)
        _neighbours(cell, grid, size, near)
        chosen[r, 0] = cell
        chosen[r, 1] = _by_rank(fitness[r], near, n - 1, 1.0, substream(event, MATE))
        chosen[r, 2] = _by_rank(fitness[r], near, n, -1.0, substream(event, REPLACED))
    return chosen


@dataclass(frozen=True, kw_only=True)
class _Cellular:
    """Random individuals, cell by cell, until all cells are full; then one at a time."""

    encoding: Variation
    grid = EVERYBODY
    """As of `select`."""

    @property
    def cells(self) -> int:
        """How many individuals live at a time."""
        raise NotImplementedError

    def init(self, stream: np.uint64) -> Population:
        """Empty cells."""
        return Population.empty(stream, self.encoding.random(np.uint64(0)), self.cells)

    def ask(self, state: Population, n: int) -> Batch:
        """Random individuals while cells are empty, n at most; then one offspring.

        Raises:
            StudyError: a state of another number of cells than the algorithm's.
        """
        start, there = state.evaluations, len(state.fitness)
        if there != self.cells:
            raise StudyError(f"the algorithm has {self.cells} cells, but the state to continue from {there}")
        genes, parents, cells = [], [], []
        for number in range(start, max(start + 1, min(start + n, self.cells))):
            fitness, streams = state.fitness[np.newaxis], np.array([state.stream])
            cell, mate, taken = select(fitness, self.grid, streams, number)[0].tolist()
            stream = np.uint64(substream(np.uint64(substream(state.stream, number)), OFFSPRING))
            if cell == NOBODY:
                genes.append(self.encoding.random(stream))
                parents.append((NOBODY, NOBODY))
            else:
                genes.append(self.encoding.offspring(state.genes[cell], state.genes[mate], stream))
                second = state.numbers[mate] if self.encoding.crosses(stream) else NOBODY
                parents.append((state.numbers[cell], second))
            cells.append(taken)
        return state.batch(np.stack(genes), parents, cells)

    def tell(self, state: Population, batch: Batch, fitness: NDArray[np.float64]) -> Population:
        """Each lives in its cell, if it takes it."""
        return state.told(batch, fitness, self.takes(fitness, state.fitness[batch.cells]))

    def takes(self, fitness: NDArray[np.float64], residents: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether individuals take the cells of others, by the fitness of both: always."""
        return np.ones(np.shape(fitness), bool)

    def from_bytes(self, data: bytes) -> Population:
        """The state that was saved."""
        return Population.from_bytes(data)


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
        for name in ("rows", "columns"):  # a cell has eight neighbours
            as_count(getattr(self, name), f"{name} of the torus", 3, LARGEST)
        as_count(self.cells, "rows · columns of the torus", 9, LARGEST)

    @property
    def cells(self) -> int:
        """How many individuals live on the grid."""
        return self.rows * self.columns

    @property
    def grid(self) -> int:  # type: ignore[override]
        """Its rows."""
        return self.rows


@dataclass(frozen=True, kw_only=True)
class Panmictic(_Cellular):
    """As the torus, but the mate is drawn from all others and the replaced cell from all."""

    size: int = 64
    least = 2

    def __post_init__(self) -> None:
        as_count(self.size, "size of the population", self.least, LARGEST)

    @property
    def cells(self) -> int:
        """How many individuals there are."""
        return self.size


@dataclass(frozen=True, kw_only=True)
class RandomSearch(Panmictic):
    """No selection and no inheritance; the cells hold the best `size` so far, for a retest."""

    grid = NOBODY
    least = 1

    def takes(self, fitness: NDArray[np.float64], residents: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Only if they are fitter."""
        return np.greater(fitness, residents)
