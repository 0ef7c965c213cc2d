"""An algorithm's state as bytes: a header, numbers and arrays by their names, and a checksum; no pickle.

Layout, little-endian: magic "RGEV", version, then zlib of a line of JSON ([numbers, name, type and shape
of each array]) and the arrays, then the CRC-32 of everything before it. Version 1 held the fields of a
population in a fixed order, its genes int8; it is still read.
"""

import json
import math
import struct
import zlib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import StudyError

__all__ = ["MAGIC", "pack", "unpack"]

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
