"""A folder of results: worked on by one process at a time, and only with the settings that it was begun with.

    with RunFolder(path, "study.toml", "study").lock() as folder:
        folder.begin(settings) if not folder.begun else folder.refuse_other(settings)

The settings' file is for people to read and to copy. Digests at its end tell whether a setting, or one of the
other files that the results follow from, was edited since.
"""

import errno
import json
import os
import platform
import shutil
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from realitygap.errors import StudyBusyError, StudyError
from realitygap.files import atomic_write, move_whole, parse_toml, read_toml, to_toml

__all__ = [
    "LOCK", "SEALS", "RunFolder", "file_errors", "flat", "inside", "lock", "new_folder",
    "refuse_difference", "refuse_links", "require_only_own", "settings_in",
]  # fmt: skip

LOCK = "study.lock"
SEALS = "sha256"
"""Table of a settings' file with the digests of the settings, under its own name, and of other files."""
_APART = ("versions", SEALS)
"""Tables of a settings' file that are no settings."""
OLD_S = 3600.0
"""A file that is being written, on whatever machine, is never left alone for that long."""


@dataclass(frozen=True)
class RunFolder:
    """A folder with settings in `file`; `what` it holds is for messages, `loose` ones change no result."""

    path: Path
    file: str
    what: str
    loose: Collection[str] = ()

    @property
    def begun(self) -> bool:
        """Whether its settings are written."""
        return (self.path / self.file).is_file()

    def begin(
        self,
        settings: Mapping[str, Any],
        *,
        head: str,
        versions: Mapping[str, str],
        files: Mapping[str, bytes] = {},
    ) -> None:
        """Write the settings, and the files that results follow from too; the lock is held.

        Args:
            settings: all that the results depend on.
            head: comment at the beginning of the file.
            versions: of what makes the results.
            files: other files by their names.

        Raises:
            StudyError: they cannot be written.
        """
        text = to_toml(settings)
        seals = {self.file: self._digest(parse_toml(text))}
        seals |= {name: sha256(content).hexdigest() for name, content in files.items()}
        with file_errors(self.path):
            for name, content in files.items():
                (self.path / name).parent.mkdir(parents=True, exist_ok=True)
                atomic_write(self.path / name, content)
            end = to_toml({"versions": versions, SEALS: seals})
            atomic_write(self.path / self.file, f"{head}\n{text}\n{end}")

    def settings(self) -> dict[str, Any]:
        """The settings as they were when it was begun.

        Raises:
            StudyError: they are missing, broken, or were edited since.
        """
        path = self.path / self.file
        cure = f"Restore it from a copy: the {self.what} cannot be read without it."
        if not path.is_file():
            raise StudyError(f"{path}: missing. {cure}")
        table = read_toml(path, StudyError, cure, broken=cure)
        if table.get(SEALS, {}).get(self.file) != self._digest(table):
            raise self._edited(path)
        return settings_in(table)

    def check_files(self, name: str | None = None) -> None:
        """Check that the other files, or one of them, are as they were.

        Raises:
            StudyError: one is missing, leads out of the folder, or was edited.
        """
        for one, seal in self.seals().items():
            if name in (None, one):
                path = inside(self.path, one)
                with file_errors(path):
                    content = path.read_bytes()
                if sha256(content).hexdigest() != seal:
                    raise self._edited(path)

    def refuse_other(
        self,
        there: Mapping[str, Any],
        requested: Mapping[str, Any],
        files: Mapping[str, bytes] = {},
        cure: str = "Leave it as it was, or choose another --out.",
    ) -> None:
        """Refuse other settings or files than those it was begun with; `cure` is what to do.

        Raises:
            StudyError: names the first setting that differs with both values, or the file.
        """
        made, now = ({k: v for k, v in table.items() if k not in self.loose} for table in (there, requested))
        refuse_difference(f"{self.path}: the {self.what} was made", made, now, cure)
        seals = self.seals()
        for name, content in files.items():
            if seals.get(name) != sha256(content).hexdigest():
                raise StudyError(f"{self.path}: the {self.what} keeps a different {name}. {cure}")

    def seals(self) -> dict[str, str]:
        """Digests of the other files by name."""
        table = read_toml(self.path / self.file, StudyError, "Restore it from a copy.")
        return {name: seal for name, seal in table.get(SEALS, {}).items() if name != self.file}

    def _edited(self, path: Path) -> StudyError:
        cure = "Restore it, or start another with it, in a folder of its own."
        return StudyError(f"{path} has been edited since the {self.what} was made. {cure}")

    def _digest(self, table: Mapping[str, Any]) -> str:
        kept = {key: value for key, value in settings_in(table).items() if key not in self.loose}
        return sha256(json.dumps(kept, sort_keys=True, default=str).encode()).hexdigest()


def settings_in(table: Mapping[str, Any]) -> dict[str, Any]:
    """A settings' file without versions and digests."""
    return {key: value for key, value in table.items() if key not in _APART}


def refuse_difference(
    what: str,
    there: Mapping[str, Any],
    requested: Mapping[str, Any],
    cure: str = "Leave it as it was, or choose another --out.",
) -> None:
    """Refuse settings that differ from those with which something was made.

    Args:
        what: where it is and how it came about: "FOLDER: the study was made".
        there: its settings.
        requested: the present ones.
        cure: what to do.

    Raises:
        StudyError: names the first key that differs, and both values.
    """
    left, right = dict(flat(there)), dict(flat(requested))
    for key in [*left, *(key for key in right if key not in left)]:
        if left.get(key) != right.get(key):
            raise StudyError(f"{what} with {key} = {left.get(key)!r}, not {right.get(key)!r}. {cure}")


def flat(table: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Every key of nested settings, with dots, and its value."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{path}{key}.")
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            yield f"{path}{key}", len(value)
            for i, entry in enumerate(value):
                yield from flat(entry, f"{path}{key}[{i}].")
        else:
            yield f"{path}{key}", value


@contextmanager
def lock(folder: Path) -> Iterator[None]:
    """Lock the folder, made if needed, against other processes; the lock ends with the process.

    Files that processes left half written when they were killed are removed.

    Raises:
        StudyBusyError: another process holds it.
        StudyError: the folder cannot be written.
    """
    from filelock import FileLock, Timeout

    file, new = folder / LOCK, not (folder / LOCK).exists()
    with ExitStack() as held:
        with file_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
            refuse_links(file)
            try:
                held.enter_context(FileLock(file, timeout=0))
            except Timeout:
                raise StudyBusyError(
                    f"{folder}: {_holder(file)} is working on this study. Wait until it ends, stop it, "
                    "or choose another --out."
                ) from None
            except NotImplementedError as error:
                raise OSError(95, f"this file system does not support locks ({error})", str(file)) from None
            with suppress(OSError):  # as where a file system has no locks
                file.write_text(f"{os.getpid()}\n{platform.node()}\n", "utf-8")
            _sweep(folder)
        try:
            yield
        except Exception:
            if new:  # a failed start leaves nothing behind
                file.unlink(missing_ok=True)
                with suppress(OSError):  # something is in it
                    folder.rmdir()
            raise


def _holder(file: Path) -> str:
    """The process that holds a lock, by its own entry in the file."""
    try:
        pid, node = file.read_text("utf-8").split()
    except (OSError, ValueError):
        return "another process"
    if node != platform.node():
        return f"another process (pid {pid} on {node})"
    return f"another process (pid {pid})" if pid != str(os.getpid()) else "this very process"


def _sweep(folder: Path) -> None:
    """Remove what nobody has been writing for a while: a process that was killed left it."""
    for part in folder.rglob(".part-*"):
        with suppress(FileNotFoundError):  # it was finished just now
            if time.time() - part.stat().st_mtime > OLD_S:
                part.unlink()


def require_only_own(folder: Path, what: str, ours: Collection[str] = ()) -> None:
    """Refuse a folder with files other than `ours` and hidden ones; the lock is held.

    Raises:
        StudyError: names the first of them.
    """
    for path in sorted(folder.iterdir()):
        if path.name not in (LOCK, *ours) and not path.name.startswith("."):
            raise StudyError(
                f"{folder} holds no {what}, but other files ({path.name}). Choose another --out."
            )


def refuse_links(folder: Path) -> None:
    """Check that nothing written into a folder can end up elsewhere.

    Raises:
        StudyError: the folder, or something in it, is a symbolic link.
    """
    for path in (folder, *sorted(folder.rglob("*"))):
        if path.is_symlink():
            raise StudyError(f"{path}: a link to {path.readlink()}, which is not followed. Remove the link.")


def inside(folder: Path, name: str) -> Path:
    """The path of a file named relative to a folder.

    Raises:
        StudyError: it is missing, or leads out of the folder.
    """
    path, home = folder / name, folder.resolve()
    if ".." in Path(name).parts or not path.resolve().is_relative_to(home):
        raise StudyError(f"{folder}: expected a file in the study's own folder; {name!r} leads out of it.")
    if not path.is_file():
        raise StudyError(f"{path}: missing. Restore it from a copy: the study cannot be used without it.")
    return path


@contextmanager
def new_folder(out: Path, then: str) -> Iterator[Path]:
    """A folder to fill, which becomes `out` when it is complete; one left by a kill is started again.

    `then` is the command for what comes after that, if only that is left.

    Raises:
        StudyError: `out` exists already.
        StudyBusyError: another process is filling it.
    """
    if not out.name.strip(".") or (out.exists() and (not out.is_dir() or any(out.iterdir()))):
        left = f"If it is this study, without its report, `{then}` makes that; else choose another --out."
        raise StudyError(f"{out} exists already, and is not overwritten. {left}")
    half = out.with_name(f".{out.name}.half")
    with lock(half), file_errors(out):
        _empty(half)
        try:
            yield half
            if out.exists():
                out.rmdir()
            move_whole(half, out)
        except BaseException:
            _empty(half)
            raise


def _empty(half: Path) -> None:
    for path in half.iterdir() if half.exists() else ():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        elif path.name != LOCK:
            path.unlink(missing_ok=True)


@contextmanager
def file_errors(path: Path) -> Iterator[None]:
    """Turn the system's errors about files into one StudyError that names the file and the cure."""
    try:
        yield
    except OSError as error:
        kept = "What was saved is kept. " if error.errno == errno.ENOSPC else ""
        cure = "Free some space and resume" if kept else "Check the path and its rights, or take another"
        there = "a file, or a link to nothing, is there" if isinstance(error, FileExistsError) else None
        what = there or error.strerror or str(error)
        raise StudyError(f"{error.filename or path}: {what}. {kept}{cure}.") from error
