"""A task's score, compiled once and kept on disk as the kernels are."""

from __future__ import annotations

import inspect
import re
from functools import lru_cache
from typing import Any

import numpy as np

from realitygap.errors import TaskError
from realitygap.kernels.params import Path, Room
from realitygap.tasks.task import Score

__all__ = ["compile_score", "example"]


@lru_cache(maxsize=64)
def compile_score(score: Score) -> Score:
    """`score` compiled by Numba for (Path, Room); `score` itself where the compiler is off.

    Raises:
        TaskError: it does not compile or returns no float; names file and line.
    """
    import numba

    from realitygap.kernels.jit import SHELF

    if numba.config.DISABLE_JIT:
        return score
    compiled = SHELF.compiled(score, error_model="numpy")
    types = tuple(numba.typeof(value) for value in example())
    try:
        compiled.compile(types)
    except Exception as error:  # Numba's own errors, and those it lets through (a name NumPy lacks)
        raise TaskError(f"{_where(score, error)}: the score cannot be compiled: {_reason(error)}") from None
    returned = compiled.overloads[types].signature.return_type
    if returned != numba.float64:
        raise TaskError(
            f"{_where(score)}: score: expected a function that returns a float, it returns "
            f"{_named(returned)}. Return one number on every way out, as float(…)."
        )
    return compiled  # type: ignore[no-any-return]


def example() -> tuple[Path, Room]:
    """A path and a room of the types that every score meets."""
    row = np.zeros(2)
    path = Path(x=row, y=row, heading=row, left=row, right=row, contact=row)
    room = Room(
        lamps=np.zeros((1, 2)), size=np.ones(2), cylinders=np.zeros((1, 3)), top_speed=8.0, radius=2.9
    )
    return path, room


def _where(score: Score, error: Any = None) -> str:
    line = getattr(getattr(error, "loc", None), "line", None) or score.__code__.co_firstlineno
    return f"{inspect.getfile(score)}, line {line}"


def _named(returned: Any) -> str:
    """A type of Numba's in a Python user's words."""
    text = str(returned)
    if text == "none":
        return "nothing"
    if text.startswith("OptionalType"):
        return "nothing on some ways out"
    return "int" if text.startswith(("Literal[int]", "int", "uint")) else text


def _reason(error: Exception) -> str:
    """The line of Numba's report that says what is wrong, and what a score may use."""
    dull = ("Failed in", "During:", "File ", "<source", "This error", "-", "^", ">>>", "def ")
    plain = re.sub(r"\x1b\[[0-9;]*m", "", str(error))
    lines = [line.strip() for line in plain.splitlines()]
    told = [line for line in lines if line and not line.startswith(dull)]
    first = next((line for line in told if "rror" in line or "nknown" in line or "No " in line), "")
    return f"{(first or (told or ['unknown'])[0]).rstrip('.')}. A score may use numbers, math and NumPy only."
