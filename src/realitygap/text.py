"""Small text files, read; whatever is wrong with them is said in one line."""

from __future__ import annotations

from pathlib import Path

from realitygap.errors import UsageError

__all__ = ["read_text"]


def read_text(path: str | Path, error: type[UsageError], cure: str) -> str:
    """The text of a file in UTF-8.

    Args:
        path: the file.
        error: what to raise.
        cure: what to do if there is none, such as "Give the path of a disk's .toml file."

    Raises:
        UsageError: of the class `error`: no such file, no right to read it, or no text.
    """
    try:
        return Path(path).read_text("utf-8-sig")
    except FileNotFoundError:
        raise error(f"{path}: no such file. {cure}") from None
    except UnicodeDecodeError:
        raise error(f"{path}: not a text file in UTF-8. {cure}") from None
    except OSError as why:
        raise error(f"{path}: cannot be read ({why.strerror}). Check the path and its rights.") from None
