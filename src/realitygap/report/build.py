"""The page of a study: `index.html`, every figure as PNG and SVG, every table as CSV.

Here are its figures and numbers; its words are in the templates.
"""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup

from realitygap.control.encoding import Variation
from realitygap.experiments.reproduction import again
from realitygap.report.calibration import TITLES, calibrated_part
from realitygap.report.drawing import (
    Scene,
    arena_figure,
    panels_figure,
    robot_figure,
    sheet_figure,
    shown_sensors,
)
from realitygap.report.evolution import (
    PER_CONDITION,
    Curves,
    Mean,
    NoiseClass,
    Paths,
    TaskPart,
    best_so_far,
    chosen,
    curves_figure,
    difference,
    ends_of_paths,
    individual,
    mean_of,
    parts_of,
    table_csv,
)
from realitygap.report.network import network_figure, read_wiring
from realitygap.report.page import Figures, OnProgress, Picture, report_folder, write_page
from realitygap.report.player import player_data, player_json
from realitygap.report.scores import SCORES, ScoreTable, score_tables, scores_csv
from realitygap.report.style import noise_key, number
from realitygap.report.transfers import Group, Pair, Situated, pairs_of, situated_of, transfers_csv
from realitygap.study.config import Encoding, Evolution
from realitygap.study.load import Run, Study, load_study
from realitygap.tasks import load_task
from realitygap.transfer.scores import ScoreRow, marks_of
from realitygap.world.robot import NOISE_LEVELS, Profile, load_profile

__all__ = ["build_report", "figures_of"]

PAPER = {
    "obstacle-avoidance": ("Figure 1", "Figure 4", "Figure 3", "Table 1"),
    "light-seeking": ("Figure 2", "Figure 6", "Figure 5", "Table 2"),
}
"""The paper's names of each task's arena, curves, paths and table."""
KHEPERAS = ("paper", "khepera", "enki-khepera")
"""Shipped profiles of the paper's robot; the others are other robots'."""


def build_report(study_path: str | PathLike[str], *, on_progress: OnProgress | None = None) -> Path:
    """Write a study's report into its folder `report/`, and return the page's path.

    Args:
        study_path: the study's folder; it may be unfinished.
        on_progress: called with figures done, figures in all, and the name of the next one.

    Raises:
        StudyError: the folder holds no study that can be read.
        OSError: the report cannot be written.
    """
    study = load_study(study_path)
    maker = Sections(study, report_folder(study.folder))
    sections = [maker.section(part) for part in maker.parts]
    data = player_data(study, maker.parts, maker.pairs, maker.paths)
    settings = study.folder / "study.toml"
    facts = {
        "robot": maker.robot, "sections": sections, "calibrated": calibrated_part(study, maker.figures),
        "stand_ins": sorted({kind for s in sections if s["situated"] for kind in s["situated"].kinds}),
        "paper": is_paper(study, maker.parts), "key": noise_key(maker.levels), "config": study.config,
        "profile": study.profile, "titles": TITLES, "total": len(study.runs), "again": again(study),
        "finished": sum(run.finished for run in study.runs), "per_condition": PER_CONDITION,
        "evaluations": sum(run.evaluations for run in study.runs), "mean_of": mean_of,
        "settings": settings.read_text("utf-8") if settings.is_file() else "",
        "versions": {name: ", then ".join(found) for name, found in study.versions().items()},
        "player": Markup("" if data is None else player_json(data)),
    }  # fmt: skip
    page = maker.folder / "index.html"
    return write_page(page, "page.html.j2", maker.figures, facts, on_progress, tables=maker.tables)


def figures_of(study: Study) -> Figures:
    """All figures of a study's page by name, not yet drawn."""
    with tempfile.TemporaryDirectory(prefix="realitygap-") as folder:  # for links to films
        maker = Sections(study, Path(folder))
        for part in maker.parts:
            maker.section(part)
        calibrated_part(study, maker.figures)
        return maker.figures


def is_paper(study: Study, parts: Sequence[TaskPart]) -> bool:
    """Whether this is the paper's study: its tasks, noise levels, robot, networks, genetic algorithm."""
    tasks = {part.task.name: part.task for part in parts}
    config, levels = study.config, sorted(NOISE_LEVELS.values())
    usual = (config.evolution, config.encoding, config.variation) == (Evolution(), Encoding(), Variation())
    return (
        set(tasks) == set(PAPER)
        and all(task.source is None and task.arena == load_task(name).arena for name, task in tasks.items())
        and all([c.level for c in part.conditions] == levels for part in parts)
        and usual
        and _is_khepera(study.profile)
    )


def _is_khepera(profile: Profile) -> bool:
    """Whether its constants are a Khepera's: shipped, or fitted to recordings starting from such."""
    if profile.name in KHEPERAS:
        return profile == load_profile(profile.name)
    return bool(profile.provenance.fits) and profile.provenance.base in KHEPERAS


class Card(NamedTuple):
    """A network on the page: its figure and facts, and whether its run is in the figure of paths."""

    figure: Picture
    title: str
    champion: bool
    links: int
    hidden: int
    shown: bool


@dataclass(frozen=True)
class Sections:
    """Makes the tasks' sections: pictures go to `figures`, CSV texts to `tables`."""

    study: Study
    folder: Path
    figures: Figures = field(default_factory=Figures)
    tables: dict[str, str] = field(default_factory=dict)

    @cached_property
    def parts(self) -> list[TaskPart]:
        return parts_of(self.study)

    @cached_property
    def pairs(self) -> Mapping[str, Sequence[Pair]]:
        return pairs_of(self.study, self.parts)

    @cached_property
    def paths(self) -> Paths:
        return Paths(self.study)

    @cached_property
    def marks(self) -> Sequence[ScoreRow]:
        return marks_of(self.study)

    @cached_property
    def levels(self) -> dict[float, str]:
        """All noise levels of the page: each has one look in all of its figures."""
        return dict(sorted({c.level: c.name for part in self.parts for c in part.conditions}.items()))

    @cached_property
    def robot(self) -> Picture:
        count = sum(1 for _ in shown_sensors(self.study.profile.to_kernel()))
        alt = (
            f"The robot from above, to scale: {count} sensors with their numbers and directions, two wheels."
        )
        return self.figures.add("robot", partial(robot_figure, self.study.profile), alt)

    def section(self, part: TaskPart) -> dict[str, Any]:
        """A task's values for the page."""
        task = part.task
        usual = ("Arena", "Curves", "Paths", "")
        labels = PAPER.get(task.name, usual) if task.source is None else usual
        assert self.robot  # the first figure
        scores = score_tables(task, [one.level for one in part.conditions], self.marks)
        self.tables[task.name] = table_csv(part)
        self.tables[f"{task.name}-scores"] = scores_csv(scores)
        start = task.to_kernel(self.study.profile).start
        draw = partial(arena_figure, task.arena, self.study.profile, task.feeds, start)
        alt = "The arena to scale, with a robot and its sensors' rays."
        arena = self.figures.add(f"{task.name}-arena", draw, alt, labels[0])
        situated = self._situated(part, labels[2])
        whole = situated is not None and situated.stands_for(part)
        return {
            "task": task, "arena": arena, "table": part, "scores": scores, "score_label": labels[3],
            "curves": self._curves(part, labels[1]),
            "differences": differences(part, scores, situated.groups if situated else ()),
            "paths": None if whole else self._chosen_paths(part, "" if situated else labels[2]),
            "situated": situated, "sheet": self._sheet(part), "networks": self._networks(part),
        }  # fmt: skip

    def _situated(self, part: TaskPart, label: str) -> Situated | None:
        pairs = self.pairs[part.task.name]
        if not pairs:
            return None
        made = situated_of(part, pairs, self._scene(part), label, self.figures, self.folder)
        self.tables[f"{part.task.name}-transfers"] = transfers_csv(part.task, made.groups, self.study.folder)
        return made

    def _scene(self, part: TaskPart) -> Scene:
        return Scene.of(part.task, self.study.profile)._replace(levels=tuple(self.levels))

    def _curves(self, part: TaskPart, label: str) -> Picture | None:
        runs = best_so_far(self.study, part)
        if not runs:
            return None
        means = {c.level: c.mean("fittest", c.level) for c in part.conditions}
        fresh = {level: mean.value for level, mean in means.items() if mean is not None}
        task, names = part.task, dict.fromkeys(self.levels, "") | part.names
        curves = Curves(runs=runs, names=names, fresh=fresh, scale=task.fitness_scale, unit=task.fitness_unit)
        ends = ", ".join(
            f"{part.names[level]} {part.text(float(sum(run[-1] for run in every) / len(every)))}"
            for level, every in runs.items()
        )
        alt = f"Fitness of the fittest against evaluations. At the end: {ends}."
        return self.figures.add(f"{task.name}-curves", partial(curves_figure, curves), alt, label)

    def _chosen_paths(self, part: TaskPart, label: str) -> Picture | None:
        panels = [
            self.paths.panel(part, condition, row, f"{condition.name} noise, #{row.run.index}: {{score}}")
            for condition in part.conditions
            if (row := chosen(condition)) is not None
        ]
        if not panels:
            return None
        draw = partial(panels_figure, self._scene(part), panels)
        alt = f"Paths. {ends_of_paths(part.names, [panels])}."
        return self.figures.add(f"{part.task.name}-paths", draw, alt, label)

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
        draw = partial(sheet_figure, self._scene(part), rows)
        alt = f"Paths of {sum(map(len, rows))} runs. {ends_of_paths(part.names, rows)}."
        return self.figures.add(f"{part.task.name}-all-paths", draw, alt)

    def _networks(self, part: TaskPart) -> list[Card]:
        cards = []
        for condition in part.conditions:
            shown = chosen(condition)
            rows = list(condition.begun[:PER_CONDITION])
            if shown is not None and shown not in rows:
                rows.append(shown)
            cards += [self._network(part, condition, row.run, row is shown) for row in rows]
        return cards

    def _network(self, part: TaskPart, condition: NoiseClass, run: Run, shown: bool) -> Card:
        genotype, task = individual(run), part.task
        title, wiring = f"{condition.name} noise, #{run.index}", read_wiring(genotype)
        working = [link for link in wiring.links if wiring.works(link)]
        listed = (f"{k.source} to {k.target} weight {k.weight} delay {k.delay}" for k in working)
        draw = partial(
            network_figure, genotype, self.study.profile, title=title, feeds=task.feeds, sensors=task.sensors
        )
        name = f"{task.name}-network-{condition.name}-{run.index}"
        figure = self.figures.add(name, draw, f"Network of {title}: {'; '.join(listed)}.")
        hidden = sum(h in wiring.useful for h in wiring.hidden)
        return Card(figure, title, run.finished, len(working), hidden, shown)


def differences(
    part: TaskPart, scores: Sequence[ScoreTable], groups: Sequence[Group]
) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """A table of what the runs tell apart: heads, and a row of differences for each noise level.

    Each is a mean over runs ± its 95 % interval, with a star where that excludes zero. Levels are compared
    with the observed one (else the lowest): tested at the same noise, by Welch's interval.
    """
    level = 1.0 if 1.0 in part.levels else min(part.levels, default=1.0)
    usual = next((c for c in part.conditions if c.level == 1.0), part.conditions[0])
    beside = f"less {usual.name} noise’s"
    heads = ["stored less fresh", "champion less fittest", f"at {part.levels.get(level, '')} noise, {beside}"]
    rows: list[tuple[str, list[str]]] = []
    for c in part.conditions:
        both = [(row.stored, row.mean("fittest", c.level), row.mean("champion", c.level)) for row in c.rows]
        luck = mean_of([stored - fresh.value for stored, fresh, _ in both if stored is not None and fresh])
        gain = mean_of([champion.value - fresh.value for _, fresh, champion in both if fresh and champion])
        other = None if c is usual else difference(c.means("fittest", level), usual.means("fittest", level))
        rows.append((c.name, [_starred(mean, part) for mean in (luck, gain, other)]))
    for table in scores:
        ours = next(one for one in table.classes if one.level == usual.level)
        for of in SCORES if table is scores[0] else SCORES[1:]:
            if len(table.classes) < 2 or not ours.values(of):
                continue
            where = f" on the {table.kind}" if of == "correspondence" else ""
            heads.append(f"{of} score{where}, {beside}")
            for (_, cells), one in zip(rows, table.classes, strict=True):
                cells.append(_starred(None if one is ours else difference(one.values(of), ours.values(of))))
    for kind in dict.fromkeys(group.kind for group in groups):
        drops = {group.level: group.mean("drop") for group in groups if group.kind == kind}
        heads.append(f"simulated less situated, {kind}")
        for (_, cells), c in zip(rows, part.conditions, strict=True):
            cells.append(_starred(drops.get(c.level), part))
    return heads, [row for row in rows if any(cell != "–" for cell in row[1])]


def _starred(mean: Mean | None, part: TaskPart | None = None) -> str:
    """A difference as displayed, in a task's unit or as a score: "0.12 ± 0.05 *"."""
    if mean is None:
        return "–"
    value, half = part.show(mean) if part else (number(mean.value, 1), f"± {number(mean.half, 1)}")
    return " ".join(one for one in (value, half, mean.star) if one and "nan" not in one)
