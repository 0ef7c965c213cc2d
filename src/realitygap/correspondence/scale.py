"""The two ends of the scale: a floor (the same robot again) and a ceiling (another behaviour)."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import files

import numpy as np

from realitygap.correspondence.distances import Distances
from realitygap.correspondence.trials import Trial
from realitygap.values import Floats

__all__ = ["CALM", "EDGE", "PARTS", "Scale", "exemplar_scale", "scale_of"]

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
    own = "the sets' own trials, parted in two"
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
