"""Each room says what it is and what it exports, and loads nothing heavy for saying so."""

from __future__ import annotations

import importlib
import pkgutil
import subprocess
import sys

import pytest

import realitygap
from tests.cli.test_start_up import HEAVY

ROOMS = sorted(room.name for room in pkgutil.iter_modules(realitygap.__path__, "realitygap.") if room.ispkg)
LIGHT = [
    "realitygap." + name
    for name in ("calibration", "control", "correspondence", "experiments", "film", "report", "robots",
                 "simulation", "study", "transfer", "twin")
]  # fmt: skip


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_says_what_it_is(room: str) -> None:
    """In a docstring; every name of its `__all__` is there, and a wrong one is an AttributeError."""
    module = importlib.import_module(room)
    assert module.__doc__
    for name in getattr(module, "__all__", ()):
        assert getattr(module, name) is not None
    with pytest.raises(AttributeError, match="load_stuby"):
        _ = module.load_stuby


def test_rooms_load_lightly() -> None:
    """What a room exports is loaded when it is first used."""
    assert set(LIGHT) <= set(ROOMS)
    code = f"import sys, {', '.join(LIGHT)}; print(sorted(set(sys.modules) & {{*{HEAVY!r}, 'numpy'}}))"
    made = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert made.stdout.strip() == "[]"
