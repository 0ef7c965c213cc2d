"""Functions compiled by Numba, and kept on file by Numba's own cache.

A `kernel` is called from Python; the `step`s that it is made of are inlined into it, and neither allocates.
`helper`s are steps that Python calls as well. A `routine` runs once an evaluation and may allocate. No flag
lets LLVM change the order of a sum: a fresh compilation, code from the cache, another machine and plain
Python (NUMBA_DISABLE_JIT=1) give the same bits.

Three names of Numba's are used that it does not publish (`DefaultOptions._nrt`,
`JITCodeLibrary._optimize_final_module`, `FunctionCache.load_overload`). Where one is missing, steps run,
compile or load more slowly, with the same results.
"""

import builtins
import dis
import fcntl
import gc
import hashlib
import inspect
import os
import pickle
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from types import FunctionType, ModuleType
from typing import IO, Any

import llvmlite
import numba
import numpy as np
from llvmlite.binding import get_host_cpu_features
from numba import types
from numba.core import cgutils
from numba.core.compiler_lock import global_compiler_lock
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_jitable,
    register_model,
)

__all__ = ["compiled", "folder", "frozen", "helper", "kernel", "lacks", "naming", "routine", "step", "used"]

SAFE = {"nnan", "ninf", "nsz"}
"""What LLVM may assume of numbers: nothing that reorders a sum."""
SMALL = 6
"""Tuples with at most this many fields are passed by value, unless a field is a large tuple itself."""
PACKAGE = Path(__file__).parent

if numba.config.CPU_FEATURES is None and numba.config.ENABLE_AVX:
    # Rows of eight sensors fill a vector of 256 bits: of 512 they fill half, and are left to scalar code.
    _host = get_host_cpu_features()
    if _host.get("avx512f"):
        numba.config.CPU_FEATURES = f"{_host.flatten()},+prefer-256-bit"

if numba.config.DISABLE_JIT:
    # The generator's integers wrap on purpose; NumPy scalars would warn at each draw.
    warnings.filterwarnings("ignore", "overflow encountered", RuntimeWarning)


def _unpublished() -> tuple[dict[str, Any], dict[str, Any]]:
    """Numba's options for what never allocates, and for what is inlined."""
    lean: dict[str, Any] = {}
    inlined: dict[str, Any] = {}
    with suppress(ImportError):
        from numba.core.options import DefaultOptions

        if hasattr(DefaultOptions, "_nrt"):
            lean["_nrt"] = False  # reference counts take as long as the step itself
    with suppress(ImportError):
        from numba.core.codegen import JITCodeLibrary
        from numba.core.compiler import Compiler

        if hasattr(JITCodeLibrary, "_optimize_final_module"):
            inlined["pipeline_class"] = _into(JITCodeLibrary, Compiler)
    return lean, inlined


def _into(library: Any, compiler: Any) -> Any:
    """A compiler of code that is optimised where it is inlined, not before; that was most of the work."""

    class Part(library):  # type: ignore[misc]
        def add_ir_module(self, module: Any) -> None:
            """A call looks cheap, so LLVM would copy whole loops around it before it inlines it."""
            for function in module.functions:
                if "alwaysinline" in function.attributes:
                    function.attributes.add("noduplicate")
            super().add_ir_module(module)

        def _optimize_final_module(self) -> None:
            for function in self.get_defined_functions():
                if any(b"alwaysinline" in one for one in function.attributes):
                    function.linkage = "available_externally"  # no machine code of its own

    class PartCompiler(compiler):  # type: ignore[misc]
        def __init__(self, *args: Any) -> None:
            super().__init__(*args)
            self.state.library = Part(self.state.targetctx.codegen(), "part")
            self.state.library.enable_object_caching()

    return PartCompiler


_LEAN, _INLINED = _unpublished()


def compiled(
    function: Callable[..., Any],
    *,
    home: Callable[..., Any] | None = None,
    allocates: bool = True,
    **options: Any,
) -> Any:
    """A function compiled with Numba's options, and kept on file; as it is where the compiler is off.

    Args:
        function: what to compile.
        home: the function by whose file and name it is kept, if not its own.
        allocates: it may make arrays; reference counts take as long as a step itself.
        options: Numba's.
    """
    options = ({} if allocates else _LEAN) | options
    made = numba.njit(error_model="numpy", no_cfunc_wrapper=True, **options)(function)
    if not numba.config.DISABLE_JIT:
        made.compile = _Kept(made, home or function).compile
        made.get_call_template = partial(_template, made.get_call_template)
    return made


def _template(usual: Callable[..., Any], args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
    """What compiled code calls: one for any number, not another for each number that a caller writes down."""
    return usual(tuple(map(types.unliteral, args)), kws)


helper = partial(compiled, fastmath=SAFE, allocates=False, forceinline=True)
"""For what kernels and Python call often."""

routine = partial(compiled, fastmath=SAFE, nogil=True)
"""For what runs once an evaluation, not once a step."""


def step(function: Callable[..., Any], *, allocates: bool = False, **options: Any) -> Any:
    """For the parts of a step: inlined into the kernel that calls them. Python's calls are not compiled."""
    if numba.config.DISABLE_JIT:
        return function
    function.py_func = function  # type: ignore[attr-defined]
    options = {"fastmath": SAFE, **_INLINED, **({} if allocates else _LEAN), **options}
    return register_jitable(error_model="numpy", no_cfunc_wrapper=True, forceinline=True, **options)(function)


def kernel(
    function: Callable[..., Any],
    *,
    home: Callable[..., Any] | None = None,
    allocates: bool = False,
    fastmath: Any = SAFE,
) -> Any:
    """For what is called from Python, by position: releases the interpreter's lock while it runs.

    Inside, large tuples are passed by pointer: a call then passes one value, not the hundreds in a World.
    """
    if numba.config.DISABLE_JIT:
        return function
    entry = naming(_enter, body=step(function, allocates=allocates, fastmath=fastmath))
    entry.__qualname__ = function.__qualname__
    return compiled(entry, home=home or function, allocates=False, nogil=True)


def entry_for(made: Any, *given: Any) -> Callable[[tuple[Any, ...]], Any]:
    """What runs a kernel on a tuple of arguments without a look at their types, which are those of `given`."""
    if numba.config.DISABLE_JIT:
        return lambda others: made(*others)
    return made.compile((numba.typeof(given),))


def lacks(made: Any) -> bool:
    """Whether no code of a compiled function is on file for this processor, though some can be."""
    return not numba.config.DISABLE_JIT and made.compile.__self__.lacks()


def naming(function: Callable[..., Any], **names: Any) -> Any:
    """A copy of a function for which these global names stand for these things.

    For what calls a function that is known only later. Numba would not find it on file in another process if
    it were a closure.
    """
    copy = FunctionType(function.__code__, {**function.__globals__, **names}, function.__name__)
    copy.__qualname__ = function.__qualname__
    return copy


def _enter(*given):  # type: ignore[no-untyped-def]
    return body(*_pointed(given))  # type: ignore[name-defined]  # noqa: F821


class Pointed(types.Type):  # type: ignore[misc]
    """A pointer to a tuple of type `dtype`."""

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        # A short name, because it is part of the name of each function that takes one.
        super().__init__(f"Pointed.{hashlib.sha256(str(dtype).encode()).hexdigest()[:16]}")


register_model(Pointed)(models.PointerModel)


def _by_pointer(kind: Any) -> Any:
    """The type that a kernel's inside uses for a value of type `kind`."""
    named = isinstance(kind, types.NamedTuple | types.NamedUniTuple)
    large = named and (len(kind) > SMALL or any(isinstance(_by_pointer(one), Pointed) for one in kind))
    return Pointed(kind) if large else kind


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    key = Pointed

    def generic_resolve(self, kind: Any, name: str) -> Any:
        fields = kind.dtype.fields
        return _by_pointer(kind.dtype[fields.index(name)]) if name in fields else None


@lower_getattr_generic(Pointed)
def _field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    """A field's value, or a pointer to it if it is a large tuple."""
    at = kind.dtype.fields.index(name)
    there, field = cgutils.gep_inbounds(builder, value, 0, at), _by_pointer(kind.dtype[at])
    found = there if isinstance(field, Pointed) else builder.load(there)
    return impl_ret_borrowed(context, builder, field, found)


@intrinsic
def _pointed(_typing: Any, given: Any) -> Any:
    """The same tuple, with pointers in place of the large tuples in it."""
    kinds = types.Tuple([_by_pointer(kind) for kind in given])

    def lay_down(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        values = [builder.extract_value(arguments[0], i) for i in range(len(kinds))]
        for i, kind in enumerate(kinds):
            if isinstance(kind, Pointed):
                values[i] = cgutils.alloca_once_value(builder, values[i])
        return impl_ret_borrowed(context, builder, kinds, context.make_tuple(builder, kinds, values))

    return kinds(given), lay_down


def folder() -> Path:
    """Where compiled code is kept."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(numba.config.CACHE_DIR or Path(home) / "realitygap")


class _Kept:
    """Where Numba's cache keeps a compiled function: a cache locator, as Numba calls it.

    Numba itself would know a function by the text of its own file. Here it is known by the text of what this
    file imports from the package, too, and by what a user's function uses from elsewhere. Each file of the
    cache ends with a digest: Numba loads what it finds, and a few wrong bytes would end the interpreter.
    """

    _asked: "_Kept | None" = None
    """The one that Numba is about to ask for."""

    def __init__(self, made: Any, home: Callable[..., Any]) -> None:
        self._made, self._home, self._compile = made, home, made.compile
        self._name = self._text = ""
        self._lock: IO[bytes] | None = None

    def compile(self, sig: Any) -> Any:
        """What Numba calls to have the function compiled for a signature, or loaded."""
        if sig in self._made.overloads:
            return self._compile(sig)
        with global_compiler_lock, _without_garbage():
            try:
                self._prepare()
                with _loading(self._made.targetctx):
                    return self._compile(sig)
            except OSError:  # it is compiled, but cannot be kept
                return self._compile(sig)
            finally:
                self._finish()

    def _prepare(self) -> None:
        """Before a look into the cache: have one, without damaged files."""
        if not self._name:
            self._name = "none"
            with suppress(TypeError):  # a function without a file, as in a console, is not kept
                self._enable(Path(inspect.getfile(self._home)), self._made.py_func)
        if not all(map(_is_whole, self._files())):
            self.ensure_cache_path()  # nobody is just writing them
            for file in self._files():
                if not _is_whole(file):
                    file.unlink()
            self._finish()

    def _enable(self, file: Path, function: Any) -> None:
        text = repr((_text_of(file), frozen(self._home), frozen(function), VERSIONS))
        processor = self._made.targetctx.codegen().magic_tuple()
        name = repr((str(file), self._home.__qualname__, function.__qualname__, processor))
        self._name, self._text = (hashlib.sha256(one.encode()).hexdigest()[:16] for one in (name, text))
        folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        os.listdir(folder())  # else what cannot be read would be an error at each call
        if hasattr(numba.config, "CACHE_LOCATOR_CLASSES"):
            before, _Kept._asked = numba.config.CACHE_LOCATOR_CLASSES, self
            numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}._Kept"
            try:
                self._made.enable_caching()
            finally:
                numba.config.CACHE_LOCATOR_CLASSES, _Kept._asked = before, None

    def lacks(self) -> bool:
        """Whether nothing is on file, and something can be."""
        try:
            self._prepare()
            self.ensure_cache_path()
        except OSError:
            return False
        self._finish()
        return not self._files()

    def _finish(self) -> None:
        """Files that were written get their digests; others may write again."""
        lock, self._lock = self._lock, None
        if lock is not None:
            with lock, suppress(OSError):  # on a full disk: what has no digest counts as damaged
                for file in self._files():
                    if not _is_whole(file):
                        digest = _digest(file.name, file.read_bytes())
                        with file.open("ab") as end:
                            end.write(digest)

    def _files(self) -> list[Path]:
        return list(folder().glob(f"*-{self._name}-{self._text}.*.nb[ci]"))

    @classmethod
    def from_function(cls, _function: Any, _file: str) -> "_Kept | None":
        """The place of the function whose cache Numba is making."""
        return cls._asked

    def get_cache_path(self) -> str:
        """The folder."""
        return str(folder())

    def get_disambiguator(self) -> str:
        """What tells a function's files from others'."""
        return f"{self._name}-{self._text}"

    def get_source_stamp(self) -> str:
        """Says whether files are out of date: never, those of other texts have other names."""
        return ""

    def ensure_cache_path(self) -> None:
        """Before a file is written: one process at a time, and files of another text go.

        Raises:
            OSError: none can be written.
        """
        folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        self._lock = (folder() / "lock").open("wb")
        with suppress(OSError):  # a file system without locks
            fcntl.flock(self._lock, fcntl.LOCK_EX)
        for file in set(folder().glob(f"*-{self._name}-*.nb[ci]")) - set(self._files()):
            file.unlink(missing_ok=True)


@contextmanager
def _without_garbage() -> Iterator[None]:
    """Compile without looking for garbage: there is little, and looking takes a seventh of the time."""
    looks = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if looks:
            gc.enable()


@contextmanager
def _loading(context: Any) -> Iterator[None]:
    """Without a first look at all that Numba could compile: code is loaded without it, and importing it takes
    half a second. What is not on file is compiled after a second look."""
    with suppress(ImportError, AttributeError):
        from numba.core.caching import FunctionCache
        from numba.core.runtime import rtsys

        if "refresh" in FunctionCache.load_overload.__code__.co_names:
            rtsys.initialize(context)
            context.refresh = lambda: vars(context).pop("refresh", None)
    try:
        yield
    finally:
        vars(context).pop("refresh", None)


_DIGEST = hashlib.sha256().digest_size
_IMPORT = re.compile(rf"^from ({__package__}[\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)
VERSIONS = numba.__version__, llvmlite.__version__, np.__version__


def _digest(name: str, data: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + data).digest()


def _is_whole(file: Path) -> bool:
    data = file.read_bytes()
    return data[-_DIGEST:] == _digest(file.name, data[:-_DIGEST])


@cache
def _text_of(file: Path) -> str:
    """A digest of a file, of what it imports from this package, and of what those import that compile too."""
    met, new = dict[Path, bytes](), [file]
    while new:
        one = new.pop()
        text = met[one] = one.read_bytes()
        if one != file and not re.search(rb"^@(step|helper|kernel|routine|jit)\b", text, re.MULTILINE):
            continue
        for module, names in _IMPORT.findall(text.decode()):
            place = PACKAGE.parent.joinpath(*module.split("."))
            parts = (
                part.with_suffix(".py") for part in (place, *map(place.joinpath, re.findall(r"\w+", names)))
            )
            new += [part for part in (*parts, place / "__init__.py") if part.is_file() and part not in met]
    met.pop(PACKAGE / "__init__.py", None)  # nothing is taken from there
    return hashlib.sha256(b"".join(met[one] for one in sorted(met))).hexdigest()


_PLAIN = (int, float, complex, str, np.generic, np.ndarray, tuple)
"""What Numba takes the value of, once for all."""


def used(function: Any) -> Iterator[tuple[int, Any, str]]:
    """What a function's names stand for, through modules too: line, value and name of each."""
    scope = {**vars(builtins), **function.__globals__, **inspect.getclosurevars(function).nonlocals}
    found: Any = None
    for one in dis.get_instructions(function):
        name, line = str(one.argval), getattr(one.positions, "lineno", None)
        if one.opname.startswith(("LOAD_GLOBAL", "LOAD_DEREF")):
            found = scope.get(name)
        elif one.opname in ("LOAD_ATTR", "LOAD_METHOD") and isinstance(found, ModuleType):
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
    found: list[str] = []
    for _, one, name in used(function):
        if isinstance(one, _PLAIN):
            try:
                found.append(f"{name}={pickle.dumps(one)!r}")
            except (pickle.PicklingError, AttributeError, TypeError):  # a tuple of functions
                found.append(f"{name}={one!r}")
        called = getattr(one, "py_func", None)
        if called is None or called in met:
            continue
        met = (*met, called)
        found.append(f"{called.__module__}.{called.__qualname__}")
        if not str(called.__module__).startswith(f"{__package__}."):
            text = hashlib.sha256(Path(inspect.getfile(called)).read_bytes()).hexdigest()
            found += [text, str(called.__code__.co_firstlineno), *frozen(called, met)]
    return tuple(found)
