"""What a reproduction does while its robot is recorded."""

from __future__ import annotations

import os
import pickle

import pytest

from realitygap.compiled import SHELF
from realitygap.experiments.reproduction import meanwhile
from realitygap.study.ahead import compile_ahead


@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="the compiler is off")
def test_what_evolution_and_transfers_call_is_compiled_ahead_once(monkeypatch):
    """A worker is given it where nothing is on file, never a single process; then all of it is on file."""
    compile_ahead()
    assert all(map(SHELF.holds, ("run_trials", "record_trial", "offspring"))) and not meanwhile(2)
    monkeypatch.setattr(type(SHELF), "holds", lambda self, function: False)
    assert not meanwhile(1)
    assert [pickle.loads(pickle.dumps(one)) for one in meanwhile(None)] == [compile_ahead]
