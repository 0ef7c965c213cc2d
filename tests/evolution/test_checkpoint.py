"""A checkpoint is a state bit for bit, or it is refused."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from realitygap.errors import StudyError
from realitygap.evolution import DistributedGA, State
from tests.evolution.toy import Toy, advance

ALGORITHM = DistributedGA(variation=Toy())
STATE = advance(ALGORITHM, ALGORITHM.init(np.uint64(2**63 + 5)), 100)
BYTES = STATE.to_bytes()


@pytest.mark.parametrize("evaluations", [0, 1, 64, 65])
def test_round_trip(evaluations):
    """Every field comes back with its type, shape and bits, of empty states too."""
    state = advance(ALGORITHM, ALGORITHM.init(np.uint64(3)), evaluations)
    back = State.from_bytes(state.to_bytes())
    for name in State.__dataclass_fields__:
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
    with pytest.raises(StudyError, match=r"a checkpoint .* damaged"):
        State.from_bytes(bytes(damaged))


@settings(max_examples=50)
@given(st.integers(0, len(BYTES) - 1))
def test_cut_off_checkpoints_are_found(length):
    """A checkpoint that was not written to its end is found."""
    with pytest.raises(StudyError, match="damaged"):
        State.from_bytes(BYTES[:length])


def test_other_versions_are_named():
    """A checkpoint of a later version says so, with the cure."""
    later = BYTES[:4] + struct.pack("<H", 2) + BYTES[6:-4]
    later += struct.pack("<I", zlib.crc32(later))
    with pytest.raises(StudyError, match="version 2, this realitygap reads version 1"):
        State.from_bytes(later)


def test_content_of_another_size_is_found():
    """A checkpoint whose content is too short for its own numbers is damaged, checksum or not."""
    body = zlib.decompress(BYTES[6:-4])
    for content in (zlib.compress(body[:-1]), zlib.compress(body[:10]), b"no zlib"):
        short = BYTES[:6] + content
        short += struct.pack("<I", zlib.crc32(short))
        with pytest.raises(StudyError, match="damaged"):
            State.from_bytes(short)


def test_checkpoints_are_small():
    """A hundred evaluations of the toy take a few kilobytes, so a study can keep them all."""
    assert len(BYTES) < 3000
