"""A task's section of a study's page: its figures, its tables, its sentences."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from realitygap.report import words
from realitygap.report.arenas import arena_figure
from realitygap.report.curves import Curves, curves_figure
from realitygap.report.gather import PER_CONDITION, Paths, best_so_far, chosen, individual, path_of
from realitygap.report.network import network_figure
from realitygap.report.page import Figures, Picture
from realitygap.report.paths import Scene, panels_figure, sheet_figure
from realitygap.report.reading import read_scores, read_table
from realitygap.report.scores import score_tables, scores_csv
from realitygap.report.situated import SituatedPart, make_situated
from realitygap.report.statistics import mean_of
from realitygap.report.tables import NoiseClass, TaskPart, table_csv
from realitygap.report.transfers import Pair, transfers_csv
from realitygap.study.load import Run, Study
from realitygap.transfer.scores import ScoreRow

__all__ = ["Sections"]

PAPER = {
    "obstacle-avoidance": ("Figure 1", "Figure 4", "Figure 3", "Table 1"),
    "light-seeking": ("Figure 2", "Figure 6", "Figure 5", "Table 2"),
}
"""The paper's names of each task's arena, curves, paths and table."""


@dataclass(frozen=True, kw_only=True)
class Sections:
    """Makes the tasks' sections: pictures go to `figures`, CSV texts to `tables`."""

    study: Study
    folder: Path
    figures: Figures
    tables: dict[str, str]
    pairs: Mapping[str, Sequence[Pair]]
    marks: Sequence[ScoreRow]

    @cached_property
    def paths(self) -> Paths:
        return Paths(self.study)

    def section(self, part: TaskPart) -> dict[str, Any]:
        """A task's values for the page; `networks` with whether each is of a run in the figure of paths."""
        task = part.task
        usual = ("Arena", "Curves", "Paths", "")
        labels = PAPER.get(task.name, usual) if task.source is None else usual
        scores = score_tables(task, [one.level for one in part.conditions], self.marks)
        self.tables[task.name] = table_csv(part)
        self.tables[f"{task.name}-scores"] = scores_csv(scores)
        start = task.to_kernel(self.study.profile).start
        draw = partial(arena_figure, task.arena, self.study.profile, task.feeds, start)
        arena = self.figures.add(f"{task.name}-arena", draw, words.arena_words(part), labels[0])
        situated = self._situated(part, labels[2])
        whole = situated is not None and situated.stands_for(part)
        read = [*(said for one in scores for said in read_scores(one)), *read_table(part)]
        return {
            "task": task, "arena": arena, "table": part, "scores": scores, "score_label": labels[3],
            "sentences": [*read, *(situated.sentences if situated else ())],
            "curves": self._curves(part, labels[1]),
            "paths": None if whole else self._chosen_paths(part, "" if situated else labels[2]),
            "situated": situated, "sheet": self._sheet(part), "networks": self._networks(part),
        }  # fmt: skip

    def _situated(self, part: TaskPart, label: str) -> SituatedPart | None:
        pairs = self.pairs[part.task.name]
        if not pairs:
            return None
        made = make_situated(part, pairs, self._scene(part), label, self.figures, self.folder)
        self.tables[f"{part.task.name}-transfers"] = transfers_csv(part.task, made.groups, self.study.folder)
        return made

    def _scene(self, part: TaskPart) -> Scene:
        return Scene.of(part.task, self.study.profile)._replace(levels=self._levels)

    @property
    def _levels(self) -> tuple[float, ...]:
        """All noise levels of the page: each has one look in all of its figures."""
        return tuple(sorted({run.noise for run in self.study.runs}))

    def _curves(self, part: TaskPart, label: str) -> Picture | None:
        runs = best_so_far(self.study, part)
        if not runs:
            return None
        means = {c.level: mean_of(c.means("fittest", c.level)) for c in part.conditions}
        fresh = {level: mean.value for level, mean in means.items() if mean is not None}
        task, told = part.task, words.curve_words(part, runs, bool(fresh))
        names = dict.fromkeys(self._levels, "") | part.names
        curves = Curves(runs=runs, names=names, fresh=fresh, scale=task.fitness_scale, unit=task.fitness_unit)
        return self.figures.add(f"{task.name}-curves", partial(curves_figure, curves), told, label)

    def _chosen_paths(self, part: TaskPart, label: str) -> Picture | None:
        panels = []
        for condition in part.conditions:
            row = chosen(condition)
            if row is not None:
                title = f"{condition.name} noise, #{row.run.index}: {{score}}"
                panels.append(self.paths.panel(part, condition, row, title))
        if not panels:
            return None
        told = words.path_words(part, path_of(part.names, [panels]))
        draw = partial(panels_figure, self._scene(part), panels)
        return self.figures.add(f"{part.task.name}-paths", draw, told, label)

    def _sheet(self, part: TaskPart) -> Picture | None:
        rows = [
            [
                self.paths.panel(part, c, row, f"{c.name} #{row.run.index}: {{score}}")
                for row in c.begun[:PER_CONDITION]
            ]
            for c in part.conditions
            if c.begun
        ]
        if sum(len(row) for row in rows) < 2:
            return None
        told = words.sheet_words(part, path_of(part.names, rows))
        draw = partial(sheet_figure, self._scene(part), rows)
        return self.figures.add(f"{part.task.name}-all-paths", draw, told)

    def _networks(self, part: TaskPart) -> list[tuple[Picture, bool]]:
        cards = []
        for condition in part.conditions:
            shown = chosen(condition)
            rows = list(condition.begun[:PER_CONDITION])
            if shown is not None and shown not in rows:
                rows.append(shown)
            cards += [(self._network(part, condition, row.run), row is shown) for row in rows]
        return cards

    def _network(self, part: TaskPart, condition: NoiseClass, run: Run) -> Picture:
        genotype, task = individual(run), part.task
        title = f"{condition.name} noise, #{run.index}"
        told = words.network_words(genotype, title, champion=run.finished)
        draw = partial(
            network_figure, genotype, self.study.profile, title=title, feeds=task.feeds, sensors=task.sensors
        )
        return self.figures.add(f"{task.name}-network-{condition.name}-{run.index}", draw, told)
