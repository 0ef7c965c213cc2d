"""How the twin's inner loops are compiled, and kept on file until a file of this package changes."""

from functools import partial
from pathlib import Path

from realitygap.machine_code import Shelf

__all__ = ["jit", "part"]

_SHELF = Shelf(b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py"))))

jit = partial(_SHELF.compiled, error_model="numpy", nogil=True, _nrt=False)
"""For what allocates nothing: Numba's reference counts cost as much as the work itself."""

part = partial(jit, forceinline=True, form="PART")
"""For a part of it, inlined: arrays would cost more to hand over than the step itself."""
