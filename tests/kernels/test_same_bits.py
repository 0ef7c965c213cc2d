"""The same bits from a fresh compilation, from the cache, and from Python itself."""

from __future__ import annotations

import os
from pathlib import Path

from tests.kernels.child import compiled_into, fingerprints, in_a_child


def test_python_gives_the_same_bits():
    """With the compiler off, a short trial of each task gives the compiled one's bits."""
    assert in_a_child(1.0, 2, "whole", NUMBA_DISABLE_JIT="1") == fingerprints(1.0, 2)


def test_a_fresh_compilation_gives_the_same_bits(tmp_path):
    """Compiled anew into an empty cache, loaded from it, and here: three times the same bits."""
    folder = Path(os.environ.get("COMPILED_AFRESH", tmp_path))  # check.py compiles while types are checked
    fresh, code = compiled_into(folder), {path: path.stat() for path in folder.rglob("*.nbc")}
    assert any("run_trials-" in path.name for path in code), "nothing was compiled into it"
    cached = in_a_child(5.0, 20, "scores", NUMBA_CACHE_DIR=str(folder))
    again = {path: path.stat() for path in folder.rglob("*.nbc")}
    assert {p: s.st_mtime_ns for p, s in again.items()} == {p: s.st_mtime_ns for p, s in code.items()}
    assert fresh == cached == fingerprints(5.0, 20, whole=False)
