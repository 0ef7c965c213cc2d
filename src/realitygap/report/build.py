"""Make a study's report: `index.html`, every figure as PNG and SVG, every table as CSV."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from realitygap import whole
from realitygap.report import page, words
from realitygap.report.arenas import arena_figure
from realitygap.report.calibrated import calibrated_part
from realitygap.report.curves import curves_figure
from realitygap.report.few_runs import few_figure, few_sentences, few_words, shows_few
from realitygap.report.gather import (
    PER_CONDITION,
    Paths,
    TaskPart,
    best_so_far,
    chosen,
    individual,
    parts_of,
    path_of,
)
from realitygap.report.lead import is_paper
from realitygap.report.network import network_figure
from realitygap.report.page import Card, Section
from realitygap.report.paths import panels_figure, sheet_figure
from realitygap.report.player import player_data, player_json
from realitygap.report.reading import read_table
from realitygap.report.robots import robot_figure
from realitygap.report.scores import ScoreTable, score_tables, write_scores
from realitygap.report.situated import SituatedPart, count_figures, make_situated
from realitygap.report.statistics import mean_of
from realitygap.report.style import inline_svg, save_figure, styled
from realitygap.report.tables import NoiseClass, Row, Table, write_csv
from realitygap.report.transfers import Pair, pairs_of
from realitygap.report.words_scores import read_scores
from realitygap.study.sources import refuse_links
from realitygap.transfer.score_rows import Mark, marks_of

__all__ = ["build_report"]

Progress = Callable[[int, int, str], None]

PAPER = {
    "obstacle-avoidance": ("Figure 1", "Figure 4", "Figure 3", "Table 1"),
    "light-seeking": ("Figure 2", "Figure 6", "Figure 5", "Table 2"),
}
"""What the paper calls each task's arena, curves, paths and table."""


def build_report(study_path: str | PathLike[str], *, on_progress: Progress | None = None) -> Path:
    """Write a study's report into its folder `report/`, and return the page's path.

    Args:
        study_path: the study's folder; it may be unfinished.
        on_progress: called with figures done, figures in all, and the name of the next one.

    Raises:
        StudyError: the folder holds no study that can be read.
        OSError: the report cannot be written.
    """
    from realitygap.study.load import load_study

    study = load_study(study_path)
    folder = study.folder / "report"
    refuse_links(folder)
    for name in ("figures", "tables"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    parts = parts_of(study)
    pairs = pairs_of(study, parts)
    total = 2 + sum(_count(part) + count_figures(pairs[part.task.name]) + 1 for part in parts)
    marks = marks_of(study)
    maker = _Maker(
        folder=folder, study=study, pairs=pairs, marks=marks, tell=on_progress, total=total,
        paper=is_paper(study, parts),
    )  # fmt: skip
    with styled():
        robot = maker.card("robot", lambda: robot_figure(study.profile), **words.robot_words(study.profile))
        sections = [maker.section(part) for part in parts]
        calibrated = calibrated_part(study, maker.card)
    text = page.render(study, parts, robot, sections, calibrated, maker.player(parts))
    target = folder / "index.html"
    whole.write(target, text)
    if on_progress:
        on_progress(maker.total, maker.total, target.name)
    return target


def _count(part: TaskPart) -> int:
    """Figures of one task."""
    return 4 + sum(min(len(c.begun), PER_CONDITION + 1) for c in part.conditions)


@dataclass(kw_only=True)
class _Maker:
    """Makes figures one after the other and keeps count."""

    folder: Path
    study: Any
    pairs: Mapping[str, Sequence[Pair]]
    marks: Sequence[Mark]
    paper: bool
    tell: Progress | None
    total: int
    done: int = 0
    paths: Paths = field(init=False)

    def __post_init__(self) -> None:
        self.paths = Paths(self.study)

    def card(self, name: str, draw: Callable[[], Any], *, alt: str, caption: str, label: str = "") -> Card:
        """Draw a figure, write it down, and make it ready for the page."""
        if self.tell:
            self.tell(self.done, self.total, name)
        svg = save_figure(draw(), self.folder / "figures", name)
        self.done += 1
        return Card(name=name, svg=inline_svg(svg, name, alt), caption=caption, label=label)

    def section(self, part: TaskPart) -> Section:
        """All figures and the table of one task."""
        task = part.task
        labels = (
            PAPER.get(task.name, ("Arena", "Curves", "Paths", ""))
            if task.source is None
            else ("Arena", "Curves", "Paths", "")
        )
        table = part.table
        write_csv(self.folder / "tables" / f"{task.name}.csv", table)
        scores = score_tables(task, [one.level for one in part.conditions], self.marks)
        write_scores(self.folder / "tables" / f"{task.name}-scores.csv", scores)
        arena = self.card(
            f"{task.name}-arena",
            lambda: arena_figure(task, self.study.profile),
            label=labels[0],
            **words.arena_words(part),
        )
        situated = self._situated(part, labels[2])
        whole = situated is not None and situated.stands_for(part)
        few = next((one for one in scores if self.paper and shows_few(one)), None)
        return Section(
            task=task,
            arena=arena,
            table=table,
            scores=scores,
            score_label=labels[3],
            few=None if few is None else self._few(few),
            few_sentences=[] if few is None else few_sentences(few),
            sentences=[
                *(words for one in scores for words in read_scores(one)),
                *read_table(table),
                *(situated.sentences if situated else ()),
            ],
            curves=self._curves(part, table, labels[1]),
            paths=None if whole else self._chosen_paths(part, "" if situated else labels[2]),
            situated=situated,
            sheet=self._sheet(part),
            networks=self._networks(part),
        )

    def _few(self, table: ScoreTable) -> Card:
        told = few_words(table, self.study.config.evaluations)
        return self.card(f"{table.task}-few", lambda: few_figure(table), **told)

    def player(self, parts: Sequence[TaskPart]) -> str:
        """What the page's player knows; nothing where no run has been begun."""
        if self.tell:
            self.tell(self.done, self.total, "player")
        data = player_data(self.study, parts, self.pairs, self.paths)
        self.done += 1
        return "" if data is None else player_json(data)

    def _situated(self, part: TaskPart, label: str) -> SituatedPart | None:
        pairs = self.pairs[part.task.name]
        if not pairs:
            return None
        return make_situated(part, pairs, self.study.profile, label, self.card, self.folder)

    def _curves(self, part: TaskPart, table: Table, label: str) -> Card | None:
        curves = best_so_far(self.study, part)
        if not curves:
            return None
        fresh = {c.level: mean_of(c.means("fittest", c.level)) for c in table.classes}
        marks = {level: mean.value for level, mean in fresh.items() if mean is not None}
        return self.card(
            f"{part.task.name}-curves",
            lambda: curves_figure(
                curves, part.names, scale=part.task.fitness_scale, unit=part.task.fitness_unit, fresh=marks
            ),
            label=label,
            **words.curve_words(part, curves, bool(marks)),
        )

    def _chosen_paths(self, part: TaskPart, label: str) -> Card | None:
        panels = []
        for condition in part.conditions:
            run = chosen(condition)
            if run is not None:
                title = f"{condition.name} noise, #{run.index}: {{score}}"
                panels.append(self.paths.panel(part, condition, run, title))
        if not panels:
            return None
        told = words.path_words(part, path_of(part.names, [panels]))
        draw = lambda: panels_figure(part.task, self.study.profile, panels)  # noqa: E731
        return self.card(f"{part.task.name}-paths", draw, label=label, **told)

    def _sheet(self, part: TaskPart) -> Card | None:
        rows = [
            [
                self.paths.panel(part, c, run, f"{c.name} #{run.index}: {{score}}")
                for run in c.begun[:PER_CONDITION]
            ]
            for c in part.conditions
            if c.begun
        ]
        if sum(len(row) for row in rows) < 2:
            return None
        told = words.sheet_words(part, path_of(part.names, rows))
        return self.card(
            f"{part.task.name}-all-paths", lambda: sheet_figure(part.task, self.study.profile, rows), **told
        )

    def _networks(self, part: TaskPart) -> list[tuple[Card, bool]]:
        """Champions' networks; True marks those of the runs that the paths show."""
        cards = []
        for condition in part.conditions:
            shown = chosen(condition)
            runs = list(condition.begun[:PER_CONDITION])
            if shown is not None and shown not in runs:
                runs.append(shown)
            cards += [(self._network(part, condition, run), run is shown) for run in runs]
        return cards

    def _network(self, part: TaskPart, condition: NoiseClass, row: Row) -> Card:
        genes, task = individual(row), part.task
        title = f"{condition.name} noise, #{row.index}"
        options = {"feeds": task.feeds, "sensors": task.sensors, "inputs": len(task.sensors)}
        told = words.network_words(genes, title, len(task.sensors), champion=row.finished)
        return self.card(
            f"{task.name}-network-{condition.name}-{row.index}",
            lambda: network_figure(genes, self.study.profile, title=title, **options),
            **told,
        )
