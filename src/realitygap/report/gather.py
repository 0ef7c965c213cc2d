"""Collects a report's data from a study: conditions, curves, tables, chosen runs, their paths."""

from collections.abc import Mapping, Sequence

import numpy as np

from realitygap.control.genotype import Genotype
from realitygap.kernels.rng import substream
from realitygap.report.paths import PathPanel
from realitygap.report.statistics import mean_of, running_best
from realitygap.report.tables import NoiseClass, Row, TaskPart
from realitygap.simulation.simulation import Simulation
from realitygap.streams import PICTURES
from realitygap.study.load import Run, Study
from realitygap.tasks.task import Task
from realitygap.transfer.spec import median_run
from realitygap.world.robot import NOISE_LEVELS, noise_level, noise_name

__all__ = ["PER_CONDITION", "Paths", "best_so_far", "chosen", "individual", "parts_of", "path_of"]

PER_CONDITION = 5
"""Runs of a condition whose paths, networks and table rows a page shows at most."""


def parts_of(study: Study) -> list[TaskPart]:
    """The study's runs by task and by noise level, tasks in the study's order, levels rising."""
    groups: dict[str, dict[float, list[Row]]] = {}
    for run in study.runs:
        groups.setdefault(run.task, {}).setdefault(noise_level(run.noise), []).append(_row(run))
    return [_part(study.task(name), levels) for name, levels in groups.items()]


def _part(task: Task, groups: dict[float, list[Row]]) -> TaskPart:
    """One task's runs as its table holds them."""
    classes = tuple(
        NoiseClass(level=level, name=noise_name(level), rows=tuple(rows))
        for level, rows in sorted(groups.items())
    )
    tested = {level for rows in groups.values() for row in rows for _, level in row.means}
    levels = {level: noise_name(level) for level in sorted(tested or NOISE_LEVELS.values())}
    return TaskPart(task=task, conditions=classes, levels=levels)


def _row(run: Run) -> Row:
    means = {(who, noise_level(noise)): mean_of(scores) for (who, noise), scores in run.tests.items()}
    return Row(run=run, means={key: mean for key, mean in means.items() if mean is not None})


def individual(run: Run) -> Genotype:
    """The genotype shown for a run: its champion's, or its fittest's so far."""
    genes = run.fittest if run.champion is None else run.champion
    assert genes is not None  # the run has begun
    return run.study.slots(run.task, genes)


def best_so_far(study: Study, part: TaskPart) -> dict[float, list[np.ndarray]]:
    """For each noise level the running best fitness of each run, read one run at a time."""
    return {
        one.level: [running_best(study.evaluations(row.run.id)["fitness"]) for row in one.begun]
        for one in part.conditions
        if one.begun
    }


def chosen(condition: NoiseClass) -> Row | None:
    """The run shown in a figure: the condition's median one."""
    run = median_run(row.run for row in condition.begun)
    return next((row for row in condition.begun if row.run is run), None)


class Paths:
    """Simulates a study's individuals again, all of a task from the same start."""

    def __init__(self, study: Study) -> None:
        self._study = study
        self._stream = int(substream(np.uint64(study.config.seed), np.uint64(PICTURES)))
        self._simulations: dict[tuple[str, float], Simulation] = {}

    def panel(self, part: TaskPart, condition: NoiseClass, row: Row, title: str) -> PathPanel:
        """One trial of a run's champion at the noise it evolved under.

        Args:
            part: the task.
            condition: the noise it evolved under.
            row: the run.
            title: may contain {score}.
        """
        task = part.task
        key = (task.name, condition.level)
        if key not in self._simulations:
            self._simulations[key] = Simulation(task, self._study.profile, condition.level)
        networks = individual(row.run).networks()
        trajectory, score = self._simulations[key].trajectory(networks, stream=self._stream)
        shown = f"{score / task.fitness_scale:.2f}"
        return PathPanel(noise=condition.level, title=title.format(score=shown), trajectory=trajectory)


def path_of(names: Mapping[float, str], rows: Sequence[Sequence[PathPanel]]) -> str:
    """Text alternative of a picture of paths."""
    paths = ((names[panel.noise], panel.trajectory) for row in rows for panel in row)
    return "; ".join(
        f"{name}: from ({path.x[0]:.0f}, {path.y[0]:.0f}) to ({path.end.x:.0f}, {path.end.y:.0f}) cm"
        for name, path in paths
    )
