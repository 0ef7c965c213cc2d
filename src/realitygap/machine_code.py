"""Functions compiled by Numba, and kept on file for the next process; damaged files are not used.

Numba loads what it finds, and a few wrong bytes there end the interpreter. So an entry here carries a
digest of its name and its content, in a folder that nobody else can write into; one that does not agree
is removed and compiled again, with a warning. Where nothing can be kept, one temporary folder serves this
process and all that it starts. This module knows neither the simulation nor its twin.
"""

import atexit
import hashlib
import inspect
import logging
import os
import pickle
import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core.compiler import CompileResult
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

from realitygap import linking, temporary
from realitygap.files import atomic_write, written_together
from realitygap.outside import frozen

__all__ = ["Shelf"]

SPARE = "REALITYGAP_SPARE_CACHE"
"""Tells the processes that this one starts which temporary folder they share."""
_SIZE = hashlib.sha256().digest_size
_log = logging.getLogger("realitygap")
_said: set[str] = set()


class Shelf:
    """Where compiled functions are kept that follow from the same text.

    Args:
        text: all source that a function's own file does not show: of the functions that it calls.
    """

    def __init__(self, text: bytes) -> None:
        versions = (numba.__version__, llvmlite.__version__, np.__version__, sys.version)
        self._why = ""  # the usual folder does not do
        self._digest = hashlib.sha256(repr(versions).encode() + text).hexdigest()[:16]

    def __getstate__(self) -> dict[str, str]:
        return {"_why": "", "_digest": self._digest}  # folders are another process's own

    def compiled(
        self, function: Callable[..., Any], *, like: Any = None, form: str = "ENTIRE", **options: Any
    ) -> Any:
        """`function` compiled with Numba's options; not kept where it has no file, as in a console.

        Args:
            function: what to compile.
            like: the compiled function that it encloses, if it does, for that has no digest of its own.
            form: "ENTIRE"; or, of others, which call it, "PART", linked into them, or "APART": Python's way
                in, which costs more than the rest, is compiled only where Python does call it.
            options: Numba's.
        """
        made = numba.njit(**options, **getattr(linking, form))(function)
        if not numba.config.DISABLE_JIT:
            made.get_call_template = partial(_template, type(made).get_call_template, made)
            with suppress(OSError, TypeError, AttributeError):
                made._cache = _Entries(function, self, None if like is None else like._cache.of, form)
            if form != "ENTIRE":
                made.add_overload = partial(_add_overload, made, form)
                made._compile_for_args = partial(_called, cache(partial(self.compiled, function, **options)))
        return made

    def holds(self, function: str) -> bool:
        """Whether compiled code of a function of that name is kept, or the compiler is off."""
        kept = (path for folder in self._folders() for path in folder.glob(f"{function}-*"))
        return bool(numba.config.DISABLE_JIT) or any(kept)

    def read(self, name: str) -> bytes | None:
        """What is kept under a name; None where nothing is, or not what was written."""
        for path in [folder / name for folder in self._folders()]:
            if not path.exists():
                continue
            with suppress(OSError):
                data = path.read_bytes()
                if data[:_SIZE] == _digest(name, data[_SIZE:]):
                    return data[_SIZE:]
            self.refuse(name)
        return None

    def refuse(self, name: str) -> None:
        """Remove what cannot be used."""
        for path in [folder / name for folder in self._folders()]:
            if path.exists():
                _say("damaged", f"{path}: this compiled code was damaged; it is compiled again")
                with suppress(OSError):
                    path.unlink()

    def load(self, name: str, sig: Any) -> Any:
        """The compiled code under a name, with what lies apart from it; None: it has to be compiled."""
        content = self.read(name)
        if content is None:
            return None
        rtsys.initialize(cpu_target.target_context)  # no more: all that compiling needs takes half a second
        try:
            kept, payload = pickle.loads(content)
            made = CompileResult._rebuild(cpu_target.target_context, *payload) if kept == sig else None
        except _LacksError:
            return None
        except Exception:  # whole, but not to be used: of another making
            self.refuse(name)
            return None
        if made is not None:
            made.library._reload_init.update(made.reload_init)
        return made

    def write(self, name: str, content: bytes) -> None:
        """Keep it; in the temporary folder where the usual one cannot take it."""
        data = _digest(name, content) + content
        if self.folder is not None:
            try:
                with written_together(self.folder):  # not to the disk at once: a digest tells what is cut
                    atomic_write(self.folder / name, data)
                return
            except OSError as error:
                self._why = error.strerror or str(error)
        spare = self._spare(make=True)
        if spare is not None:
            with suppress(OSError):
                atomic_write(spare / name, data)

    @cached_property
    def place(self) -> Path:
        """The usual folder's path."""
        home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
        return Path(os.environ.get("NUMBA_CACHE_DIR") or Path(home) / "realitygap") / self._digest

    @cached_property
    def folder(self) -> Path | None:
        """The usual folder; None where there can be none, or another user could write into it."""
        try:
            self.place.mkdir(mode=0o700, parents=True, exist_ok=True)
            facts = self.place.stat()
            if facts.st_uid != os.getuid():
                self._why = "it belongs to another user"
            elif facts.st_mode & 0o022:
                self._why = "others can write into it: chmod go-w"
        except OSError as error:
            self._why = error.strerror or str(error)
        return None if self._why else self.place

    def _folders(self) -> list[Path]:
        """Where something may be kept."""
        return [folder for folder in (self.folder, self._spare(make=False)) if folder is not None]

    def _spare(self, *, make: bool) -> Path | None:
        """The temporary folder, if there is one or one is to be made."""
        with suppress(OSError):
            folder = _spare_folder()
            if make:
                with suppress(FileExistsError):
                    folder.mkdir(mode=0o700)
                    _say("spare", f"{self.place}: {self._why}; {folder} holds compiled code for now")
            if temporary.is_ours(folder):
                if folder not in _held:
                    _held[folder] = temporary.hold(folder)
                return folder
        if make:
            _say("spare", f"{self.place}: {self._why}; compiled code cannot be kept")
        return None


class _Entries:
    """What Numba asks for a function's compiled code, one entry for each signature and processor."""

    def __init__(self, function: Callable[..., Any], shelf: Shelf, enclosed: bytes | None, form: str) -> None:
        source = Path(inspect.getfile(function))
        code = function.__code__
        cells = function.__closure__ or ()
        closure = dumps([cell.cell_contents for cell in cells]) if enclosed is None else enclosed
        facts: tuple[object, ...] = (
            str(source), function.__qualname__, code.co_firstlineno, code.co_code, form
        )  # fmt: skip
        if not str(function.__module__).startswith(f"{__package__}."):
            facts += (frozen(function),)
        self.shelf = shelf
        self._name = function.__name__.strip("<>")
        self.of = hashlib.sha256(source.read_bytes() + repr(facts).encode() + closure).digest()

    @property
    def cache_path(self) -> str:
        """Where entries are."""
        return str(self.shelf.place)

    def enable(self) -> None:
        """Always on, and nothing waits to be written."""

    disable = flush = enable

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was compiled for a signature; None where it has to be compiled."""
        return self.shelf.load(self.entry(sig, target_context.codegen()), sig)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled, if it can be."""
        if not data.lifted and not data.library.has_dynamic_globals:
            self.shelf.write(self.entry(sig, data.codegen), dumps((sig, data._reduce())))

    def entry(self, sig: Any, codegen: Any) -> str:
        """The name of what is kept for a signature."""
        digest = hashlib.sha256(self.of + repr((sig, codegen.magic_tuple())).encode())
        return f"{self._name}-{digest.hexdigest()[:24]}.code"


def _template(usual: Callable[..., Any], made: Any, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
    """What compiled code calls: one for any number, not another for each number that a caller writes down."""
    return usual(made, tuple(map(numba.types.unliteral, args)), kws)


def _add_overload(made: Any, form: str, compiled: CompileResult) -> None:
    """Keep a part's code for those compiled functions that call it, out of Python's reach."""
    sig = tuple(compiled.signature.args)
    made.overloads[sig] = compiled
    if form == "APART":
        symbol, entries = compiled.fndesc.mangled_name, made._cache
        _lying[symbol] = compiled
        name = entries.entry(sig, compiled.codegen) if isinstance(entries, _Entries) else ""
        # Whatever links it is loaded after it.
        compiled.library._reload_init.add(partial(_need, getattr(entries, "shelf", None), name, sig, symbol))


_lying: dict[str, CompileResult] = {}
"""By its name, the code in this process that lies apart: it stays, for what was linked to it."""


class _LacksError(Exception):
    """What lies apart from some code is not on file, or another one is."""


def _need(shelf: Shelf | None, name: str, sig: Any, symbol: str) -> None:
    """Load what code that is being loaded is linked to."""
    if symbol not in _lying:
        made = None if shelf is None else shelf.load(name, sig)
        if made is None or made.fndesc.mangled_name != symbol:
            raise _LacksError
        _lying[symbol] = made


def _called(entire: Callable[[], Any], *args: Any) -> Any:
    """What Python calls instead of a part: the same function, compiled with a way in."""
    return entire()._compile_for_args(*args)


_held: dict[Path, int | None] = {}


def _spare_folder() -> Path:
    """The path that this process and all that it starts have in common; the first one names it."""
    if SPARE not in os.environ:
        os.environ[SPARE] = str(temporary.name("code"))
        atexit.register(shutil.rmtree, os.environ[SPARE], ignore_errors=True)
    return Path(os.environ[SPARE])


def _digest(name: str, content: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + content).digest()


def _say(what: str, text: str) -> None:
    """Say something once."""
    if what not in _said:
        _said.add(what)
        _log.warning("note: %s", text)


temporary.sweep()
_spare_folder()
