"""Locks a study's folder for one process at a time, and refuses folders with other files."""

import os
import platform
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from realitygap.errors import StudyBusyError, StudyError
from realitygap.study.schema import told
from realitygap.study.sources import refuse_links

__all__ = ["LOCK", "lock", "locked", "refuse_strangers"]

LOCK = "study.lock"


@contextmanager
def lock(folder: Path) -> Iterator[None]:
    """Lock the folder against other processes; the lock ends with the process, however that ends.

    Raises:
        StudyBusyError: another process holds it.
        StudyError: the folder cannot be written.
    """
    file, new = folder / LOCK, not (folder / LOCK).exists()
    with ExitStack() as held:
        with told(folder):
            folder.mkdir(parents=True, exist_ok=True)
            refuse_links(file)
            try:
                held.enter_context(locked(file))
            except BlockingIOError:
                raise StudyBusyError(
                    f"{folder}: {_holder(file)} is working on this study. Wait until it ends, stop it, "
                    "or choose another --out."
                ) from None
            _sign(file)
        try:
            yield
        except Exception:
            if new:  # a failed start leaves nothing behind
                file.unlink(missing_ok=True)
                with suppress(OSError):  # something is in it
                    folder.rmdir()
            raise


@contextmanager
def locked(file: Path, *, within_s: float = 0.0) -> Iterator[None]:
    """Lock a file, created if missing, against other processes; waits up to `within_s` for another holder.

    Raises:
        BlockingIOError: another process holds it.
        OSError: it cannot be created, or its file system has no locks.
    """
    from filelock import FileLock, Timeout

    held = FileLock(file, timeout=within_s)
    try:
        held.acquire()
    except Timeout:
        raise BlockingIOError(11, "held by another process", str(file)) from None
    except NotImplementedError as error:
        raise OSError(95, f"this file system does not support locks ({error})", str(file)) from None
    try:
        yield
    finally:
        held.release()


def _sign(file: Path) -> None:
    """Write the holder's name into a lock file, unless it is there already, as where a file system has no
    locks."""
    pid = str(os.getpid())
    with suppress(OSError, ValueError):
        if file.read_text("utf-8").split()[:1] != [pid]:
            file.write_text(f"{pid}\n{platform.node()}\n", "utf-8")


def _holder(file: Path) -> str:
    """The process that holds a lock, by its own entry in the file."""
    try:
        pid, node = file.read_text("utf-8").split()
    except (OSError, ValueError):
        return "another process"
    if node != platform.node():
        return f"another process (pid {pid} on {node})"
    return f"another process (pid {pid})" if pid != str(os.getpid()) else "this very process"


def refuse_strangers(folder: Path, what: str, ours: Collection[str] = ()) -> None:
    """Refuse a folder with files other than `ours` and hidden ones; the lock is held.

    Raises:
        StudyError: names the first of them.
    """
    for path in sorted(folder.iterdir()):
        if path.name not in (LOCK, *ours) and not path.name.startswith("."):
            raise StudyError(
                f"{folder} holds no {what}, but other files ({path.name}). Choose another --out."
            )
