"""What kind of behaviour a trial shows: the paper's names (tables 1 and 2), or "none of these".

A trial is named after the exemplars that are nearest to it; a descriptor counts by how well it tells
kinds apart: how much it varies between them beside how much it does within one (Fisher's ratio). A robot
and its mirror image have one name. What is nearest to robots that take no notice of anything, or far from
every exemplar, is "none of these".
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from functools import cached_property
from importlib.resources import files
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.descriptors import chosen, mirrored, table
from realitygap.correspondence.exemplars.kinds import KINDS
from realitygap.correspondence.setting import Setting
from realitygap.correspondence.trials import Trial
from realitygap.errors import TrackError
from realitygap.tasks.load import load_task
from realitygap.text import must_be

__all__ = ["NONE", "Name", "Namer", "common_name", "namer"]

Floats = NDArray[np.float64]

NONE = "none of these"
NEIGHBOURS = 3
UNSEEN, LEAST, MOST = 0.1, 0.3, 9.0
"""A variance that nobody sees (in just-noticeable amounts); bounds of what a descriptor counts."""
SLACK = 1.75
"""A trial may be so many times farther from its kind than the kind's loneliest exemplar."""


class Name(NamedTuple):
    """A trial's name, and how sure it is, 0 to 1."""

    start: str
    name: str
    confidence: float
    unit: str = ""


class Namer:
    """Names trials of one task by exemplars.

    Args:
        task: whose exemplars.
        rows: their descriptors [n, d], in just-noticeable amounts.
        names: their kinds [n].
    """

    def __init__(self, task: str, rows: Floats, names: NDArray[np.str_]) -> None:
        self.task = task
        self._signs = mirrored(chosen(load_task(task).arena))
        self._names = np.array([name if name in KINDS[task] else NONE for name in names])
        self._unit = np.ones(rows.shape[1])
        plain = self._folded(rows.astype(np.float64))
        kinds = [plain[self._names == name] for name in KINDS[task]]
        within = np.mean([rows.var(axis=0) for rows in kinds], axis=0) + UNSEEN
        between = np.var([rows.mean(axis=0) for rows in kinds], axis=0)
        self._unit = np.sqrt(within / (np.minimum(between / within, MOST) + LEAST))
        self._rows = plain / self._unit

    def name(self, trials: Sequence[Trial], setting: Setting) -> list[Name]:
        """A name for each trial."""
        rows = self._folded(table(trials, setting.arena))
        return [self._named(trial, row) for trial, row in zip(trials, rows, strict=True)]

    @cached_property
    def _reach(self) -> dict[str, float]:
        """How far from the nearest exemplar of its kind a trial may be."""
        reach = {}
        for name in KINDS[self.task]:
            rows = self._rows[self._names == name]
            far = np.sqrt(((rows[:, None] - rows[None]) ** 2).sum(axis=2))
            np.fill_diagonal(far, np.inf)
            reach[name] = SLACK * float(far.min(axis=1).max())
        return reach

    def _named(self, trial: Trial, row: Floats) -> Name:
        far = np.sqrt(((self._rows - row) ** 2).sum(axis=1))
        nearest = np.argsort(far)[:NEIGHBOURS]
        votes: defaultdict[str, float] = defaultdict(float)
        for i in nearest:
            votes[str(self._names[i])] += 1 / (far[i] + 0.5)
        name = max(votes, key=votes.__getitem__)
        share = votes[name] / sum(votes.values())
        if name == NONE:
            return Name(trial.start, NONE, round(float(share), 3), trial.unit)
        away = float(far[self._names == name].min()) / self._reach[name]
        if away > 1:
            return Name(trial.start, NONE, round(1 - 0.5 / away, 3), trial.unit)
        return Name(trial.start, name, round(float(share) * min(1.0, 1.25 - away / 2), 3), trial.unit)

    def _folded(self, rows: Floats) -> Floats:
        return np.where(self._signs < 0, np.abs(rows), rows) / self._unit


def namer(setting: Setting) -> Namer:
    """The namer for a setting, from the exemplars that come with the package.

    Raises:
        TrackError: a setting that nobody knows: names need walls and lamps.
    """
    must_be(setting, Setting, "setting", "setting_of(trials) makes one.")
    task = setting.exemplars
    if task is None:
        raise TrackError(
            "the tracks fit neither of the paper's arenas: expected --task, the task whose arena they "
            "were made in (a name or a .py file)."
        )
    place = files("realitygap.correspondence.exemplars").joinpath("exemplars.npz")
    with place.open("rb") as file, np.load(file) as kept:
        rows, names = kept[f"{task} rows"], kept[f"{task} names"]
        told = [d.name for d in chosen(load_task(task).arena)]
        if kept[f"{task} descriptors"].tolist() != told:
            raise RuntimeError("exemplars.npz is older than the descriptors: run correspondence.make")
    return Namer(task, rows, names)


def common_name(names: Sequence[Name]) -> str:
    """The name of a robot from its trials: the one with most confidence behind it."""
    votes: defaultdict[str, float] = defaultdict(float)
    for name in names:
        votes[name.name] += name.confidence
    return max(votes, key=votes.__getitem__) if votes else NONE
