"""The style of all figures: colours, line styles, sizes, and how a figure is saved.

Colours are Okabe and Ito's (https://jfly.uni-koeln.de/color/), suitable for colour-blind readers; every
colour comes with a line style, a marker or a shape, so nothing is shown by colour alone.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from realitygap.files import atomic_path, atomic_write, written_together

if TYPE_CHECKING:
    from matplotlib.typing import LineStyleType, RcKeyType

__all__ = [
    "COLUMN", "INHIBITORY", "INK", "PAGE", "SIMULATED", "SITUATED", "Look", "NoiseStyle", "inline_svg",
    "new_figure", "noise_key", "noise_styles", "number", "save_figure", "styled",
]  # fmt: skip

COLUMN = 3.35
"""Width of one column of a two-column paper, inches."""
PAGE = 7.0
"""Width of both columns; also fits a slide at twice the size."""

INK = "#1b1d21"
MUTED = "#6b7078"
GRID = "#dfe1e4"
PAPER = "#fffffe"
FLOOR = "#faf8f2"
WALL = "#5f564a"
CYLINDER = "#b9b4aa"
LAMP = "#e69f00"
BODY = "#fdfdfc"
RAY = "#b7791f"
INHIBITORY = "#cc79a7"

_VARIABLES = {
    INK: "ink", MUTED: "muted", GRID: "grid", PAPER: "paper", FLOOR: "floor", WALL: "wall",
    CYLINDER: "cylinder", BODY: "body", RAY: "ray",
}  # fmt: skip
"""Colours that the page replaces by its own, so that figures follow light and dark mode."""

_RC: dict[RcKeyType, object] = {
    "font.family": "sans-serif", "font.sans-serif": ["DejaVu Sans"], "font.size": 8,
    "axes.titlesize": 8.5, "axes.labelsize": 8, "xtick.labelsize": 7, "ytick.labelsize": 7,
    "legend.fontsize": 7.5, "legend.frameon": False, "text.color": INK, "axes.labelcolor": INK,
    "axes.edgecolor": MUTED, "axes.titlecolor": INK, "xtick.color": MUTED, "ytick.color": MUTED,
    "xtick.labelcolor": INK, "ytick.labelcolor": INK, "axes.spines.top": False,
    "axes.spines.right": False, "axes.linewidth": 0.7, "xtick.major.width": 0.7, "ytick.major.width": 0.7,
    "xtick.major.size": 3, "ytick.major.size": 3, "grid.color": GRID, "grid.linewidth": 0.6,
    "lines.linewidth": 1.4, "figure.facecolor": PAPER, "axes.facecolor": "none",
    "savefig.facecolor": PAPER, "axes.unicode_minus": True, "path.simplify": False, "pdf.fonttype": 42,
    "svg.fonttype": "none", "svg.hashsalt": "realitygap",
}  # fmt: skip


class NoiseStyle(NamedTuple):
    """Style of a noise level in every figure; `sign` is its marker in a text."""

    colour: str
    line: LineStyleType
    marker: str
    sign: str


class Look(NamedTuple):
    """Style of a robot and its tail: `simulated` or `situated` (on a robot, or a twin of one)."""

    line: LineStyleType
    tail_width: float
    tail_alpha: float
    body: str


SIMULATED = Look(line="-", tail_width=0.8, tail_alpha=1.0, body=BODY)
SITUATED = Look(line=(0, (2, 1)), tail_width=1.5, tail_alpha=0.6, body=CYLINDER)

_NAMED = {
    0.0: NoiseStyle("#0072b2", "-", "o", "●"),
    1.0: NoiseStyle("#d55e00", (0, (5, 1.5)), "s", "■"),
    2.0: NoiseStyle("#009e73", (0, (5, 1.5, 1, 1.5)), "^", "▲"),
}
_OTHERS = (
    NoiseStyle("#cc79a7", (0, (1, 1)), "D", "◆"),
    NoiseStyle("#56b4e9", (0, (3, 1, 1, 1, 1, 1)), "v", "▼"),
    NoiseStyle("#e69f00", (0, (8, 2)), "P", "✚"),
    NoiseStyle(MUTED, (0, (1, 2)), "X", "✖"),
    NoiseStyle("#0072b2", (0, (2, 2)), "<", "◀"),
    NoiseStyle("#d55e00", (0, (8, 2, 1, 2)), ">", "▶"),
    NoiseStyle("#009e73", (0, (2, 1, 2, 4)), "*", "★"),
    NoiseStyle("#cc79a7", (0, (12, 3)), "p", "⬟"),
)


def noise_styles(levels: Iterable[float]) -> dict[float, NoiseStyle]:
    """A style for each of a figure's noise levels; zero, observed and double always have the same."""
    levels = sorted(set(map(float, levels)))
    others = [level for level in levels if level not in _NAMED]
    spare = {level: _OTHERS[i % len(_OTHERS)] for i, level in enumerate(others)}
    return {level: _NAMED.get(level) or spare[level] for level in levels}


def noise_key(levels: Mapping[float, str]) -> list[tuple[str, str, str]]:
    """Name, colour and sign of each noise level, for a page's legend."""
    styles = noise_styles(levels)
    return [(name, styles[level].colour, styles[level].sign) for level, name in levels.items()]


def number(value: float, places: int) -> str:
    """A number with a proper minus sign, and none on a zero."""
    return f"{value:z.{places}f}".replace("-", "−")


def styled() -> AbstractContextManager[None]:
    """The context in which figures are drawn and saved."""
    return matplotlib.rc_context(_RC)


def new_figure(
    width: float, height: float, *, layout: Literal["constrained"] | None = None, dpi: float | None = None
) -> Figure:
    """A figure of so many inches without global state."""
    figure = Figure(figsize=(width, height), layout=layout, dpi=dpi)
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, folder: Path | None, name: str, *, dpi: int = 200) -> str:
    """Write NAME.png and NAME.svg into a folder, if given; returns the SVG's text.

    The same figure gives the same bytes: no date, fixed ids. Each file replaces an earlier one only when it
    is complete.
    """
    buffer = io.StringIO()
    if folder is not None:  # figures can be drawn again: the disk is not waited for
        with written_together(folder), atomic_path(folder / f"{name}.png") as new:
            figure.savefig(new, dpi=dpi, metadata={"Software": None}, pil_kwargs={"compress_level": 4})
    figure.savefig(buffer, format="svg", dpi=dpi, metadata={"Date": None, "Creator": "realitygap"})
    svg = buffer.getvalue()
    if folder is not None:
        with written_together(folder):
            atomic_write(folder / f"{name}.svg", svg)
    return svg


_FONT = re.compile(r"'DejaVu Sans'(, [^;\"]*)?(?=[;\"])")
PHONE_PX = 350
"""A wider figure may scroll sideways on a phone, and its caption says so."""
_HEAD = re.compile(r"^.*?(?=<svg)", re.DOTALL)
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)


def inline_svg(svg: str, name: str, alt: str) -> str:
    """An SVG for a page: unique ids, the page's colours, a text alternative."""
    svg = _METADATA.sub("", _HEAD.sub("", svg, count=1))
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r"url\(#", f"url(#{name}-", svg)
    svg = re.sub(r'href="#', f'href="#{name}-', svg)
    for colour, variable in _VARIABLES.items():
        svg = svg.replace(f": {colour}", f": var(--{variable}, {colour})")
    svg = _FONT.sub("var(--sans, sans-serif)", svg)
    head, rest = svg.split(">", 1)
    viewbox = re.search(r'viewBox="[^"]*"', head)
    width = re.search(r'width="([\d.]+)pt"', head)
    box = viewbox.group(0) if viewbox else ""
    size = f"{float(width.group(1)) / 0.75:.0f}" if width else "600"
    label = alt.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    kind = "figure broad" if float(size) > PHONE_PX else "figure"
    return (
        f'<svg class="{kind}" role="img" aria-label="{label}" {box} style="--w:{size}px" '
        f'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">{rest}'
    )
