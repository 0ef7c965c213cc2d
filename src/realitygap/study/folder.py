"""A study's folder: made once, locked while worked on, opened only by the configuration it was made with."""

from __future__ import annotations

import os
import platform
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path

from realitygap import whole
from realitygap.errors import StudyBusyError, StudyError
from realitygap.study.commit import project_commit
from realitygap.study.config import StudyConfig
from realitygap.study.machine import processor
from realitygap.study.materials import Materials, gather
from realitygap.study.plan import plans
from realitygap.study.schema import told
from realitygap.study.settings import difference
from realitygap.study.store import DATABASE, create
from realitygap.toml import to_toml

__all__ = ["exists", "lock", "open_folder", "open_to_begin", "read_config", "read_materials", "versions"]

CONFIG = "study.toml"
LOCK = "study.lock"
OURS = {CONFIG, LOCK, "profile.toml", "arenas", "tasks", "report", "reproduce.toml", "calibration"}
"""What a study that was killed while it was being made may have left."""

_HEADER = """\
# A realitygap study: all that its results depend on. Files are named from this folder.
# To make another like it: realitygap evolve TASK --config THIS_FILE --out ANOTHER_FOLDER
"""


def exists(folder: Path) -> bool:
    """Whether a study was made in this folder."""
    return (folder / DATABASE).is_file()


def open_folder(folder: Path, wished: Materials | None, *, resume: bool) -> Materials:
    """Make the wished study in the folder, or open the one that is there; the lock is held.

    Raises:
        StudyError: there is a study but `resume` is not wished, or it was made with another
            configuration, or there is none to resume, or the folder holds something else.
    """
    if exists(folder):
        if not resume:
            open_to_begin(folder)
        if wished is not None:
            _refuse_difference(folder, wished)
        return read_materials(folder)
    if wished is None:
        raise StudyError(f"{folder} holds no study ({DATABASE} is missing). Give the folder of a study.")
    _refuse_strangers(folder)
    local, files = wished.copies()
    with told(folder):
        for name, content in {**files, CONFIG: _text(local).encode()}.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            whole.write(path, content)
    trials = max(task.trials for task in wished.tasks)
    create(folder / DATABASE, plans(wished), trials)
    return read_materials(folder)


def open_to_begin(folder: Path) -> None:
    """See that a study could be begun in the folder; the lock is held.

    Raises:
        StudyError: there is one, or something else.
    """
    if exists(folder):
        raise StudyError(f"{folder} already holds a study. Resume it (--resume) or choose another --out.")
    _refuse_strangers(folder)


def read_config(folder: Path) -> StudyConfig:
    """The configuration that a study was made with, paths from the folder.

    Raises:
        StudyError: no study there.
        ConfigError: its file is broken.
    """
    path = folder / CONFIG
    if not exists(folder):
        what = "no such folder" if not folder.exists() else f"no study there ({DATABASE} is missing)"
        raise StudyError(f"{folder}: {what}. Give a study's folder, such as --out made it.")
    if not path.is_file():
        raise StudyError(f"{path}: missing. Restore it from a copy: the study cannot be read without it.")
    return StudyConfig.from_toml(path, local=True)


def read_materials(folder: Path) -> Materials:
    """A study's robot, tasks and arenas, from its own copies."""
    return gather(read_config(folder), folder)


@contextmanager
def lock(folder: Path) -> Iterator[None]:
    """Hold the folder against other processes; the lock ends with the process, however that ends.

    Raises:
        StudyBusyError: another process holds it.
        StudyError: the folder cannot be written.
    """
    from filelock import FileLock, Timeout

    with told(folder):
        folder.mkdir(parents=True, exist_ok=True)
        held = FileLock(folder / LOCK, timeout=0)
        try:
            held.acquire()
        except Timeout:
            raise StudyBusyError(
                f"{folder}: {_holder(folder)} is working on this study. Wait until it ends, stop it, "
                "or choose another --out."
            ) from None
        except NotImplementedError as error:
            reason = f"this file system has no locks ({error})"
            raise StudyError(f"{folder}: {reason}. Choose another --out.") from None
    try:
        yield
    finally:
        held.release()


def versions() -> dict[str, str]:
    """What the bits of a result may depend on besides the configuration."""
    from importlib.metadata import version

    import numba
    import numpy

    return {
        "realitygap": version("realitygap"),
        "commit": project_commit(),
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "numba": numba.__version__,
        "mujoco": version("mujoco"),
        "opencv": version("opencv-python-headless"),
        "sqlite": sqlite3.sqlite_version,
        "platform": platform.platform(),
        "processor": processor(),
    }


def _text(config: StudyConfig) -> str:
    return f"{_HEADER}\n{to_toml({**config.to_dict(), 'versions': versions()})}"


def _refuse_difference(folder: Path, wished: Materials) -> None:
    """Refuse to resume with another configuration than the study was made with."""
    config, files = wished.copies()
    cure = "Leave it as it was, or choose another --out."
    found = difference(_decisive(read_config(folder).to_dict()), _decisive(config.to_dict()))
    if found is not None:
        key, here, there = found
        raise StudyError(f"{folder}: the study was made with {key} = {here!r}, not {there!r}. {cure}")
    for name, content in files.items():
        with told(folder / name):
            same = (folder / name).read_bytes() == content
        if not same:
            raise StudyError(f"{folder}: the study keeps another {name} than the one given now. {cure}")


def _decisive(table: Mapping[str, object]) -> dict[str, object]:
    """A configuration without what changes no result."""
    return {key: value for key, value in table.items() if key not in ("title", "checkpoint_every")}


def _refuse_strangers(folder: Path) -> None:
    """Refuse to make a study among other files."""
    for path in sorted(folder.iterdir()):
        if path.name not in OURS and not path.name.startswith((".", DATABASE)):
            raise StudyError(f"{folder} holds no study, but other files ({path.name}). Choose another --out.")


def _holder(folder: Path) -> str:
    """The process that holds the lock, as far as it has said so."""
    try:
        uri = f"{(folder / DATABASE).resolve().as_uri()}?mode=ro"
        with closing(sqlite3.connect(uri, uri=True)) as database:
            pid = database.execute("SELECT pid FROM session ORDER BY id DESC LIMIT 1").fetchone()[0]
    except (sqlite3.Error, OSError, TypeError):
        return "another process"
    return f"another process (pid {pid})" if pid != os.getpid() else "this very process"
