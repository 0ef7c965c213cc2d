"""The scripts that no other test runs (benchmarks, the docs, the hostile machine) keep up with the code."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

from tests.mutations import MUTATIONS

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("benchmarks", "docs", "tests/hostile")
SCRIPTS = [*(file for folder in FOLDERS for file in sorted((ROOT / folder).glob("*.py"))),
           *(ROOT / "tests" / f"{name}.py" for name in ("mutate", "same_everywhere"))]  # fmt: skip


def found(module: str, name: str = "") -> object:
    """A module, or what it has by a name; None where there is none."""
    try:
        value = import_module(module)
        if not name:
            return value
        return getattr(value, name) if hasattr(value, name) else import_module(f"{module}.{name}")
    except ModuleNotFoundError:
        return None


def missing_names(text: str) -> Iterator[str]:
    """What of this project's a script imports, anywhere in it, or asks of a module, that is not there."""
    tree, modules = ast.parse(text), dict[str, ModuleType]()
    for node in ast.walk(tree):
        pairs = [(alias.name, "", alias) for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            pairs = [(node.module, alias.name, alias) for alias in node.names]
        for module, name, alias in pairs:
            if module.split(".")[0] not in ("realitygap", "tests"):
                continue
            value = found(module, name)
            if value is None:
                yield f"{module}: {name}"
            if isinstance(value, ModuleType):
                modules[alias.asname or name] = value
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in modules:
            module = modules[node.value.id]
            if not hasattr(module, node.attr):
                yield f"{module.__name__}: {node.attr}"


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda file: file.relative_to(ROOT).as_posix())
def test_a_script_names_only_what_exists(script: Path) -> None:
    """Whatever a script takes from this project, at its head or late, stands where it looks for it."""
    assert list(missing_names(script.read_text("utf-8"))) == []


def test_every_mutation_has_its_place() -> None:
    """What a mutation replaces stands exactly once in its file, and the tests that should see it exist."""
    for one in MUTATIONS:
        text = (ROOT / "src" / "realitygap" / one.file).read_text("utf-8")
        assert text.count(one.old) == 1 and one.old != one.new, (one.file, one.title)
        for test in one.tests:
            file, _, name = test.partition("::")
            assert (ROOT / file).is_file() and f"def {name}" in (ROOT / file).read_text("utf-8"), (
                one.title,
                test,
            )
