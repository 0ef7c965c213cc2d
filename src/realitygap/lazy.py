"""Loaded when first needed: a package's public names, modules of layers above, packages of an extra."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any

from realitygap.errors import UsageError

__all__ = ["names_of", "needed", "notebook", "tables"]

notebook: Callable[[], Any]
"""Loads `report.notebook`, with which values show themselves; `realitygap/__init__.py` sets both of these."""
tables: Callable[[], Any]
"""Loads `export.tables`, with which a study becomes data frames."""


def names_of(package: str, homes: Mapping[str, str]) -> tuple[list[str], Callable[[str], Any]]:
    """`__all__` and `__getattr__` of a package whose names must not load what they need before they are used.

    Args:
        package: its `__name__`.
        homes: names, separated by spaces, by the file of the package that holds them.
    """
    where = {name: home for home, names in homes.items() for name in names.split()}

    def load(name: str) -> Any:
        if name not in where:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(f"{package}.{where[name]}"), name)

    return sorted(where), load


def needed(name: str, extra: str) -> Any:
    """A package that one of realitygap's extras brings.

    Raises:
        UsageError: it is not installed; with the line that installs it.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package = name.partition(".")[0]
        if error.name is None or error.name.partition(".")[0] != package:
            raise
        raise UsageError(
            f"{package} is not installed. Install it: pip install 'realitygap[{extra}]'."
        ) from None
