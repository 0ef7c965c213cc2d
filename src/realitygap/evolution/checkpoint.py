"""A state as bytes: a header, its fields, and a checksum over all of it; no pickle.

Layout, little-endian: magic "RGEV", version, then zlib of [stream, evaluations, best number,
best fitness, number of dimensions of `genes`, their lengths, genes, fitness, numbers, best
genes], then the CRC-32 of everything before it.
"""

from __future__ import annotations

import math
import struct
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

from realitygap.errors import StudyError

if TYPE_CHECKING:
    from realitygap.evolution.algorithm import State

__all__ = ["pack", "unpack"]

MAGIC = b"RGEV"
VERSION = 1
_HEAD = struct.Struct("<4sH")
_FIELDS = struct.Struct("<QqqdI")
_CRC = struct.Struct("<I")


def pack(state: State) -> bytes:
    """The bytes of a state; equal states give equal bytes."""
    shape = state.genes.shape
    body = b"".join(
        (
            _FIELDS.pack(
                int(state.stream), state.evaluations, state.best_number, state.best_fitness, len(shape)
            ),
            struct.pack(f"<{len(shape)}q", *shape),
            state.genes.astype("<i1").tobytes(),
            state.fitness.astype("<f8").tobytes(),
            state.numbers.astype("<i8").tobytes(),
            state.best_genes.astype("<i1").tobytes(),
        )
    )
    data = _HEAD.pack(MAGIC, VERSION) + zlib.compress(body, 1)
    return data + _CRC.pack(zlib.crc32(data))


def unpack(data: bytes) -> dict[str, Any]:
    """The fields of the state that `pack` wrote.

    Raises:
        StudyError: says what was expected of the checkpoint and what came.
    """
    if len(data) < _HEAD.size + _CRC.size or data[:4] != MAGIC:
        raise StudyError(f"a checkpoint must begin with {MAGIC!r}, not {bytes(data[:4])!r}: it is damaged")
    version = _HEAD.unpack_from(data)[1]
    content, crc = data[: -_CRC.size], _CRC.unpack(data[-_CRC.size :])[0]
    if zlib.crc32(content) != crc:
        raise StudyError("a checkpoint is damaged: its checksum does not fit its content")
    if version != VERSION:
        raise StudyError(
            f"a checkpoint is of version {version}, this realitygap reads version {VERSION}: "
            "use the realitygap that wrote it"
        )
    try:
        return _fields(zlib.decompress(content[_HEAD.size :]))
    except (struct.error, zlib.error, ValueError) as error:
        raise StudyError(f"a checkpoint is damaged: {error}") from None


def _fields(body: bytes) -> dict[str, Any]:
    stream, evaluations, best_number, best_fitness, dimensions = _FIELDS.unpack_from(body)
    at = _FIELDS.size
    shape = struct.unpack_from(f"<{dimensions}q", body, at)
    at += 8 * dimensions
    arrays = []
    for kind, dims in (("<i1", shape), ("<f8", shape[:1]), ("<i8", shape[:1]), ("<i1", shape[1:])):
        count = math.prod(dims)
        array = np.frombuffer(body, kind, count, at).reshape(dims)
        arrays.append(array.astype(array.dtype.newbyteorder("=")))
        at += array.nbytes
    return {
        "stream": np.uint64(stream),
        "evaluations": evaluations,
        "genes": arrays[0],
        "fitness": arrays[1],
        "numbers": arrays[2],
        "best_genes": arrays[3],
        "best_fitness": best_fitness,
        "best_number": best_number,
    }
