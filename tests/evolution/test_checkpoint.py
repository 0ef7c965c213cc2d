"""A checkpoint is a state bit for bit, or it is refused."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from realitygap.errors import StudyError
from realitygap.evolution import DistributedGA, Population
from tests.evolution.toy import Toy, advance

ALGORITHM = DistributedGA(encoding=Toy())
STATE = advance(ALGORITHM, ALGORITHM.init(np.uint64(2**63 + 5)), 100)
BYTES = STATE.to_bytes()


@pytest.mark.parametrize("evaluations", [0, 1, 64, 65])
def test_round_trip(evaluations):
    """Every field comes back with its type, shape and bits, of empty states too."""
    state = advance(ALGORITHM, ALGORITHM.init(np.uint64(3)), evaluations)
    back = Population.from_bytes(state.to_bytes())
    for name in Population.__dataclass_fields__:
        mine, other = getattr(state, name), getattr(back, name)
        assert type(mine) is type(other), name
        if isinstance(mine, np.ndarray):
            assert mine.dtype == other.dtype and mine.shape == other.shape
            assert mine.tobytes() == other.tobytes() and other.flags.writeable
        else:
            assert mine == other
    assert back.to_bytes() == state.to_bytes()


@settings(max_examples=200)
@given(st.integers(0, len(BYTES) - 1), st.integers(1, 255))
def test_damage_is_found(place, change):
    """Any one byte changed is found, and said."""
    damaged = bytearray(BYTES)
    damaged[place] ^= change
    with pytest.raises(StudyError, match=r"a checkpoint.* damaged"):
        Population.from_bytes(bytes(damaged))


@settings(max_examples=50)
@given(st.integers(0, len(BYTES) - 1))
def test_cut_off_checkpoints_are_found(length):
    """A checkpoint that was not written to its end is found."""
    with pytest.raises(StudyError, match="damaged"):
        Population.from_bytes(BYTES[:length])


def test_other_versions_are_named():
    """A checkpoint of a later version says so, with the cure."""
    later = BYTES[:4] + struct.pack("<H", 3) + BYTES[6:-4]
    later += struct.pack("<I", zlib.crc32(later))
    with pytest.raises(StudyError, match="version 3, this realitygap reads versions 1 to 2"):
        Population.from_bytes(later)


def test_content_of_another_size_is_found():
    """A checkpoint whose content is too short for its own numbers is damaged, checksum or not."""
    body = zlib.decompress(BYTES[6:-4])
    for content in (zlib.compress(body[:-1]), zlib.compress(body[:10]), b"no zlib"):
        short = BYTES[:6] + content
        short += struct.pack("<I", zlib.crc32(short))
        with pytest.raises(StudyError, match="damaged"):
            Population.from_bytes(short)


def test_other_kinds_come_back():
    """Real-valued individuals, and whatever else an algorithm remembers, come back bit for bit."""
    empty = Population.empty(np.uint64(7), np.zeros((2, 3)), 1, step=0.3, mean=np.arange(4, dtype=np.float32))
    state = empty.told(empty.batch(np.full((1, 2, 3), 1 / 3)), [-0.1]).remember(step=np.pi)
    back = Population.from_bytes(state.to_bytes())
    assert back.genes.dtype == np.float64 and (back.genes == 1 / 3).all() and back.best_fitness == -0.1
    assert back.memory["step"] == np.pi and (back.memory["mean"] == np.arange(4)).all()
    assert back.memory["mean"].dtype == np.float32 and back.to_bytes() == state.to_bytes()


def test_the_first_version_is_read():
    """A checkpoint of a study made by an earlier version goes on where it was."""
    shape = STATE.genes.shape
    body = struct.pack("<QqqdI", int(STATE.stream), 100, STATE.best_number, STATE.best_fitness, len(shape))
    body += struct.pack("<2q", *shape) + STATE.genes.tobytes() + STATE.fitness.tobytes()
    body += STATE.numbers.tobytes() + STATE.best_genes.tobytes()
    old = b"RGEV" + struct.pack("<H", 1) + zlib.compress(body, 1)
    back = Population.from_bytes(old + struct.pack("<I", zlib.crc32(old)))
    assert back.to_bytes() == BYTES
    assert advance(ALGORITHM, back, 20).to_bytes() == advance(ALGORITHM, STATE, 20).to_bytes()


def test_checkpoints_are_small():
    """A hundred evaluations of the toy take a few kilobytes, so a study can keep them all."""
    assert len(BYTES) < 3000
