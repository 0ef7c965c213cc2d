"""What evolution calls is compiled side by side, once."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from realitygap.kernels.jit import SHELF
from realitygap.study import ahead
from realitygap.work.pool import Here
from realitygap.work.processes import Processes

PARTS = """
from numba.core import event

from realitygap.study.ahead import STAGES, Ahead

compiled = []


class Names(event.Listener):
    def on_start(self, event):
        compiled.append(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event):
        pass


event.register("numba:compile", Names())
done = Ahead()
for job in (*STAGES[0][:2], STAGES[1][0]):
    done.carry_out(job, print)
print(*compiled)
"""


@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="the compiler is off")
def test_a_part_that_was_compiled_alone_is_the_one_that_trials_need(tmp_path):
    """Compiled from nothing: none is compiled again when what encloses it is; a kernel has a way in."""
    done = subprocess.run(
        [sys.executable, "-c", PARTS], capture_output=True, text=True, check=True,
        env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)},
    )  # fmt: skip
    names = done.stdout.split()
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
