"""Facts as TOML: the standard library reads it, this writes it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["to_toml"]


def to_toml(facts: Mapping[str, Any]) -> str:
    """TOML text of a table: plain keys first, then tables; None is left out.

    Arrays are written as lists, anything else that TOML has no word for as its text.
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
