"""A study's transfers: the same individual simulated and situated, from the same start."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np

from realitygap.files import to_csv
from realitygap.report.gather import chosen
from realitygap.report.statistics import Mean, mean_of
from realitygap.report.tables import NoiseClass, TaskPart
from realitygap.robots.address import ROBOT, StandIn
from realitygap.study.load import Study
from realitygap.tasks.task import Task
from realitygap.track import Track
from realitygap.transfer.record import TransferredTrial, load_transfers

__all__ = ["Group", "Pair", "groups_of", "kinds_of", "pairs_of", "robots_of", "shown_pair", "transfers_csv"]

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
    pairs = [_pair(one, *runs[one.run]) for one in load_transfers(study.folder) if one.run in runs]
    pairs.sort(key=lambda p: (p.run, p.stand_in is not None, len(p.robot), p.robot, p.start))
    return {part.task.name: [p for p in pairs if p.task == part.task.name] for part in parts}


def _pair(one: TransferredTrial, level: float, index: int) -> Pair:
    known = {field.name: getattr(one, field.name) for field in fields(one)}
    return Pair(**known, level=level, index=index)


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
            told = [repr(v) if math.isfinite(v) else "" for v in (*p.fitness, p.drop)]
            who = [p.run, p.name, p.individual, p.robot, p.start, p.situated_from]
            rows.append([task.name, group.name, *who, *told, p.folder.relative_to(study).as_posix()])
    return to_csv(rows, end="\r\n")
