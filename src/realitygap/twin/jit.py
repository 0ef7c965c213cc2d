"""How the twin's few inner loops are compiled.

What is compiled hangs on its own file alone, constants come in as values: so what is kept on file is known
to be out of date by that file. No flag lets the compiler change the order of a sum.
"""

from __future__ import annotations

from functools import partial

from realitygap.machine_code import Shelf

__all__ = ["jit", "step"]

_SHELF = Shelf(b"the twin")

jit = partial(_SHELF.compiled, error_model="numpy", nogil=True)
"""For what is called from Python."""

step = partial(_SHELF.compiled, error_model="numpy", nogil=True, forceinline=True)
"""For a part of it, inlined: arrays would cost more to hand over than the step itself."""
