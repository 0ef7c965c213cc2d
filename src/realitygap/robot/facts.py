"""Facts about a drive as TOML: whatever a caller wants to keep beside the steps."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

__all__ = ["to_toml"]


def to_toml(facts: Mapping[str, Any]) -> str:
    """Facts as TOML: plain keys first, then tables; None is left out."""
    plain = {k: v for k, v in facts.items() if not isinstance(v, Mapping) and v is not None}
    lines = [f"{json.dumps(str(k))} = {_value(v)}" for k, v in plain.items()]
    for key, table in facts.items():
        if isinstance(table, Mapping):
            lines += ["", f"[{json.dumps(str(key))}]"]
            lines += [f"{json.dumps(str(k))} = {_value(v)}" for k, v in table.items() if v is not None]
    return "\n".join(lines).lstrip("\n") + "\n"


def _value(value: Any) -> str:
    """A TOML value: strings as JSON writes them, which TOML reads alike."""
    if isinstance(value, Mapping):
        inner = ", ".join(f"{json.dumps(str(k))} = {_value(v)}" for k, v in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, str):
        return json.dumps(value).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    if hasattr(value, "tolist"):
        return _value(value.tolist())
    if isinstance(value, bool | int | float):
        return json.dumps(value) if not isinstance(value, float) or math.isfinite(value) else repr(value)
    return json.dumps(str(value))
