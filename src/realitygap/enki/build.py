"""Compiles the program that holds Enki, once, into the user's cache."""

import hashlib
import os
import shutil
import subprocess
import sysconfig
from importlib import resources
from pathlib import Path

from realitygap import whole
from realitygap.errors import UsageError

__all__ = ["program"]

SOURCE = "enki.cpp"
COMPILER = ("g++", "-std=c++14", "-O2")
LIBRARY = "libenki.so"
CURE = "Install them with: apt install libenki-dev g++"
LONGEST_S = 300.0
"""Compiling takes 3 s."""


def program(text: bytes | None = None) -> Path:
    """The path of the program that `text` in C++ compiles to, by default of the one that is talked to.

    It is named after its text, the compiler's options and the library.

    Raises:
        UsageError: without the library or the compiler, or where nothing can be kept.
    """
    if text is None:
        text = resources.files(__package__).joinpath(SOURCE).read_bytes()
    library = _library()
    digest = hashlib.sha256(repr(COMPILER).encode() + text + library.read_bytes()).hexdigest()[:16]
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    path = Path(home) / "realitygap" / f"enki-{digest}"
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        facts = path.parent.stat()
        if facts.st_uid != os.getuid() or facts.st_mode & 0o022:
            raise PermissionError(13, "others can write into it")
        if not path.is_file():
            _compile(text, library, path)
    except OSError as error:
        raise UsageError(
            f"enki: its compiled program cannot be kept in {path.parent}: {error.strerror or error}. "
            "Name another folder by XDG_CACHE_HOME."
        ) from None
    return path


def _library() -> Path:
    """Enki's shared library."""
    multiarch = sysconfig.get_config_var("MULTIARCH")
    for folder in ("/usr/lib", f"/usr/lib/{multiarch}", "/usr/local/lib", "/usr/lib64"):
        if (Path(folder) / LIBRARY).exists():
            return Path(folder) / LIBRARY
    raise UsageError(f"enki: expected EPFL's simulator Enki ({LIBRARY}) and its headers. {CURE}")


def _compile(text: bytes, library: Path, path: Path) -> None:
    """Compile to `path`, whole: of two processes that do so at once the later one's program stays."""
    compiler = shutil.which(COMPILER[0])
    if compiler is None:
        raise UsageError(f"enki: expected a compiler, {COMPILER[0]}, to use the simulator Enki. {CURE}")
    with whole.new(path) as spare:
        order = [compiler, *COMPILER[1:], "-x", "c++", "-", "-x", "none", str(library), "-o", str(spare)]
        try:
            made = subprocess.run(order, input=text, capture_output=True, timeout=LONGEST_S)
        except subprocess.TimeoutExpired:
            raise UsageError(f"enki: {COMPILER[0]} did not compile it within {LONGEST_S:g} s.") from None
        if made.returncode:
            raise UsageError(f"enki: {COMPILER[0]} cannot compile it: {_said(made.stderr)}. {CURE}")


def _said(words: bytes) -> str:
    """The first line that tells what is wrong."""
    lines = words.decode("utf-8", "replace").splitlines()
    return next(
        (line.strip() for line in lines if "error" in line), lines[-1] if lines else "no reason given"
    )
