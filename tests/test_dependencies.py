"""The package declares what it imports."""

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def imported() -> set[str]:
    """Every top-level package that some file of the package imports."""
    found = set()
    for file in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                found.add(node.module)
    return {name.partition(".")[0] for name in found} - {"realitygap", *sys.stdlib_module_names}


def test_every_import_is_declared():
    """Nothing is there only because something else happens to bring it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    declared = {re.split(r"[<>=\[; ]", text)[0].lower() for text in project["dependencies"]}
    known = packages_distributions()
    assert len(imported()) > 5
    for name in imported():
        assert {one.lower() for one in known[name]} & declared, name
