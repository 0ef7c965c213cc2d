"""How the twin's inner loops are compiled: without licence for the compiler to rewrite arithmetic."""

from functools import partial

from realitygap.compiled import compiled, step

__all__ = ["jit", "part"]

jit = partial(compiled, nogil=True, allocates=False)
"""For what is called from Python."""

part = partial(step, fastmath=False)
"""For a part of it, inlined: arrays would cost more to hand over than the step itself."""
