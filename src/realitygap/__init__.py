"""realitygap: evolve controllers in a calibrated simulation of a Khepera, and measure the gap.

Public names are loaded when first used, so that `import realitygap` costs next to nothing:

    import realitygap

    study = realitygap.load_study("out/reproduce")
    study.runs[0].champion

Their one list is `__init__.pyi`.
"""

import re
from importlib import import_module
from pathlib import Path
from typing import Any

from realitygap import lazy

__version__ = "0.1.0"

_IMPORT = re.compile(r"^from (\S+) import (\w+) as", re.MULTILINE)
_HOMES = {name: home for home, name in _IMPORT.findall(Path(__file__).with_suffix(".pyi").read_text("utf-8"))}
__all__: list[str] = sorted([*_HOMES, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__


def _notebook() -> Any:
    from realitygap.report import notebook

    return notebook


def _tables() -> Any:
    from realitygap.export import tables

    return tables


lazy.notebook, lazy.tables = _notebook, _tables
