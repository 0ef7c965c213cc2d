"""A state for most algorithms: individuals in cells, the fittest ever, and what else is remembered.

Its bytes are a header, numbers and arrays by their names, and a checksum; no pickle. Layout, little-endian:
magic "RGEV", version, then zlib of a line of JSON ([numbers, name, type and shape of each array]) and the
arrays, then the CRC-32 of everything before it. Version 1 held the fields of a population in a fixed order,
its genes int8; it is still read.
"""

import json
import math
import struct
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from realitygap.errors import StudyError, UsageError
from realitygap.evolution.algorithm import NOBODY, Batch, Genes
from realitygap.text import must_be
from realitygap.values import as_stream, shown

__all__ = ["MAGIC", "Population", "pack", "unpack"]

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
