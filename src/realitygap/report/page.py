"""Makes a page from a list of figures, its tables and a template, as one file."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup
from matplotlib.figure import Figure

from realitygap.files import atomic_write
from realitygap.report.style import inline_svg, noise_styles, save_figure, styled
from realitygap.work.folder import refuse_links
from realitygap.work.pool import Bench, Setup, Tell, Workers, near, opened

__all__ = [
    "Figures", "OnProgress", "Picture", "Steps", "Words", "draw_all", "noise_key", "rendered",
    "report_folder", "write_page",
]  # fmt: skip

OnProgress = Callable[[int, int, str], None]
"""Called with parts done, parts in all, and the name of the next one."""

FEW = 12
"""Up to this number of figures, drawing takes less time than loading Matplotlib in other processes."""

TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent / "templates"),
    autoescape=True, trim_blocks=True, lstrip_blocks=True,
)  # fmt: skip
"""Each is compiled once."""

GLYPHS = {
    "o": "●", "s": "■", "^": "▲", "D": "◆", "v": "▼", "P": "✚", "X": "✖",
    "<": "◀", ">": "▶", "*": "★", "p": "⬟",
}  # fmt: skip


class Words(NamedTuple):
    """A figure's text alternative and its caption."""

    alt: str
    caption: str


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure to be drawn, with everything that a process needs to draw it.

    Attributes:
        name: of its files, figures/NAME.png and .svg, and of its anchor on the page.
        draw: draws it; a `functools.partial` of a function and its data, so that it can be sent.
        words: its text alternative and its caption.
        label: what the paper calls it, such as "Figure 3".
    """

    name: str
    draw: Callable[[], Figure]
    words: Words
    label: str = ""

    @property
    def caption(self) -> str:
        return self.words.caption

    def save(self, folder: Path | None, dpi: int = 200) -> str:
        """Draw it, and write it into a folder, if given, as PNG and SVG; returns the SVG."""
        with styled():
            return save_figure(self.draw(), folder, self.name, dpi=dpi)


class Figures(dict[str, Picture]):
    """The figures of a page by name, in the order in which they were added.

    Attributes:
        workers: processes or a pool to draw them.
    """

    def __init__(self, workers: Workers = 1) -> None:
        self.workers = workers

    def add(self, name: str, draw: Callable[[], Figure], words: Words, label: str = "") -> Picture:
        """Add a figure, to be drawn with the others; arguments as of `Picture`."""
        self[name] = Picture(name=name, draw=draw, words=words, label=label)
        return self[name]


class Drawing(Bench):
    """Draws pictures into a folder, if given."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def carry_out(self, job: Picture, tell: Tell) -> None:
        """Draw one picture; sends its name and its SVG."""
        tell((job.name, job.save(self._folder)))


class Steps:
    """Counts the parts of a page, and reports each before it is made."""

    def __init__(self, tell: OnProgress | None, total: int) -> None:
        self._tell, self._done, self._total = tell, 0, total

    def __call__(self, name: str) -> None:
        if self._tell:
            self._tell(self._done, self._total, name)
        self._done += 1


def report_folder(study: Path) -> Path:
    """The folder of a study's report, with folders for figures and tables.

    Raises:
        StudyError: a link is in its place.
    """
    folder = study / "report"
    refuse_links(folder)
    for name in ("figures", "tables"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    return folder


def draw_all(figures: Figures, folder: Path | None, step: Steps) -> dict[str, str]:
    """Draw every figure, into `folder` if given; SVGs by name."""
    drawn: dict[str, str] = {}

    def heard(message: tuple[str, str]) -> None:
        step(message[0])
        drawn[message[0]] = message[1]

    with opened(1 if len(figures) <= FEW else near(figures.workers)) as pool:
        pool.work(Setup(Drawing, (folder,)), figures.values(), heard)
    return drawn


def write_page(
    target: Path,
    template: str,
    figures: Figures,
    facts: Mapping[str, object] | Callable[[], Mapping[str, object]],
    step: Steps,
    *,
    tables: Mapping[str, str] | None = None,
) -> Path:
    """Write a page: draw its figures, write its tables, then the page, as a whole.

    Args:
        target: the page's path.
        template: from the folder `templates`; `figure(picture)` in it shows a figure.
        figures: all its figures.
        facts: the template's values by name; or a function that returns them, called after drawing.
        step: called with each figure, then with the page.
        tables: CSV texts by name; None for a page that stands alone, with no files beside it.

    Raises:
        OSError: something cannot be written.
    """
    for name, text in (tables or {}).items():
        atomic_write(target.parent / "tables" / f"{name}.csv", text)
    drawn = draw_all(figures, None if tables is None else target.parent / "figures", step)
    svgs = {name: Markup(inline_svg(drawn[name], name, one.words.alt)) for name, one in figures.items()}
    spoken = facts() if callable(facts) else facts
    atomic_write(target, rendered(template, {**spoken, "svgs": svgs}))
    step(target.name)
    return target


def rendered(template: str, facts: Mapping[str, object]) -> str:
    """The HTML of a page from a template in the folder `templates`."""
    return re.sub(r"\n\s*\n+", "\n", TEMPLATES.get_template(template).render(facts))


def noise_key(levels: Mapping[float, str]) -> list[tuple[str, str, str]]:
    """Name, colour and sign of each noise level, for a page's legend."""
    styles = noise_styles(levels)
    return [(name, styles[level].colour, GLYPHS[styles[level].marker]) for level, name in levels.items()]
