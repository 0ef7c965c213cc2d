"""Evaluations and fresh trials as arrays in a study's database, many to a row."""

import lzma
import zlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Block", "evaluations", "joined", "spread", "unpacked"]

Table = dict[str, NDArray[Any]]
FLOAT = np.dtype("<f8")
PRESET = 2
"""LZMA's: half of zlib's size, and faster to read; saving another twelfth would take seven times as long."""


LZMA = b"\xfd7zXZ"
"""How its data begin."""


class Block(NamedTuple):
    """n successive evaluations."""

    number: int
    """Number of the first."""
    scores: NDArray[np.float64]
    """[n, trials]."""
    fitness: NDArray[np.float64]
    """[n] mean scores."""
    places: NDArray[np.int64]
    """[n, 3] both parents, the cell."""
    genes: bytes

    def row(self, *, final: bool = True) -> tuple[object, ...]:
        """The columns of `evolved` after the run; those that are not `final` are soon replaced, so zlib's
        speed counts more than LZMA's size."""
        scores, fitness = (np.ascontiguousarray(a, FLOAT).tobytes() for a in (self.scores, self.fitness))
        if fitness == _plain(self.scores).tobytes():
            fitness = b""
        kind = "<u2" if self.places.max() < 0xFFFF else "<u4"
        places = (self.places + 1).astype(kind).tobytes()
        size = min(2**20, max(2**12, len(self.genes)))  # a larger one takes time to set up
        how = [{"id": lzma.FILTER_LZMA2, "preset": PRESET, "dict_size": size}]
        genes = lzma.compress(self.genes, filters=how) if final else zlib.compress(self.genes, 1)
        return self.number, len(self.places), scores, fitness, places, genes

    @classmethod
    def of(cls, row: Sequence[Any]) -> "Block":
        """From the columns of `evolved` after the run; without genes where those are left out."""
        number, count, scores, fitness, places, *genes = row
        kind = f"<u{len(places) // (3 * count)}"
        values = np.frombuffer(scores, FLOAT).reshape(count, -1)
        mean = np.frombuffer(fitness, FLOAT) if fitness else _plain(values)
        told = np.frombuffer(places, kind).reshape(count, 3).astype(np.int64) - 1
        return cls(number, values, mean, told, b"".join(map(unpacked, genes)))


def unpacked(genes: bytes) -> bytes:
    """Genotypes of a row of `evolved`, final or not."""
    return lzma.decompress(genes) if genes.startswith(LZMA) else zlib.decompress(genes)


def _plain(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means computed as SQL does; of more than two scores the last bit could differ."""
    count = scores.shape[1]
    return (scores.sum(axis=1) / count).astype(FLOAT) if count <= 2 else np.zeros(0, FLOAT)


def joined(blocks: Sequence[Block]) -> Block:
    """One block of several successive ones."""
    number, *arrays, genes = zip(*blocks, strict=True)
    scores, fitness, places = map(np.concatenate, arrays)
    return Block(number[0], scores, fitness, places, b"".join(genes))


def evaluations(rows: Iterable[Sequence[Any]], trials: int) -> Table:
    """Columns of rows of `evolved`, the run first, without genotypes; NaN after the scores of tasks with
    fewer than `trials` trials."""
    found = [(row[0], Block.of(row[1:])) for row in rows]
    found = found or [(0, Block(0, np.zeros((0, 1)), np.zeros(0), np.zeros((0, 3), np.int64), b""))]
    blocks = [block for _, block in found]
    numbers = [block.number + np.arange(len(block.places)) for block in blocks]
    columns = {
        "run": np.repeat([run for run, _ in found], [len(some) for some in numbers]),
        "number": np.concatenate(numbers),
        "fitness": np.concatenate([block.fitness for block in blocks]),
    }
    wide = [((0, 0), (0, trials - block.scores.shape[1])) for block in blocks]
    scores = [np.pad(b.scores, w, constant_values=np.nan) for b, w in zip(blocks, wide, strict=True)]
    columns |= {f"score_{k + 1}": column for k, column in enumerate(np.concatenate(scores).T)}
    places = np.concatenate([block.places for block in blocks]).T
    columns |= zip(("parent_a", "parent_b", "cell"), places, strict=True)
    return {name: np.ascontiguousarray(column) for name, column in columns.items()}


def spread(rows: Sequence[Sequence[Any]], kinds: Mapping[str, Any]) -> Table:
    """A row for each trial: the columns before the scores of `tested`, named by `kinds`; trial; score."""
    scores = [np.frombuffer(row[-1], FLOAT) for row in rows]
    counts = np.array([len(some) for some in scores], np.int64)
    before = [np.array([row[k] for row in rows], kind) for k, kind in enumerate(kinds.values())]
    told = {name: np.repeat(some, counts) for name, some in zip(kinds, before, strict=True)}
    trial = np.concatenate([[], *map(np.arange, counts)]).astype(np.int64)
    return {**told, "trial": trial, "score": np.concatenate([[], *scores])}
