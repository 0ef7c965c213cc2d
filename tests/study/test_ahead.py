"""What evolution calls is compiled side by side, once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from realitygap.compiled import SHELF
from realitygap.study import ahead
from realitygap.work.pool import Here, Processes
from tests.kernels.child import compiled_into


@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="the compiler is off")
def test_a_part_that_was_compiled_alone_is_the_one_that_trials_need(tmp_path):
    """Compiled from nothing: none is compiled again when what encloses it is; a kernel has a way in."""
    names, _ = compiled_into(Path(os.environ.get("COMPILED_AFRESH", tmp_path)))
    assert [names.count(one) for one in ("ambient", "infrared", "move", "run_trials")] == [1, 1, 1, 2]
    assert names.index("ambient") < names.index("infrared") < names.index("run_trials")


@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="the compiler is off")
def test_only_several_processes_compile_and_only_what_is_not_on_file(monkeypatch):
    """One process, or a pool of somebody's own, goes on as it is."""
    asked = []
    monkeypatch.setattr(Processes, "work", lambda self, setup, jobs, tell: asked.append(jobs))
    held = {"run_trials": False}
    monkeypatch.setattr(type(SHELF), "holds", lambda self, name: held[name])
    for pool in (Here(), Processes(1)):
        ahead.compile_side_by_side(pool)
    assert not asked
    ahead.compile_side_by_side(Processes(2))
    assert asked == list(ahead.STAGES)
    held["run_trials"] = True
    ahead.compile_side_by_side(Processes(2))
    assert len(asked) == len(ahead.STAGES)
