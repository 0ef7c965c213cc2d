"""A study's transfers: the same individual simulated and on a robot (or a twin of one), from the same start.

Figures 3 and 5 show pairs of paths; beside them stand the films' last frames and a table.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.files import to_csv
from realitygap.report.drawing import PathPanel, Scene, paths_figure
from realitygap.report.evolution import PER_CONDITION, WHO, Mean, NoiseClass, TaskPart, mean_of
from realitygap.report.page import Figures, Picture
from realitygap.report.style import SIMULATED, SITUATED, number
from realitygap.robots.address import ROBOT, StandIn
from realitygap.study.load import Study
from realitygap.tasks.task import Task
from realitygap.track import Track
from realitygap.transfer.record import TransferredTrial, load_transfers
from realitygap.transfer.scores import kind_of

__all__ = [
    "Group", "Pair", "groups_of", "pair_figures", "pairs_of", "robots_of", "shown_pair",
    "transfers_csv",
]  # fmt: skip

TAIL_S = 0.1
"""Interval of a tail's strokes, independent of the film's rate: as in the simulation."""

MAKES = {
    "khepera": "Khepera", "serial": "Khepera", "epuck": "e-puck", "epuck2": "e-puck2", "thymio": "Thymio II",
}  # fmt: skip
"""Makes of robots by the prefix of their folders' names; a body of your own is called by its folder."""


@dataclass(frozen=True, kw_only=True)
class Pair(TransferredTrial):
    """One transfer of a run, which is number `index` among those evolved at its noise level."""

    level: float
    index: int

    @cached_property
    def paths(self) -> tuple[Track, Track]:
        """Simulated and on the robot, thinned for drawing tails, without lost poses."""
        return _drawn(self.simulated), _drawn(self.situated)

    @property
    def seen(self) -> bool:
        """Whether anything is known of the robot's path."""
        return bool(self.situated.found.any())

    @property
    def fitness(self) -> tuple[float, float]:
        """Simulated and on the robot, unscaled; NaN if there is none."""
        return self.fitness_simulated, self.fitness_situated

    @property
    def drop(self) -> float:
        """Loss of fitness from simulation to robot."""
        return self.fitness_simulated - self.fitness_situated

    @property
    def kind(self) -> str:
        """What averages are over: all robots, or all units of a kind with the same noise scale."""
        return kind_of(self)

    @property
    def where(self) -> str:
        """The robot in words."""
        if (there := StandIn.of_folder(self.robot)) is not None:
            return there.words
        kind, _, port = self.robot.partition("-")
        return f"{MAKES[kind]} on {port}" if kind in MAKES else f"robot {self.robot}"


@dataclass(frozen=True, kw_only=True)
class Group:
    """The transfers of one noise level's champions (or another individual) on one kind of robot."""

    level: float
    name: str
    kind: str
    individual: str
    pairs: tuple[Pair, ...]

    @property
    def words(self) -> str:
        """Where and, unless champions, who."""
        where = "a robot" if self.kind == ROBOT else f"the {self.kind}"
        who = WHO.get(self.individual, self.individual)
        return where if self.individual == "champion" else f"{where} ({who})"

    def mean(self, of: str) -> Mean | None:
        """Of the runs' "fitness_simulated", "fitness_situated" or "drop", each over its scored transfers."""
        runs: dict[int, list[float]] = {}
        for pair in self.pairs:
            if math.isfinite(pair.drop):
                runs.setdefault(pair.run, []).append(getattr(pair, of))
        return mean_of([float(np.mean(values)) for values in runs.values()])


def pairs_of(study: Study, parts: Sequence[TaskPart]) -> dict[str, list[Pair]]:
    """The study's transfers by task, in the order of its runs, robots and starts."""
    runs = {row.run.id: (c.level, row.run.index) for part in parts for c in part.conditions for row in c.rows}
    pairs = []
    for one in load_transfers(study.folder):
        if one.run in runs:
            level, index = runs[one.run]
            known = {field.name: getattr(one, field.name) for field in fields(one)}
            pairs.append(Pair(**known, level=level, index=index))
    pairs.sort(key=lambda p: (p.run, p.kind != ROBOT, len(p.robot), p.robot, p.individual, p.start))
    return {part.task.name: [p for p in pairs if p.task == part.task.name] for part in parts}


def _drawn(track: Track) -> Track:
    """Rows about a tenth of a second apart, without those in which the robot was lost."""
    known = np.flatnonzero(track.found)
    steps = np.round(track.t[known] / TAIL_S)
    first = np.append(True, steps[1:] != steps[:-1]) if len(steps) else np.zeros(0, bool)
    return track.only(np.unique(np.append(known[first], known[-1:])))


def kinds_of(pairs: Sequence[Pair]) -> list[str]:
    """The kinds of robots: real ones first."""
    return sorted({pair.kind for pair in pairs}, key=lambda kind: (kind != ROBOT, len(kind), kind))


def robots_of(pairs: Sequence[Pair]) -> list[str]:
    """The robots in a figure: of each kind the one with the most noise levels, films, then pairs."""

    def worth(robot: str) -> tuple[int, int, int]:
        here = [pair for pair in pairs if pair.robot == robot]
        return len({pair.level for pair in here}), sum(pair.filmed for pair in here), len(here)

    return [
        max(dict.fromkeys(p.robot for p in pairs if p.kind == kind), key=worth) for kind in kinds_of(pairs)
    ]


def shown_pair(condition: NoiseClass, pairs: Sequence[Pair]) -> Pair | None:
    """The pair in a figure: of the run shown in the report, if there is one; filmed ones first."""
    row = condition.chosen
    here = [pair for pair in pairs if pair.level == condition.level]
    here.sort(key=lambda p: (row is None or p.run != row.run.id, p.individual, not p.filmed, p.run, p.start))
    return next((pair for pair in here if pair.seen), None)


def groups_of(part: TaskPart, pairs: Sequence[Pair]) -> list[Group]:
    """A task's transfers by kind of robot, individual and noise level."""
    found = []
    for kind in kinds_of(pairs):
        for who in sorted({p.individual for p in pairs if p.kind == kind}):
            for c in part.conditions:
                here = tuple(p for p in pairs if (p.kind, p.individual, p.level) == (kind, who, c.level))
                if here:
                    group = Group(level=c.level, name=c.name, kind=kind, individual=who, pairs=here)
                    found.append(group)
    return found


def transfers_csv(task: Task, groups: Sequence[Group], study: Path) -> str:
    """The transfers as CSV: a row each, fitness unscaled; folders relative to the study's."""
    head = "task noise run name individual robot start path_from simulated situated drop folder"
    rows: list[list[object]] = [[*head.split()]]
    for group in groups:
        for p in group.pairs:
            scores = [repr(v) if math.isfinite(v) else "" for v in (*p.fitness, p.drop)]
            who = [p.run, p.name, p.individual, p.robot, p.start, p.situated_from]
            rows.append([task.name, group.name, *who, *scores, p.folder.relative_to(study).as_posix()])
    return to_csv(rows, end="\r\n")


# On the page


def pair_figures(
    part: TaskPart, pairs: Sequence[Pair], scene: Scene, label: str, figures: Figures
) -> dict[str, Any]:
    """The figures of a task's transfers, which are added to the page's; `label` is the paper's name of them.

    Returns:
        pairs: a figure for each kind of robot; sheets: of all its runs, and their number; shown: the pairs.
    """
    made: dict[str, Any] = {"pairs": [], "sheets": [], "shown": []}
    for robot in robots_of(pairs):
        here = [pair for pair in pairs if pair.robot == robot]
        shown = [pair for c in part.conditions if (pair := shown_pair(c, here)) is not None]
        if not shown:
            continue
        name = f"{part.task.name}-{'pairs' if not made['pairs'] else 'pairs-' + robot}"
        heads = [f"{part.names[pair.level]}, #{pair.index}" for pair in shown]
        rows = [
            [_panel(part, pair, 0, "simulated") for pair in shown],
            [_panel(part, pair, 1, pair.where) for pair in shown],
        ]
        draw = partial(paths_figure, scene, rows, heads=heads)
        alt = f"Paths. {'; '.join(_ends(part, pair) for pair in shown)}."
        made["pairs"].append(figures.add(name, draw, alt, label))
        made["shown"] += shown
        made["sheets"] += _sheet(part, here, scene, name, figures)
    return made


def _ends(part: TaskPart, pair: Pair) -> str:
    before, after = pair.paths
    return (
        f"{part.names[pair.level]}: from ({before.x[0]:.0f}, {before.y[0]:.0f}) simulated to "
        f"({before.x[-1]:.0f}, {before.y[-1]:.0f}), on {pair.where} to "
        f"({after.x[-1]:.0f}, {after.y[-1]:.0f}) cm"
    )


def _panel(part: TaskPart, pair: Pair, side: int, title: str) -> PathPanel:
    """The path of one side: 0, simulated, or 1, on the robot."""
    score = pair.fitness[side]
    text = "–" if math.isnan(score) else number(score / part.task.fitness_scale, 2)
    look = (SIMULATED, SITUATED)[side]
    return PathPanel(noise=pair.level, title=f"{title}: {text}", trajectory=pair.paths[side], look=look)


def _sheet(
    part: TaskPart, here: Sequence[Pair], scene: Scene, name: str, figures: Figures
) -> list[tuple[Picture, int]]:
    """Every transferred run of a robot, and their number: two rows a noise level, simulated above."""
    rows: list[list[PathPanel]] = []
    many = 0
    for condition in part.conditions:
        runs: dict[int, Pair] = {}
        for p in here:
            if p.level == condition.level and p.seen:
                runs.setdefault(p.run, p)
        pairs = [runs[run] for run in sorted(runs)][:PER_CONDITION]
        many += len(pairs)
        if pairs:
            rows.append([_panel(part, p, 0, f"{condition.name} #{p.index}") for p in pairs])
            rows.append([_panel(part, p, 1, p.where) for p in pairs])
    if many <= len(part.conditions) and len(rows) == 2 * many:  # the figure of pairs shows them all
        return []
    alt = f"Paths of {many} runs in simulation and on the robot, each from its first start."
    return [(figures.add(f"{name}-all", partial(paths_figure, scene, rows, small=True), alt), many)]
