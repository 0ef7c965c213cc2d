"""The two scores: similarity of two sets of trials, with figures beside it; and quality of behaviour."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.distances import Distances, matched_starts
from realitygap.correspondence.scale import PARTS, Scale, scale_of
from realitygap.correspondence.setting import Setting
from realitygap.correspondence.statistics import (
    parting_s,
    resampled_weights,
    transferability,
    two_sample_p,
)
from realitygap.correspondence.trials import SHORTEST_S, STEP_S, Trial, require_trials
from realitygap.correspondence.words import differences, signed
from realitygap.errors import TrackError, UsageError
from realitygap.files import must_be
from realitygap.tasks.task import Task
from realitygap.world.robot import Profile

__all__ = ["Comparison", "behaviour_score", "comparable", "compare", "ends_of"]

NEARLY = 0.9
"""Rates of rows count as equal if their ratio is at least this."""
PIECES = 4
"""Pieces into which a single trial is cut, to show its variation."""
RESAMPLES = 1000
"""Of the bootstrap: ends of an interval are then certain to a tenth or two."""
TOGETHER = 50
"""Resamples computed at once: their maps fit into a cache."""
LEAST_STARTS = 3
"""Starts needed for an interval: with two, every other resample would have only one, and nothing to compare.
"""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Results of a comparison. Scores are 0 (another behaviour) to 10 (the same robot again).

    Attributes:
        behaviour, layout: the two parts; score: their weighted mean.
        interval: of the score, 95 %, by bootstrap over starts and units; None with one start or two.
        differences: of b from a, in the paper's words.
        noisiness, responsiveness: log2 ratios, b to a; looping: a difference of shares of time.
        matched: whether the starts are pairs; parting_s: the median time at which pairs part (None: at least
            half never do, or no pairs); transferability: of pairs.
        p: of the two-sample test.
        distances: of both parts; scale: their floor, ceiling and source.
        notes: on changes to the tracks.
    """

    behaviour: float
    layout: float
    score: float
    interval: tuple[float, float] | None
    differences: str
    noisiness: float
    responsiveness: float | None
    looping: float
    matched: bool
    parting_s: float | None
    transferability: float | None
    p: float
    distances: dict[str, float]
    setting: str
    trials: tuple[int, int]
    notes: tuple[str, ...]
    scale: Scale

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return asdict(self)


def compare(
    a: Sequence[Trial], b: Sequence[Trial], setting: Setting, *, ceiling: Sequence[Trial] | None = None,
    scale: Scale | None = None, resamples: int = RESAMPLES,
) -> Comparison:  # fmt: skip
    """Compare b (situated) with a (simulated).

    Args:
        a, b: trials, at least one of each.
        setting: where they were (`setting_of`).
        ceiling: trials of another behaviour, for the scale's lower end.
        scale: a common scale for several comparisons; by default each has its own.
        resamples: of the bootstrap.

    Raises:
        TrackError: no trials, or too short ones.
    """
    must_be(setting, Setting, "setting", "setting_of(trials) makes one.")
    if scale is not None:
        must_be(scale, Scale, "scale", "The `scale` of another comparison is one.")
    for trials in (a, b, ceiling or []):
        require_trials(trials)
    given = [a, b, *([ceiling] if ceiling else [])]
    cut, notes = comparable(given)
    pairs, lone = matched_starts(cut[0], cut[1]), min(map(len, given)) < 2
    ours, theirs = (_partners(trials, pairs, notes) for trials in cut[:2])
    swapped = _order(theirs) < _order(ours)  # no figure depends on the order of the two
    first, second = (theirs, ours) if swapped else (ours, theirs)
    between = Distances(a=first, b=second, arena=setting.arena, matched=bool(pairs), jitter=setting.jitter)
    ends = scale or scale_of(
        between, task=setting.exemplars, ceiling=cut[2] if ceiling else None, whole=not lone
    )
    far = {name: float(getattr(between, name)()) for name in PARTS}
    score, behaviour = ends.score(far), ends.part("behaviour", far["behaviour"])
    notes += [] if lone else _few(_starts(ours, theirs))
    noisy, response, loops = signed(*(between.told[::-1] if swapped else between.told))
    return Comparison(
        behaviour=behaviour, layout=ends.part("layout", far["layout"]), score=score, matched=between.matched,
        interval=_interval(between, ends, 0 if lone else resamples), noisiness=noisy, looping=loops,
        differences=differences(score, behaviour, noisy, response, loops), responsiveness=response,
        transferability=transferability(ours, theirs) if between.matched else None,
        parting_s=_median(parting_s(ours, theirs) if between.matched else []), trials=(len(a), len(b)),
        p=two_sample_p(between), distances=far, scale=ends, setting=setting.name, notes=tuple(notes),
    )  # fmt: skip


def comparable(sets: Sequence[Sequence[Trial]]) -> tuple[list[list[Trial]], list[str]]:
    """Sets of trials made comparable: of one length, at least two trials in each; and notes on changes.

    Raises:
        TrackError: a set without trials, or trials too short for that.
    """
    notes = []
    if not all(sets):
        raise TrackError("expected at least one trial in each set, got none. Give a file with rows in it.")
    every = [t for trials in sets for t in trials]
    shortest = min(every, key=len)
    if max(map(len, every)) > len(shortest) + 1:
        notes.append(
            f"all trials are cut to {shortest.seconds:.1f} s, the shortest "
            f"({shortest.source}, start {shortest.start})"
        )
    slowest, fastest = (of(every, key=lambda t: t.rate_hz) for of in (min, max))
    if slowest.rate_hz < NEARLY * fastest.rate_hz:
        notes.append(
            f"{slowest.source} has {slowest.rate_hz:.1f} rows a second, {fastest.source} more: it shows "
            "quick turns less well, and may seem less noisy than it was"
        )
    bridged = sum(t.bridged_s > 0 for t in every)
    if bridged:
        notes.append(f"{bridged} tracks had short losses, which were bridged")
    made = [[t.cut(shortest.seconds) for t in trials] for trials in sets]
    if min(map(len, made)) >= 2:
        return made, notes
    if shortest.seconds < PIECES * SHORTEST_S:
        raise TrackError(
            f"{shortest.source}: a set with one trial is compared by its quarters and must last "
            f"{PIECES * SHORTEST_S:g} s, got {shortest.seconds:.1f} s. Give more trials, or longer ones."
        )
    notes.append(f"one set has one trial only: all are compared by pieces of 1/{PIECES}, without an interval")
    return [[piece for t in trials for piece in t.pieces(PIECES)] for trials in made], notes


def _partners(trials: list[Trial], pairs: frozenset[str], notes: list[str]) -> list[Trial]:
    """A set without the starts that have no partner in the other, if starts are matched."""
    if not pairs:
        return trials
    alone = dict.fromkeys(t.start for t in trials if t.start not in pairs)
    if alone:
        notes.append(f"starts {', '.join(alone)} of {trials[0].source} left out: in one of the sets only")
    return [t for t in trials if t.start in pairs]


def _starts(a: Sequence[Trial], b: Sequence[Trial]) -> int:
    """How many different starts the set with fewer has."""
    return min(len({t.start for t in trials}) for trials in (a, b))


def _few(starts: int) -> list[str]:
    """A note on starts that are too few for an interval."""
    if starts >= LEAST_STARTS:
        return []
    return [
        f"{starts} start{'s' * (starts > 1)} only, so there is no interval, and the score says little: "
        f"trials that differ may score near 10. Give {LEAST_STARTS} starts or more"
    ]


def _order(trials: Sequence[Trial]) -> list[list[float]]:
    return [t.x.tolist() for t in trials]


def _interval(between: Distances, scale: Scale, resamples: int) -> tuple[float, float] | None:
    draw, scores = np.random.default_rng(0), []
    if _starts(between.a, between.b) < LEAST_STARTS:
        return None
    for first in range(0, resamples, TOGETHER):
        weights = resampled_weights(between, draw, min(TOGETHER, resamples - first))
        far = np.column_stack([getattr(between, name)(*weights) for name in PARTS])
        compared = far[np.isfinite(far).all(axis=1)].tolist()
        scores += [scale.score(dict(zip(PARTS, row, strict=True))) for row in compared]
    if not scores:
        return None
    low, high = np.quantile(scores, [0.025, 0.975])
    return float(low), float(high)


def _median(times: Sequence[float | None]) -> float | None:
    if not times:
        return None
    middle = float(np.median([np.inf if t is None else t for t in times]))
    return round(middle, 2) if np.isfinite(middle) else None


def behaviour_score(scores: Sequence[float] | NDArray[np.float64], ends: tuple[float, float]) -> float:
    """How close to the best possible, 0 to 10: the mean position between worst and best.

    The paper's judges marked "how close they came to the ideal strategy", "on the grounds of how robust
    and optimal they proved to be in simulation after repeated testing" (§6, §7.1).

    Each trial counts by itself and is clipped to the ends, so that lucky trials cannot compensate for
    failures.

    Args:
        scores: of many trials, at the noise level that the controller evolved under.
        ends: the score of doing nothing, and of the ideal (`ends_of`).
    """
    values = np.asarray(scores, np.float64).ravel()
    low, high = ends
    if len(values) == 0 or not np.isfinite(values).all() or not low < high:
        raise UsageError("behaviour score: expected finite trial scores, and a second end above the first.")
    return 10 * float(np.clip((values - low) / (high - low), 0, 1).mean())


def ends_of(task: Task, profile: Profile) -> tuple[float, float]:
    """The scores of a robot that stands still and of an ideal one, for a task with the paper's scores.

    The ideal drives at top speed all the time: straight to the lamp, where it stays (light), or straight on
        (obstacles; no arena allows it, so nobody reaches 10).

    Raises:
        UsageError: another task, whose ends you must give.
    """
    room, n = task.room(profile), task.steps
    if task.plain_name == "obstacle-avoidance":
        return 0.0, 1.0
    if task.plain_name != "light-seeking":
        raise UsageError(
            f"behaviour score: the ideal of task {task.name!r} is not known; expected its ends, the score "
            "of a robot that stands and of an ideal one."
        )
    away = min(math.hypot(x - task.start.x_cm, y - task.start.y_cm) for x, y in room.lamps)
    far = np.maximum(room.radius, away - room.top_speed * STEP_S * np.arange(1, n + 1))
    return 1 / (n * away**2), float(1 / (far**2).sum())
