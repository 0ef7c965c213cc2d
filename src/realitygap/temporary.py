"""Temporary folders that are removed in the end, whatever ends the process.

Whoever uses one holds a lock on it, which the system takes away from a dead process: a folder of ours that
nobody holds was left by a kill, and making the next one removes it.
"""

import os
import re
import secrets
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

try:
    import fcntl
except ModuleNotFoundError as missing:
    raise OSError(
        f"realitygap needs Linux or macOS (there is no module {missing.name!r} here). "
        "On Windows install it in WSL."
    ) from None

__all__ = ["Folder", "hold", "is_ours", "name", "sweep"]

PREFIX = "realitygap.tmp."
_NAME = re.compile(re.escape(PREFIX) + r"[a-z]+\.[a-z0-9_]{8}")


class Folder(tempfile.TemporaryDirectory[str]):
    """A new folder; as a context its path, removed at the end. `kind` says in its name what it is for."""

    def __init__(self, kind: str) -> None:
        sweep()
        self._lock: int | None = None
        while self._lock is None:  # a sweeper may come between making and holding
            super().__init__(prefix=f"{PREFIX}{kind}.")
            self._lock = hold(Path(self.name))
            if self._lock is None:
                super().cleanup()  # else it warns of this one when the next is done with

    def cleanup(self) -> None:
        super().cleanup()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def name(kind: str) -> Path:
    """A path for a folder of ours that is not made yet."""
    return Path(tempfile.gettempdir()) / f"{PREFIX}{kind}.{secrets.token_hex(4)}"


def is_ours(folder: Path) -> bool:
    """Whether it has a name of ours, belongs to us, and no other user can write into it."""
    try:
        facts = folder.lstat()
    except OSError:
        return False
    closed = facts.st_uid == os.getuid() and not facts.st_mode & 0o022
    return closed and _NAME.fullmatch(folder.name) is not None and folder.is_dir() and not folder.is_symlink()


def hold(folder: Path) -> int | None:
    """Hold a folder until the process ends or the descriptor is closed; None if it is gone."""
    try:
        held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        return None
    with suppress(OSError):  # a file system without locks: nothing is swept there either
        fcntl.flock(held, fcntl.LOCK_SH)
    if folder.is_dir():
        return held
    os.close(held)
    return None


def sweep() -> None:
    """Remove the folders of our dead processes."""
    with suppress(OSError), os.scandir(tempfile.gettempdir()) as entries:
        for folder in [Path(entry.path) for entry in entries if _NAME.fullmatch(entry.name)]:
            if is_ours(folder):
                _remove_unheld(folder)


def _remove_unheld(folder: Path) -> None:
    with suppress(OSError):
        held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(held)
