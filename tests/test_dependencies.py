"""The package declares what it imports."""

import ast
import re
import sys
import tomllib
from importlib import import_module
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


NOT_PUBLIC = (
    ("numba._dispatcher", "compute_fingerprint"),
    ("numba.core.options", "DefaultOptions._nrt"),
    ("numba.core.dispatcher", "Dispatcher.enable_caching"),
    ("numba.core.dispatcher", "Dispatcher.typeof_pyval"),
    ("numba.core.codegen", "JITCodeLibrary._optimize_final_module"),
    ("numba.core.codegen", "JITCodeLibrary._finalize_final_module"),
    ("numba.core.codegen", "JITCodeLibrary._get_module_for_linking"),
    ("numba.core.codegen", "JITCodeLibrary.add_ir_module"),
    ("numba.core.compiler", "Compiler.compile_extra"),
    ("numba.core.compiler", "CompileResult._reduce"),
    ("numba.core.compiler", "CompileResult._rebuild"),
    ("numba.core.runtime", "rtsys.initialize"),
    ("numba.core.serialize", "dumps"),
)
"""What of Numba's the project leans on though no release promises it: the reason of its upper bound."""
MIGHT_REPLACE = (
    ("numba.core.options", "DefaultOptions.nrt"),
    ("numba.core.compiler", "CompileResult.reduce"),
    ("numba.core.dispatcher", "Dispatcher.set_cache"),
)


def found(module: str, name: str) -> bool:
    """Whether a module has it."""
    value = import_module(module)
    for part in name.split("."):
        if not hasattr(value, part):
            return False
        value = getattr(value, part)
    return True


def test_numba_is_bounded_for_as_long_as_need_be():
    """Numba has what is used of it that is not public; once it offers it openly, the upper bound can go."""
    missing = [name for module, name in NOT_PUBLIC if not found(module, name)]
    assert not missing, f"this Numba lacks {missing}: mend linking.py, machine_code.py, or keep the bound"
    public = [name for module, name in MIGHT_REPLACE if found(module, name)]
    assert not public, f"Numba offers {public}: use it, and let the upper bound in pyproject.toml go"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert any(re.match(r"numba>=[\d.]+,<", text) for text in project["dependencies"])


def test_licences_of_all_dependencies_are_named():
    """`docs/licences.md` has a line for every package that an installation brings at first hand."""
    named = (ROOT / "docs" / "licences.md").read_text("utf-8").lower()
    for text in asked_for():
        name = re.split(r"[<>=\[; ]", text)[0].lower()
        assert f"| {name} |" in named, name
