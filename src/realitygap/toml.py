"""Facts as TOML, in and out."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from realitygap.errors import UsageError
from realitygap.text import read_text, reason, refuse_odd_values

__all__ = ["parse_toml", "read_toml", "to_toml"]


def read_toml(
    path: str | Path, error: type[UsageError], cure: str, *, broken: str = "Correct that line."
) -> dict[str, Any]:
    """The table of a TOML file; `cure` says what to do if there is none, `broken` if it is not TOML.

    Args:
        path: the file.
        error: what to raise.
        cure: what to do if there is none.
        broken: what to do if it is not TOML.

    Raises:
        UsageError: of the class `error`: as of `read_text`, or broken TOML, with its line.
    """
    text = read_text(path, error, cure)
    try:
        return parse_toml(text)
    except ValueError as why:
        raise error(f"{path}: not a TOML file: {why}. {broken}") from None


def parse_toml(text: str) -> dict[str, Any]:
    """The table of a TOML text.

    Raises:
        ValueError: broken TOML, whole numbers beyond 64 bits, or tables too deep in each other.
    """
    try:
        table = tomllib.loads(text)
        refuse_odd_values(table)
    except (ValueError, RecursionError) as why:
        raise ValueError(reason(why)) from None
    return table


def to_toml(facts: Mapping[str, Any]) -> str:
    """TOML text of a table: plain keys first, then tables; None is left out.

    Arrays are written as lists, anything else that TOML lacks as its text.
    """
    import tomlkit  # only a command that writes waits for it

    return tomlkit.dumps(_plain(facts))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return value if isinstance(value, str | bool | int | float) else str(value)
