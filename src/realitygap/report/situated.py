"""The situated half of a task's section: figures 3 and 5 in pairs, films' last frames, a table, words."""

import base64
import io
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from realitygap.files import atomic_path
from realitygap.report import transfers
from realitygap.report.gather import PER_CONDITION, chosen
from realitygap.report.page import Figures, Picture
from realitygap.report.paths import PathPanel, Scene, pairs_figure, sheet_figure
from realitygap.report.reading import read_transfers
from realitygap.report.style import SIMULATED, SITUATED
from realitygap.report.tables import TaskPart, number
from realitygap.report.transfers import Group, Pair
from realitygap.report.words import about, pair_words, transfer_sheet_words
from realitygap.transfer.spec import WHEELS

__all__ = ["SituatedPart", "make_situated"]

FILM_PX = 720
"""Width of a film's last frame on the page."""
ROWS = 2 * PER_CONDITION
"""Rows of the table shown for each noise level."""


@dataclass(frozen=True, kw_only=True)
class SituatedPart:
    """The part of a task's section on its transfers."""

    about: str
    shown: list[Pair]
    figures: list[Picture]
    sheets: list[Picture]
    films: list[dict[str, object]]
    groups: list[Group]
    sentences: list[str]
    total: int

    def stands_for(self, part: TaskPart) -> bool:
        """Whether its figures show every run that a figure of simulated paths would show."""
        runs = {pair.run for pair in self.shown}
        return all(row is None or row.run.id in runs for row in map(chosen, part.conditions))

    @property
    def counted(self) -> bool:
        """Whether some paths are computed from the wheels."""
        return any(pair.situated_from in WHEELS for group in self.groups for pair in group.pairs)

    @property
    def cut(self) -> bool:
        """Whether some rows are only in the CSV."""
        return any(len(group.pairs) > ROWS for group in self.groups)

    def rows(self, group: Group, table: TaskPart) -> list[dict[str, object]]:
        """A group's rows for the template, then their average."""
        rows: list[dict[str, object]] = [
            {
                "head": f"{p.index}", "where": p.where, "start": p.start, "source": p.situated_from,
                "cells": [table.show(value) for value in (*p.fitness, p.drop)], "average": False,
            }
            for p in group.pairs[:ROWS]
        ]  # fmt: skip
        means = [table.show(group.mean(of)) for of in ("simulated", "situated", "drop")]
        rows.append({"head": "average", "cells": means, "average": True})
        return rows


def make_situated(
    part: TaskPart, pairs: Sequence[Pair], scene: Scene, label: str, listed: Figures, report: Path
) -> SituatedPart:
    """The part of a section on a task's transfers.

    Args:
        part: the task's runs.
        pairs: its transfers, at least one.
        scene: the arena, and the simulated robot.
        label: the paper's name of the figure.
        listed: the page's figures, to which this part's are added.
        report: the report's folder; films are copied into it.
    """
    groups = transfers.groups_of(part, pairs)
    figures, sheets, films, seen = list[Picture](), list[Picture](), list[dict[str, object]](), list[Pair]()
    for robot in transfers.robots_of(pairs):
        here = [pair for pair in pairs if pair.robot == robot]
        shown = [pair for c in part.conditions if (pair := transfers.shown_pair(c, here)) is not None]
        if not shown:
            continue
        name = f"{part.task.name}-{'pairs' if not figures else 'pairs-' + robot}"
        figures.append(_figure(part, shown, scene, name, label, listed))
        seen += shown
        sheets += _sheet(part, here, scene, name, listed)
        films += [film for pair in shown if (film := _film(part, pair, report)) is not None]
    sentences = [read_transfers(part, groups, kind) for kind in transfers.kinds_of(pairs)]
    return SituatedPart(
        about=about(pairs), shown=seen, figures=figures, sheets=sheets, films=films, groups=groups,
        sentences=sentences, total=len(pairs),
    )  # fmt: skip


def _figure(
    part: TaskPart, shown: Sequence[Pair], scene: Scene, name: str, label: str, listed: Figures
) -> Picture:
    """Figure 3 or 5: a column a noise level, simulated above, situated below."""
    heads = [f"{part.names[pair.level]}, #{pair.index}" for pair in shown]
    above = [_panel(part, pair, situated=False, title="simulated: {}") for pair in shown]
    below = [_panel(part, pair, situated=True, title=f"{pair.where}: {{}}") for pair in shown]
    return listed.add(
        name, partial(pairs_figure, scene, heads, [above, below]), pair_words(part, shown), label
    )


def _panel(part: TaskPart, pair: Pair, *, situated: bool, title: str) -> PathPanel:
    score = pair.fitness[situated]
    told = "–" if score != score else number(score / part.task.fitness_scale, 2)
    look = SITUATED if situated else SIMULATED
    return PathPanel(noise=pair.level, title=title.format(told), trajectory=pair.paths[situated], look=look)


def _sheet(part: TaskPart, here: Sequence[Pair], scene: Scene, name: str, listed: Figures) -> list[Picture]:
    """Every transferred run of a robot: two rows a noise level, simulated above situated."""
    rows: list[list[PathPanel | None]] = []
    many = 0
    for condition in part.conditions:
        runs: dict[int, Pair] = {}
        for p in here:
            if p.level == condition.level and p.run not in runs and p.seen:
                runs[p.run] = p
        pairs = [runs[run] for run in sorted(runs)][:PER_CONDITION]
        many += len(pairs)
        if pairs:
            titles = [f"{condition.name} #{p.index}: {{}}" for p in pairs]
            above = zip(pairs, titles, strict=True)
            rows.append([_panel(part, p, situated=False, title=title) for p, title in above])
            rows.append([_panel(part, p, situated=True, title="situated: {}") for p in pairs])
    if many <= len(part.conditions) and len(rows) == 2 * many:
        return []
    told = transfer_sheet_words(many, here[0].where, counted=any(p.situated_from in WHEELS for p in here))
    return [listed.add(f"{name}-all", partial(sheet_figure, scene, rows), told)]


def _film(part: TaskPart, pair: Pair, report: Path) -> dict[str, object] | None:
    """A film's last frame under its track's tail (a data URI) and its link; None without a film.

    It is copied into the report, so that the report's folder is complete without the study's.
    """
    path = pair.folder / "tails.png"
    if not (pair.filmed and path.is_file()):
        return None
    picture, size = _embedded(path)
    film, link = pair.folder / "film.mp4", ""
    if film.is_file():
        link = f"films/{pair.folder.parent.name}-{pair.robot}-{pair.folder.name}.mp4"
        (report / link).parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(report / link) as spare:
            shutil.copyfile(film, spare)
    head = f"{part.names[pair.level]}, #{pair.index}"
    alt = f"Last frame of the film of {head} on {pair.where}, from above, with its tail in white."
    caption = f"{pair.where}, start {pair.start}"
    return {"head": head, "caption": caption, "alt": alt, "picture": picture, "size": size, "link": link}


def _embedded(path: Path) -> tuple[str, tuple[int, int]]:
    """A picture reduced for a page, as a data URI, and its size in px."""
    from PIL import Image

    with Image.open(path) as frame:
        wide = min(FILM_PX, frame.width)
        size = (wide, max(1, round(frame.height * wide / frame.width)))
        small = frame.convert("RGB").resize(size, Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    small.save(buffer, "JPEG", quality=82, optimize=True)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}", size
