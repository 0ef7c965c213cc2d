"""Machine code of a GPU's kernels: compiled as numba-cuda does not offer to, and kept on file."""

import hashlib
import importlib.metadata
import itertools
import pickle
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path as File
from typing import Any, NamedTuple

import numba
from numba import cuda, types

from realitygap import tasks
from realitygap.kernels.jit import SHELF

__all__ = ["SIMULATED", "Kernel", "compiling", "kept"]

SIMULATED = bool(numba.config.ENABLE_CUDASIM)
FIRST = 1_000_000
"""Number of the first node of our own among a module's metadata."""


class Kernel(NamedTuple):
    """What is launched: numba-cuda's kernel, the threads of a block, whether it is made of steps,
    and whether their loops are to stay loops."""

    made: Any
    block: int
    steps: bool
    rolled: bool = False


class _Entries:
    """What numba-cuda asks for a kernel's machine code, one entry for each signature and kind of GPU.

    Args:
        name: the kernel's.
        facts: what it is made of besides the text of kernels, tasks and this engine.
    """

    def __init__(self, name: str, *facts: object) -> None:
        here, theirs = File(__file__).parent.glob("cuda*.py"), File(tasks.__file__).parent.glob("*.py")
        texts = [*sorted(here), *sorted(theirs)]
        known = repr((facts, importlib.metadata.version("numba-cuda"))).encode()
        self._name, self._of = name, known + b"".join(text.read_bytes() for text in texts)

    def load_overload(self, sig: Any, _target_context: Any) -> Any:
        """What was compiled for a signature; None where it has to be compiled."""
        from numba.cuda.dispatcher import _Kernel

        content = SHELF.read(self._entry(sig))
        if content is not None:
            try:
                return _Kernel._rebuild(**pickle.loads(content))
            except Exception:  # whole, but not to be used: of another making
                SHELF.refuse(self._entry(sig))
        return None

    def save_overload(self, sig: Any, made: Any) -> None:
        """Keep what was compiled, if it can be."""
        from numba.cuda.serialize import dumps

        with suppress(pickle.PicklingError, TypeError, RuntimeError):
            SHELF.write(self._entry(sig), dumps(made._reduce_states()))

    def _entry(self, sig: Any) -> str:
        facts = repr((sig, cuda.get_current_device().compute_capability)).encode()
        return f"{self._name}-{hashlib.sha256(self._of + facts).hexdigest()[:24]}.cuda"


def kept(made: Any, *facts: object) -> Any:
    """A kernel whose machine code is kept on file."""
    if not SIMULATED:
        made._cache = _Entries(made.py_func.__name__, *facts)
    return made


@contextmanager
def compiling(steps: bool, rolled: bool = False) -> Iterator[None]:
    """Compile as numba-cuda does not offer to: multiplications and additions are not fused.

    Args:
        steps: also, no index counts from an array's end, as negative ones otherwise do. Steps have none.
        rolled: no loop is unrolled, for code has to be fetched.
    """
    from numba.cuda.cudadrv import nvvm
    from numba.cuda.np import arrayobj

    compile_ir, fix_index = nvvm.compile_ir, arrayobj.fix_integer_index
    text = _rolled if rolled else _as_it_is
    nvvm.compile_ir = lambda ir, **options: compile_ir(text(ir), **{**options, "fma": False})
    if steps:
        arrayobj.fix_integer_index = _index
    try:
        yield
    finally:
        nvvm.compile_ir, arrayobj.fix_integer_index = compile_ir, fix_index


def _as_it_is(ir: Any) -> Any:
    return ir


def _rolled(ir: str | list[str]) -> list[str]:
    """Modules of LLVM's text whose loops are to stay loops: so much is said at every branch."""
    return [_rolled_one(text) for text in ([ir] if isinstance(ir, str) else ir)]


def _rolled_one(text: str) -> str:
    numbers = itertools.count(FIRST + 1)
    said = re.sub(r"(?m)^\s+br (?:label|i1) .*$", lambda br: f"{br[0]}, !llvm.loop !{next(numbers)}", text)
    nodes = (f"!{n} = distinct !{{!{n}, !{FIRST}}}" for n in range(FIRST + 1, next(numbers)))
    return "\n".join((said, f'!{FIRST} = !{{!"llvm.loop.unroll.disable"}}', *nodes, ""))


def _index(context: Any, builder: Any, kind: Any, index: Any, _size: Any) -> Any:
    """An index as a number of the width of a pointer."""
    return context.cast(builder, index, kind, types.intp if kind.signed else types.uintp)
