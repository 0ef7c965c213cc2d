"""The documentation site: `sphinx-build -nW --keep-going docs build/site`."""

from __future__ import annotations

import builtins
import gc
import inspect
import re
import sys
from pathlib import Path
from typing import Any

from docutils.nodes import document
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.ext.napoleon import Config, GoogleDocstring

import realitygap

sys.path.append(str(Path(__file__).parent))
import look
from live import write_live  # beside this file, both

gc.set_threshold(100_000, 50, 50)  # to look through documents, which live on, was a quarter of the work

project = "realitygap"
author = "The realitygap authors"
project_copyright = f"{author}; MIT licence"
release = realitygap.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary"]
exclude_patterns = ["conf.py", "live.py", "look.py", "loop.py", "figures/*"]
myst_heading_anchors = 3
nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_merge_streams = True
nb_execution_timeout = 300  # s, a cell: a loaded machine, and kernels that are not compiled yet

html_theme = "furo"
pygments_dark_style = "github-dark"
html_title = f"realitygap {release}"
html_theme_options = look.colours()
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_favicon = html_logo = "_static/mark.svg"
html_search_scorer = str(Path(__file__).parent / "_static" / "guides-first.js")
toc_object_entries = False

default_role = "code"  # as in Markdown
add_module_names = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 90
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: name for name in ("NDArray", "ArrayLike")}
autosummary_generate = False
nitpick_ignore_regex = [
    ("py:class", ".*"),  # half the types are from elsewhere; what docstrings raise must be known
    ("py:obj", r"typing\..*"),
    ("py:exc", "|".join(name for name in dir(builtins) if "Error" in name)),
]

SHOWN = {
    "contributing": "CONTRIBUTING.md",
    "examples": "examples/README.md",
    "changes": "CHANGELOG.md",
    "index": "README.md",
}
"""Pages of the site that show a file from beside `docs`; of README.md only the head is on the front page."""
MOVED = {
    "down-load": "robots",
    "enki": "robots",
    "evolution": "benchmarks",
    "gymnasium": "how-to-own-parts",
    "how-to": "how-to-evolve",
    "licences": "machines",
    "live": "how-to-evolve",
    "measure-or-randomise": "noise",
    "noise-level": "noise",
    "noise-level-2": "noise",
    "noise-level-2-results": "noise",
    "notebook": "notebooks",
    "optimisers": "how-to-own-parts",
    "readings": "differences",
    "realities": "how-to-robots",
    "tables-and-logs": "how-to-look",
    "thymio": "robots",
    "twin": "robots",
}
"""Pages that are gone, and where their links lead."""
SOURCE = Path(realitygap.__file__).parent
LEFT_OUT = {"__init__", "cli", "kernels", "lazy"}
"""Packages without a page in the reference: the command line, compiled code, the package's own."""


def show(app: Sphinx, page: str, source: list[str]) -> None:
    """The text of a file beside `docs`, with its links from here; links to such files lead to their pages."""
    text = source[0]
    if page == "index":
        text = look.pictured(text)
    elif page in SHOWN:
        file = Path("..", SHOWN[page])
        text = re.sub(r"\]\((?![#\w]+:|#)", f"]({file.parent}/", Path(app.srcdir, file).read_text("utf-8"))
    text = text.replace("](../docs/", "](")
    for name, file in SHOWN.items():
        text = text.replace(f"](../{file}", f"]({name}.md")
    # Python beside `docs` is a file to take away, as a study's pages are; within it, a notebook.
    source[0] = re.sub(r"\]\(((?:\.\./)+(?:[^)]+\.py|studies/[^)#]+)\))", r"](path:\1", text)


def write_reference(app: Sphinx) -> None:
    """A page for each package, whose text autodoc takes from the docstrings, and one that lists them."""
    packages: dict[str, list[str]] = {}
    for file in sorted(SOURCE.rglob("*.py")):
        words = file.relative_to(SOURCE).with_suffix("").parts
        if words[0] not in LEFT_OUT and words[-1] != "__main__":
            packages.setdefault(words[0], []).append(
                ".".join(("realitygap", *words)).removesuffix(".__init__")
            )
    public = [getattr(realitygap, name) for name in sorted(realitygap.__all__) if name != "__version__"]
    folder = Path(app.srcdir, "reference")
    folder.mkdir(exist_ok=True)
    pages = {package: "\n".join(map(_module, modules)) for package, modules in packages.items()}
    pages["index"] = f"""{_heading("Reference")}
All of it is made from the docstrings. What a program usually needs can be taken from ``realitygap`` itself:

.. autosummary::

   {_lines(f"~{value.__module__}.{value.__qualname__}" for value in public)}

Packages:

.. autosummary::

   {_lines(f"realitygap.{package}" for package in sorted(packages))}

.. toctree::
   :hidden:

   {_lines(sorted(packages))}
"""
    for name, text in pages.items():
        file = folder / f"{name}.rst"
        if not file.is_file() or file.read_text("utf-8") != text:
            file.write_text(text, encoding="utf-8")


def _lines(names: Any) -> str:
    return "\n   ".join(names)


def _heading(text: str, line: str = "=") -> str:
    return f"{text}\n{line * len(text)}\n"


def _module(name: str) -> str:
    head = _heading(name, "=") if name.count(".") == 1 else _heading(name.removeprefix("realitygap."), "-")
    return f"{head}\n.. automodule:: {name}\n   :members:\n"


def at_home(app: Sphinx, what: str, name: str, value: object, skip: bool, options: Any) -> bool | None:
    """A name that a module only passes on is described where it is at home; a tuple's fields have no text."""
    if type(value).__name__ == "_tuplegetter":
        return True
    if what != "module" or not (inspect.isclass(value) or inspect.isfunction(value)):
        return None
    return value.__module__ != app.env.current_document.autodoc_module or None


def google(app: Sphinx, what: str, name: str, value: object, options: Any, lines: list[str]) -> None:
    """Docstrings in Google style; an indented block is code, and an attribute's text starts with no type."""
    for i in range(len(lines) - 1, 1, -1):
        if lines[i].startswith("    ") and not lines[i - 1] and re.match(r"\S", lines[i - 2]):
            lines[i:i] = ["::", ""]
    what = "function" if what in ("attribute", "data", "property") else what
    sections = [("Attributes", "params_style")]
    config = Config(napoleon_use_param=False, napoleon_custom_sections=sections)
    lines[:] = GoogleDocstring(lines, config, app, what, name, value, options).lines()


def redirect(app: Sphinx, exception: Exception | None) -> None:
    """Old addresses lead to the pages that took over."""
    for old, new in MOVED.items() if exception is None and app.builder.format == "html" else ():
        text = f'<!doctype html><title>Moved</title><meta http-equiv="refresh" content="0; url={new}.html">'
        Path(app.outdir, f"{old}.html").write_text(f'{text}<a href="{new}.html">Moved here</a>', "utf-8")


def drive(app: Sphinx, exception: Exception | None) -> None:
    """The pages on which readers drive robots."""
    if exception is None and app.builder.format == "html":
        write_live(Path(app.outdir), app.config.drive_evaluations)


def besides(app: Sphinx, exception: Exception | None) -> None:
    """Notebooks to take away, and the site's contents for programs that read."""
    if exception is None and app.builder.format == "html":
        look.notebooks(app)
        look.write_llms(app, SHOWN)


def exact(app: Sphinx, page: document) -> None:
    """A type in a signature is meant by its whole name, not as whatever ends in it."""
    for node in page.findall(pending_xref):
        if node.get("refspecific") is False:
            del node["refspecific"]


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("builder-inited", write_reference)
    app.connect("source-read", show)
    app.connect("autodoc-skip-member", at_home)
    app.connect("autodoc-process-docstring", google)
    app.connect("doctree-read", exact)
    app.connect("build-finished", redirect)
    app.connect("build-finished", drive)
    app.connect("html-page-context", look.downloads)
    app.connect("build-finished", besides)
    app.add_config_value("drive_evaluations", 1000, "", (int,), "Of each run on the pages to drive.")
    return {"parallel_read_safe": True, "parallel_write_safe": True}
