"""Options for Numba's compiler: whether other code links a function's whole code or only its name.

Everything that this project compiles uses one of these; machine_code.py keeps the results on file.
"""

import gc
from typing import Any

from llvmlite.binding import Linkage, parse_assembly
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

__all__ = ["APART", "ENTIRE", "PART"]


class _Code(JITCodeLibrary):  # type: ignore[misc]
    """Code in which LLVM may not duplicate a call that it will inline later: a call looks cheap, so LLVM
    would otherwise copy whole loops around it."""

    def add_ir_module(self, module: Any) -> None:
        for function in module.functions:
            if "alwaysinline" in function.attributes:
                function.attributes.add("noduplicate")
        super().add_ir_module(module)


class _PartsCode(_Code):
    """Code that is only ever linked into other code, and optimized and compiled there; here only the
    variables that Numba fills in are compiled."""

    _final_module: Any

    def _optimize_final_module(self) -> None:
        """Left to the code that links it."""

    def _finalize_final_module(self) -> None:
        linked = self._final_module
        names = [v.name for v in linked.global_variables if v.linkage is Linkage.common]
        self._final_module = parse_assembly(
            "\n".join(f'@"{name}" = common global ptr null' for name in names)
        )
        super()._finalize_final_module()
        self._final_module = linked


class _ApartCode(_Code):
    """Code compiled on its own: callers link only a declaration of it."""

    _shared_module: Any

    def _get_module_for_linking(self) -> Any:
        self._ensure_finalized()
        if self._shared_module is None:
            own = [one for one in self.get_defined_functions() if one.linkage is Linkage.external]
            heads = [str(one.global_value_type).replace("(", f'@"{one.name}"(', 1) for one in own]
            self._shared_module = parse_assembly("\n".join(f"declare {head}" for head in heads))
        return self._shared_module


class _Compiler(Compiler):  # type: ignore[misc]
    """Numba's own, with garbage collection off: there is little to collect, and looking for it takes a
    seventh of the time."""

    into = _Code

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.state.library = self.into(self.state.targetctx.codegen(), self.into.__name__)
        self.state.library.enable_object_caching()

    def compile_extra(self, func: Any) -> Any:
        collects = gc.isenabled()
        gc.disable()
        try:
            return super().compile_extra(func)
        finally:
            if collects:
                gc.enable()


class _PartsCompiler(_Compiler):
    into = _PartsCode


class _ApartCompiler(_Compiler):
    into = _ApartCode


ENTIRE = {"no_cfunc_wrapper": True, "pipeline_class": _Compiler}
"""Numba's options, without the entry point for C, which nobody uses."""
PART = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": _PartsCompiler}
"""Without Python's entry point either."""
APART = PART | {"pipeline_class": _ApartCompiler}
