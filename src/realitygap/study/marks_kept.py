"""Marks that were computed once, kept in a study's folder for as long as they hold."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Collection, Iterable
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from realitygap import whole

__all__ = ["MARKS", "Kept", "digest"]

MARKS = "marks.json"


class Kept:
    """The marks in a folder's file; a file that is broken or cannot be written is done without."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / MARKS
        self._marks: dict[str, dict[str, Any]] = {}
        with contextlib.suppress(OSError, ValueError):
            there = json.loads(self._file.read_text("utf-8"))
            if isinstance(there, dict) and all(isinstance(mark, dict) for mark in there.values()):
                self._marks = there
        self._changed = False

    def get(self, key: str) -> dict[str, Any] | None:
        """The mark that was made of just this."""
        return self._marks.get(key)

    def put(self, key: str, mark: dict[str, Any]) -> None:
        """Keep a mark."""
        self._marks[key] = mark
        self._changed = True

    def save(self, wanted: Collection[str]) -> None:
        """Write the file, without what nobody asks for any more."""
        if not self._changed:
            return
        text = json.dumps({key: mark for key, mark in self._marks.items() if key in wanted}, indent=1)
        with contextlib.suppress(OSError):
            whole.write(self._file, text)


def digest(words: Iterable[object], data: bytes, paths: Iterable[Path]) -> str:
    """A key for a mark: of all that it follows from, and of the rules that it is made by."""
    found = hashlib.blake2b(_rules(), digest_size=16)
    found.update(repr(list(words)).encode())
    found.update(data)
    for path in paths:
        found.update(path.read_bytes() if path.is_file() else b"none")
    return found.hexdigest()


@cache
def _rules() -> bytes:
    """The text of the room that names and scores, its exemplars included."""
    found = hashlib.blake2b(digest_size=16)
    for entry in sorted(files("realitygap.correspondence").iterdir(), key=lambda entry: entry.name):
        if entry.name.endswith((".py", ".json", ".npz")):
            found.update(entry.read_bytes())
    return found.digest()
