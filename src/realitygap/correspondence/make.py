"""Makes what the package keeps of its exemplars: `python -m realitygap.correspondence.make`.

Two files beside this one: `exemplars.npz` (descriptors of trials with known names, for naming)
and `scales.json` (how far the same robot again, and another behaviour, are; for scoring).
Everything follows from fixed seeds, none of which a test uses.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np

from realitygap.correspondence.descriptors import chosen, table
from realitygap.correspondence.distances import Distances
from realitygap.correspondence.exemplars import KINDS, exemplar, kinds_of
from realitygap.correspondence.ladders import Behaviour
from realitygap.correspondence.scale import PARTS
from realitygap.tasks.load import load_task
from realitygap.world.arena import Arena

__all__ = ["main"]

EACH = 60
"""Exemplars of a kind; a third of them at each noise level."""
FIRST_SEED = 100_000
LEVELS = (0.0, 1.0, 2.0)
ROBOTS, STARTS = 4, 12
"""Of each kind, for the scales."""
FLOOR, CEILING = 0.975, 0.05
"""Quantiles: what the same robot again hardly exceeds; what hardly any other behaviour undercuts."""

_HERE = Path(__file__).parent


def main() -> None:
    """Write both files."""
    np.savez_compressed(_HERE / "exemplars.npz", **exemplars())
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
        made[f"{task} rows"] = np.vstack(rows).astype(np.float32)
        made[f"{task} names"] = np.array(names)
        made[f"{task} descriptors"] = np.array([d.name for d in chosen(arena)])
    return made


def scales() -> dict[str, dict[str, dict[str, float]]]:
    """By task, and of the motion alone: floor (of one start in each set) and ceiling of each part."""
    made, motion = {}, []
    for task, kinds in KINDS.items():
        robots = [Behaviour(task=task, kind=kind, seed=FIRST_SEED + i) for kind in kinds for i in range(ROBOTS)]
        lives = {robot: [robot.trials(STARTS, again=j, starts=9) for j in (1, 2)] for robot in robots}
        arena = load_task(task).arena
        made[task] = _ends(*_measured(lives, arena))
        motion.append(_measured(lives, None))
    made["motion"] = _ends([*motion[0][0], *motion[1][0]], [*motion[0][1], *motion[1][1]])
    return made


def _measured(lives: dict, arena: Arena | None) -> tuple[list[tuple[float, ...]], list[tuple[float, ...]]]:
    """Distances of the same robot again, and of robots of different kinds."""

    def far(a: list, b: list) -> tuple[float, ...]:
        between = Distances(a=a, b=b, arena=arena, matched=True)
        return tuple(getattr(between, name)() for name in PARTS)

    same = [far(*two) for two in lives.values()]
    pairs = itertools.combinations(lives, 2)
    other = [far(lives[r][0], lives[s][0]) for r, s in pairs if r.kind != s.kind]
    return same, other


def _ends(same: list[tuple[float, ...]], other: list[tuple[float, ...]]) -> dict[str, dict[str, float]]:
    ends = {}
    for i, name in enumerate(PARTS):
        floor = float(np.quantile([d[i] for d in same], FLOOR)) * np.sqrt(STARTS)
        ceiling = float(np.quantile([d[i] for d in other], CEILING if name == "behaviour" else 0.5))
        ends[name] = {"floor": round(float(floor), 4), "ceiling": round(ceiling, 4)}
    return ends


if __name__ == "__main__":
    main()
