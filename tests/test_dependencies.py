"""The package declares what it imports."""

import ast
import re
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, distribution
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


def asked_for() -> list[str]:
    """What an installation brings, with all that a user may add to it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = {name: texts for name, texts in project["optional-dependencies"].items() if name != "dev"}
    return [*project["dependencies"], *(text for texts in extras.values() for text in texts)]


def brings(package: str) -> set[str]:
    """The names that a package's files can be imported by; none if it is not installed."""
    try:
        files = distribution(package).files
    except PackageNotFoundError:
        return set()
    return {file.parts[0].partition(".")[0] for file in files or ()}


def test_every_import_is_declared():
    """Nothing is there only because something else happens to bring it."""
    declared = {re.split(r"[<>=\[; ]", text)[0].lower() for text in asked_for()}
    brought = set().union(*map(brings, declared))
    needed = imported()
    assert len(needed) > 5
    assert not needed - brought


def test_licences_of_all_dependencies_are_named():
    """`docs/machines.md` has a line for every package that an installation brings at first hand."""
    named = (ROOT / "docs" / "machines.md").read_text("utf-8").lower()
    for text in asked_for():
        name = re.split(r"[<>=\[; ]", text)[0].lower()
        assert f"| {name} |" in named, name
