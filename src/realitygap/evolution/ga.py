"""The distributed genetic algorithm (§5.1), and two to compare it with."""

import json
import math
import operator
import struct
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from realitygap.errors import StudyError, UsageError
from realitygap.evolution.algorithm import NOBODY, Batch, Genes, Variation
from realitygap.files import must_be
from realitygap.kernels.jit import routine, step
from realitygap.kernels.rng import below, bits, substream
from realitygap.streams import CELL, MATE, OFFSPRING, REPLACED
from realitygap.values import as_stream, shown

__all__ = [
    "MAGIC", "DistributedGA", "Panmictic", "Population", "RandomSearch", "pack", "panmictic_event",
    "torus_event", "unpack",
]  # fmt: skip


MAGIC = b"RGEV"
VERSION = 2
_HEAD = struct.Struct("<4sH")
_FIRST = struct.Struct("<QqqdI")
_CRC = struct.Struct("<I")


def pack(numbers: Mapping[str, int | float], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """The bytes of a state's numbers and arrays; equal states give equal bytes."""
    kept = {name: np.asarray(a, a.dtype.newbyteorder("<")) for name, a in arrays.items()}
    forms = [(name, array.dtype.str, array.shape) for name, array in kept.items()]
    body = json.dumps([numbers, forms]).encode() + b"\n" + b"".join(a.tobytes() for a in kept.values())
    data = _HEAD.pack(MAGIC, VERSION) + zlib.compress(body, 1)
    return data + _CRC.pack(zlib.crc32(data))


def unpack(data: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The numbers and arrays of the state that `pack` wrote.

    Raises:
        StudyError: says what was expected of the checkpoint and what came.
    """
    if len(data) < _HEAD.size + _CRC.size or data[:4] != MAGIC:
        raise StudyError(f"a checkpoint: expected {MAGIC!r} first, got {bytes(data[:4])!r}: it is damaged.")
    version = _HEAD.unpack_from(data)[1]
    content, crc = data[: -_CRC.size], _CRC.unpack(data[-_CRC.size :])[0]
    if zlib.crc32(content) != crc:
        raise StudyError("a checkpoint is damaged: its checksum does not fit its content")
    if version not in (1, VERSION):
        raise StudyError(
            f"a checkpoint is of version {version}, this realitygap reads versions 1 to {VERSION}: "
            "use the realitygap that wrote it"
        )
    try:
        body = zlib.decompress(content[_HEAD.size :])
        return _first_version(body) if version == 1 else _fields(body)
    except (struct.error, zlib.error, ValueError, TypeError) as error:
        raise StudyError(f"a checkpoint is damaged: {error}") from None


def _fields(body: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    head, _, _ = body.partition(b"\n")
    numbers, forms = json.loads(head)
    return numbers, _arrays(body, len(head) + 1, forms)


def _first_version(body: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    stream, evaluations, number, fitness, dimensions = _FIRST.unpack_from(body)
    shape = struct.unpack_from(f"<{dimensions}q", body, _FIRST.size)
    forms = [("genes", "<i1", shape), ("fitness", "<f8", shape[:1]), ("numbers", "<i8", shape[:1])]
    forms.append(("best_genes", "<i1", shape[1:]))
    told = {"stream": stream, "evaluations": evaluations, "best_fitness": fitness, "best_number": number}
    return told, _arrays(body, _FIRST.size + 8 * dimensions, forms)


def _arrays(body: bytes, at: int, forms: Iterable[Any]) -> dict[str, NDArray[Any]]:
    """Arrays of given names, types and shapes, one behind the other."""
    arrays = {}
    for name, kind, shape in forms:
        array = np.frombuffer(body, kind, math.prod(shape), at).reshape(shape)
        arrays[name] = array.astype(array.dtype.newbyteorder("="))
        at += array.nbytes
    return arrays


ARRAYS = ("genes", "fitness", "numbers", "best_genes")
NUMBERS = ("stream", "evaluations", "best_fitness", "best_number")


def _arrays_of(memory: Mapping[str, ArrayLike]) -> dict[str, NDArray[Any]]:
    arrays = {name: np.array(value) for name, value in memory.items()}
    for name, array in arrays.items():
        if array.dtype.hasobject:
            raise UsageError(f"memory: {name}: expected numbers or an array of them, got {memory[name]!r}.")
    return arrays


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
            memory=_arrays_of(memory),
        )

    def batch(self, genes: Genes, parents: ArrayLike | None = None, cells: ArrayLike | None = None) -> Batch:
        """The next individuals [n, ...]: without parents and for cells 0 to n − 1 unless they are given."""
        n = len(genes)
        named = np.full((n, 2), NOBODY, np.int64) if parents is None else np.array(parents, np.int64)
        return Batch(self.evaluations, genes, named, np.array(range(n) if cells is None else cells, np.int64))

    def told(
        self,
        batch: Batch,
        fitness: ArrayLike,
        takes: Callable[[float, float], bool] = lambda _fitness, _resident: True,
    ) -> Self:
        """The population after some evaluations.

        Args:
            batch: who was evaluated.
            fitness: theirs, [n].
            takes: of a fitness and that of the resident: whether one takes the cell; always, if left out.

        Raises:
            UsageError: a fitness that is not finite, an answer out of turn, or other individuals.
        """
        values = self._checked(batch, fitness)
        genes, residents, numbers = self.genes.copy(), self.fitness.copy(), self.numbers.copy()
        best = (self.best_genes, self.best_fitness, self.best_number)
        for i, (value, cell) in enumerate(zip(values, batch.cells.tolist(), strict=True)):
            if takes(value, float(residents[cell])):
                genes[cell], residents[cell], numbers[cell] = batch.genes[i], value, batch.number + i
            if value > best[1]:
                best = (batch.genes[i], value, batch.number + i)
        return replace(
            self,
            evaluations=self.evaluations + len(values),
            genes=genes,
            fitness=residents,
            numbers=numbers,
            best_genes=best[0].copy(),
            best_fitness=best[1],
            best_number=best[2],
        )

    def remember(self, **memory: ArrayLike) -> Self:
        """The same with other arrays in its memory; those that are not named stay.

        Raises:
            UsageError: something that is not an array of numbers: it could not be saved.
        """
        return replace(self, memory={**self.memory, **_arrays_of(memory)})

    def _checked(self, batch: Batch, fitness: ArrayLike) -> list[float]:
        """The fitness of each, if the batch is one that could be asked of this population."""
        must_be(batch, Batch, "batch", "Give what `ask` returned.")
        if np.iscomplexobj(fitness):
            raise UsageError(f"fitness: expected real numbers, got {shown(np.asarray(fitness))}.")
        try:
            values = np.asarray(fitness, np.float64).reshape(len(batch.genes)).tolist()
        except (TypeError, ValueError):
            values = [math.nan]
        for i, value in enumerate(values):
            if not math.isfinite(value):
                raise UsageError(
                    f"the fitness of evaluation {batch.number + i}: expected a finite number, "
                    f"got {value}. Check the task's score."
                )
        kind, shape, cells = batch.genes.dtype, batch.genes.shape[1:], len(self.fitness)
        right = (kind, shape) == (self.best_genes.dtype, self.best_genes.shape)
        if not right or batch.cells.min() < 0 or batch.cells.max() >= cells:
            expected = f"genes {shown(self.best_genes)} for cells of 0 to {cells - 1}"
            raise UsageError(
                f"the batch: expected {expected}, got {kind}{list(shape)} for {batch.cells.tolist()}"
            )
        if batch.number != self.evaluations:
            raise UsageError(f"expected the fitness of evaluation {self.evaluations}, not of {batch.number}")
        return values

    def to_bytes(self) -> bytes:
        """The population as bytes, checked on reading."""
        numbers = {name: getattr(self, name) for name in NUMBERS} | {"stream": int(self.stream)}
        memory = {f"memory.{name}": value for name, value in self.memory.items()}
        return pack(numbers, {name: getattr(self, name) for name in ARRAYS} | memory)

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """The population that `to_bytes` wrote, bit for bit.

        Raises:
            StudyError: the bytes are damaged or of another version.
        """
        numbers, arrays = unpack(data)
        memory = {n.removeprefix("memory."): arrays.pop(n) for n in list(arrays) if n.startswith("memory.")}
        if set(numbers) != set(NUMBERS) or set(arrays) != set(ARRAYS):
            raise StudyError(f"a checkpoint: expected {', '.join(NUMBERS + ARRAYS)}: it is damaged.")
        numbers["stream"] = np.uint64(numbers["stream"])
        return cls(**numbers, **cast("dict[str, Any]", arrays), memory=memory)


# mypy: allow-untyped-defs, no-check-untyped-defs


@step
def _by_rank(fitness, cells, n, sign, stream):
    """One of cells[:n] by linear rank of sign · fitness: the winner of a pair (see above)."""
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
def _neighbourhood(cell, rows, columns, cells):
    """Fills `cells` with the eight neighbours of a cell on the torus, then itself."""
    row = cell // columns
    column = cell - row * columns
    n = 0
    for down in range(-1, 2):
        for right in range(-1, 2):
            if down != 0 or right != 0:
                cells[n] = (row + down + rows) % rows * columns + (column + right + columns) % columns
                n += 1
    cells[8] = cell


@routine
def torus_event(fitness, rows, columns, event):
    """(cell that breeds, its mate, the cell that the offspring takes) on a grid with fitness [rows · columns]
    (§5.1).

    Args:
        fitness: [rows · columns] of the grid.
        rows, columns: its size.
        event: random numbers.
    """
    cell = below(substream(event, CELL), 0, rows * columns)
    cells = np.empty(9, np.int64)
    _neighbourhood(cell, rows, columns, cells)
    mate = _by_rank(fitness, cells, 8, 1.0, substream(event, MATE))
    replaced = _by_rank(fitness, cells, 9, -1.0, substream(event, REPLACED))
    return cell, mate, replaced


@routine
def panmictic_event(fitness, event):
    """(cell that breeds, its mate, the cell that the offspring takes) among all cells."""
    size = len(fitness)
    cell = below(substream(event, CELL), 0, size)
    cells = np.arange(size)
    cells[cell] = size - 1
    cells[size - 1] = cell
    mate = _by_rank(fitness, cells, size - 1, 1.0, substream(event, MATE))
    replaced = _by_rank(fitness, cells, size, -1.0, substream(event, REPLACED))
    return cell, mate, replaced


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
