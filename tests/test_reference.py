"""The reference in docs is made of the docstrings."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"


def test_the_reference_is_what_the_docstrings_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every page, to the letter; no page of a room that is gone."""
    monkeypatch.syspath_prepend(str(DOCS))
    import reference

    made = reference.pages()
    kept = {file.name: file.read_text("utf-8") for file in (DOCS / "reference").glob("*.md")}
    old = sorted(name for name in made.keys() | kept.keys() if made.get(name) != kept.get(name))
    sys.modules.pop("reference")
    assert not old, f"run `python docs/reference.py`: {', '.join(old)} changed"
