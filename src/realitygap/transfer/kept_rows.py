"""Score rows that were computed once, kept in a study's folder for as long as they hold."""

import contextlib
import hashlib
import json
from collections.abc import Collection, Iterable
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from realitygap import whole
from realitygap.study.digest import check_of
from realitygap.transfer.packed import content

__all__ = ["MARKS", "Kept", "digest"]

MARKS = "marks.json"


class Kept:
    """The score rows in a folder's file, each with a checksum.

    What is broken or was edited is computed anew; a file that cannot be written is done without.
    """

    def __init__(self, folder: Path) -> None:
        self._file = folder / MARKS
        self._marks: dict[str, dict[str, Any]] = {}
        with contextlib.suppress(OSError, ValueError, RecursionError):
            there = json.loads(self._file.read_text("utf-8"))
            if isinstance(there, dict):
                self._marks = {key: kept["mark"] for key, kept in there.items() if _is_sound(kept)}
        self._changed = False

    def get(self, key: str) -> dict[str, Any] | None:
        """The score row that was made of just this."""
        return self._marks.get(key)

    def put(self, key: str, mark: dict[str, Any]) -> None:
        """Keep a score row."""
        self._marks[key] = mark
        self._changed = True

    def save(self, wanted: Collection[str]) -> None:
        """Write the file, without what nobody asks for any more; not through a link."""
        if not self._changed or self._file.is_symlink():
            return
        kept = {k: {"mark": mark, "check": check_of(mark)} for k, mark in self._marks.items() if k in wanted}
        with contextlib.suppress(OSError):
            whole.write(self._file, json.dumps(kept, indent=1))


def _is_sound(kept: object) -> bool:
    """Whether this is a score row as it was kept."""
    return isinstance(kept, dict) and "mark" in kept and kept.get("check") == check_of(kept["mark"])


def digest(words: Iterable[object], data: bytes, paths: Iterable[Path]) -> str:
    """A key for a score row: of all that it follows from, and of the rules that it is made by."""
    found = hashlib.blake2b(_rules(), digest_size=16)
    found.update(repr(list(words)).encode())
    found.update(data)
    for path in paths:
        found.update(content(path) or b"none")
    return found.hexdigest()


@cache
def _rules() -> bytes:
    """The text of the room that names and scores, its exemplars included."""
    found = hashlib.blake2b(digest_size=16)
    for room in ("realitygap.correspondence", "realitygap.correspondence.exemplars"):
        for entry in sorted(files(room).iterdir(), key=lambda entry: entry.name):
            if entry.name.endswith((".py", ".json", ".npz")):
                found.update(entry.read_bytes())
    return found.digest()
