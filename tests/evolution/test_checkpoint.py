"""A checkpoint is a state bit for bit, or it is refused."""

from __future__ import annotations

from io import BytesIO

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
    """With any one byte changed a checkpoint is refused, or is the same state: zip has bytes nobody reads."""
    damaged = bytearray(BYTES)
    damaged[place] ^= change
    try:
        back = Population.from_bytes(bytes(damaged))
    except StudyError as error:
        assert "damaged" in str(error)
    else:
        assert back.to_bytes() == BYTES


@settings(max_examples=50)
@given(st.integers(0, len(BYTES) - 1))
def test_cut_off_checkpoints_are_found(length):
    """A checkpoint that was not written to its end is found."""
    with pytest.raises(StudyError, match="damaged"):
        Population.from_bytes(BYTES[:length])


def test_checkpoints_of_another_kind_are_found():
    """One of an earlier realitygap, an archive of something else, and pickled objects: never loaded."""
    other, pickled = BytesIO(), BytesIO()
    np.savez(other, genes=STATE.genes)
    np.savez(pickled, genes=np.array([{}]))
    for data in (b"RGEV\2\0" + BYTES, other.getvalue(), pickled.getvalue()):
        with pytest.raises(
            StudyError, match=r"damaged, or an older realitygap wrote it \(.*with the realitygap"
        ):
            Population.from_bytes(data)


def test_other_kinds_come_back():
    """Real-valued individuals, and whatever else an algorithm remembers, come back bit for bit."""
    empty = Population.empty(np.uint64(7), np.zeros((2, 3)), 1, step=0.3, mean=np.arange(4, dtype=np.float32))
    state = empty.told(empty.batch(np.full((1, 2, 3), 1 / 3)), [-0.1]).remember(step=np.pi)
    back = Population.from_bytes(state.to_bytes())
    assert back.genes.dtype == np.float64 and (back.genes == 1 / 3).all() and back.best_fitness == -0.1
    assert back.memory["step"] == np.pi and (back.memory["mean"] == np.arange(4)).all()
    assert back.memory["mean"].dtype == np.float32 and back.to_bytes() == state.to_bytes()
