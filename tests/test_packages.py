"""Each package says what it is and what it exports, and loads nothing heavy for saying so."""

from __future__ import annotations

import importlib
import pkgutil
import subprocess
import sys

import pytest

import realitygap
from tests.cli.test_commands import HEAVY

PACKAGES = sorted(one.name for one in pkgutil.iter_modules(realitygap.__path__, "realitygap.") if one.ispkg)
LIGHT = [
    "realitygap." + name
    for name in ("calibration", "control", "correspondence", "experiments", "film", "report", "robots",
                 "simulation", "study", "transfer", "twin")
]  # fmt: skip


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_says_what_it_is(package: str) -> None:
    """In a docstring; every name of its `__all__` is there, and a wrong one is an AttributeError."""
    module = importlib.import_module(package)
    assert module.__doc__
    for name in getattr(module, "__all__", ()):
        assert getattr(module, name) is not None
    with pytest.raises(AttributeError, match="load_stuby"):
        _ = module.load_stuby


def test_packages_load_lightly() -> None:
    """What a package exports is loaded when it is first used."""
    assert set(LIGHT) <= set(PACKAGES)
    code = f"import sys, {', '.join(LIGHT)}; print(sorted(set(sys.modules) & {{*{HEAVY!r}, 'numpy'}}))"
    made = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert made.stdout.strip() == "[]"
