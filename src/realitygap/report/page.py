"""Makes a page from a list of figures, its tables and a template, as one file."""

import re
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup
from matplotlib.figure import Figure

from realitygap.files import atomic_write
from realitygap.report.style import inline_svg, number, save_figure, styled
from realitygap.work.folder import refuse_links

__all__ = ["Figures", "OnProgress", "Picture", "rendered", "report_folder", "write_page"]

OnProgress = Callable[[int, int, str], None]
"""Called with parts done, parts in all, and the name of the next one."""

TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent / "templates"),
    autoescape=True, trim_blocks=True, lstrip_blocks=True,
)  # fmt: skip
"""Each is compiled once."""
TEMPLATES.filters["number"] = number


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure to be drawn; its caption is the template's.

    Attributes:
        name: of its files, figures/NAME.png and .svg, and of its anchor on the page.
        draw: draws it.
        alt: its text alternative.
        label: what the paper calls it, such as "Figure 3".
    """

    name: str
    draw: Callable[[], Figure]
    alt: str
    label: str = ""

    def save(self, folder: Path | None, dpi: int = 200) -> str:
        """Draw it, and write it into a folder, if given, as PNG and SVG; returns the SVG."""
        with styled():
            return save_figure(self.draw(), folder, self.name, dpi=dpi)


class Figures(dict[str, Picture]):
    """The figures of a page by name, in the order in which they were added."""

    def add(self, name: str, draw: Callable[[], Figure], alt: str, label: str = "") -> Picture:
        """Add a figure, to be drawn with the others; arguments as of `Picture`."""
        self[name] = Picture(name=name, draw=draw, alt=alt, label=label)
        return self[name]


def report_folder(study: Path) -> Path:
    """The folder of a study's report, with folders for figures and tables; a link in its place is refused."""
    folder = study / "report"
    refuse_links(folder)
    for name in ("figures", "tables"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    return folder


def write_page(
    target: Path,
    template: str,
    figures: Figures,
    facts: Mapping[str, object],
    on_progress: OnProgress | None = None,
    *,
    tables: Mapping[str, str] | None = None,
) -> Path:
    """Write a page from a template: draw its figures, write its tables, then the page, as a whole.

    `tables` are CSV texts by name; None for a page that stands alone, with no files beside it. Facts that are
    futures are waited for once the figures are drawn.
    """
    report = on_progress or (lambda done, total, name: None)
    for name, text in (tables or {}).items():
        atomic_write(target.parent / "tables" / f"{name}.csv", text)
    folder, svgs = None if tables is None else target.parent / "figures", {}
    for done, (name, picture) in enumerate(figures.items()):
        report(done, len(figures) + 1, name)
        svgs[name] = Markup(inline_svg(picture.save(folder), name, picture.alt))
    report(len(figures), len(figures) + 1, target.name)
    known = {name: fact.result() if isinstance(fact, Future) else fact for name, fact in facts.items()}
    atomic_write(target, rendered(template, {**known, "svgs": svgs}))
    report(len(figures) + 1, len(figures) + 1, "")
    return target


def rendered(template: str, facts: Mapping[str, object]) -> str:
    """The HTML of a page from a template in the folder `templates`."""
    return re.sub(r"\n\s*\n+", "\n", TEMPLATES.get_template(template).render(facts))
