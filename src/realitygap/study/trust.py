"""Whose code is run: a study that somebody made elsewhere may bring a task file of theirs.

Task files that this user evolved with, or agreed to, are known by their content. The list lies in
`~/.local/state/realitygap` (`XDG_STATE_HOME`), where no study can reach it.
"""

import os
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path

from realitygap.errors import StudyError

__all__ = ["agree_to", "refuse_strange", "strange"]

LIST = "trusted-tasks"


def agree_to(contents: Iterable[bytes]) -> None:
    """Run task files of this content from now on, without another question."""
    new = {sha256(content).hexdigest() for content in contents} - _known()
    if not new:
        return
    _known().update(new)
    with suppress(OSError):  # a home that cannot be written: the question comes again
        _file().parent.mkdir(parents=True, exist_ok=True)
        with _file().open("a", encoding="utf-8") as lines:
            lines.writelines(f"{one}\n" for one in sorted(new))


def strange(files: Iterable[Path]) -> list[Path]:
    """Those of some task files that this user has neither evolved with nor agreed to."""
    return [file for file in files if sha256(file.read_bytes()).hexdigest() not in _known()]


def refuse_strange(folder: Path, files: Iterable[Path]) -> None:
    """Refuse to run files of others.

    Raises:
        StudyError: names the file and the cure.
    """
    for file in strange(files):
        raise StudyError(
            f"{folder}: the study was made elsewhere and brings a program, {file}, that would be run. "
            "Read it; if you trust who wrote it, give --trust (in Python: load_study(…, trust=True))."
        )


@cache
def _known() -> set[str]:
    """Of this process: what is on the list, and what was agreed to since."""
    try:
        return set(_file().read_text("utf-8").split())
    except (OSError, UnicodeDecodeError):
        return set()


def _file() -> Path:
    home = Path(os.environ.get("XDG_STATE_HOME", ""))
    return (home if home.is_absolute() else Path.home() / ".local" / "state") / "realitygap" / LIST
