"""The two ends of the scale: a floor (the same robot again) and a ceiling (another behaviour)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from importlib.resources import files

import numpy as np

from realitygap.correspondence.distances import Distances
from realitygap.correspondence.trials import Trial

__all__ = ["PARTS", "Scale", "exemplar_scale", "scale_of"]

PARTS = {"behaviour": 0.8, "layout": 0.2}
"""What counts how much. Layout is the weaker witness: two behaviours may fill an arena alike."""
ENOUGH_STARTS = 8
"""From so many starts on, a set's own halves make the floor."""
SPLITS = 60
FLOOR_QUANTILE = 0.975
"""The floor is what the same robot again hardly ever exceeds: such a pair scores 10."""


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Distances at 10 (floor) and at 0 (ceiling), of each part, and where they come from.

    Give one and the same to all comparisons that are held against each other.
    """

    behaviour_floor: float
    behaviour_ceiling: float
    layout_floor: float
    layout_ceiling: float
    floor_from: str
    ceiling_from: str

    def part(self, name: str, distance: float) -> float:
        """A part's score, 0 to 10."""
        floor, ceiling = getattr(self, f"{name}_floor"), getattr(self, f"{name}_ceiling")
        return 10 * float(np.clip(1 - (distance - floor) / (ceiling - floor), 0, 1))

    def score(self, distances: dict[str, float]) -> float:
        """The correspondence score, 0 to 10."""
        return sum(weight * self.part(name, distances[name]) for name, weight in PARTS.items())

    def to_dict(self) -> dict[str, float | str]:
        """Ready for JSON."""
        return asdict(self)


def scale_of(
    distances: Distances, *, task: str | None = None, ceiling: Sequence[Trial] | None = None
) -> Scale:
    """The scale for two sets of trials: from themselves where they allow it, else from exemplars.

    Args:
        distances: of the two sets.
        task: the paper's task whose exemplars serve; None: those of both, by their motion alone.
        ceiling: trials of another behaviour.
    """
    scale = exemplar_scale(task, len(set(_names(distances.a))), len(set(_names(distances.b))))
    scale = _own_ceiling(scale, distances, ceiling) if ceiling else scale
    scale = _own_floor(scale, distances)
    top = {f"{part}_floor": getattr(scale, f"{part}_ceiling") / 2 for part in PARTS}
    return replace(scale, **{key: min(getattr(scale, key), most) for key, most in top.items()})


def exemplar_scale(task: str | None, starts_a: int, starts_b: int) -> Scale:
    """The scale of the project's own exemplars, for so many starts in the two sets."""
    text = files("realitygap.correspondence").joinpath("scales.json").read_text(encoding="utf-8")
    made = json.loads(text)[task or "motion"]
    shrink = float(np.sqrt((1 / starts_a + 1 / starts_b) / 2))
    of = f"exemplars of {task.replace('-', ' ')}" if task else "exemplars of both tasks, by motion alone"
    floors = {f"{part}_floor": made[part]["floor"] * shrink for part in PARTS}
    floors = {key: min(value, made[key.split("_")[0]]["ceiling"] / 2) for key, value in floors.items()}
    return Scale(
        **floors,
        behaviour_ceiling=made["behaviour"]["ceiling"],
        layout_ceiling=made["layout"]["ceiling"],
        floor_from=of,
        ceiling_from=of,
    )


def _own_floor(scale: Scale, distances: Distances) -> Scale:
    """Halves of a set's own starts against each other, brought to the size of the whole sets."""
    sizes = [len(set(_names(trials))) for trials in (distances.a, distances.b)]
    found: dict[str, list[float]] = {name: [] for name in PARTS}
    for side, size in zip(distances.sides, sizes, strict=True):
        if size < ENOUGH_STARTS:
            continue
        shrink = float(np.sqrt((1 / sizes[0] + 1 / sizes[1]) / (4 / size)))
        halves = [_halves(distances, side, k) for k in range(SPLITS)]
        for name in PARTS:
            measured = [getattr(distances, name)(*half) for half in halves]
            found[name].append(shrink * float(np.quantile(measured, FLOOR_QUANTILE)))
    if not found["behaviour"]:
        return scale
    floors = {f"{name}_floor": float(np.mean(values)) for name, values in found.items()}
    return replace(scale, **floors, floor_from="halves of the sets' own starts")


def _own_ceiling(scale: Scale, distances: Distances, ceiling: Sequence[Trial]) -> Scale:
    """How far both sets are from the other behaviour that was given."""
    far: dict[str, list[float]] = {name: [] for name in PARTS}
    for trials in (distances.a, distances.b):
        between = Distances(a=trials, b=ceiling, arena=distances.arena)
        for name in PARTS:
            far[name].append(getattr(between, name)())
    ends = {f"{name}_ceiling": max(float(np.mean(values)), 0.05) for name, values in far.items()}
    return replace(scale, **ends, ceiling_from="the other behaviour that was given")


def _halves(distances: Distances, side: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    own = np.unique(distances.starts[side > 0])
    chosen = np.random.default_rng(k).permutation(own)[: len(own) // 2]
    half = side * np.isin(distances.starts, chosen)
    return half, side - half


def _names(trials: Sequence[Trial]) -> list[str]:
    return [t.start for t in trials]

