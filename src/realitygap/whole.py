"""Files that appear whole or not at all, whatever ends the process, the power included.

A file is written under another name beside its place, brought to the disk, and renamed over what was
there. Whatever the system says of it names the file.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

__all__ = ["move", "named", "new", "together", "write"]

_together: ContextVar[Path | None] = ContextVar("together", default=None)


def write(path: str | Path, content: str | bytes) -> None:
    """Write a file whole; text in UTF-8, its line ends as they are.

    Raises:
        OSError: it cannot be written; names the file, and leaves what was there.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    with new(path) as spare:
        spare.write_bytes(data)


@contextmanager
def new(path: str | Path) -> Iterator[Path]:
    """A path to write to, of the same ending, which becomes `path` at the end, or nothing if that fails.

    What is no plain file (a terminal, /dev/null) is written to directly.

    Raises:
        OSError: it cannot be written; names the file, and leaves what was there.
    """
    path = Path(path)
    with named(path):
        if path.exists() and not path.is_file():
            yield path
            return
        target = Path(os.path.realpath(path))  # a link stays a link
        if target.exists() and not os.access(target, os.W_OK):
            raise PermissionError(13, "Permission denied")
        spare = target.with_name(f".part-{os.getpid()}-{target.name}")
        try:
            yield spare
            move(spare, target)
        finally:
            with suppress(OSError):
                spare.unlink(missing_ok=True)


@contextmanager
def together(folder: Path) -> Iterator[None]:
    """Within it files of this folder do not go to the disk one by one: `move` brings it there as a whole."""
    before = _together.set(folder.resolve())
    try:
        yield
    finally:
        _together.reset(before)


def move(made: Path, path: Path) -> None:
    """Give a finished file or folder its name, once all of it is on the disk."""
    later = _together.get()
    if later is not None and path.is_relative_to(later):
        os.replace(made, path)
        return
    for part in (*made.rglob("*"), made):
        if part.is_file() or part.is_dir():
            _sync(part)
    os.replace(made, path)
    with suppress(OSError):  # some file systems do not sync folders
        _sync(path.parent)


@contextmanager
def named(path: str | Path) -> Iterator[Path]:
    """Let what the system says about a file name it, which writing to a full disk does not do."""
    try:
        yield Path(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def _sync(path: Path) -> None:
    """Wait until a file or a folder is on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
