"""A study's transfers: the same individual simulated and situated, from the same start.

"Situated" is the paper's word for an individual that drives a robot (or here its stand-in, a twin). Figures 3
and 5 show pairs of paths; beside them stand the films' last frames and a table.
"""

import base64
import io
import math
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from realitygap.files import atomic_path, to_csv
from realitygap.report.drawing import PathPanel, Scene, pairs_figure, sheet_figure
from realitygap.report.evolution import PER_CONDITION, Mean, NoiseClass, TaskPart, chosen, mean_of
from realitygap.report.page import Figures, Picture
from realitygap.report.style import SIMULATED, SITUATED, number
from realitygap.robots.address import ROBOT, StandIn
from realitygap.study.load import Study
from realitygap.tasks.task import Task
from realitygap.track import Track
from realitygap.transfer.record import TransferredTrial, load_transfers

__all__ = [
    "Group", "Pair", "Situated", "groups_of", "kinds_of", "pairs_of", "robots_of", "shown_pair",
    "situated_of", "transfers_csv",
]  # fmt: skip

FILM_PX = 720
"""Width of a film's last frame on the page."""
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
        """Simulated and situated, thinned for drawing tails, without lost poses; read when first needed."""
        return _drawn(self.simulated), _drawn(self.situated)

    @property
    def seen(self) -> bool:
        """Whether anything is known of the situated path."""
        return bool(self.situated.found.any())

    @property
    def fitness(self) -> tuple[float, float]:
        """Simulated and situated, unscaled; NaN if there is none."""
        return self.fitness_simulated, self.fitness_situated

    @property
    def stand_in(self) -> StandIn | None:
        """The simulated robot that it is; None for a robot."""
        return StandIn.of_folder(self.robot)

    @property
    def kind(self) -> str:
        """The group for averages: all robots, or all units of a kind with the same noise scale."""
        return ROBOT if self.stand_in is None else self.stand_in.kind

    @property
    def where(self) -> str:
        """The robot in words."""
        if (there := self.stand_in) is not None:
            return there.words
        kind, _, port = self.robot.partition("-")
        return f"{MAKES[kind]} on {port}" if kind in MAKES else f"robot {self.robot}"

    @property
    def drop(self) -> float:
        """Loss of score from simulated to situated."""
        return self.fitness[0] - self.fitness[1]


@dataclass(frozen=True, kw_only=True)
class Group:
    """The transfers of one noise level on one kind of robot, for a table."""

    level: float
    name: str
    kind: str
    pairs: tuple[Pair, ...]

    def values(self, of: str) -> list[float]:
        """Each run's "simulated", "situated" or "drop": the mean of its transfers with scores."""
        runs: dict[int, list[float]] = {}
        for pair in self.pairs:
            value = {"simulated": pair.fitness[0], "situated": pair.fitness[1], "drop": pair.drop}[of]
            if math.isfinite(pair.drop):
                runs.setdefault(pair.run, []).append(value)
        return [float(np.mean(values)) for values in runs.values()]

    def mean(self, of: str) -> Mean | None:
        """The mean of `values` over the runs."""
        return mean_of(self.values(of))


def pairs_of(study: Study, parts: Sequence[TaskPart]) -> dict[str, list[Pair]]:
    """The study's transfers by task, in the order of its runs, robots and starts."""
    runs = {row.run.id: (c.level, row.run.index) for part in parts for c in part.conditions for row in c.rows}
    pairs = []
    for one in load_transfers(study.folder):
        if one.run in runs:
            level, index = runs[one.run]
            known = {field.name: getattr(one, field.name) for field in fields(one)}
            pairs.append(Pair(**known, level=level, index=index))
    pairs.sort(key=lambda p: (p.run, p.stand_in is not None, len(p.robot), p.robot, p.start))
    return {part.task.name: [p for p in pairs if p.task == part.task.name] for part in parts}


def _drawn(track: Track) -> Track:
    """Rows about a tenth of a second apart, without those in which the robot was lost."""
    known = np.flatnonzero(track.found)
    steps = np.round(track.t[known] / TAIL_S)
    first = np.append(True, steps[1:] != steps[:-1]) if len(steps) else np.zeros(0, bool)
    return track.only(np.unique(np.append(known[first], known[-1:])))


def kinds_of(pairs: Sequence[Pair]) -> list[str]:
    """The kinds of situation: robots first."""
    return sorted({pair.kind for pair in pairs}, key=lambda kind: (kind != ROBOT, len(kind), kind))


def robots_of(pairs: Sequence[Pair]) -> list[str]:
    """The robots in a figure: of each kind the one with the most noise levels, films, then pairs."""
    found = []
    for kind in kinds_of(pairs):
        robots: dict[str, list[Pair]] = {}
        for pair in pairs:
            if pair.kind == kind:
                robots.setdefault(pair.robot, []).append(pair)
        found.append(max(robots, key=lambda robot: _worth(robots[robot])))
    return found


def _worth(pairs: Sequence[Pair]) -> tuple[int, int, int]:
    return len({pair.level for pair in pairs}), sum(pair.filmed for pair in pairs), len(pairs)


def shown_pair(condition: NoiseClass, pairs: Sequence[Pair]) -> Pair | None:
    """The pair in a figure: of the run shown in the report, if there is one; filmed ones first."""
    row = chosen(condition)
    here = [pair for pair in pairs if pair.level == condition.level]
    here.sort(key=lambda p: (row is None or p.run != row.run.id, not p.filmed, p.run, p.start))
    return next((pair for pair in here if pair.seen), None)


def groups_of(part: TaskPart, pairs: Sequence[Pair]) -> list[Group]:
    """A task's transfers by kind of robot and noise level."""
    groups = []
    for kind in kinds_of(pairs):
        for one in part.conditions:
            here = tuple(p for p in pairs if p.level == one.level and p.kind == kind)
            if here:
                groups.append(Group(level=one.level, name=one.name, kind=kind, pairs=here))
    return groups


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


class Situated(NamedTuple):
    """What a task's section shows of its transfers.

    Attributes:
        shown: the pairs in its figures.
        figures: pairs of paths; sheets: all of them.
        films: last frames, as the template needs them.
        groups: rows of the table.
    """

    shown: list[Pair]
    figures: list[Picture]
    sheets: list[tuple[Picture, int]]
    films: list[dict[str, object]]
    groups: list[Group]

    @property
    def total(self) -> int:
        return sum(len(group.pairs) for group in self.groups)

    @property
    def kinds(self) -> list[str]:
        """Of what was driven, the first word of each kind: "robot", "twin", "stranger", "Enki"."""
        return sorted({group.kind.split()[0] for group in self.groups})

    def stands_for(self, part: TaskPart) -> bool:
        """Whether its figures show every run that a figure of simulated paths would show."""
        runs = {pair.run for pair in self.shown}
        return all(row is None or row.run.id in runs for row in map(chosen, part.conditions))


def situated_of(
    part: TaskPart, pairs: Sequence[Pair], scene: Scene, label: str, figures: Figures, report: Path
) -> Situated:
    """What a section shows of a task's transfers, at least one; `label` is the paper's name of the figure.

    Its figures are added to the page's; films are linked or copied into the report's folder.
    """
    made = Situated([], [], [], [], groups_of(part, pairs))
    for robot in robots_of(pairs):
        here = [pair for pair in pairs if pair.robot == robot]
        shown = [pair for c in part.conditions if (pair := shown_pair(c, here)) is not None]
        if not shown:
            continue
        name = f"{part.task.name}-{'pairs' if not made.figures else 'pairs-' + robot}"
        heads = [f"{part.names[pair.level]}, #{pair.index}" for pair in shown]
        rows = [
            [_panel(part, pair, situated=False, title="simulated: {}") for pair in shown],
            [_panel(part, pair, situated=True, title=f"{pair.where}: {{}}") for pair in shown],
        ]
        alt = f"Paths. {'; '.join(_ends(part, pair) for pair in shown)}."
        made.figures.append(figures.add(name, partial(pairs_figure, scene, heads, rows), alt, label))
        made.shown.extend(shown)
        made.sheets.extend(_sheet(part, here, scene, name, figures))
        made.films.extend(film for pair in shown if (film := _film(part, pair, report)) is not None)
    return made


def _ends(part: TaskPart, pair: Pair) -> str:
    before, after = pair.paths
    return (
        f"{part.names[pair.level]}: from ({before.x[0]:.0f}, {before.y[0]:.0f}) simulated to "
        f"({before.x[-1]:.0f}, {before.y[-1]:.0f}), on {pair.where} to "
        f"({after.x[-1]:.0f}, {after.y[-1]:.0f}) cm"
    )


def _panel(part: TaskPart, pair: Pair, *, situated: bool, title: str) -> PathPanel:
    score = pair.fitness[situated]
    text = "–" if math.isnan(score) else number(score / part.task.fitness_scale, 2)
    look = SITUATED if situated else SIMULATED
    return PathPanel(noise=pair.level, title=title.format(text), trajectory=pair.paths[situated], look=look)


def _sheet(
    part: TaskPart, here: Sequence[Pair], scene: Scene, name: str, figures: Figures
) -> list[tuple[Picture, int]]:
    """Every transferred run of a robot, and their number: two rows a noise level, simulated above."""
    rows: list[list[PathPanel | None]] = []
    many = 0
    for condition in part.conditions:
        runs: dict[int, Pair] = {}
        for p in here:
            if p.level == condition.level and p.seen:
                runs.setdefault(p.run, p)
        pairs = [runs[run] for run in sorted(runs)][:PER_CONDITION]
        many += len(pairs)
        if pairs:
            rows.append(
                [_panel(part, p, situated=False, title=f"{condition.name} #{p.index}: {{}}") for p in pairs]
            )
            rows.append([_panel(part, p, situated=True, title="situated: {}") for p in pairs])
    if many <= len(part.conditions) and len(rows) == 2 * many:  # the figure of pairs shows them all
        return []
    alt = f"Simulated and situated paths of {many} runs, each from its first start."
    return [(figures.add(f"{name}-all", partial(sheet_figure, scene, rows), alt), many)]


def _film(part: TaskPart, pair: Pair, report: Path) -> dict[str, object] | None:
    """A film's last frame under its track's tail (a data URI) and its link; None without a film.

    The film itself is linked into the report (copied where the disk has no links), so that the report's
    folder is complete without the study's.
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
            spare.unlink(missing_ok=True)
            try:
                os.link(film, spare)
            except OSError:
                shutil.copyfile(film, spare)
    head = f"{part.names[pair.level]}, #{pair.index}"
    return {
        "head": head,
        "where": pair.where,
        "start": pair.start,
        "picture": picture,
        "size": size,
        "link": link,
    }


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
