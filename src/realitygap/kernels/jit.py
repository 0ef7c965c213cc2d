"""How every kernel is compiled, and where the compiled code is kept.

`fastmath` is limited to flags that cannot reorder a sum: a fresh compilation, a cached one and
another machine give the same bits. With NUMBA_DISABLE_JIT=1 the same functions run as Python.
"""

import hashlib
import os
import tempfile
import warnings
from pathlib import Path

import numba
import numpy as np
from numba import njit

_FLAGS = {"nnan", "ninf", "nsz"}


def _cache_folder() -> Path:
    """A folder named after the compiled rooms' own text: no stale machine code is ever loaded.

    (Numba alone notices a change in a function's own file, not in the files it calls.)
    """
    package = Path(__file__).parent.parent
    digest = hashlib.sha256(numba.__version__.encode() + np.__version__.encode())
    for room in ("kernels", "controller", "evolution"):
        for source in sorted((package / room).glob("*.py")):
            digest.update(source.read_bytes())
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(home) / "realitygap" / digest.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except (OSError, RuntimeError):
        pass
    return Path(tempfile.mkdtemp(prefix="realitygap-"))


if not os.environ.get("NUMBA_CACHE_DIR"):
    numba.config.CACHE_DIR = str(_cache_folder())

if numba.config.DISABLE_JIT:
    # The generator's integers wrap on purpose; NumPy scalars would warn at each draw.
    warnings.filterwarnings("ignore", "overflow encountered", RuntimeWarning)

step = njit(cache=True, fastmath=_FLAGS, error_model="numpy", forceinline=True, _nrt=False)
"""For the parts of a step: inlined into the kernel that calls them.

Without Numba's reference counts, which cost more than the step itself: so no step allocates.
"""

kernel = njit(cache=True, fastmath=_FLAGS, error_model="numpy", nogil=True, _nrt=False)
"""For what is called from Python: releases the interpreter's lock while it runs, never allocates."""

routine = njit(cache=True, fastmath=_FLAGS, error_model="numpy", nogil=True)
"""For what runs once an evaluation, not once a step, and may allocate."""
