"""Functions compiled by Numba, and kept on file by Numba's own cache.

A `kernel` is called from Python; the `step`s that it is made of are inlined into it, and neither allocates.
A `helper` is a step that Python calls compiled, too. A `routine` runs once an evaluation and may allocate. No
flag lets LLVM change the order of a sum: a fresh compilation, code from the cache, another machine and plain
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
from functools import cache, partial, wraps
from pathlib import Path
from types import FunctionType, ModuleType
from typing import IO, Any

import llvmlite
import numba
import numba.core.codegen
import numba.core.compiler
import numba.core.options
import numpy as np
from llvmlite.binding import get_host_cpu_features
from numba.extending import overload, register_jitable

__all__ = [
    "compiled", "entry_for", "folder", "frozen", "helper", "kept", "kernel", "naming", "routine", "step",
    "used",
]  # fmt: skip

SAFE = {"nnan", "ninf", "nsz"}
"""What LLVM may assume of numbers: nothing that reorders a sum."""
PACKAGE = Path(__file__).parent

if numba.config.CPU_FEATURES is None and numba.config.ENABLE_AVX:
    # Rows of eight sensors fill a vector of 256 bits: of 512 they fill half, and are left to scalar code.
    _host = get_host_cpu_features()
    if _host.get("avx512f"):
        numba.config.CPU_FEATURES = f"{_host.flatten()},+prefer-256-bit"

if numba.config.DISABLE_JIT:
    # The generator's integers wrap on purpose; NumPy scalars would warn at each draw.
    warnings.filterwarnings("ignore", "overflow encountered", RuntimeWarning)


def _inlined() -> dict[str, Any]:
    """Options of what is inlined: optimised where that happens, not before, which was most of the work."""
    library: Any = getattr(numba.core.codegen, "JITCodeLibrary", None)
    if not hasattr(library, "_optimize_final_module"):
        return {}

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

    class PartCompiler(numba.core.compiler.Compiler):  # type: ignore[misc]
        def __init__(self, *args: Any) -> None:
            super().__init__(*args)
            with suppress(AttributeError, TypeError):
                part = Part(self.state.targetctx.codegen(), "part")
                part.enable_object_caching()
                self.state.library = part

    return {"pipeline_class": PartCompiler}


_INLINED = _inlined()
_LEAN = {"_nrt": False} if hasattr(getattr(numba.core.options, "DefaultOptions", None), "_nrt") else {}
"""Of what never allocates: without reference counts, which take as long as a step itself."""


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
        allocates: it may make arrays.
        options: Numba's.
    """
    options = ({} if allocates else _LEAN) | options
    made = numba.njit(error_model="numpy", no_cfunc_wrapper=True, **options)(function)
    if not numba.config.DISABLE_JIT:
        made.compile = _Kept(made, home or function).compile
    return made


kernel = partial(compiled, fastmath=SAFE, allocates=False, nogil=True)
"""For what is called from Python, by position: releases the interpreter's lock while it runs."""

routine = partial(compiled, fastmath=SAFE, nogil=True)
"""For what runs once an evaluation, not once a step."""


def step(function: Callable[..., Any], *, fastmath: Any = SAFE) -> Any:
    """For the parts of a step: inlined into the kernel that calls them. Python's calls are not compiled."""
    if not numba.config.DISABLE_JIT:
        function.py_func = function  # type: ignore[attr-defined]
        register_jitable(**_for_step(fastmath))(function)
    return function


def helper(function: Callable[..., Any]) -> Any:
    """A step that Python calls often: those calls are compiled, too."""
    made = compiled(function, fastmath=SAFE, allocates=False)

    @wraps(function)
    def called(*given: Any) -> Any:
        return made(*given)

    called.py_func = function  # type: ignore[attr-defined]
    overload(called, jit_options=_for_step(SAFE), strict=False)(lambda *given: function)
    return called


def _for_step(fastmath: Any) -> dict[str, Any]:
    told = {"error_model": "numpy", "fastmath": fastmath, "forceinline": True, "no_cfunc_wrapper": True}
    return told | _LEAN | _INLINED


def naming(function: Callable[..., Any], /, **names: Any) -> Any:
    """A copy of a function for which these global names stand for these things; a closure would not be found
    on file by another process."""
    return FunctionType(function.__code__, {**function.__globals__, **names}, function.__name__)


def entry_for(made: Any, *given: Any) -> Callable[..., Any]:
    """What runs a kernel without a look at its arguments' types, which must be those of `given`: in a World
    that takes Numba longer than a step of a trial."""
    if numba.config.DISABLE_JIT:
        return made  # type: ignore[no-any-return]
    entry = made.compile(tuple(map(numba.typeof, given)))
    return entry if callable(entry) else made  # type: ignore[no-any-return]


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

    _asked: "_Kept | None" = None  # the one whose cache Numba is making

    def __init__(self, made: Any, home: Callable[..., Any]) -> None:
        self._made, self._home, self._compile = made, home, made.compile
        self._name = self._text = ""
        self._lock: IO[bytes] | None = None

    def compile(self, sig: Any) -> Any:
        """What Numba calls to have the function compiled for a signature, or loaded."""
        if sig in self._made.overloads:
            return self._compile(sig)
        with numba.core.compiler_lock.global_compiler_lock, _without_delays(self._made.targetctx):
            try:
                with suppress(TypeError):  # a function without a file, as in a console, is not kept
                    self._open()
                return self._compile(sig)
            except OSError:  # it is compiled, but cannot be kept
                return self._compile(sig)
            finally:
                self._seal()

    def _open(self) -> None:
        """Before a look into the cache: remove damaged files, then have one."""
        new = not self._name
        if new:
            self._find()
        if not all(map(_is_whole, self._files())):
            self.ensure_cache_path()  # nobody is just writing them
            for file in self._files():
                if not _is_whole(file):
                    file.unlink()
            self._seal()
        if new and hasattr(numba.config, "CACHE_LOCATOR_CLASSES"):
            before, _Kept._asked = numba.config.CACHE_LOCATOR_CLASSES, self
            numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}._Kept"
            try:
                self._made.enable_caching()
            finally:
                numba.config.CACHE_LOCATOR_CLASSES, _Kept._asked = before, None

    def _find(self) -> None:
        """Name the files: after the function, and after all that the compiled code follows from."""
        own, function = self._home, self._made.py_func
        files = [Path(inspect.getfile(one)) for one in (own, function)]
        text = repr(
            (*map(_text_of, files), frozen(own), frozen(function), llvmlite.__version__, np.__version__)
        )
        name = repr((str(files[0]), own.__qualname__, function.__qualname__))
        folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        os.listdir(folder())  # else what cannot be read would be an error at each call
        self._name, self._text = (hashlib.sha256(one.encode()).hexdigest()[:16] for one in (name, text))

    def _seal(self) -> None:
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
        return cls._asked

    def get_cache_path(self) -> str:
        return str(folder())

    def get_disambiguator(self) -> str:
        return f"{self._name}-{self._text}"

    def get_source_stamp(self) -> str:
        return ""  # files of other texts have other names

    def ensure_cache_path(self) -> None:
        """Before a file is written: one process at a time, and files of another text go."""
        folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        self._lock = (folder() / "lock").open("wb")
        with suppress(OSError):  # a file system without locks
            fcntl.flock(self._lock, fcntl.LOCK_EX)
        for file in set(folder().glob(f"*-{self._name}-*.nb[ci]")) - set(self._files()):
            file.unlink(missing_ok=True)


@contextmanager
def _without_delays(context: Any) -> Iterator[None]:
    """Compile without looking for garbage, which takes a seventh of the time; and load without importing all
    that Numba could compile, which takes half a second: the second look at it imports it."""
    looks = gc.isenabled()
    gc.disable()
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
        if looks:
            gc.enable()


def _digest(name: str, data: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + data).digest()


def _is_whole(file: Path) -> bool:
    data = file.read_bytes()
    return data[-32:] == _digest(file.name, data[:-32])


def kept(home: str, name: str, text: str, make: Callable[[], bytes]) -> bytes:
    """What is made under a name by the code of a file (its path is `home`) out of a text; made anew when one
    of them changes."""
    follows = _text_of(Path(home)), text, numba.__version__, llvmlite.__version__
    digests = [hashlib.sha256(repr(one).encode()).hexdigest()[:16] for one in ((home, name), follows)]
    stem = f"{Path(home).stem}-{digests[0]}"
    file = folder() / f"{stem}-{digests[1]}.made"
    with suppress(OSError):
        if _is_whole(file):
            return file.read_bytes()[:-32]
    made = make()
    with suppress(OSError):  # it cannot be kept
        folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        for old in folder().glob(f"{stem}-*"):
            old.unlink(missing_ok=True)
        own = file.with_suffix(f".{os.getpid()}")
        own.write_bytes(made + _digest(file.name, made))
        own.replace(file)
    return made


_COMPILES = re.compile(rf"^from {__package__}\S*compiled import", re.MULTILINE)
_IMPORT = re.compile(rf"^from ({__package__}[\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)


@cache
def _text_of(file: Path) -> str:
    """A digest of a file, of what it imports from this package, and of what those import that compile too."""
    met, new = dict[Path, str](), [file]
    while new:
        one = new.pop()
        text = met[one] = one.read_text("utf-8", "replace")
        for module, names in _IMPORT.findall(text) if one == file or _COMPILES.search(text) else ():
            place = PACKAGE.parent.joinpath(*module.split("."))
            parts = [place / "__init__", place, *map(place.joinpath, re.findall(r"\w+", names))]
            found = {part.with_suffix(".py") for part in parts} - met.keys()
            new += filter(Path.is_file, found)
    return hashlib.sha256("\0".join(met[one] for one in sorted(met)).encode()).hexdigest()


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
        if isinstance(one, int | float | complex | str | np.generic | np.ndarray | tuple):
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
