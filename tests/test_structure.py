"""The house holds to its plan: which file may know which."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import realitygap

SOURCE = Path(realitygap.__file__).parent


def imports() -> dict[str, set[str]]:
    """What each file of the package imports of it: early, late, and for types only."""
    files = {_name(path): path for path in SOURCE.rglob("*.py")}
    graph: dict[str, set[str]] = {}
    for name, path in files.items():
        found = set()
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom):
                assert not node.level, f"{path}, line {node.lineno}: imports are absolute here"
                found |= {node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)}
            elif isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
        # A package's own __init__ says only what is in it.
        graph[name] = {other for other in found & files.keys() if files[other].name != "__init__.py"} - {name}
    return graph


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Files that import each other, one after another; empty where there are none."""
    done: set[str] = set()

    def walk(name: str, way: list[str]) -> list[str]:
        if name in way:
            return [*way[way.index(name) :], name]
        if name in done:
            return []
        for other in sorted(graph[name]):
            found = walk(other, [*way, name])
            if found:
                return found
        done.add(name)
        return []

    return next((found for name in sorted(graph) if (found := walk(name, []))), [])


def test_no_two_files_import_each_other() -> None:
    """No file needs itself, by whatever way round: not late, not even for types."""
    graph = imports()
    assert len(graph) > 200
    assert not circle(graph)


def test_a_circle_is_found() -> None:
    """The search finds a circle of three files, and none where two ways lead to one file."""
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"a"}}) == ["a", "b", "c", "a"]
    assert not circle({"a": {"b", "c"}, "b": {"c"}, "c": set()})


def unsaid(text: str) -> list[str]:
    """Public functions and classes of a file whose four or more parameters its docstrings do not explain."""
    tree = ast.parse(text)
    public = next((ast.literal_eval(n.value) for n in tree.body if _assigned(n) == "__all__"), ())
    found = []
    for node in tree.body:
        if getattr(node, "name", None) not in public:
            continue
        inside = node.body if isinstance(node, ast.ClassDef) else []
        for one in (node, *inside):
            if isinstance(one, ast.FunctionDef) and (one.name == "__init__" or one.name[0] != "_"):
                told = [one, node] if one.name == "__init__" else [one]
                said = " ".join(ast.get_docstring(other) or "" for other in told)  # type: ignore[arg-type]
                names = {a.arg for a in (*one.args.posonlyargs, *one.args.args, *one.args.kwonlyargs)}
                if len(names - {"self", "cls"}) >= 4 and not re.search(r"Args:|rguments as of|as of `", said):
                    found.append(one.name)
    return found


def test_four_parameters_are_explained() -> None:
    """Of every public function; a command's stand in its help."""
    files = [path for path in sorted(SOURCE.rglob("*.py")) if path.parent.name != "cli"]
    assert len(files) > 200
    assert {_name(path): names for path in files if (names := unsaid(path.read_text("utf-8")))} == {}


def test_an_unexplained_parameter_is_found() -> None:
    """In a function, in a class, and not where it is explained or private."""
    text = '''__all__ = ["f", "g", "C"]
def f(a, b, c, *, d): "Something."
def g(a, b, c, d): "Something.\\n\\nArgs:\\n    a: of it."
def h(a, b, c, d): "Private."
class C:
    "Something."
    def m(self, a, b, c): "Few."
    def n(self, a, b, c, d): "Many."'''
    assert unsaid(text) == ["f", "n"]


def _assigned(node: ast.stmt) -> str:
    return getattr(node.targets[0], "id", "") if isinstance(node, ast.Assign) else ""


def _name(path: Path) -> str:
    return ".".join(("realitygap", *path.relative_to(SOURCE).with_suffix("").parts)).removesuffix(".__init__")
