"""The page a person looks at: its words, and the template that they go into."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from realitygap.experiments.reproduction import again
from realitygap.report.gather import PER_CONDITION, TaskPart
from realitygap.report.lead import departures, is_paper, lead
from realitygap.report.statistics import mean_of
from realitygap.report.style import noise_styles
from realitygap.report.tables import WHO, NoiseClass, Table

if TYPE_CHECKING:
    from realitygap.report.calibrated import CalibratedPart
    from realitygap.report.scores import ScoreTable
    from realitygap.report.situated import SituatedPart

__all__ = ["Card", "Section", "render"]

GLYPHS = {"o": "●", "s": "■", "^": "▲", "D": "◆", "v": "▼", "P": "✚", "X": "✖"}


@dataclass(frozen=True, kw_only=True)
class Card:
    """A figure on the page; its files are figures/NAME.png and .svg."""

    name: str
    svg: str
    caption: str
    label: str = ""


@dataclass(frozen=True, kw_only=True)
class Section:
    """One task's part of the page."""

    task: Any
    arena: Card
    curves: Card | None
    paths: Card | None
    situated: SituatedPart | None
    sheet: Card | None
    table: Table
    scores: list[ScoreTable]
    score_label: str
    few: Card | None
    few_sentences: list[str]
    sentences: list[str]
    networks: list[tuple[Card, bool]]


def _rows(one: NoiseClass, table: Table) -> list[dict[str, Any]]:
    """A noise class's rows for the template: few enough to read, then the average."""
    rows = [
        {
            "head": f"{row.index}",
            "stored": table.show(row.stored),
            "average": False,
            "finished": row.finished,
            "cells": [
                (table.show(row.mean(who, level)), level == one.level)
                for who in WHO
                for level in table.levels
            ],
        }
        for row in one.rows[: 2 * PER_CONDITION]
    ]
    rows.append(
        {
            "head": "average",
            "stored": table.show(mean_of(one.stored())),
            "average": True,
            "finished": True,
            "cells": [
                (table.show(mean_of(one.means(who, level))), level == one.level)
                for who in WHO
                for level in table.levels
            ],
        }
    )
    return rows


def render(
    study: Any,
    parts: Sequence[TaskPart],
    robot: Card,
    sections: Sequence[Section],
    calibrated: CalibratedPart | None = None,
    player: str = "",
) -> str:
    """The page as one self-contained HTML text; `player` is what its player knows, as JSON."""
    from jinja2 import Environment, FileSystemLoader
    from markupsafe import Markup

    folder = Path(__file__).parent / "templates"
    environment = Environment(
        loader=FileSystemLoader(folder), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["svg"] = lambda text: Markup(text)
    levels = sorted({c.level: c.name for part in parts for c in part.conditions}.items())
    styles = noise_styles(level for level, _ in levels)
    runs = list(study.runs)
    html = environment.get_template("page.html.j2").render(
        study=study,
        config=study.config,
        robot=robot,
        player=Markup(player),
        scripts=Markup(_scripts()),
        sections=sections,
        calibrated=calibrated,
        rows=_rows,
        per_condition=2 * PER_CONDITION,
        sheet_runs=PER_CONDITION,
        key=[(name, styles[level].colour, GLYPHS[styles[level].marker]) for level, name in levels],
        total=len(runs),
        finished=sum(bool(run.finished) for run in runs),
        paper=is_paper(study, parts),
        lead=lead(study, parts),
        departures=departures(study.profile),
        changes=", ".join(f"{key} = {value}" for key, value in study.config.task.to_dict().items()),
        again=again(study),
        stand_in=_stand_in(sections),
        evaluations=sum(int(run.evaluations) for run in runs),
        settings=_settings(study),
        versions={name: ", then ".join(found) for name, found in study.versions().items()},
    )
    return re.sub(r"\n\s*\n+", "\n", html)


def _scripts() -> str:
    """The page's own scripts in one scope, in the order of their names."""
    files = sorted((Path(__file__).parent / "assets").glob("*.js"))
    text = "\n".join(file.read_text("utf-8") for file in files)
    return f'"use strict";\n(() => {{\n{text}}})();'


def _stand_in(sections: Sequence[Section]) -> str:
    """What the evolved networks were let have besides the simulation: "twin", "robot", "both" or nothing."""
    pairs = [pair for s in sections if s.situated for group in s.situated.groups for pair in group.pairs]
    kinds = {pair.twin for pair in pairs}
    return "both" if len(kinds) > 1 else "" if not kinds else "twin" if True in kinds else "robot"


def _settings(study: Any) -> str:
    """The study's own configuration file as text."""
    path = Path(study.folder) / "study.toml"
    return path.read_text("utf-8") if path.is_file() else ""
