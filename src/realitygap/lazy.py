"""What is loaded when first needed: public names of a room, rooms above, packages of an extra."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any

from realitygap.errors import UsageError

__all__ = ["above", "names_of", "needed"]


def names_of(room: str, homes: Mapping[str, str]) -> tuple[list[str], Callable[[str], Any]]:
    """`__all__` and `__getattr__` of a package whose names must not load what they need before they are used.

    Args:
        room: the package's `__name__`.
        homes: names, separated by spaces, by the file of the package that holds them.
    """
    where = {name: home for home, names in homes.items() for name in names.split()}

    def load(name: str) -> Any:
        if name not in where:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        return getattr(importlib.import_module(f"{room}.{where[name]}"), name)

    return sorted(where), load


def above(home: str) -> Any:
    """A file of a room above, by its name: where a value shows itself, or becomes what others read."""
    return importlib.import_module(f"realitygap.{home}")


def needed(name: str, extra: str) -> Any:
    """A package that one of realitygap's extras brings.

    Raises:
        UsageError: it is not installed; with the line that installs it.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != name.partition(".")[0]:
            raise
        package = name.partition(".")[0]
        raise UsageError(
            f"{package} is not installed. Install it: pip install 'realitygap[{extra}]'."
        ) from None
