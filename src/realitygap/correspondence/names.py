"""The kind of behaviour that a trial shows: the paper's names (tables 1 and 2), or "none of these".

A trial is named after its nearest exemplars. Descriptors are weighted by how well they separate kinds: their
variance between kinds over that within kinds (Fisher's ratio). Large robots are described as if they were
small, in rooms scaled down with them. A robot and its mirror image have the same name. A trial nearest to
robots that ignore their surroundings, or far from every exemplar, is "none of these".

The confidence of a name follows from the neighbours' votes and the distance of the nearest. Two parameters
calibrate it to the share of correct names: the reach, beyond which a trial is too far for any name, and the
temperature. Both are fitted to exemplars of designs that are excluded from the votes
(studies/correspondence/run.py in the repository).
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.descriptors import (
    FOR_LARGE,
    FOR_NAMES,
    Descriptor,
    chosen,
    describe_all,
    in_units,
    mirrored,
)
from realitygap.correspondence.setting import Setting, around
from realitygap.correspondence.trials import RADIUS_CM, STEP_S, Trial
from realitygap.errors import TrackError
from realitygap.tasks.load import load_task
from realitygap.values import Floats
from realitygap.world.arena import Arena

__all__ = [
    "KINDS", "NONE", "Name", "Namer", "common_name", "descriptors_of", "namer", "of_length", "rows_of",
    "shares", "tells",
]  # fmt: skip

NONE = "none of these"
KINDS = {
    "obstacle-avoidance": ("one way turner", "two way turner", "wall follower", "one way looper"),
    "light-seeking": ("three point turner", "straight looper", "two way turner", "bobber"),
}
"""The paper's kinds of behaviour, by task (tables 1 and 2)."""
NEIGHBOURS = 7
DOUBT = 0.05
"""A vote that each name has beforehand: nothing is certain."""
LARGE, LARGE_CM = ", large", 5.5
"""Bodies whose radius is larger are named by exemplars of their own: the others' are of 2.6 to 4.1 cm."""
UNTOLD = 0.75
"""Of its confidence, what is left of a large robot's name whose evidence the track does not hold; of "none of
these", where it holds no kind's: a robot that stands before a wall may be jammed."""
WHOLE_S, FADES_S, LOST = 20.0, 4.0, 0.45
"""Exemplars last 20 s. Of a shorter trial's confidence this share of e^(−seconds / 4) is lost, less what 20 s
would lose: chosen by eye on held-out exemplars cut to 3 … 15 s, whose names were surer than right."""
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
        task: of the exemplars.
        rows: the exemplars' descriptors [n, d] (`rows_of`).
        names: their kinds [n].
        reach: distance of the nearest exemplar at which "none of these" has a vote of one.
        temperature: the votes' power is its inverse; higher means less confident.
        large: whether exemplars and named robots are large; then correlated descriptors are weighted jointly,
            and a name whose evidence a track lacks is less sure.
    """

    def __init__(
        self,
        task: str,
        rows: Floats,
        names: NDArray[np.str_],
        *,
        reach: float = np.inf,
        temperature: float = 1.0,
        large: bool = False,
    ) -> None:
        self.kinds = (*KINDS[task], NONE)
        self.reach, self.temperature, self._large = reach, temperature, large
        self._signs = mirrored(descriptors_of(load_task(task).arena, large))
        self._of = np.array([self.kinds.index(n) if n in self.kinds else len(self.kinds) - 1 for n in names])
        plain = self._eased(rows.astype(np.float64))
        named = [plain[self._of == k] for k in range(len(KINDS[task]))]
        within = np.mean([np.cov(own.T, bias=True) for own in named], axis=0)
        between = np.cov(np.array([own.mean(axis=0) for own in named]).T, bias=True)
        if not large:
            within, between = (np.diag(np.diag(each)) for each in (within, between))
        whiten = np.linalg.inv(np.linalg.cholesky(within + UNSEEN * np.eye(len(within))))
        ratios, turned = np.linalg.eigh(whiten @ between @ whiten.T)
        self._axes = whiten.T @ turned * np.sqrt(np.clip(ratios, 0.0, MOST) + LEAST)
        self._rows = plain @ self._axes

    def name(self, trials: Sequence[Trial], setting: Setting) -> list[Name]:
        """A name for each trial.

        Raises:
            TrackError: a setting of another task.
        """
        rows = rows_of(trials, setting.arena, large=self._large)
        if rows.shape[1] != len(self._signs):
            raise TrackError(
                f"setting: expected one of the task whose kinds are {', '.join(self.kinds[:-1])}, got "
                f"{setting.name!r}. namer(setting) makes a namer for it."
            )
        near = self.nearest(rows)
        found = shares(*near, self.reach, self.temperature)
        found *= np.array([of_length(trial.seconds) for trial in trials])[:, None]
        if self._large and setting.arena is not None:
            held = [tells(trial, setting.arena) for trial in trials]
            best = [self.kinds[k] for k in found.argmax(axis=1)]
            shown = [each.get(kind, any(each.values())) for each, kind in zip(held, best, strict=True)]
            found *= np.where(shown, 1.0, UNTOLD)[:, None]
        return [
            Name(trial.start, self.kinds[share.argmax()], round(float(share.max()), 3), trial.unit)
            for trial, share in zip(trials, found, strict=True)
        ]

    def nearest(self, rows: Floats) -> tuple[Floats, Floats]:
        """Distances of the nearest exemplars of each row, nearest first, and their kinds.

        Returns:
            [n, neighbours], and 1 for the kind of each: [n, neighbours, kinds].
        """
        eased = self._eased(rows) @ self._axes
        far = np.sqrt(((eased[:, None] - self._rows) ** 2).sum(axis=2))
        order = np.argsort(far, axis=1, kind="stable")[:, :NEIGHBOURS]
        return np.take_along_axis(far, order, axis=1), np.eye(len(self.kinds))[self._of[order]]

    def _eased(self, rows: Floats) -> Floats:
        """Make rows the same for a robot and its mirror image, and reduce the weight of large values."""
        folded = np.where(self._signs < 0, np.abs(rows), rows)
        return np.asarray(np.sign(folded) * 1.5 * np.sqrt(np.abs(folded)))


def shares(far: Floats, kinds: Floats, reach: float, temperature: float) -> Floats:
    """Confidence in each kind, [n, kinds], the last being "none of these"; rows sum to one.

    Args:
        far: distances of the nearest exemplars, [n, neighbours].
        kinds: their kinds (`Namer.nearest`).
        reach, temperature: as of a `Namer`.
    """
    votes = DOUBT + (np.exp(far[:, :1] - far)[:, :, None] * kinds).sum(axis=1)
    votes[:, -1] += np.exp(np.minimum(far[:, 0] - reach, 10.0))
    powers = votes ** (1 / temperature)
    return np.asarray(powers / powers.sum(axis=1, keepdims=True))


def of_length(seconds: float) -> float:
    """What is left of a name's confidence in a trial of this length."""
    return 1.0 - LOST * (math.exp(-min(seconds, WHOLE_S) / FADES_S) - math.exp(-WHOLE_S / FADES_S))


def descriptors_of(arena: Arena | None, large: bool = False) -> tuple[Descriptor, ...]:
    """The descriptors for naming trials."""
    return (*chosen(arena), *FOR_NAMES, *(FOR_LARGE if large else ()))


def rows_of(trials: Sequence[Trial], arena: Arena | None, *, large: bool = False) -> Floats:
    """Descriptors of trials in just-noticeable amounts, [n, d]; of large robots as if they were small."""
    descriptors = descriptors_of(arena, large)
    if not large or arena is None:
        return in_units(describe_all(trials, arena), descriptors)
    return np.vstack([in_units(describe_all(*_shrunk(trial, arena)), descriptors) for trial in trials])


def _shrunk(trial: Trial, arena: Arena) -> tuple[list[Trial], Arena]:
    """A trial and its arena, scaled so that its body has the small exemplars' radius."""
    by = RADIUS_CM / trial.radius_cm
    small = replace(trial, x=trial.x * by, y=trial.y * by, radius_cm=RADIUS_CM)
    cylinders = tuple(
        replace(c, x_cm=c.x_cm * by, y_cm=c.y_cm * by, radius_cm=c.radius_cm * by) for c in arena.cylinders
    )
    width, depth = arena.size_cm
    walls = tuple((x0 * by, y0 * by, x1 * by, y1 * by) for x0, y0, x1, y1 in arena.walls)
    return [small], replace(arena, size_cm=(width * by, depth * by), cylinders=cylinders, walls=walls)


def namer(setting: Setting, radius_cm: float = RADIUS_CM) -> Namer:
    """The namer for a setting and bodies of this radius, with the package's exemplars.

    Raises:
        TrackError: an unknown setting: names need walls and lamps.
    """
    task = setting.exemplars
    if task is None:
        raise TrackError(
            "the tracks fit neither of the paper's arenas: expected --task, the task whose arena they "
            "were made in (a name or a .py file)."
        )
    place = files("realitygap.correspondence.exemplars").joinpath("exemplars.npz")
    with place.open("rb") as file, np.load(file) as kept:
        large = radius_cm > LARGE_CM and f"{task}{LARGE} rows" in kept
        of = f"{task}{LARGE}" if large else task
        fitted = {what: float(kept[f"{of} {what}"]) for what in ("reach", "temperature")}
        return Namer(task, kept[f"{of} rows"], kept[f"{of} names"], large=large, **fitted)


def common_name(names: Sequence[Name]) -> str:
    """A robot's name from its trials: the one with the highest total confidence."""
    votes: defaultdict[str, float] = defaultdict(float)
    for name in names:
        votes[name.name] += name.confidence
    return max(votes, key=votes.__getitem__) if votes else NONE


# What a track must contain to be called so: one rule for robots of every size and make, which does not use a
# trial's name. It was fixed after a look at tracks of a Thymio, and before the later vehicles that names were
# tested on (studies/correspondence/vehicles_later.py) were named.

TURNING_DEG_S, TURN_DEG, TURNS = 10.0, 20.0, 3
"""A turn is one-sided, faster and larger than this; a robot that turns from obstacles does so three times."""
STRAIGHT_S, MOVING, BESIDE = 2.0, 0.5, 0.25
"""Seconds straight on; shares of the time in motion, and with a surface at one side."""
SLOW_CM_S, BESIDE_CM = 0.5, 4.0
"""For a Khepera; scaled with the robot's size."""


def tells(trial: Trial, arena: Arena) -> dict[str, bool]:
    """By kind of obstacle avoidance, whether a judge could recognise it in this track.

    All are in motion for half of the time. One way and two way turners go straight for two seconds and turn
    three times, the latter to either side; a looper goes once round; a wall follower has a wall at the same
    side, while moving, for a quarter of the time, and turns towards it.
    """
    size, mean = trial.radius_cm / RADIUS_CM, (trial.heading[:-1] + trial.heading[1:]) / 2
    forward = (np.diff(trial.x) * np.cos(mean) + np.diff(trial.y) * np.sin(mean)) / STEP_S
    moving = np.abs(np.convolve(forward, np.ones(3) / 3, "same")) > SLOW_CM_S * size
    rate = np.convolve(np.degrees(np.diff(trial.heading)) / STEP_S, np.ones(7) / 7, "same")
    way = np.sign(rate) * (np.abs(rate) > TURNING_DEG_S)
    parts = np.split(rate * (way != 0) * STEP_S, np.flatnonzero(np.diff(way)) + 1)
    turns = np.array([part.sum() for part in parts if abs(part.sum()) > TURN_DEG])
    straight = STEP_S * (moving & (way == 0) & (forward > 0)).sum() >= STRAIGHT_S
    clearance, surface, *_ = around(arena, trial.x[:-1], trial.y[:-1], trial.heading[:-1], trial.radius_cm)
    side = np.sin(surface) * (moving & (clearance < BESIDE_CM * size))
    back = [(np.maximum(w * rate, 0.0) * (way == w) * (w * side > 0.6)).sum() * STEP_S for w in (1, -1)]
    turner = straight and len(turns) >= TURNS
    held = {
        "one way turner": turner,
        "two way turner": turner and turns.min() < 0 < turns.max(),
        "wall follower": any(
            (w * side > 0.6).mean() >= BESIDE and to > TURN_DEG for w, to in zip((1, -1), back, strict=True)
        ),
        "one way looper": abs(np.degrees(trial.heading[-1] - trial.heading[0])) >= 360,
    }
    return {kind: bool(yes and moving.mean() >= MOVING) for kind, yes in held.items()}
