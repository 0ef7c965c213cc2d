"""Writes a recording as it is made, each finished place or trial at once: a kill loses at most one."""

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from realitygap.calibration.recordings.checks import FACTS
from realitygap.calibration.recordings.files import READINGS, STEPS
from realitygap.errors import RecordingError
from realitygap.files import atomic_write, naming_errors, read_toml, to_toml

__all__ = ["ARENA", "STUDY", "Journal", "alone", "refuse_another"]

ARENA, STUDY = "arena.toml", "study.db"
SAME = ("plan", "kind", "object", "robot", "unit", "twin_noise", "marker", "seed", "repeats", "bearings",
        "distances_cm", "places")  # fmt: skip
"""Facts that must not change when a recording is resumed."""
USUAL = "the usual"
"""What a fact is that is not said."""


class Journal:
    """One recording's folder; `done` has the rows of the places that are finished, by their keys.

    Args:
        folder: the recording's.
        facts: for recording.toml, written at the start; the kind decides which table is kept.
        columns: of the table.
        key: the columns that name a place.
        rows: how many rows a finished place has, by its key.
        table: another one than the kind's; it is made with its first rows.

    Raises:
        RecordingError: the folder holds another recording.
    """

    def __init__(
        self,
        folder: Path,
        *,
        facts: Mapping[str, Any],
        columns: Sequence[str],
        key: Sequence[str],
        rows: Callable[[tuple[str, ...]], int],
        table: str | None = None,
    ) -> None:
        self.folder = folder
        self.path = self.folder / (table or (STEPS if facts["kind"] == "wheels" else READINGS))
        self.columns = tuple(columns)
        self._key = [self.columns.index(name) for name in key]
        self.done: dict[tuple[str, ...], Sequence[Sequence[str]]] = {}
        if (self.folder / FACTS).exists():
            self._check(facts)
            self._take_up(rows)
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        atomic_write(self.path, ",".join(self.columns) + "\n")
        date = datetime.now().astimezone().isoformat(timespec="seconds")
        atomic_write(self.folder / FACTS, to_toml({**facts, "date": date}))

    def add(self, rows: Sequence[Sequence[str]]) -> None:
        """Write all rows of a finished place."""
        head = [] if self.path.exists() else [self.columns]
        text = "".join(",".join(row) + "\n" for row in (*head, *rows))
        with naming_errors(self.path), self.path.open("ab", buffering=0) as file:
            file.write(text.encode("utf-8"))
        self.done[self.key(rows[0])] = rows

    def state(self, name: str, fact: Any) -> None:
        """Put a fact into recording.toml that is known only now."""
        path = self.folder / FACTS
        atomic_write(path, to_toml({**self._stated(), name: fact}))

    def discard(self) -> None:
        """Remove an empty recording's files, and its folder if nothing else is in it."""
        for name in (self.path.name, ARENA, FACTS):
            (self.folder / name).unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def key(self, row: Sequence[str]) -> tuple[str, ...]:
        """The columns of a row that name its place."""
        return tuple(row[i] for i in self._key)

    def _stated(self) -> dict[str, Any]:
        return read_toml(self.folder / FACTS, RecordingError, "Begin the recording anew, in another folder.")

    def _check(self, facts: Mapping[str, Any]) -> None:
        path, there = self.folder / FACTS, self._stated()
        for name in SAME:
            if there.get(name) != facts.get(name):
                begun, asked = (repr(said[name]) if name in said else USUAL for said in (there, facts))
                raise RecordingError(
                    f"{path}: {name}: this recording was begun with {begun}, not {asked}; resume it as it "
                    "was begun, or choose another folder."
                )

    def _take_up(self, rows: Callable[[tuple[str, ...]], int]) -> None:
        """Keep the table's finished places; drop an incomplete one that a kill left."""
        if not self.path.is_file():
            return
        data = self.path.read_bytes()
        lines = data[: data.rfind(b"\n") + 1].decode("utf-8", "replace").splitlines()
        head = ",".join(self.columns)
        if lines and lines[0] != head:
            raise RecordingError(f"{self.path}, line 1: expected {head!r}, got {lines[0]!r}.")
        places: dict[tuple[str, ...], list[str]] = {}
        for number, line in enumerate(lines[1:], 2):
            row = line.split(",")
            if len(row) != len(self.columns):
                expected = f"expected {len(self.columns)} values"
                raise RecordingError(f"{self.path}, line {number}: {expected}, got {line!r}.")
            places.setdefault(self.key(row), []).append(line)
        finished = {k: kept for k, kept in places.items() if len(kept) == rows(k)}
        text = "".join(f"{line}\n" for line in (head, *(line for kept in finished.values() for line in kept)))
        if text.encode() != data:
            atomic_write(self.path, text)
        self.done = {key: [line.split(",") for line in kept] for key, kept in finished.items()}


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """A folder to record into, for one process at a time; an empty one is removed at the end.

    Raises:
        RecordingError: another process holds it, or it is a study's.
    """
    import fcntl  # where a system has none, `files` has said so

    if (folder / STUDY).exists():
        raise RecordingError(f"{folder}: holds a study ({STUDY}). Choose another folder.")
    folder.mkdir(parents=True, exist_ok=True)
    held = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(held)
        cure = "Wait until it ends, stop it, or choose another folder."
        raise RecordingError(f"{folder}: another process records there. {cure}") from None
    except OSError:
        pass  # a file system without locks
    try:
        yield
    finally:
        os.close(held)
        with contextlib.suppress(OSError):  # something is in it
            folder.rmdir()


def refuse_another(folder: Path, *, resume: bool) -> None:
    """Refuse a folder that holds a recording, unless it is to be resumed.

    Raises:
        RecordingError: it holds one.
    """
    if not resume and (folder / FACTS).exists():
        cure = "choose another folder, or go on with --resume."
        raise RecordingError(f"{folder}: already holds a recording; {cure}")
