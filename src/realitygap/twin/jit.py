"""How the twin's few inner loops are compiled.

What is compiled hangs on its own file alone, constants come in as values: so Numba, which looks at that
file, sees for itself when what it keeps is out of date. No flag lets it change the order of a sum.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

__all__ = ["jit", "step"]


def jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """What is called from Python: kept for the next process where that can be written."""
    return _compiled(function)


def step(function: Callable[..., Any]) -> Callable[..., Any]:
    """A part of it, inlined: arrays would cost more to hand over than the step itself."""
    return _compiled(function, forceinline=True)


def _compiled(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    options |= {"error_model": "numpy", "nogil": True}
    try:
        compiled: Callable[..., Any] = numba.njit(cache=True, **options)(function)
    except RuntimeError:
        compiled = numba.njit(**options)(function)
    return compiled
