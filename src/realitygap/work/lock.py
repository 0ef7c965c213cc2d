"""The lock on a file: it ends with its process, however that ends."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["locked"]


@contextmanager
def locked(file: Path, *, wait: bool) -> Iterator[None]:
    """Hold a file against other processes.

    Args:
        file: made if need be.
        wait: for whoever holds it, instead of an error.

    Raises:
        BlockingIOError: another process holds it.
        OSError: it cannot be made, or its file system has no locks.
    """
    from filelock import FileLock, Timeout

    held = FileLock(file, timeout=-1 if wait else 0)
    try:
        held.acquire()
    except Timeout:
        raise BlockingIOError(11, "held by another process", str(file)) from None
    except NotImplementedError as error:
        raise OSError(95, f"this file system has no locks ({error})", str(file)) from None
    try:
        yield
    finally:
        held.release()
