"""Kernels for a web page: the same steps, compiled by Numba and LLVM for WebAssembly, with the same bits.

Run as a program it compiles what it reads: Numba's target must be another one before anything is compiled.
A function's arguments lie in the page's memory, each number or pointer in eight bytes, after room for what
it returns: a page hands over one address.
"""

import inspect
import os
import pickle
import struct
import subprocess
import sys
from collections import namedtuple
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import llvmlite.binding as llvm
import numba
import numpy as np

from realitygap.compiled import kept, kernel
from realitygap.kernels import page

__all__ = ["BASE", "Arguments", "Memory", "WasmError", "entries", "module"]

TRIPLE = "wasm32-unknown-unknown"
FEATURES = "+simd128,+bulk-memory,+sign-ext,+nontrapping-fptoint"
"""In every browser since 2023."""
BASE = 1 << 16
"""Where a page's memory begins: before it are the module's own constants."""
SLOT = 8
RETURNED = 2
"""Slots for what a function returns, and for an exception, before those of its arguments."""
Entries = Mapping[str, tuple[Callable[..., Any], tuple[Any, ...]]]
"""Functions by the names that a page calls them by, with arguments of the types to compile them for."""
Arguments = namedtuple("Arguments", "world nets n stream k many path scratch")
"""Of the functions of kernels/page.py."""


class WasmError(Exception):
    """This Numba does not compile for a page."""


def entries(given: Arguments) -> Entries:
    """The functions of kernels/page.py, for such arguments."""
    return {one.__name__: (one, given) for one in (page.start, page.stand, page.step)}


def module(functions: Entries) -> bytes:
    """A module that imports a memory and exports these functions; made once, and kept with compiled code."""
    types = {name: (one.__qualname__, *map(numba.typeof, given)) for name, (one, given) in functions.items()}
    text = "".join(inspect.getsource(one) for one, _ in functions.values())
    return kept(__file__, repr(types), text, lambda: _in_a_child(functions))


def _in_a_child(functions: Entries) -> bytes:
    program = f"import sys; sys.path[:] = {sys.path!r}; import {__name__} as made; made.main()"
    words, environment = [sys.executable, "-c", program], {**os.environ, "NUMBA_DISABLE_JIT": "0"}
    told = pickle.dumps(functions)
    made = subprocess.run(words, input=told, capture_output=True, check=False, env=environment)
    if made.returncode:
        why = made.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise WasmError(f"the simulation was not compiled for the page: {why}")
    return made.stdout


def main() -> None:
    """Compile the functions that stdin has for stdout; else the last line of stderr says what failed."""
    try:
        made = _compile(pickle.load(sys.stdin.buffer))
    except Exception as error:  # Numba's own are long
        sys.exit(f"{type(error).__name__}: {str(error).partition(chr(10))[0]}")
    sys.stdout.buffer.write(made)


def _lowered(functions: Entries) -> tuple[Any, dict[str, tuple[Any, str]]]:
    """LLVM's target, and of each function its module and its name in there.

    All that is private to Numba is here, but for the order of an array's parts (`leaves`), which is checked.
    """
    from numba.core import codegen
    from numba.core.registry import cpu_target

    class Library(codegen.JITCodeLibrary):  # type: ignore[misc]
        def _optimize_final_module(self) -> None: ...  # all functions are, together

    class Generator(codegen.CPUCodegen):  # type: ignore[misc]
        """For wasm32, and loads nothing into this process."""

        _library_class = Library

        def _init(self, _module: Any) -> None:
            llvm.initialize_all_targets()
            llvm.initialize_all_asmprinters()
            target = llvm.Target.from_triple(TRIPLE)
            self._tm_features = FEATURES
            self._tm = target.create_target_machine(opt=3, features=FEATURES, reloc="static")
            self._target_data, self._engine = self._tm.target_data, self
            self._data_layout = str(self._target_data)
            self._loopvect, self._opt_level = False, 0

        def _create_empty_module(self, name: str) -> Any:
            empty = super()._create_empty_module(name)
            empty.triple = TRIPLE
            return empty

        def set_env(self, *_: Any) -> None: ...

        def is_symbol_defined(self, _: str) -> bool:
            return False

        _add_module = _scan_and_fix_unresolved_refs = finalize_object = set_env

    generator = cpu_target.target_context._internal_codegen = Generator("page")
    found = {}
    for name, (function, given) in functions.items():
        made, types = kernel(function, no_cpython_wrapper=True), tuple(map(numba.typeof, given))
        type(made).compile(made, types)  # not kept
        one = made.overloads[types]
        found[name] = one.library._final_module, one.fndesc.mangled_name
    return generator._tm, found


def _compile(functions: Entries) -> bytes:
    machine, lowered = _lowered(functions)
    text = [f'target triple = "{TRIPLE}"', f'target datalayout = "{machine.target_data}"', "!0 = !{}"]
    for name, (whole, inner) in lowered.items():
        kinds = [str(one.type) for one in whole.get_function(inner).arguments]
        if kinds[RETURNED:] != [kind for _, kind, _ in leaves(functions[name][1])]:
            raise WasmError("Numba passes arguments in another way")
        text.append(f"declare i32 @{inner}({', '.join(kinds)})\ndefine void @{name}(ptr %p) {{")
        for i, kind in enumerate(kinds):
            text.append(f"%at{i} = getelementptr i8, ptr %p, i32 {SLOT * i}")
            text.append(f"%v{i} = load {kind}, ptr %at{i}, align 8, !invariant.load !0")
        told = ["ptr %at0", "ptr %at1", *(f"{kind} %v{i}" for i, kind in enumerate(kinds) if i >= RETURNED)]
        text.append(f"call i32 @{inner}({', '.join(told)})\nret void\n}}")
    whole = llvm.parse_assembly("\n".join(text))
    for part, _ in lowered.values():
        whole.link_in(part, preserve=True)
    for function in whole.functions:
        if not function.is_declaration and function.name not in functions:
            function.linkage = "internal"
            function.add_function_attribute("alwaysinline")
    for variable in whole.global_variables:
        variable.linkage = "internal"
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(3))
    builder.getModulePassManager().run(whole, builder)
    whole.verify()
    defined = [one.name for one in whole.functions if not one.is_declaration]
    return _exporting(machine.emit_object(whole), {name: defined.index(name) for name in functions})


def _exporting(made: bytes, exports: Mapping[str, int]) -> bytes:
    """LLVM's relocatable object as a module. It is linked with nothing else, so the addresses in it hold; it
    lacks exports (section 7), and has what only a linker reads (sections 0)."""
    table = [_leb(len(name)) + name.encode() + b"\0" + _leb(i) for name, i in exports.items()]
    sections = {7: _leb(len(table)) + b"".join(table)}
    at = 8
    while at < len(made):
        size = sum((made[at + 1 + i] & 0x7F) << 7 * i for i in range(5))
        sections[made[at]] = made[at + 6 : at + 6 + size]
        at += 6 + size
    if sections[2][:1] != b"\1":
        raise WasmError("LLVM wants something of the page besides memory")
    del sections[0]
    order = sorted(sections, key=lambda kind: 9.5 if kind == 12 else kind)  # a count of data precedes code
    return made[:8] + b"".join(bytes([kind]) + _leb(len(sections[kind])) + sections[kind] for kind in order)


def _leb(value: int) -> bytes:
    """A number in five groups of seven bits, as LLVM writes a section's size."""
    return bytes(value >> 7 * i & 0x7F | 0x80 * (i < 4) for i in range(5))


def leaves(given: Any, name: str = "") -> Iterator[tuple[str, str, Any]]:
    """The numbers that arguments are passed as: name, LLVM's type and value of each.

    An array is passed as two pointers that nothing uses, its size, its itemsize, its numbers (the value is
    the array), its shape and its strides.
    """
    if isinstance(given, np.ndarray):
        parts = ("ptr", 0), ("ptr", 0), ("i64", given.size), ("i64", given.itemsize), ("ptr", given)
        yield from ((name, kind, part) for kind, part in parts)
        yield from ((name, "i64", part) for part in (*given.shape, *given.strides))
    elif isinstance(given, tuple):
        for field, part in zip(getattr(given, "_fields", range(len(given))), given, strict=True):
            yield from leaves(part, f"{name}.{field}" if name else str(field))
    else:
        yield name, "double" if isinstance(given, float) else "i64", given


class Memory:
    """What a page's memory holds from BASE on (`data`), as the module's functions find it."""

    def __init__(self) -> None:
        self.data = bytearray()
        self._arrays: dict[int, tuple[Any, int]] = {}  # by their ids: the array, its address

    def lay(self, given: tuple[Any, ...]) -> tuple[int, dict[str, int]]:
        """Lay a function's arguments down; their address, and those of each number and array by name."""
        found = list(leaves(given))
        arrays = {name: self._place(value) for name, _, value in found if isinstance(value, np.ndarray)}
        at = BASE + len(self.data)
        self.data += bytes(SLOT * RETURNED)
        for name, kind, value in found:
            number = arrays[name] if isinstance(value, np.ndarray) else value
            self.data += struct.pack("<d" if kind == "double" else "<q", number)
        return at, {name: at + SLOT * i for i, (name, _, _) in enumerate(found, RETURNED)} | arrays

    def _place(self, array: Any) -> int:
        """The address of an array; one that is laid down already stays where it is."""
        if id(array) not in self._arrays:
            self._arrays[id(array)] = array, BASE + len(self.data)
            self.data += array.tobytes() + bytes(-array.nbytes % SLOT)
        return self._arrays[id(array)][1]
