"""Public names of a room, loaded when they are first asked for."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["names_of"]


def names_of(room: str, homes: Mapping[str, str]) -> tuple[list[str], Callable[[str], Any]]:
    """`__all__` and `__getattr__` of a package whose names must not load what they need before they are used.

    Args:
        room: the package's `__name__`.
        homes: names, parted by spaces, by the file of the package that holds them.
    """
    where = {name: home for home, names in homes.items() for name in names.split()}

    def load(name: str) -> Any:
        if name not in where:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        return getattr(importlib.import_module(f"{room}.{where[name]}"), name)

    return sorted(where), load
