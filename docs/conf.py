"""The documentation site: `sphinx-build -W --keep-going -n docs build/site`."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx

import realitygap

project = "realitygap"
author = "The realitygap authors"
project_copyright = f"{author}; MIT licence"
release = realitygap.__version__

extensions = ["myst_nb"]
exclude_patterns = ["noise-level/*", "reference/*"]
myst_heading_anchors = 3
nb_execution_mode = "off"

html_theme = "furo"
html_title = f"realitygap {release}"

SHOWN = {
    "contributing": "CONTRIBUTING.md",
    "examples": "examples/README.md",
    "changes": "CHANGELOG.md",
    "index": "README.md",
}
"""Pages of the site that show a file from beside `docs`; of README.md only the head is on the front page."""


def show(app: Sphinx, page: str, source: list[str]) -> None:
    """The text of a file beside `docs`, with its links from here; links to such files lead to their pages."""
    text = source[0]
    if page in SHOWN and page != "index":
        file = Path("..", SHOWN[page])
        text = re.sub(r"\]\((?![#\w]+:|#)", f"]({file.parent}/", Path(app.srcdir, file).read_text("utf-8"))
    text = text.replace("](../docs/", "](")
    for name, file in SHOWN.items():
        text = text.replace(f"](../{file}", f"]({name}.md")
    source[0] = text


def setup(app: Sphinx) -> None:
    """Sphinx calls this."""
    app.connect("source-read", show)
