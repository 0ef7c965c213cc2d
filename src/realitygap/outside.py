"""What a user's function uses from outside its own file."""

import builtins
import dis
import hashlib
import inspect
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

__all__ = ["frozen", "used"]

_PLAIN = (int, float, complex, str, np.generic, np.ndarray, tuple)
"""What Numba takes the value of, once for all."""


def used(function: Any) -> Iterator[tuple[int, Any, str]]:
    """What a function's names stand for, through modules too: line, value and name of each."""
    scope = {**vars(builtins), **function.__globals__, **inspect.getclosurevars(function).nonlocals}
    found: Any = None
    for step in dis.get_instructions(function):
        name, line = str(step.argval), getattr(step.positions, "lineno", None)
        if step.opname.startswith(("LOAD_GLOBAL", "LOAD_DEREF")):
            found = scope.get(name)
        elif step.opname in ("LOAD_ATTR", "LOAD_METHOD") and isinstance(found, ModuleType):
            found = getattr(found, name, None)
        else:
            continue
        yield line or function.__code__.co_firstlineno, found, name


def frozen(function: Any, met: tuple[Any, ...] = ()) -> tuple[str, ...]:
    """What is compiled into a function though its file does not show it, as texts: numbers, texts and arrays,
    which may change while no file does, and the files of the compiled functions of a user's that it calls.

    Raises:
        OSError, TypeError: one of these functions has no file.
    """
    from numba.core.serialize import dumps  # slow to load, and needed only where something is compiled

    found: list[str] = []
    for _, one, name in used(function):
        if isinstance(one, _PLAIN):
            found.append(f"{name}={dumps(one)!r}")
        called = getattr(one, "py_func", None)
        ours = str(getattr(called, "__module__", "")).startswith(f"{__package__}.")
        if called is not None and called not in met and not ours:
            met = (*met, called)
            text = hashlib.sha256(Path(inspect.getfile(called)).read_bytes()).hexdigest()
            found += [text, called.__qualname__, str(called.__code__.co_firstlineno), *frozen(called, met)]
    return tuple(found)
