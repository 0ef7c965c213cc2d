"""Writes docs/reference/*.md, a page a room, from the docstrings of its public names.

`python docs/reference.py` makes them; a test holds the pages to what this makes. Nothing is imported:
the source is read.
"""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

DOCS = Path(__file__).resolve().parent
SOURCE = DOCS.parent / "src" / "realitygap"
PAGES = DOCS / "reference"
LEFT_OUT = {"cli", "kernels", "__main__", "lazy"}
"""Rooms for the command line and for compiled code, and what only the package itself uses."""


def main() -> None:
    """Write every page, and remove those of rooms that are gone."""
    made = pages()
    PAGES.mkdir(exist_ok=True)
    for old in {file.name for file in PAGES.glob("*.md")} - made.keys():
        (PAGES / old).unlink()
    for name, text in made.items():
        (PAGES / name).write_text(text, encoding="utf-8")


def pages() -> dict[str, str]:
    """The text of each page by its file's name."""
    rooms: dict[str, list[Path]] = {}
    for file in sorted(SOURCE.rglob("*.py")):
        room = file.relative_to(SOURCE).parts[0].removesuffix(".py")
        if room not in LEFT_OUT and file.stem != "__main__" and file != SOURCE / "__init__.py":
            rooms.setdefault(room, []).append(file)
    made = {f"{room}.md": _room(room, files) for room, files in rooms.items()}
    first = [f"- [{room}]({room}.md): {_summary(files[0])}" for room, files in sorted(rooms.items())]
    head = (
        "# Reference\n\nPublic names by room, from their docstrings. Made by `python docs/reference.py`.\n\n"
    )
    return {"README.md": head + "\n".join(first) + "\n", **made}


def _room(room: str, files: list[Path]) -> str:
    """One page: every public name of every file of a room."""
    parts = [f"# realitygap.{room}\n\n{_fenced(_doc(ast.parse(files[0].read_text('utf-8'))))}"]
    for file in files:
        tree = ast.parse(file.read_text("utf-8"))
        names = set(_public(tree))
        found = [_entry(node) for node in tree.body if getattr(node, "name", "") in names]
        if found:
            module = ".".join(file.relative_to(SOURCE).with_suffix("").parts)
            about = [] if file == files[0] else [_fenced(_doc(tree))]
            parts += [f"## `realitygap.{module}`", *about, *found]
    return "\n\n".join(part for part in parts if part) + "\n"


def _entry(node: ast.stmt) -> str:
    """A class with its public methods, or a function."""
    assert isinstance(node, ast.ClassDef | ast.FunctionDef)
    if isinstance(node, ast.FunctionDef):
        return f"### `{_signature(node)}`\n\n{_fenced(_doc(node))}"
    bases = ", ".join(ast.unparse(base) for base in node.bases)
    text = f"### class `{node.name}`{f' ({bases})' if bases else ''}\n\n{_fenced(_doc(node))}"
    own = [one for one in node.body if isinstance(one, ast.FunctionDef) and not one.name.startswith("_")]
    rows = [
        f"- `{_signature(one)}`: {' '.join((_doc(one) or '–').split(chr(10) * 2)[0].split())}" for one in own
    ]
    return "\n\n".join([text, "\n".join(rows)] if rows else [text])


def _signature(node: ast.FunctionDef) -> str:
    """As it is called: names, kinds and defaults; `self` left out."""
    arguments = ast.unparse(node.args).removeprefix("self, ").removeprefix("self").removeprefix("cls, ")
    if any(ast.unparse(one) == "property" for one in node.decorator_list):
        return node.name
    returns = f" -> {ast.unparse(node.returns)}" if node.returns is not None else ""
    return f"{node.name}({arguments}){returns}"


def _public(tree: ast.Module) -> list[str]:
    """The names in `__all__`, where that is a list."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return [one.value for one in getattr(node.value, "elts", []) if isinstance(one, ast.Constant)]
    return []


def _doc(node: ast.Module | ast.ClassDef | ast.FunctionDef) -> str:
    return inspect.cleandoc(ast.get_docstring(node) or "")


def _fenced(text: str) -> str:
    """A docstring as it is laid out, so that shapes and sections keep their lines."""
    return f"```text\n{text}\n```" if "\n" in text else text


def _summary(file: Path) -> str:
    return " ".join(_doc(ast.parse(file.read_text("utf-8"))).split("\n\n")[0].split())


if __name__ == "__main__":
    main()
