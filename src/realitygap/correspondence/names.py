"""What kind of behaviour a trial shows: the paper's names (tables 1 and 2), or "none of these".

A trial is named after the exemplars that are nearest to it; a descriptor counts by how well it tells
kinds apart: how much it varies between them beside how much it does within one (Fisher's ratio). A robot
and its mirror image have one name. What is nearest to robots that take no notice of anything, or far from
every exemplar, is "none of these".

How sure a name is follows from the neighbours' votes and the distance of the nearest. Two numbers make that a
share of right names: the reach, from where on a trial is too far for any name, and the temperature. Both are
fitted to exemplars of designs that the votes know nothing of (`python -m tests.exemplars.make`).
"""

from collections import defaultdict
from collections.abc import Sequence
from importlib.resources import files
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.descriptors import (
    FOR_NAMES,
    Descriptor,
    chosen,
    describe_all,
    in_units,
    mirrored,
)
from realitygap.correspondence.setting import Setting
from realitygap.correspondence.trials import RADIUS_CM, Trial
from realitygap.errors import TrackError
from realitygap.tasks.load import load_task
from realitygap.text import must_be
from realitygap.values import Floats
from realitygap.world.arena import Arena

__all__ = ["KINDS", "NONE", "Name", "Namer", "common_name", "descriptors_of", "namer", "rows_of", "shares"]

NONE = "none of these"
KINDS = {
    "obstacle-avoidance": ("one way turner", "two way turner", "wall follower", "one way looper"),
    "light-seeking": ("three point turner", "straight looper", "two way turner", "bobber"),
}
"""The paper's kinds of behaviour, by task (tables 1 and 2)."""
NEIGHBOURS = 7
DOUBT = 0.05
"""A vote that each name has beforehand: nothing is certain."""
LARGE_CM = 5.5
"""Bodies whose radius is larger are named by exemplars of their own: the others' are of 2.6 to 4.1 cm."""
UNSEEN, LEAST, MOST = 0.1, 0.3, 9.0
"""A variance that nobody sees (in just-noticeable amounts); bounds of what a descriptor counts."""


class Name(NamedTuple):
    """A trial's name, and how sure it is, 0 to 1: of names given with 0.8, four in five should be right."""

    start: str
    name: str
    confidence: float
    unit: str = ""


class Namer:
    """Names trials of one task by exemplars.

    Args:
        task: whose exemplars.
        rows: their descriptors [n, d] (`rows_of`).
        names: their kinds [n].
        reach: distance of the nearest exemplar from which on "none of these" has a vote of more than one.
        temperature: the votes' power is one over it; more makes less sure.
    """

    def __init__(
        self,
        task: str,
        rows: Floats,
        names: NDArray[np.str_],
        *,
        reach: float = np.inf,
        temperature: float = 1.0,
    ) -> None:
        self.kinds = (*KINDS[task], NONE)
        self.reach, self.temperature = reach, temperature
        self._signs = mirrored(descriptors_of(load_task(task).arena))
        self._of = np.array([self.kinds.index(n) if n in self.kinds else len(self.kinds) - 1 for n in names])
        plain = self._eased(rows.astype(np.float64))
        named = [plain[self._of == k] for k in range(len(KINDS[task]))]
        within = np.mean([own.var(axis=0) for own in named], axis=0) + UNSEEN
        between = np.var([own.mean(axis=0) for own in named], axis=0)
        self._unit = np.sqrt(within / (np.minimum(between / within, MOST) + LEAST))
        self._rows = plain / self._unit

    def name(self, trials: Sequence[Trial], setting: Setting) -> list[Name]:
        """A name for each trial."""
        found = shares(*self.nearest(rows_of(trials, setting.arena)), self.reach, self.temperature)
        best = found.argmax(axis=1)
        return [
            Name(trial.start, self.kinds[k], round(float(share[k]), 3), trial.unit)
            for trial, k, share in zip(trials, best, found, strict=True)
        ]

    def nearest(self, rows: Floats) -> tuple[Floats, Floats]:
        """Distances of the nearest exemplars of each row, nearest first, and whose they are.

        Returns:
            [n, neighbours], and 1 for the kind of each: [n, neighbours, kinds].
        """
        eased = self._eased(rows) / self._unit
        far = np.sqrt(((eased[:, None] - self._rows) ** 2).sum(axis=2))
        order = np.argsort(far, axis=1, kind="stable")[:, :NEIGHBOURS]
        return np.take_along_axis(far, order, axis=1), np.eye(len(self.kinds))[self._of[order]]

    def _eased(self, rows: Floats) -> Floats:
        """Of a robot and its mirror image the same; what is large anyway counts less."""
        folded = np.where(self._signs < 0, np.abs(rows), rows)
        return np.asarray(np.sign(folded) * 1.5 * np.sqrt(np.abs(folded)))


def shares(far: Floats, kinds: Floats, reach: float, temperature: float) -> Floats:
    """How sure each kind is, [n, kinds], the last being "none of these"; rows sum to one.

    Args:
        far: distances of the nearest exemplars, [n, neighbours].
        kinds: whose they are (`Namer.nearest`).
        reach, temperature: as of a `Namer`.
    """
    votes = DOUBT + (np.exp(far[:, :1] - far)[:, :, None] * kinds).sum(axis=1)
    votes[:, -1] += np.exp(np.minimum(far[:, 0] - reach, 10.0))
    powers = votes ** (1 / temperature)
    return np.asarray(powers / powers.sum(axis=1, keepdims=True))


def descriptors_of(arena: Arena | None) -> tuple[Descriptor, ...]:
    """What trials are named by."""
    return (*chosen(arena), *FOR_NAMES)


def rows_of(trials: Sequence[Trial], arena: Arena | None) -> Floats:
    """Descriptors of trials in just-noticeable amounts, [n, d]."""
    return in_units(describe_all(trials, arena), descriptors_of(arena))


def namer(setting: Setting, radius_cm: float = RADIUS_CM) -> Namer:
    """The namer for a setting, and bodies of such a radius, from the exemplars that come with the package.

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
        told = [d.name for d in descriptors_of(load_task(task).arena)]
        if kept[f"{task} descriptors"].tolist() != told:
            raise RuntimeError("exemplars.npz is older than the descriptors: run tests.exemplars.make")
        large = f"{task}, large"
        of = large if radius_cm > LARGE_CM and f"{large} rows" in kept else task
        reach, temperature = float(kept[f"{of} reach"]), float(kept[f"{of} temperature"])
        return Namer(task, kept[f"{of} rows"], kept[f"{of} names"], reach=reach, temperature=temperature)


def common_name(names: Sequence[Name]) -> str:
    """The name of a robot from its trials: the one with most confidence behind it."""
    votes: defaultdict[str, float] = defaultdict(float)
    for name in names:
        votes[name.name] += name.confidence
    return max(votes, key=votes.__getitem__) if votes else NONE
