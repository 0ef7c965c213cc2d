"""The same bits from a fresh compilation, from the cache, and from Python itself."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

from tests.kernels.child import fingerprints

PROJECT = Path(__file__).parents[2]


def in_a_child(seconds: float, count: int, part: str, **environment: str) -> list[str]:
    """The fingerprints as another process prints them."""
    words = [sys.executable, "-m", "tests.kernels.child", str(seconds), str(count), part]
    done = subprocess.run(
        words, cwd=PROJECT, env={**os.environ, **environment}, capture_output=True, text=True, timeout=500
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split("\n")[:-1]


def test_python_gives_the_same_bits():
    """With the compiler off, a short trial of each task gives the compiled one's bits."""
    assert in_a_child(1.0, 2, "whole", NUMBA_DISABLE_JIT="1") == fingerprints(1.0, 2)


def test_a_fresh_compilation_gives_the_same_bits(tmp_path):
    """Compiled anew into an empty cache, loaded from it, and here: three times the same bits."""
    expected = fingerprints(5.0, 20, whole=False)
    start = time.perf_counter()
    fresh = in_a_child(5.0, 20, "scores", NUMBA_CACHE_DIR=str(tmp_path))
    compiled = time.perf_counter()
    assert any(tmp_path.rglob("*.code")), "nothing was compiled into the empty cache"
    cached = in_a_child(5.0, 20, "scores", NUMBA_CACHE_DIR=str(tmp_path))
    assert time.perf_counter() - compiled < compiled - start, "the second run compiled again"
    assert fresh == expected and cached == expected
