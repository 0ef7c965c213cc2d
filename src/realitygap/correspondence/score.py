"""How alike two sets of trials are, 0 to 10, with words for how they differ; and how good a behaviour is.

Two distances between the sets are measured: of behaviour, and of layout (where the robot was). A scale turns
them into scores: its floor is the distance of the same robot from itself, its ceiling that of another
behaviour. Distances are precomputed for all pairs of trials, so that a bootstrap only changes weights. Both
are unbiased: two sets of one robot's trials have distance 0 on average, with any number of trials. Two trials
of one start are never compared, within a set or across: a common start would make any two robots similar.

Sources: Székely and Rizzo, "Energy statistics" (J. Stat. Plan. Inference 143, 2013); Lin, "Divergence
measures based on the Shannon entropy" (IEEE Trans. Inf. Theory 37, 1991).
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.descriptors import chosen, describe_all, in_units
from realitygap.correspondence.setting import Setting
from realitygap.correspondence.statistics import parting_s, resampled_weights, transferability, two_sample_p
from realitygap.correspondence.trials import SHORTEST_S, STEP_S, Trial, require_trials
from realitygap.errors import TrackError, UsageError
from realitygap.files import must_be
from realitygap.tasks.task import Task
from realitygap.values import Floats
from realitygap.world.arena import Arena
from realitygap.world.robot import Profile

__all__ = [
    "ANOTHER", "CALM", "EDGE", "PARTS", "Comparison", "Distances", "Scale", "behaviour_score", "comparable",
    "compare", "differences", "ends_of", "exemplar_scale", "matched_starts", "noisiness", "scale_of",
    "signed",
]  # fmt: skip


# Distances

BLUR_CM = 4.0
"""Standard deviation of the blur of an occupancy map: a little more than a body's radius."""
ANYWHERE_PER_CM2 = 1e-6
"""Occupancy added everywhere: limits the weight of places that no robot visits."""
EVERY = 5
"""Every fifth row, two a second, represents a trial in its map."""
ROUNDING = 1e-12
"""A squared distance below this is 0: a set compared with itself gives only rounding errors."""
SAME_CM, SAME_RAD = 1.5, np.radians(15)
"""Two robots set down by hand within these have the same start."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Distances:
    """Precomputed distances of two sets of trials, `a` and `b`, for any weights.

    Attributes:
        a, b: the trials, two at least in each.
        arena: where they were; None: only the tracks' own motion is compared.
        matched: whether starts of one name are the same start in both sets.
        jitter: whether the descriptor "jitter" is included.
    """

    a: Sequence[Trial]
    b: Sequence[Trial]
    arena: Arena | None = None
    matched: bool = False
    jitter: bool = True

    @cached_property
    def described(self) -> tuple[dict[str, Floats], dict[str, Floats]]:
        """Descriptors by name of a's and of b's trials, in their own units."""
        return describe_all(self.a, self.arena), describe_all(self.b, self.arena)

    @cached_property
    def rows(self) -> Floats:
        """Descriptors of both sets' trials, [n, d]: a's, then b's."""
        kept = [d for d in chosen(self.arena) if self.jitter or d.name != "jitter"]
        return np.vstack([in_units(one, kept) for one in self.described])

    @cached_property
    def starts(self) -> NDArray[np.int64]:
        """[n] number of each trial's start."""
        names = [("" if self.matched else "a", t.start) for t in self.a]
        names += [("" if self.matched else "b", t.start) for t in self.b]
        number = {name: i for i, name in enumerate(dict.fromkeys(names))}
        return np.array([number[name] for name in names])

    @cached_property
    def counts(self) -> NDArray[np.bool_]:
        """[n, n] which pairs of trials are compared: those of different starts."""
        starts, n = self.starts, len(self.a)
        few = len(set(starts[:n])) < 2 or len(set(starts[n:])) < 2
        names = np.arange(len(starts)) if few else starts
        return np.asarray(names[:, None] != names[None, :])

    @cached_property
    def sides(self) -> tuple[Floats, Floats]:
        """Weights [n] that count each trial of `a`, or each of `b`, once."""
        ours = (np.arange(len(self.a) + len(self.b)) < len(self.a)).astype(np.float64)
        return ours, 1.0 - ours

    def behaviour(self, wa: Floats | None = None, wb: Floats | None = None) -> Floats:
        """√ of the energy distance of the descriptors, in just-noticeable amounts; 0 or more."""
        return _root(self.energy(wa, wb))

    def energy(self, wa: Floats | None = None, wb: Floats | None = None) -> Floats:
        """The energy distance of the descriptors: `2 E|X − Y| − E|X − X'| − E|Y − Y'|`; may be below 0.

        Weights [..., n] of the trials on either side, by default a and b; a distance [...] for each row.
        """
        wa, wb = self._weights(wa, wb)
        counts, far = self.counts, self._between * self.counts

        def mean(one: Floats, other: Floats) -> Floats:
            total = np.vecdot(one @ counts, other)
            # row by row: a product of two matrices has other last bits than that of one row
            summed = np.vecdot((one[..., np.newaxis, :] @ far)[..., 0, :], other)
            return np.asarray(summed / np.where(total > 0, total, np.nan))

        return 2 * mean(wa, wb) - mean(wa, wa) - mean(wb, wb)

    def layout(self, wa: Floats | None = None, wb: Floats | None = None) -> Floats:
        """Jensen-Shannon distance (√, base 2) of the occupancy maps; 0 to 1. Weights as of `energy`."""
        wa, wb = self._weights(wa, wb)
        density = []
        for weights in (wa, wb):
            # which trials form the map that another is compared with
            makers = weights[..., np.newaxis] * self.counts
            made = np.einsum("...ij,ijp->...jp", makers, self._occupancy)
            mass = np.maximum(makers.sum(axis=-2), 1e-12)
            density.append(made / mass[..., np.newaxis] + ANYWHERE_PER_CM2)
        both = density[0] + density[1]
        gain = [np.log2(2 * own / both).mean(axis=-1) for own in density]
        gained = np.vecdot(wa, gain[0]) / wa.sum(axis=-1) + np.vecdot(wb, gain[1]) / wb.sum(axis=-1)
        return np.minimum(1.0, _root(gained / 2))

    def _weights(self, wa: Floats | None, wb: Floats | None) -> tuple[Floats, Floats]:
        return self.sides[0] if wa is None else wa, self.sides[1] if wb is None else wb

    @cached_property
    def _between(self) -> Floats:
        rows = self.rows
        return np.asarray(np.sqrt(((rows[:, None] - rows[None, :]) ** 2).sum(axis=2)))

    @cached_property
    def _occupancy(self) -> Floats:
        """[i, j, p]: occupancy of trial i at the p-th place of trial j, a share per cm²."""
        trials = [*self.a, *self.b]
        count = min(len(t) for t in trials) // EVERY
        places = np.array([np.column_stack([t.x, t.y])[: count * EVERY : EVERY] for t in trials])
        places /= np.sqrt(2) * BLUR_CM
        n = len(trials)
        made = np.empty((n, n, count))
        for i, own in enumerate(places):  # one table of distances serves both directions
            later = places[i:].reshape(-1, 2)
            near = np.subtract.outer(own[:, 0], later[:, 0]) ** 2
            near += np.subtract.outer(own[:, 1], later[:, 1]) ** 2
            np.negative(near, out=near)
            np.exp(near, out=near)
            near = near.reshape(count, n - i, count)
            made[i, i:] = near.mean(axis=0)
            made[i:, i] = near.mean(axis=2).T
        return made / (2 * np.pi * BLUR_CM**2)


def matched_starts(a: Sequence[Trial], b: Sequence[Trial]) -> frozenset[str]:
    """The starts that are pairs: in both sets, of one name and one pose.

    All common starts are, or none: none if a name has two poses, or fewer than half have a partner.
    """
    first = {t.start: t for t in a}
    others = {t.start for t in b}
    common = frozenset(first) & others
    near = all(_near(first[t.start], t) for t in [*a, *b] if t.start in common)
    return common if near and 2 * len(common) >= len(others | set(first)) else frozenset()


def _near(one: Trial, other: Trial) -> bool:
    away = np.hypot(one.x[0] - other.x[0], one.y[0] - other.y[0])
    turned = (one.heading[0] - other.heading[0] + np.pi) % (2 * np.pi) - np.pi
    return bool(away < SAME_CM and abs(turned) < SAME_RAD)


def _root(square: Floats) -> Floats:
    """√, with rounding errors as 0; NaN stays NaN, where there was nothing to compare."""
    return np.sqrt(np.where(square <= ROUNDING, 0.0, square))


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

Told = dict[str, Floats]
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


def signed(a: Told, b: Told) -> tuple[float, float | None, float]:
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


def _ratio(a: Told, b: Told, name: str, unseen: float) -> float:
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
    noisy, response, loops = signed(*(between.described[::-1] if swapped else between.described))
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
