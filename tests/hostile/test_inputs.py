"""A slice of the fuzzing of every kind of file; `python -m tests.hostile` tries as many as one likes."""

import pytest

from tests.hostile.__main__ import case, fault, tried
from tests.hostile.inputs import KINDS


@pytest.mark.parametrize("name", KINDS)
def test_every_changed_file_ends_in_one_line(name):
    """No traceback, nothing "unexpected", no warning of NumPy's: done, or one line about it."""
    for number in range(12):
        assert fault(*tried(name, case(name, 5, number))) == "", number


def test_sound_files_are_read():
    """Changed files would all be refused alike if the sound ones were."""
    refused = [name for name, kind in KINDS.items() if tried(name, kind.data)[0] and name != "poses"]
    assert refused == []
