"""An experiment's folder: its settings, made once and only continued with the same; its files and tables."""

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
"""Folder of the resulting tables: all that a report needs."""
ADDED = ("versions", "plan")
"""What a settings file holds besides these."""


@dataclass(frozen=True, kw_only=True)
class Settings(Value):
    """An experiment's settings: all that its results depend on.

    A kind of experiment says FILE, where its settings are in its folder; WHAT messages call it; the COMMAND
    that makes it; FACTS, the file of its results that comes last, if it has one.
    """

    FILE = COMMAND = WHAT = FACTS = ""

    def to_dict(self) -> dict[str, Any]:
        """The settings, keys as in their file; what is None is left out."""
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
        """From a dictionary with a file's keys, what an experiment adds to them left out."""
        return build(cls, {key: value for key, value in table.items() if key not in ADDED})

    @classmethod
    def from_folder(cls, folder: Path) -> Self:
        """The settings that the experiment in a folder was made with.

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
        """The usual settings; those of a folder that is to be continued, if it holds any."""
        return cls.from_folder(folder) if resume and (folder / cls.FILE).is_file() else cls()


def open_folder(
    folder: Path, kind: type[S], requested: S | None, *, resume: bool, facts: Mapping[str, Any] | None = None
) -> S:
    """Make the requested experiment in the folder, or open the one that is there; the lock is held.

    Args:
        folder: the experiment's.
        kind: of experiment.
        requested: the settings; None: to continue what is there.
        resume: continue it.
        facts: what is written beside new settings.

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
    if (folder / _copy(kind)).is_file():  # older ones keep none
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
    """The file of the settings once more: a person may have edited those that are shown."""
    return f".{kind.FILE}"


def missing(files: Mapping[T, Path]) -> list[T]:
    """Whose file is not there yet; files appear as a whole or not at all."""
    return [one for one, file in files.items() if not file.is_file()]


@contextmanager
def kept(file: Path, what: str) -> Iterator[None]:
    """Read a file that a phase left; anything wrong with it ends in one line.

    Raises:
        StudyError: it is not there, or broken.
    """
    try:
        yield
    except Exception:  # a broken archive has a dozen ways to say so
        cure = "Delete it and resume: it is made again."
        raise StudyError(f"{file}: expected {what}. {cure}") from None


class Seconds:
    """How long each phase took, over all sessions, kept in the experiment's folder."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "seconds.json"

    def read(self) -> dict[str, float]:
        """Seconds by phase; a file that cannot be read tells nothing, and no result hangs on it."""
        try:
            return {str(key): float(value) for key, value in json.loads(self._file.read_text()).items()}
        except (OSError, ValueError, AttributeError, TypeError, ArithmeticError, RecursionError):
            return {}

    def add(self, phase: str, seconds: float) -> None:
        """So much more."""
        table = self.read()
        table[phase] = round(table.get(phase, 0.0) + seconds, 1)
        whole.write(self._file, json.dumps(table, indent=1) + "\n")


def write_table(file: Path, head: Iterable[str], rows: Iterable[Sequence[object]]) -> None:
    """A CSV file of five digits; what is not known is empty."""
    whole.write(file, to_csv([list(head), *([_text(value) for value in row] for row in rows)]))


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.5g}" if math.isfinite(value) else ""
    return str(value).lower() if isinstance(value, bool) else str(value)
