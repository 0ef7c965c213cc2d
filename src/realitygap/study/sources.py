"""The files that a study depends on: those in its folder, and their original content."""

import os
import tomllib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from itertools import zip_longest
from pathlib import Path
from typing import Any

from realitygap.errors import StudyError
from realitygap.study.schema import told
from realitygap.study.settings import EDITED, difference

__all__ = ["agree_to", "changed", "inside", "refuse_edited", "refuse_links", "refuse_strange", "strange"]


def inside(folder: Path, name: str) -> Path:
    """The path of a file named relative to a study's folder.

    Raises:
        StudyError: it is missing, or leads out of the folder.
    """
    path, home = folder / name, folder.resolve()
    if ".." in Path(name).parts or not path.resolve().is_relative_to(home):
        raise StudyError(f"{folder}: expected a file in the study's own folder; {name!r} leads out of it.")
    if not path.is_file():
        raise StudyError(f"{path}: missing. Restore it from a copy: the study cannot be used without it.")
    return path


def refuse_edited(folder: Path, sources: Mapping[str, bytes]) -> None:
    """Check that a study's files have their original content.

    Raises:
        StudyError: one is missing, leads elsewhere, or was edited: says where.
    """
    for name, was in sources.items():
        path = inside(folder, name)
        with told(path):
            found = changed(name, was, path.read_bytes())
        if found is not None:
            raise StudyError(f"{path} has been edited since the study was made: {found}. {EDITED}")


def changed(name: str, was: bytes, now: bytes) -> str | None:
    """Where a file differs from its original, in words; None if it is equivalent."""
    if was == now:
        return None
    before, after = (text.decode("utf-8", "backslashreplace") for text in (was, now))
    if name.endswith(".toml"):
        try:
            found = difference(tomllib.loads(before), tomllib.loads(after))
        except tomllib.TOMLDecodeError as error:
            return f"it is no longer TOML ({error})"
        return None if found is None else f"{found[0]} was {_shown(found[1])}, now {_shown(found[2])}"
    pairs = zip_longest(before.splitlines(), after.splitlines())
    for number, (left, right) in enumerate(pairs, start=1):
        if left != right:
            return f"line {number} was {_shown(left)}, now {_shown(right)}"
    return "its line ends differ"


def refuse_links(folder: Path) -> None:
    """Check that nothing written into a folder can end up elsewhere.

    Raises:
        StudyError: the folder, or something in it, is a symbolic link.
    """
    for path in (folder, *sorted(folder.rglob("*"))):
        if path.is_symlink():
            raise StudyError(f"{path}: a link to {path.readlink()}, which is not followed. Remove the link.")


def _shown(value: Any) -> str:
    text = "nothing" if value is None else repr(value.strip() if isinstance(value, str) else value)
    return text if len(text) <= 80 else text[:79] + "…"


LIST = "trusted-tasks"


def agree_to(contents: Iterable[bytes]) -> None:
    """Agree to run task files of this content from now on."""
    new = {sha256(content).hexdigest() for content in contents} - _known()
    if not new:
        return
    _known().update(new)
    with suppress(OSError):  # the home folder cannot be written: the question will be asked again
        _file().parent.mkdir(parents=True, exist_ok=True)
        with _file().open("a", encoding="utf-8") as lines:
            lines.writelines(f"{one}\n" for one in sorted(new))


def strange(files: Iterable[Path]) -> list[Path]:
    """Those of some task files that this user has neither evolved with nor agreed to."""
    return [file for file in files if sha256(file.read_bytes()).hexdigest() not in _known()]


def refuse_strange(folder: Path, files: Iterable[Path]) -> None:
    """Refuse to run such files.

    Raises:
        StudyError: names the file and the cure.
    """
    for file in strange(files):
        raise StudyError(
            f"{folder}: the study was made elsewhere and brings a program, {file}, that would be run. "
            "Read it; if you trust its author, give --trust (in Python: trust=True)."
        )


@cache
def _known() -> set[str]:
    """Digests of the files that this user agreed to: those on the list, and those of this process."""
    try:
        return set(_file().read_text("utf-8").split())
    except (OSError, UnicodeDecodeError):
        return set()


def _file() -> Path:
    home = Path(os.environ.get("XDG_STATE_HOME", ""))
    return (home if home.is_absolute() else Path.home() / ".local" / "state") / "realitygap" / LIST
