"""The page of a study of noise: one self-contained file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from realitygap.experiments.noise.claims import RESAMPLES, VERDICTS
from realitygap.report.noise.facts import BOTH
from realitygap.report.noise.figures import titled
from realitygap.report.noise.words import LIMITS
from realitygap.report.page import GLYPHS, Card
from realitygap.report.style import inline_svg, noise_styles
from realitygap.world.noise import noise_name

if TYPE_CHECKING:
    from realitygap.report.noise.report import NoiseReport

__all__ = ["captions", "render"]


def captions(report: NoiseReport) -> dict[str, str]:
    """What stands under each figure."""
    data = report.facts.data
    runs = len(data) // (len(data.tasks) * len(data.levels))
    sets = "Filled dots, left of their level: odd seed sets; hollow, right: even. " * (len(data.sets) > 1)
    dots = f"{sets}Bars: 95 % intervals, bootstrap over runs. Dotted line: the robot's level, {data.robot:g}."
    return {
        "noise-map": (
            f"Mean correspondence score of {runs} controllers a cell, evolved at a level (rows) and compared "
            "with the simulation at a level (columns). Framed: the paper's diagonal; bold: the robot's "
            "level; the darker, the higher."
        ),
        "noise-claims": (
            "Correspondence score by level. (a): a dot a controller at each level of comparison; (b) and "
            f"(c): a dot a run, {runs} a level and task. {dots} Stars: the paper's averages at zero, "
            "observed and double noise, five runs each, marked by eye."
        ),
        "noise-fitness": (
            "Fitness over the same starts in simulation, at the level evolved under, and on the twin "
            f"(dots), and the difference; {runs} runs a level. {dots}"
        ),
        "noise-noisiness": (
            "How much noisier the twin's turning is than that of the simulation at each level, a dot a "
            f"controller: above 0 the twin is noisier. {dots}"
        ),
    }


def render(report: NoiseReport, svgs: Mapping[str, str]) -> str:
    """The page as HTML text; `svgs` by the figures' names."""
    from jinja2 import Environment, FileSystemLoader
    from markupsafe import Markup

    folder = Path(__file__).parent.parent / "templates"
    environment = Environment(
        loader=FileSystemLoader(folder), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["svg"] = lambda text: Markup(text)
    facts, told = report.facts, captions(report)
    styles = noise_styles(facts.data.levels.tolist())
    cards = {
        name: Card(name=name, svg=inline_svg(svg, name, _alt(report, name, told[name])), caption=told[name])
        for name, svg in svgs.items()
    }
    html: str = environment.get_template("noise.html.j2").render(
        report=report,
        facts=facts,
        settings=report.results.settings,
        both=BOTH,
        cards=cards,
        key=[(_level(lv), styles[lv].colour, GLYPHS[styles[lv].marker]) for lv in facts.data.levels.tolist()],
        limits=LIMITS,
        resamples=RESAMPLES,
        tables=report.tables,
        text=(report.results.folder / "study.toml").read_text("utf-8"),
        titled=titled,
        verdicts=VERDICTS,
    )
    return html


def _level(level: float) -> str:
    name = noise_name(level)
    return name if name == f"{level:g}" else f"{name} ({level:g})"


def _alt(report: NoiseReport, name: str, caption: str) -> str:
    """A figure for those who cannot see it: its caption, and where the figures stand."""
    curves = report.facts.headline.curves
    levels = report.facts.data.levels
    if name == "noise-claims":
        said = "; ".join(
            f"({key}) " + ", ".join(f"{m:.1f} at {lv:g}" for lv, m in zip(levels, curve.means, strict=True))
            for key, curve in curves.items()
        )
        return f"{caption} Means of {report.facts.headline.name}: {said}."
    return f"{caption} The tables below have the figures."
