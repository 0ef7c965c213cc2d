"""How every kernel is compiled.

`fastmath` is limited to flags that cannot reorder a sum: a fresh compilation, a cached one and
another machine give the same bits. With NUMBA_DISABLE_JIT=1 the same functions run as Python.
"""

import warnings
from collections.abc import Callable
from functools import partial, update_wrapper
from pathlib import Path
from typing import Any

import numba
from llvmlite.binding import get_host_cpu_features
from numba._dispatcher import compute_fingerprint

from realitygap.kernels.pointed import pointed
from realitygap.machine_code import Shelf

_FLAGS = {"nnan", "ninf", "nsz"}

if numba.config.CPU_FEATURES is None and numba.config.ENABLE_AVX:
    # Rows of eight sensors fill a vector of 256 bits: of 512 they fill half, and are left to scalar code.
    _host = get_host_cpu_features()
    if _host.get("avx512f"):
        numba.config.CPU_FEATURES = f"{_host.flatten()},+prefer-256-bit"


def _text() -> bytes:
    """The compiled rooms' own text, so that no stale machine code is ever loaded."""
    package = Path(__file__).parent.parent
    rooms = ("kernels", "control", "evolution")
    sources = [source for room in rooms for source in sorted((package / room).glob("*.py"))]
    return b"".join(source.read_bytes() for source in (*sources, package / "streams.py"))


SHELF = Shelf(_text())

if numba.config.DISABLE_JIT:
    # The generator's integers wrap on purpose; NumPy scalars would warn at each draw.
    warnings.filterwarnings("ignore", "overflow encountered", RuntimeWarning)

helper = partial(SHELF.compiled, fastmath=_FLAGS, error_model="numpy", forceinline=True, _nrt=False)
"""For what kernels and Python call often.

Without Numba's reference counts, which cost more than the step itself: so no step allocates.
"""

step = partial(helper, form="PART")
"""For the parts of a step: inlined into the kernel that calls them. Python's calls compile it again."""

apart = partial(SHELF.compiled, fastmath=_FLAGS, error_model="numpy", form="APART", _nrt=False)
"""For large parts that several kernels call: compiled once for all of them."""

loose = partial(step, fastmath=_FLAGS | {"contract", "reassoc"})
loose_apart = partial(apart, fastmath=_FLAGS | {"contract", "reassoc"})
"""For what decides no bit of a result: bounds whose margin covers rounding in any order."""


def kernel(function: Callable[..., Any], *, like: Any = None, **options: Any) -> Any:
    """For what is called from Python: releases the interpreter's lock while it runs, never allocates.

    Inside, large tuples are passed by pointer (`pointed.py`).

    Args:
        function: what to compile.
        like: as of `Shelf.compiled`.
        options: others of Numba's.
    """
    if numba.config.DISABLE_JIT:
        return function
    body = apart(function, like=like, **options)

    def way_in(*given: Any) -> Any:
        return body(*pointed(given))

    update_wrapper(way_in, function)
    del vars(way_in)["__wrapped__"]  # Numba would take its parameters for this one's
    return SHELF.compiled(way_in, like=body, error_model="numpy", nogil=True, _nrt=False)


def entry_for(made: Any, *given: Any) -> Callable[[tuple[Any, ...]], Any]:
    """What runs a kernel on a tuple of arguments without a look at their types, which are those of `given`.

    Numba looks at all of them at every call, and in a World that takes longer than a step of a trial. Others
    would be taken for what they are not.

    Args:
        made: what `kernel` makes.
        given: arguments of these types.
    """
    if numba.config.DISABLE_JIT:
        return lambda others: made(*others)
    key = made, compute_fingerprint(given)  # by which Numba's own calls tell types apart
    if key not in _entries:
        _entries[key] = made.compile((made.typeof_pyval(given),))
    return _entries[key]


_entries: dict[tuple[Any, bytes], Callable[[tuple[Any, ...]], Any]] = {}

routine = partial(SHELF.compiled, fastmath=_FLAGS, error_model="numpy", nogil=True)
"""For what runs once an evaluation, not once a step, and may allocate."""
