"""Makes what the package ships of its exemplars: `python studies/correspondence/run.py FOLDER [--runs N]`.

Two files: `exemplars.npz` (descriptors of trials with known names, for naming) and `scales.json` (how far the
same robot again, and another behaviour, are; for scoring). What is made is compared with what the package
ships, in `src/realitygap/correspondence/exemplars`; to replace that, copy it there. Everything follows from
fixed seeds, none of which a test uses. It takes one core some minutes; `--runs N` makes N exemplars of a
design and as many robots of a kind, to see that it works.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))
from studies.correspondence.kinds import KINDS, Behaviour, exemplar, family_of  # noqa: E402
from studies.correspondence.wide import FAMILIES  # noqa: E402

import realitygap  # noqa: E402
from realitygap.correspondence.distances import Distances  # noqa: E402
from realitygap.correspondence.names import LARGE, Namer, descriptors_of, rows_of, shares  # noqa: E402
from realitygap.correspondence.score import CALM, PARTS  # noqa: E402
from realitygap.correspondence.trials import Trial  # noqa: E402
from realitygap.tasks.load import load_task  # noqa: E402
from realitygap.world.arena import Arena  # noqa: E402

EACH = 100
"""Exemplars of a family; a third of them at each noise level."""
FIRST_SEED = 100_000
LEVELS = (0.0, 1.0, 2.0)
SETS = {of: (of.removesuffix(LARGE), of.endswith(LARGE)) for of in FAMILIES}
"""Exemplars that are named by themselves: by task, and of robots too large for the paper's arena."""
REACHES, TEMPERATURES = (2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0), (0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.3, 1.5, 2.0)
"""What is tried for a namer's reach and temperature."""
ROBOTS, STARTS = 8, 12
"""Of each kind, for the scales."""
LIVES = ((1, 9), (2, 9), (4, 9), (3, 10))
"""A robot's trials, again, once more, and from other starts: numbers of noise and of starts."""
FLOOR, CEILING = 0.99, 0.05
"""Quantiles: what the same robot again hardly exceeds; what hardly any other behaviour undercuts.
Of layout's other behaviours the middle: many fill an arena alike."""

SHIPPED = Path(realitygap.__file__).parent / "correspondence" / "exemplars"


def main(words: list[str]) -> None:
    """Write both files, and say whether they are those that the package ships."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("folder", type=Path)
    options.add_argument("--runs", type=int, default=EACH, metavar="N")
    asked = options.parse_args(words)
    asked.folder.mkdir(parents=True, exist_ok=True)
    made: dict[str, Any] = exemplars(asked.runs)
    np.savez_compressed(asked.folder / "exemplars.npz", **made)
    ends = json.dumps(scales(min(ROBOTS, asked.runs)), indent=1) + "\n"
    (asked.folder / "scales.json").write_text(ends, encoding="utf-8")
    with np.load(SHIPPED / "exemplars.npz") as kept:
        same = kept.keys() == made.keys() and all(np.array_equal(kept[name], made[name]) for name in made)
    print(f"exemplars.npz: {'as shipped' if same else 'other than shipped'}")
    same = ends == (SHIPPED / "scales.json").read_text("utf-8")
    print(f"scales.json: {'as shipped' if same else 'other than shipped'}")


def exemplars(each: int) -> dict[str, Any]:
    """By set: descriptors [n, d] in just-noticeable amounts, names [n], reach and temperature.

    Args:
        each: exemplars of a design.
    """
    made: dict[str, Any] = {}
    for of, (task, large) in SETS.items():
        rows, names, families = [], [], []
        for kind, makers in FAMILIES[of].items():
            for i in range(each * len(makers)):
                seed, level = FIRST_SEED + i, LEVELS[i // len(makers) % 3]
                trial, arena = exemplar(task, kind, seed, level, large=large)
                rows.append(rows_of([trial], arena, large=large))
                names.append(kind)
                families.append(f"{kind} {family_of(of, kind, seed)}")
        kept = np.vstack(rows).astype(np.float16)
        reach, temperature = calibrated(of, kept, np.array(names), np.array(families))
        made |= {
            f"{of} rows": kept, f"{of} names": np.array(names), f"{of} families": np.array(families),
            f"{of} descriptors": np.array([d.name for d in descriptors_of(load_task(task).arena, large)]),
            f"{of} reach": reach, f"{of} temperature": temperature,
        }  # fmt: skip
    return made


def calibrated(
    of: str, rows: NDArray[np.floating[Any]], names: NDArray[np.str_], families: NDArray[np.str_]
) -> tuple[float, float]:
    """Reach and temperature under which exemplars that are named by others are likeliest.

    Each is named twice: by those of all other designs, and by half of all; a robot that somebody brings has a
    controller like one of ours, or has not.

    Args:
        of: which set of exemplars.
        rows: their descriptors.
        names: their kinds.
        families: their kinds and designs.
    """
    folds = [families == family for family in np.unique(families)]
    folds += [np.arange(len(names)) // 12 % 2 == half for half in (0, 1)]
    task, large = SETS[of]
    truth = np.array(
        [list(KINDS[task]).index(name) if name in KINDS[task] else len(KINDS[task]) for name in names]
    )
    told = [
        Namer(task, rows[~fold], names[~fold], large=large).nearest(rows[fold].astype(np.float64))
        for fold in folds
    ]
    right = np.concatenate([truth[fold] for fold in folds])

    def surprise(pair: tuple[float, float]) -> float:
        """Minus the log of how sure the right name was, its mean over the kinds."""
        sure = np.concatenate([shares(*near, *pair) for near in told])[np.arange(len(right)), right]
        return float(np.mean([-np.log(sure[right == kind]).mean() for kind in np.unique(truth)]))

    return min(itertools.product(REACHES, TEMPERATURES), key=surprise)


def scales(robots_of_a_kind: int) -> dict[str, dict[str, dict[str, float]]]:
    """By task, and of the motion alone: floors (of one start in each set) and ceiling of each part."""
    measured, calm = {}, {}
    for task, kinds in KINDS.items():
        seeds = range(FIRST_SEED, FIRST_SEED + robots_of_a_kind)
        robots = [Behaviour(task=task, kind=kind, seed=seed) for kind in kinds for seed in seeds]
        lives = {r: [r.trials(STARTS, again=j, starts=s) for j, s in LIVES] for r in robots}
        measured[task] = _measured(lives, load_task(task).arena)
        measured[f"motion, {task}"] = _measured(lives, None)
        calm[task] = _measured(lives, load_task(task).arena, jitter=False)
        calm[f"motion, {task}"] = _measured(lives, None, jitter=False)
    return _scales_of(measured) | {f"{name}{CALM}": ends for name, ends in _scales_of(calm).items()}


def _scales_of(measured: dict[str, Measured]) -> dict[str, dict[str, dict[str, float]]]:
    every = _together([measured[task] for task in KINDS])
    motion = _together([measured[f"motion, {task}"] for task in KINDS])
    return {**{task: _ends(every, measured[task]) for task in KINDS}, "motion": _ends(motion, motion)}


class Measured(NamedTuple):
    """Distances of both parts, a row a pair."""

    again: list[list[float]]
    """The same robot from the same starts again."""
    elsewhere: list[list[float]]
    """The same robot from other starts."""
    other: list[list[float]]
    """Two robots of different kinds."""


def _measured(
    lives: dict[Behaviour, list[list[Trial]]], arena: Arena | None, *, jitter: bool = True
) -> Measured:
    def far(a: list[Trial], b: list[Trial], matched: bool = True) -> list[float]:
        between = Distances(a=a, b=b, arena=arena, matched=matched, jitter=jitter)
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
    main(sys.argv[1:])
