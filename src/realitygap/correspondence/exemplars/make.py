"""Makes what the package keeps of its exemplars: `python -m realitygap.correspondence.exemplars.make`.

Two files beside this one: `exemplars.npz` (descriptors of trials with known names, for naming)
and `scales.json` (how far the same robot again, and another behaviour, are; for scoring).
Everything follows from fixed seeds, none of which a test uses.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from realitygap.correspondence.descriptors import chosen, table
from realitygap.correspondence.distances import Distances
from realitygap.correspondence.exemplars.kinds import KINDS, Behaviour, exemplar, kinds_of
from realitygap.correspondence.scale import PARTS
from realitygap.correspondence.trials import Trial
from realitygap.tasks.load import load_task
from realitygap.world.arena import Arena

__all__ = ["main"]

EACH = 300
"""Exemplars of a kind; a third of them at each noise level."""
FIRST_SEED = 100_000
LEVELS = (0.0, 1.0, 2.0)
ROBOTS, STARTS = 8, 12
"""Of each kind, for the scales."""
LIVES = ((1, 9), (2, 9), (4, 9), (3, 10))
"""A robot's trials, again, once more, and from other starts: numbers of noise and of starts."""
FLOOR, CEILING = 0.99, 0.05
"""Quantiles: what the same robot again hardly exceeds; what hardly any other behaviour undercuts.
Of layout's other behaviours the middle: many fill an arena alike."""

_HERE = Path(__file__).parent


def main() -> None:
    """Write both files."""
    kept: dict[str, Any] = exemplars()
    np.savez_compressed(_HERE / "exemplars.npz", **kept)
    (_HERE / "scales.json").write_text(json.dumps(scales(), indent=1) + "\n", encoding="utf-8")


def exemplars() -> dict[str, np.ndarray]:
    """By task: descriptors [n, d] in just-noticeable amounts, and names [n]."""
    made: dict[str, np.ndarray] = {}
    for task in KINDS:
        arena, rows, names = load_task(task).arena, [], []
        for kind in kinds_of(task):
            trials = [exemplar(task, kind, FIRST_SEED + i, LEVELS[i % 3]) for i in range(EACH)]
            rows.append(table(trials, arena))
            names += [kind] * EACH
        made[f"{task} rows"] = np.vstack(rows).astype(np.float16)
        made[f"{task} names"] = np.array(names)
        made[f"{task} descriptors"] = np.array([d.name for d in chosen(arena)])
    return made


def scales() -> dict[str, dict[str, dict[str, float]]]:
    """By task, and of the motion alone: floors (of one start in each set) and ceiling of each part."""
    measured = {}
    for task, kinds in KINDS.items():
        seeds = range(FIRST_SEED, FIRST_SEED + ROBOTS)
        robots = [Behaviour(task=task, kind=kind, seed=seed) for kind in kinds for seed in seeds]
        lives = {r: [r.trials(STARTS, again=j, starts=s) for j, s in LIVES] for r in robots}
        measured[task] = _measured(lives, load_task(task).arena)
        measured[f"motion, {task}"] = _measured(lives, None)
    both = {
        "": _together([measured[task] for task in KINDS]),
        "motion": _together([measured[f"motion, {task}"] for task in KINDS]),
    }
    made = {task: _ends(both[""], measured[task]) for task in KINDS}
    return {**made, "motion": _ends(both["motion"], both["motion"])}


class Measured(NamedTuple):
    """Distances of both parts, a row a pair."""

    again: list[list[float]]
    """The same robot from the same starts again."""
    elsewhere: list[list[float]]
    """The same robot from other starts."""
    other: list[list[float]]
    """Two robots of different kinds."""


def _measured(lives: dict[Behaviour, list[list[Trial]]], arena: Arena | None) -> Measured:
    def far(a: list[Trial], b: list[Trial], matched: bool = True) -> list[float]:
        between = Distances(a=a, b=b, arena=arena, matched=matched)
        return [getattr(between, name)() for name in PARTS]

    pairs = [(r, s) for r, s in itertools.combinations(lives, 2) if r.kind != s.kind]
    return Measured(
        again=[far(*two) for *here, _ in lives.values() for two in itertools.combinations(here, 2)],
        elsewhere=[far(one, away, False) for *here, away in lives.values() for one in here],
        other=[far(lives[r][0], lives[s][0]) for r, s in pairs],
    )


def _together(several: Sequence[Measured]) -> Measured:
    return Measured(*(list(itertools.chain(*rows)) for rows in zip(*several, strict=True)))


def _ends(every: Measured, own: Measured) -> dict[str, dict[str, float]]:
    """Floors of every task's robots together, the ceiling of its own.

    A just-noticeable amount is one in every task; another behaviour is another thing in each. A floor
    shrinks with the root of the number of starts; a ceiling does not.
    """
    ends = {}
    for i, name in enumerate(PARTS):
        again, elsewhere, other = (np.array(rows)[:, i] for rows in (every.again, every.elsewhere, own.other))
        ends[name] = {
            "floor": round(float(np.quantile(again, FLOOR) * np.sqrt(STARTS)), 4),
            "floor elsewhere": round(float(np.quantile(elsewhere, FLOOR) * np.sqrt(STARTS)), 4),
            "ceiling": round(float(np.quantile(other, CEILING if name == "behaviour" else 0.5)), 4),
        }
    return ends


if __name__ == "__main__":
    main()
