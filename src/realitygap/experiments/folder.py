"""An experiment's folder: its fixed settings, its files and tables."""

import json
import math
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeVar

from realitygap import whole
from realitygap.errors import ConfigError, StudyError
from realitygap.study.lock import refuse_strangers
from realitygap.study.schema import told
from realitygap.study.settings import refuse_difference, refuse_edited_settings
from realitygap.study.versions import versions
from realitygap.text import to_csv
from realitygap.toml import read_toml, to_toml
from realitygap.work.shard import MARK
from realitygap.world.files import Value, build

__all__ = ["RESULTS", "Seconds", "Settings", "kept", "missing", "open_folder", "write_table"]

T = TypeVar("T")
S = TypeVar("S", bound="Settings")

RESULTS = "results"
"""Folder of the resulting tables: everything that a report needs."""
ADDED = ("versions", "plan")
"""What a settings file contains besides the settings."""


@dataclass(frozen=True, kw_only=True)
class Settings(Value):
    """An experiment's settings: everything that its results depend on.

    A kind of experiment defines FILE, its settings' file; WHAT, its name in messages; the COMMAND that makes
    it; FACTS, the last file of its results, if any.
    """

    FILE = COMMAND = WHAT = FACTS = ""

    def to_dict(self) -> dict[str, Any]:
        """The settings with the file's keys; None is left out."""
        return {key: value for key, value in super().to_dict().items() if value is not None}

    @property
    def named(self) -> str:
        """Options to repeat when it is continued: a user's program runs only if it is named."""
        return ""

    def resuming(self, folder: str | Path) -> str:
        """The command that continues it."""
        return f"{self.COMMAND} --out {shlex.quote(str(folder))}{self.named} --resume"

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> Self:
        """From a dictionary with a file's keys, ignoring what an experiment adds."""
        return build(cls, {key: value for key, value in table.items() if key not in ADDED})

    @classmethod
    def from_folder(cls, folder: Path) -> Self:
        """The settings of the experiment in a folder.

        Raises:
            StudyError: no such experiment there.
            ConfigError: its file is broken.
        """
        path, cure = folder / cls.FILE, f"Give the folder of `{cls.COMMAND}`."
        if not path.exists():
            raise StudyError(f"{folder}: no {cls.WHAT} there ({cls.FILE} is missing). {cure}")
        table = read_toml(path, ConfigError, cure, broken="Restore it from a copy.")
        try:
            return cls.from_dict(table)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from None

    @classmethod
    def begun(cls, folder: Path, *, resume: bool) -> Self:
        """The default settings; or, to resume, those of the experiment in a folder, if there is one."""
        return cls.from_folder(folder) if resume and (folder / cls.FILE).is_file() else cls()


def open_folder(
    folder: Path, kind: type[S], requested: S | None, *, resume: bool, facts: Mapping[str, Any] | None = None
) -> S:
    """Create the requested experiment in the folder, or open the one there; the lock is held.

    Args:
        folder: the experiment's.
        kind: of experiment.
        requested: the settings; None: those in the folder.
        resume: whether to continue one.
        facts: written with new settings.

    Raises:
        StudyError: there is one but `resume` is not set, or it was made with other settings, or
            there is none to resume, or the folder holds something else.
    """
    if not (folder / kind.FILE).is_file():
        if requested is None:
            raise StudyError(f"{folder}: no {kind.WHAT} there. Start it without --resume.")
        refuse_strangers(folder, kind.WHAT, (MARK,))
        text = to_toml({**requested.to_dict(), "versions": versions(), **(facts or {})})
        header = f"# {kind.WHAT.capitalize()}: all that its results depend on.\n"
        again = f"# To continue it: {requested.resuming('THIS_FOLDER')}\n"
        with told(folder):
            whole.write(folder / _copy(kind), text)
            whole.write(folder / kind.FILE, f"{header}{again}\n{text}")
        return requested
    there = kind.from_folder(folder)
    if (folder / _copy(kind)).is_file():  # older ones have none
        made = read_toml(folder / _copy(kind), StudyError, "", broken="Restore it from a copy.")
        refuse_edited_settings(folder / kind.FILE, kind.from_dict(made).to_dict(), there.to_dict())
    if not resume:
        done = "a finished" if kind.FACTS and (folder / RESULTS / kind.FACTS).is_file() else "an unfinished"
        cure = "Resume it (--resume) or choose another --out."
        raise StudyError(f"{folder} already holds {done if kind.FACTS else 'an'} {kind.WHAT}. {cure}")
    if requested is not None:
        made_as = f"{folder}: the {kind.WHAT.split()[0]} was made"
        refuse_difference(made_as, there.to_dict(), requested.to_dict())
    return there


def _copy(kind: type[Settings]) -> str:
    """The file of a copy of the settings: a person may have edited the visible ones."""
    return f".{kind.FILE}"


def missing(files: Mapping[T, Path]) -> list[T]:
    """Keys whose file does not exist yet; files appear complete or not at all."""
    return [one for one, file in files.items() if not file.is_file()]


@contextmanager
def kept(file: Path, what: str) -> Iterator[None]:
    """Read a file of an earlier phase; any fault is reported in one line.

    Raises:
        StudyError: it is missing or broken.
    """
    try:
        yield
    except Exception:  # a broken archive raises a dozen kinds of errors
        cure = "Delete it and resume: it is made again."
        raise StudyError(f"{file}: expected {what}. {cure}") from None


class Seconds:
    """Duration of each phase over all sessions, kept in the experiment's folder."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "seconds.json"

    def read(self) -> dict[str, float]:
        """Seconds by phase; an unreadable file counts as empty, since no result depends on it."""
        try:
            return {str(key): float(value) for key, value in json.loads(self._file.read_text()).items()}
        except (OSError, ValueError, AttributeError, TypeError, ArithmeticError, RecursionError):
            return {}

    def add(self, phase: str, seconds: float) -> None:
        table = self.read()
        table[phase] = round(table.get(phase, 0.0) + seconds, 1)
        whole.write(self._file, json.dumps(table, indent=1) + "\n")


def write_table(file: Path, head: Iterable[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a CSV file with five digits; unknown values are empty."""
    whole.write(file, to_csv([list(head), *([_text(value) for value in row] for row in rows)]))


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.5g}" if math.isfinite(value) else ""
    return str(value).lower() if isinstance(value, bool) else str(value)
