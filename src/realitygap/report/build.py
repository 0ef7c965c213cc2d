"""The page of a study: `index.html`, every figure as PNG and SVG, every table as CSV.

Here are its figures and numbers; its words are in the templates.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

from markupsafe import Markup

from realitygap.control.encoding import Variation
from realitygap.experiments.reproduction import again
from realitygap.report.answer import answer_figure, answer_of, caveats, counted
from realitygap.report.calibration import TITLES, calibrated_part
from realitygap.report.drawing import Scene, arena_figure, paths_figure, robot_figure, shown_sensors
from realitygap.report.drive import drive_json, driven_runs
from realitygap.report.evolution import (
    PER_CONDITION,
    NoiseClass,
    Paths,
    Row,
    TaskPart,
    best_so_far,
    curves_figure,
    ends_of_paths,
    individual,
    mean_of,
    parts_of,
    table_csv,
)
from realitygap.report.network import network_figure, read_wiring
from realitygap.report.page import Figures, OnProgress, Picture, report_folder, write_page
from realitygap.report.player import player_data, player_json
from realitygap.report.scores import ScoreTable, score_tables, scores_csv
from realitygap.report.style import noise_key
from realitygap.report.transfers import groups_of, pair_figures, pairs_of, transfers_csv
from realitygap.study.config import Encoding, Evolution
from realitygap.study.load import Study, load_study
from realitygap.tasks import load_task
from realitygap.transfer.scores import marks_of
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
    from realitygap.report.films import film_of  # loads OpenCV and PyAV

    study = load_study(study_path)
    folder, pictures = report_folder(study.folder), StudyPictures(study)
    parts, tables, sections = pictures.parts, dict[str, str](), []
    for part in parts:
        task, groups = part.task, groups_of(part, pictures.pairs[part.task.name])
        section = pictures.of(part)
        scores = section["scores"]
        tables[task.name], tables[f"{task.name}-scores"] = table_csv(part), scores_csv(scores)
        if groups:
            tables[f"{task.name}-transfers"] = transfers_csv(task, groups, study.folder)
        sections.append({
            **section, "task": task, "table": part, "score_label": labels_of(part)[3],
            "groups": groups,
            "kinds": sorted({group.kind.split()[0] for group in groups}),
            "films": [
                film for pair in section["shown"]
                if (film := film_of(pair, task.arena, study.profile, folder)) is not None
            ],
        })  # fmt: skip
    data = player_data(study, parts, pictures.pairs, pictures.paths)
    settings = study.folder / "study.toml"
    driven = [pair for pairs in pictures.pairs.values() for pair in pairs]
    starts = [mark.starts for mark in pictures.marks if mark.correspondence is not None]
    kinds, robots = sorted({pair.kind for pair in driven}), len({pair.robot for pair in driven})
    facts = {
        "sections": sections, "caveats": caveats(kinds, robots, min(starts, default=0)), "counted": counted,
        "kinds": sorted({kind for section in sections for kind in section["kinds"]}),
        "robot": pictures.robot, "calibrated": calibrated_part(study, pictures.figures),
        "paper": is_paper(study, parts), "khepera": is_khepera(study.profile), "config": study.config,
        "profile": study.profile, "titles": TITLES, "total": len(study.runs), "again": again(study),
        "key": noise_key(pictures.levels), "per_condition": PER_CONDITION, "mean_of": mean_of,
        "finished": sum(run.finished for run in study.runs),
        "evaluations": sum(run.evaluations for run in study.runs),
        "settings": settings.read_text("utf-8") if settings.is_file() else "",
        "versions": {name: ", then ".join(found) for name, found in study.versions().items()},
        "player": Markup("" if data is None else player_json(data)),
    }  # fmt: skip
    with ThreadPoolExecutor(1) as beside:  # to compile takes as long as to draw
        live = beside.submit(drive_json, driven_runs(parts, study.profile))
        page, told = folder / "index.html", {**facts, "drive": live}
        return write_page(page, "page.html.j2", pictures.figures, told, on_progress, tables=tables)


def figures_of(study: Study) -> Figures:
    """All figures of a study's page by name, not yet drawn."""
    pictures = StudyPictures(study)
    for part in pictures.parts:
        pictures.of(part)
    calibrated_part(study, pictures.figures)
    return pictures.figures


def is_paper(study: Study, parts: Sequence[TaskPart]) -> bool:
    """Whether this is the paper's study: its tasks, noise levels, robot, networks, genetic algorithm."""
    tasks = {part.task.name: part.task for part in parts}
    config = study.config
    return (
        set(tasks) == set(PAPER)
        and all(task.source is None and task.arena == load_task(name).arena for name, task in tasks.items())
        and all([c.level for c in part.conditions] == sorted(NOISE_LEVELS.values()) for part in parts)
        and (config.evolution, config.encoding, config.variation) == (Evolution(), Encoding(), Variation())
        and is_khepera(study.profile)
    )


def is_khepera(profile: Profile) -> bool:
    """Whether a profile is a shipped one of the paper's robot, or was fitted starting from one."""
    if profile.name in KHEPERAS:
        return profile == load_profile(profile.name)
    return bool(profile.provenance.fits) and profile.provenance.base in KHEPERAS


def labels_of(part: TaskPart) -> tuple[str, str, str, str]:
    """The names of a task's arena, curves, paths and table: the paper's, if the task is its own."""
    usual = ("Arena", "Curves", "Paths", "")
    return PAPER.get(part.task.name, usual) if part.task.source is None else usual


class StudyPictures:
    """Makes the figures of a study's page, not yet drawn, and keeps what several of them show."""

    def __init__(self, study: Study) -> None:
        self.study, self.figures, self.paths = study, Figures(), Paths(study)
        self.parts = parts_of(study)
        self.pairs, self.marks = pairs_of(study, self.parts), marks_of(study)
        self.levels = dict(sorted({c.level: c.name for part in self.parts for c in part.conditions}.items()))
        """All noise levels of the page: each has one look in all of its figures."""
        count = sum(1 for _ in shown_sensors(study.profile.to_kernel()))
        alt = (
            f"The robot from above, to scale: {count} sensors with their numbers and directions, two wheels."
        )
        self.robot = self.figures.add("robot", partial(robot_figure, study.profile), alt)

    def of(self, part: TaskPart) -> dict[str, Any]:
        """A task's figures, by their places in its section (None: there is nothing to show)."""
        task, profile, labels = part.task, self.study.profile, labels_of(part)
        draw = partial(arena_figure, task.arena, profile, task.feeds, task.to_kernel(profile).start)
        alt = "The arena to scale, with a robot and its sensors' rays."
        arena = self.figures.add(f"{task.name}-arena", draw, alt, labels[0])
        scene = Scene.of(task, profile)._replace(levels=tuple(self.levels))
        made = pair_figures(part, self.pairs[task.name], scene, labels[2], self.figures)
        shown = {pair.run for pair in made["shown"]}
        whole = made["pairs"] and all(c.chosen is None or c.chosen.run.id in shown for c in part.conditions)
        label = "" if made["pairs"] else labels[2]
        scores = score_tables(task, [one.level for one in part.conditions], self.marks)
        return {
            **made, **self._answer(part, scores), "scores": scores,
            "arena": arena, "curves": self._curves(part, labels[1]),
            "paths": None if whole else self._chosen_paths(part, scene, label),
            "sheet": self._sheet(part, scene), "networks": self._networks(part),
        }  # fmt: skip

    def _answer(self, part: TaskPart, scores: Sequence[ScoreTable]) -> dict[str, Any]:
        """A task's answer, and its figure."""
        answer, figure = answer_of(part, scores), None
        if answer.means:
            draw = partial(answer_figure, answer, tuple(self.levels))
            alt = f"{answer.what} {answer.where} by noise level: "
            alt += "; ".join(f"{answer.names[level]} {answer.text(level)}" for level in sorted(answer.means))
            figure = self.figures.add(f"{part.task.name}-answer", draw, f"{alt}.")
        return {"answer": answer, "answer_figure": figure}

    def _curves(self, part: TaskPart, label: str) -> Picture | None:
        curves, task = best_so_far(self.study, part), part.task
        if not curves:
            return None
        means = {c.level: c.mean("fittest", c.level) for c in part.conditions}
        tested = {level: mean.value for level, mean in means.items() if mean is not None}
        names = dict.fromkeys(self.levels, "") | part.names
        draw = partial(
            curves_figure, curves, names, tested=tested, scale=task.fitness_scale, unit=task.fitness_unit
        )
        ends = ", ".join(
            f"{part.names[level]} {part.text(float(sum(run[-1] for run in every) / len(every)))}"
            for level, every in curves.items()
        )
        alt = f"Best fitness so far against evaluations. At the end: {ends}."
        return self.figures.add(f"{task.name}-curves", draw, alt, label)

    def _chosen_paths(self, part: TaskPart, scene: Scene, label: str) -> Picture | None:
        chosen = [(c, c.chosen) for c in part.conditions if c.chosen is not None]
        panels = [self.paths.panel(part, c, row, f"{c.name} noise, #{row.run.index}") for c, row in chosen]
        if not panels:
            return None
        alt = f"Paths. {ends_of_paths(part.names, [panels])}."
        draw = partial(paths_figure, scene, [panels])
        return self.figures.add(f"{part.task.name}-paths", draw, alt, label)

    def _sheet(self, part: TaskPart, scene: Scene) -> Picture | None:
        rows = [
            [self.paths.panel(part, c, row, f"{c.name} #{row.run.index}") for row in c.begun[:PER_CONDITION]]
            for c in part.conditions
            if c.begun
        ]
        if sum(map(len, rows)) < 2:
            return None
        alt = f"Paths of {sum(map(len, rows))} runs. {ends_of_paths(part.names, rows)}."
        draw = partial(paths_figure, scene, rows, small=True)
        return self.figures.add(f"{part.task.name}-all-paths", draw, alt)

    def _networks(self, part: TaskPart) -> list[dict[str, Any]]:
        return [self._network(part, c, row) for c in part.conditions for row in c.shown(PER_CONDITION)]

    def _network(self, part: TaskPart, condition: NoiseClass, row: Row) -> dict[str, Any]:
        """A network's figure, with facts for its caption."""
        run, task, genotype = row.run, part.task, individual(row.run)
        title, wiring = f"{condition.name} noise, #{run.index}", read_wiring(genotype)
        working = [link for link in wiring.links if wiring.works(link)]
        listed = (f"{k.source} to {k.target} weight {k.weight} delay {k.delay}" for k in working)
        draw = partial(
            network_figure, genotype, self.study.profile, title=title, feeds=task.feeds, sensors=task.sensors
        )
        name = f"{task.name}-network-{condition.name}-{run.index}"
        figure = self.figures.add(name, draw, f"Network of {title}: {'; '.join(listed)}.")
        hidden = sum(h in wiring.useful for h in wiring.hidden)
        return {
            "figure": figure, "title": title, "champion": run.finished, "links": len(working),
            "hidden": hidden, "shown": row is condition.chosen,
        }  # fmt: skip
