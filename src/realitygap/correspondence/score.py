"""The scores of tables 1 and 2, 0 to 10: how alike two sets of trials are, and how good a behaviour is.

A scale turns the distances of two sets, of behaviour and of layout, into scores: its floor is the distance of
the same robot from itself, its ceiling that of another behaviour.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.descriptors import describe_all
from realitygap.correspondence.distances import Distances, matched_starts
from realitygap.correspondence.setting import Setting
from realitygap.correspondence.trials import RADIUS_CM, SHORTEST_S, STEP_S, Trial
from realitygap.errors import TrackError, UsageError
from realitygap.tasks.task import Task
from realitygap.values import Floats
from realitygap.world.robot import Profile

__all__ = [
    "ANOTHER", "CALM", "EDGE", "PARTS", "Comparison", "Scale", "behaviour_score", "compare", "differences",
    "ends_of", "exemplar_scale", "noisiness", "parting_s", "transferability",
]  # fmt: skip

# The scale

PARTS = {"behaviour": 0.8, "layout": 0.2}
"""Weights. Layout is the weaker evidence: two behaviours may cover an arena alike."""
ENOUGH_STARTS = 8
"""From this number of starts on, a set's own trials determine the floor."""
SPLITS = 60
FLOOR_QUANTILE = 0.99
"""The floor is a distance that the same robot again hardly ever exceeds."""
CALM = ", without jitter"
"""Name of the scales of behaviour without jitter."""
EDGE = 0.3
"""Range of scores within the floor and beyond the ceiling: 10 to 9.7, and 0.3 to 0.

Within the floor a distance is mostly chance, beyond the ceiling the behaviour is another. But smaller is
still smaller, and a constant score could not distinguish bad from worse.
"""


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Distances at the upper end (floor) and at the lower (ceiling), of each part, and their source.

    Use one scale for all comparisons that are compared with each other.
    """

    behaviour_floor: float
    behaviour_ceiling: float
    layout_floor: float
    layout_ceiling: float
    floor_from: str
    ceiling_from: str

    def part(self, name: str, distance: float) -> float:
        """A part's score, 0 to 10: linear from floor to ceiling, and a little beyond both."""
        floor: float = getattr(self, f"{name}_floor")
        ceiling: float = getattr(self, f"{name}_ceiling")
        if distance <= floor:
            return 10 - EDGE * (distance / floor) ** 2 if floor > 0 else 10.0
        if distance >= ceiling:
            return EDGE * ceiling / distance
        return 10 - EDGE - (10 - 2 * EDGE) * (distance - floor) / (ceiling - floor)

    def score(self, distances: dict[str, float]) -> float:
        """The correspondence score, 0 to 10: the mean of the parts, weighted by `PARTS`.

        The layout's score is at most the behaviour's: two behaviours may cover an arena alike without being
        similar.
        """
        behaviour, layout = (self.part(name, distances[name]) for name in ("behaviour", "layout"))
        return PARTS["behaviour"] * behaviour + PARTS["layout"] * min(behaviour, layout)


def scale_of(
    distances: Distances, *, task: str | None = None, ceiling: Sequence[Trial] | None = None,
    whole: bool = True,
) -> Scale:  # fmt: skip
    """The scale for two sets of trials: from the trials themselves if possible, else from exemplars.

    Args:
        distances: of the two sets.
        task: the paper's task whose exemplars are used; None: those of both, by motion alone.
        ceiling: trials of another behaviour.
        whole: whether the trials are whole, not pieces, so that their own parts can give a floor.
    """
    starts = [len({t.start for t in trials}) for trials in (distances.a, distances.b)]
    scale = exemplar_scale(task, *starts, matched=distances.matched, jitter=distances.jitter)
    scale = _own_ceiling(scale, distances, ceiling) if ceiling else scale
    scale = _own_floor(scale, distances) if whole else scale
    low = min(scale.behaviour_floor, scale.behaviour_ceiling / 2)
    return replace(scale, behaviour_floor=low, layout_floor=min(scale.layout_floor, scale.layout_ceiling / 2))


def exemplar_scale(
    task: str | None, starts_a: int, starts_b: int, *, matched: bool = True, jitter: bool = True
) -> Scale:
    """The scale of the package's exemplars, for a number of starts in each set, matched or not.

    Args:
        task: whose exemplars; None: of both tasks.
        starts_a, starts_b: number of trials in each set.
        matched: whether trials of the two sets share their starts.
        jitter: whether jitter counts as behaviour.
    """
    text = files("realitygap.correspondence.exemplars").joinpath("scales.json").read_text(encoding="utf-8")
    made = json.loads(text)[(task or "motion") + ("" if jitter else CALM)]
    shrink = float(np.sqrt((1 / starts_a + 1 / starts_b) / 2))
    of = f"exemplars of {task.replace('-', ' ')}" if task else "exemplars of both tasks, by motion alone"
    which = "floor" if matched else "floor elsewhere"
    ends = {f"{part}_ceiling": made[part]["ceiling"] for part in PARTS}
    ends |= {f"{part}_floor": min(made[part][which] * shrink, made[part]["ceiling"] / 2) for part in PARTS}
    return Scale(**ends, floor_from=of, ceiling_from=of)


def _own_floor(scale: Scale, distances: Distances) -> Scale:
    """Distances between parts of a set, scaled to the size of the whole sets.

    Matched starts: a set with several trials of each start is divided start by start, so that its parts match
    too. Otherwise a set with many starts is divided into halves of them.
    """
    sizes = [len({t.start for t in trials}) for trials in (distances.a, distances.b)]
    found: dict[str, list[float]] = {name: [] for name in PARTS}
    for side, size in zip(distances.sides, sizes, strict=True):
        once = int(np.bincount(distances.starts[side > 0]).max()) < 2
        if size < ENOUGH_STARTS or (distances.matched and once):
            continue
        pieces = size if distances.matched else size / 2
        shrink = float(np.sqrt((1 / sizes[0] + 1 / sizes[1]) / (2 / pieces)))
        parted = [_parted(distances, side, np.random.default_rng(k)) for k in range(SPLITS)]
        for name in PARTS:
            measured = [getattr(distances, name)(*two) for two in parted]
            found[name].append(shrink * float(np.quantile(measured, FLOOR_QUANTILE)))
    if not found["behaviour"]:
        return scale
    low, layout = (float(np.mean(found[name])) for name in PARTS)
    own = "split halves of the same trials"
    return replace(scale, behaviour_floor=low, layout_floor=layout, floor_from=own)


def _own_ceiling(scale: Scale, distances: Distances, ceiling: Sequence[Trial]) -> Scale:
    """Distances of both sets to the given other behaviour."""
    other = partial(Distances, b=ceiling, arena=distances.arena, jitter=distances.jitter)
    far = [other(a=trials) for trials in (distances.a, distances.b)]
    means = [np.mean([getattr(between, part)() for between in far]) for part in PARTS]
    top, layout = (max(float(mean), 0.05) for mean in means)
    given = "the other behaviour that was given"
    return replace(scale, behaviour_ceiling=top, layout_ceiling=layout, ceiling_from=given)


def _parted(distances: Distances, side: Floats, draw: np.random.Generator) -> tuple[Floats, Floats]:
    """Weights of two halves of a set."""
    own = np.flatnonzero(side)
    starts = distances.starts[own]
    if distances.matched:
        chosen = np.concatenate([
            draw.permutation(rows)[: max(1, len(rows) // 2)]
            for rows in (own[starts == start] for start in np.unique(starts)) if len(rows) > 1
        ])  # fmt: skip
    else:
        kept = draw.permutation(np.unique(starts))
        chosen = own[np.isin(starts, kept[: len(kept) // 2])]
    half = np.zeros_like(side)
    half[chosen] = side[chosen]
    return half, side - half


# Words for differences (tables 1 and 2)

Described = dict[str, Floats]
"""Descriptors of a set's trials, by name (`describe_all`)."""

QUIET_DEG_S = 2.0
"""Invisible jitter; added to both sides, so that a robot without noise can be compared."""
CLOSE_CM, ASKEW_DEG = 0.5, 10.0
"""Invisible distance and angle; added likewise."""
NOISE_STEPS, RESPONSE_STEPS = (0.4, 1.0, 1.6), (0.06, 0.2, 0.5)
"""|log2 ratio| from which a difference is small, clear, large."""
LOOPS = 0.15
"""Difference in the share of time from which more or less looping is visible."""
ALIKE = ((9.7, "observably identical"), (8.8, "very similar"))
"""Scores from which no difference is mentioned."""
ANOTHER = "another behaviour"

_NOISE = {
    1: ("a little noisier", "noisier", "much noisier"),
    -1: ("slightly less noisy", "less noisy", "much less noisy"),
}
_RESPONSE = {
    1: ("a little more responsive", "more responsive", "much more responsive"),
    -1: ("a little less responsive", "less responsive", "much less responsive"),
}


def noisiness(a: Sequence[Trial], b: Sequence[Trial]) -> float:
    """log2 of the ratio of b's jitter in turning to a's."""
    return signed(describe_all(a, None), describe_all(b, None))[0]


def signed(a: Described, b: Described) -> tuple[float, float | None, float]:
    """Noisiness, responsiveness and looping of b relative to a, from both sets' descriptors.

    Responsiveness is the log2 ratio of how early b responds: the distance at which it turns from a surface
        ahead, or with a lamp how directly it faces the lamp; None without an arena. Looping is the difference
        in the share of time spent going round in loops.
    """
    response = None
    if "light bearing" in a:
        response = -_ratio(a, b, "light bearing", ASKEW_DEG)
    elif "turning clearance" in a:
        response = _ratio(a, b, "turning clearance", CLOSE_CM)
    loops = float(b["looping"].mean() - a["looping"].mean())
    return _ratio(a, b, "jitter", QUIET_DEG_S), response, loops


def differences(score: float, behaviour: float, noisy: float, responsive: float | None, loops: float) -> str:
    """Differences of b from a in the paper's words, the largest first.

    A behaviour beyond the scale's ceiling is another one, whatever else differs.

    Args:
        score, behaviour: 0 to 10.
        noisy, responsive, loops: signed, as above.
    """
    for least, phrase in ALIKE:
        if score >= least:
            return phrase
    found = [_word(noisy, _NOISE, NOISE_STEPS), _word(responsive, _RESPONSE, RESPONSE_STEPS)]
    if abs(loops) >= LOOPS:
        found.append((abs(loops) / LOOPS, "loops more" if loops > 0 else "loops less"))
    said = [phrase for _, phrase in sorted((f for f in found if f), key=lambda f: -f[0])]
    if behaviour <= EDGE:
        said.insert(0, ANOTHER)
    if said:
        return ", ".join(said)
    return "similar" if score >= 7 else "qualitatively similar" if score >= 4 else "different"


def _word(
    value: float | None, phrases: dict[int, tuple[str, str, str]], steps: tuple[float, float, float]
) -> tuple[float, str] | None:
    """Size of a difference relative to its first step, and its phrase; None if it is not noticeable."""
    if value is None or abs(value) < steps[0]:
        return None
    size = sum(abs(value) >= step for step in steps) - 1
    return abs(value) / steps[0], phrases[1 if value > 0 else -1][size]


def _ratio(a: Described, b: Described, name: str, unseen: float) -> float:
    ours, theirs = float(a[name].mean()), float(b[name].mean())
    return math.log2((max(theirs, 0.0) + unseen) / (max(ours, 0.0) + unseen))


# Scores

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
    """Compare b (on a robot) with a (simulated).

    Args:
        a, b: trials, at least one of each.
        setting: where they were (`setting_of`).
        ceiling: trials of another behaviour, for the scale's lower end.
        scale: a common scale for several comparisons; by default each has its own.
        resamples: of the bootstrap.

    Raises:
        TrackError: no trials, or too short ones.
    """
    given = [a, b, *([ceiling] if ceiling else [])]
    cut, notes = comparable(given)
    pairs, lone = matched_starts(cut[0], cut[1]), min(map(len, given)) < 2
    ours, theirs = (_partners(trials, pairs, notes) for trials in cut[:2])
    swapped = [t.x.tolist() for t in theirs] < [t.x.tolist() for t in ours]
    first, second = (theirs, ours) if swapped else (ours, theirs)  # no figure depends on their order
    between = Distances(a=first, b=second, arena=setting.arena, matched=bool(pairs), jitter=setting.jitter)
    ends = scale or scale_of(
        between, task=setting.exemplars, ceiling=cut[2] if ceiling else None, whole=not lone
    )
    far = {name: float(getattr(between, name)()) for name in PARTS}
    score, behaviour = ends.score(far), ends.part("behaviour", far["behaviour"])
    starts = min(len({t.start for t in trials}) for trials in (ours, theirs))
    if starts < LEAST_STARTS and not lone:
        notes.append(
            f"{starts} start{'s' * (starts > 1)} only, so there is no interval, and the score says little: "
            f"trials that differ may score near 10. Give {LEAST_STARTS} starts or more"
        )
    noisy, response, loops = signed(*(between.described[::-1] if swapped else between.described))
    parting = float(np.median(parting_s(ours, theirs))) if pairs else math.inf
    return Comparison(
        behaviour=behaviour, layout=ends.part("layout", far["layout"]), score=score, matched=bool(pairs),
        interval=None if lone or starts < LEAST_STARTS else _interval(between, ends, resamples),
        differences=differences(score, behaviour, noisy, response, loops), noisiness=noisy,
        responsiveness=response, looping=loops,
        transferability=transferability(ours, theirs) if pairs else None,
        parting_s=round(parting, 2) if math.isfinite(parting) else None, trials=(len(a), len(b)),
        p=between.two_sample_p(), distances=far, scale=ends, setting=setting.name, notes=tuple(notes),
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


def _interval(between: Distances, scale: Scale, resamples: int) -> tuple[float, float] | None:
    draw, scores = np.random.default_rng(0), list[float]()
    for first in range(0, resamples, TOGETHER):
        weights = between.resampled(draw, min(TOGETHER, resamples - first))
        far = np.column_stack([getattr(between, name)(*weights) for name in PARTS])
        compared = far[np.isfinite(far).all(axis=1)].tolist()
        scores += [scale.score(dict(zip(PARTS, row, strict=True))) for row in compared]
    if not scores:
        return None
    low, high = np.quantile(scores, [0.025, 0.975])
    return float(low), float(high)


def parting_s(a: Sequence[Trial], b: Sequence[Trial]) -> list[float]:
    """The time at which each pair of trials of one start was a body's radius apart, s; ∞: never while both
    lasted."""
    found = []
    for one, other in _pairs(a, b):
        n = min(len(one), len(other))
        apart = np.hypot(one.x[:n] - other.x[:n], one.y[:n] - other.y[:n]) > RADIUS_CM
        found.append(float(apart.argmax()) * STEP_S if apart.any() else math.inf)
    return found


def transferability(a: Sequence[Trial], b: Sequence[Trial]) -> float:
    """Minus the disparity of paired trajectories: 0 is perfect (Koos, Mouret and Doncieux 2013).

    The disparity is the mean squared distance between robots with a common start, over the mean squared
    distance of both from it. −1: as far from each other as from the start.
    """
    apart, gone = 0.0, 0.0
    for one, other in _pairs(a, b):
        n = min(len(one), len(other))
        apart += float(((one.x[:n] - other.x[:n]) ** 2 + (one.y[:n] - other.y[:n]) ** 2).mean())
        for t in (one, other):
            gone += float(((t.x[:n] - t.x[0]) ** 2 + (t.y[:n] - t.y[0]) ** 2).mean()) / 2
    return -apart / max(gone, 1e-9)


def _pairs(a: Sequence[Trial], b: Sequence[Trial]) -> list[tuple[Trial, Trial]]:
    return [(one, other) for one in a for other in b if one.start == other.start]


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
    low, high = ends
    return 10 * float(np.clip((np.asarray(scores, np.float64) - low) / (high - low), 0, 1).mean())


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
