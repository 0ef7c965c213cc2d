"""Figures 1 to 6, tables 1 and 2, and the page a person looks at."""

from __future__ import annotations

import importlib
from typing import Any

__all__ = ["build_report", "draw_network", "draw_path", "save_animation", "save_picture"]

_HOMES = {
    "build_report": "build",
    "draw_network": "network",
    "draw_path": "paths",
    "save_animation": "pictures",
    "save_picture": "pictures",
}


def __getattr__(name: str) -> Any:
    """Load matplotlib only when something is drawn."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
