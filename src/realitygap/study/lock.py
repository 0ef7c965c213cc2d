"""A study's folder is worked on by one process at a time, and holds nothing else."""

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
    """Hold the folder against other processes; the lock ends with the process, however that ends.

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
            if new:  # a start that failed leaves nothing behind
                file.unlink(missing_ok=True)
                with suppress(OSError):  # something is in it
                    folder.rmdir()
            raise


@contextmanager
def locked(file: Path, *, within_s: float = 0.0) -> Iterator[None]:
    """Hold a file, made if need be, against other processes; who holds it is waited for `within_s`.

    Raises:
        BlockingIOError: another process holds it.
        OSError: it cannot be made, or its file system has no locks.
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
    """Write into a lock who holds it, unless it says so already, as where a file system has no locks."""
    pid = str(os.getpid())
    with suppress(OSError, ValueError):
        if file.read_text("utf-8").split()[:1] != [pid]:
            file.write_text(f"{pid}\n{platform.node()}\n", "utf-8")


def _holder(file: Path) -> str:
    """The process that holds a lock, as it has written there."""
    try:
        pid, node = file.read_text("utf-8").split()
    except (OSError, ValueError):
        return "another process"
    if node != platform.node():
        return f"another process (pid {pid} on {node})"
    return f"another process (pid {pid})" if pid != str(os.getpid()) else "this very process"


def refuse_strangers(folder: Path, what: str, ours: Collection[str] = ()) -> None:
    """Refuse to make something among other files than `ours` and hidden ones; the lock is held.

    Raises:
        StudyError: names the first of them.
    """
    for path in sorted(folder.iterdir()):
        if path.name not in (LOCK, *ours) and not path.name.startswith("."):
            raise StudyError(
                f"{folder} holds no {what}, but other files ({path.name}). Choose another --out."
            )
