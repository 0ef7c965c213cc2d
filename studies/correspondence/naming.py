"""What robots are called whose behaviour is known, and whether confidence is the share of right names.

Names are tables with the columns kind (what a trial should be called), name (what it is called) and
confidence.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from studies.correspondence.kinds import KINDS, exemplar
from studies.correspondence.ladders import setting_for
from studies.correspondence.vehicles import Driven, Vehicles, called_by_name, everybody

import realitygap
from realitygap.correspondence.names import NONE, Name, Namer, namer, shares
from realitygap.correspondence.trials import Trial
from realitygap.world.arena import Arena

SHIPPED = Path(realitygap.__file__).parent / "correspondence" / "exemplars" / "exemplars.npz"
Exemplar = tuple[str, Trial, Arena]
"""What a trial should be called, the trial, and where it was."""
BANDS = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 1.01)
"""Edges of the bands of confidence within which names are counted."""


def held_out(
    task: str, kinds: Iterable[str], seeds: Iterable[int], noise: float, **how: bool
) -> list[Exemplar]:
    """Exemplars, of each kind one a seed."""
    return [
        (kind if kind in KINDS[task] else NONE, *exemplar(task, kind, seed, noise, **how))
        for kind, seed in itertools.product(kinds, seeds)
    ]


def called(task: str, robots: Sequence[Exemplar], names: Namer | None = None) -> pd.DataFrame:
    """What they are called."""
    setting = setting_for(task)
    names = names or namer(setting)
    said = [names.name([trial], replace(setting, arena=arena))[0] for _, trial, arena in robots]
    return named([kind for kind, *_ in robots], said)


def named(kinds: Sequence[str], said: Sequence[Name]) -> pd.DataFrame:
    """The table of what trials of these kinds were called."""
    return pd.DataFrame(
        {
            "kind": kinds,
            "name": [one.name for one in said],
            "confidence": [one.confidence for one in said],
        }
    )


def left_out(task: str, hotter: float = 1.0) -> pd.DataFrame:
    """What shipped exemplars of each design are called by those of all others.

    Args:
        task: one of the paper's.
        hotter: temperature, in multiples of the fitted one.
    """
    with np.load(SHIPPED) as kept:
        rows, names, families = (kept[f"{task} {what}"] for what in ("rows", "names", "families"))
        reach, temperature = float(kept[f"{task} reach"]), hotter * float(kept[f"{task} temperature"])
    made = []
    for family in np.unique(families):
        own = families == family
        others = Namer(task, rows[~own], names[~own])
        sure = shares(*others.nearest(rows[own].astype(np.float64)), reach, temperature)
        kind = str(names[own][0]) if names[own][0] in KINDS[task] else NONE
        made += [(kind, others.kinds[one.argmax()], float(one.max())) for one in sure]
    return pd.DataFrame(made, columns=["kind", "name", "confidence"])


def vehicles_named(
    models: Sequence[str], of: Vehicles, seeds: range, seconds: float = 20.0
) -> tuple[list[Driven], pd.DataFrame]:
    """All vehicles of a set on these robots, and what they are called.

    Returns:
        The drives; and a row for each, with the further columns design, robot, ordered and shown.
    """
    drives = [*everybody(seeds, models, seconds=seconds, of=of)]
    made = named([one.kind for one in drives], called_by_name(drives))
    made["design"], made["robot"] = [one.family for one in drives], [one.model for one in drives]
    made["ordered"], made["shown"] = [one.ordered for one in drives], [one.shown for one in drives]
    return drives, made


def right(made: pd.DataFrame) -> float:
    """The share of right names."""
    return float((made["kind"] == made["name"]).mean())


def surely_wrong(made: pd.DataFrame) -> int:
    """How many names are wrong that were given with more than 0.8."""
    return int(((made["kind"] != made["name"]) & (made["confidence"] > 0.8)).sum())


def interval(made: pd.DataFrame) -> tuple[float, float]:
    """95 % interval of the share of right names, by bootstrap over controllers: one's trials go together."""
    hit = made["kind"] == made["name"]
    tally = hit.groupby([made["kind"], made["design"]], sort=False).agg(["sum", "count"]).to_numpy()
    draw = np.random.default_rng(0)
    picked = tally[draw.integers(len(tally), size=(10_000, len(tally)))].sum(axis=1)
    low, high = np.quantile(picked[:, 0] / picked[:, 1], (0.025, 0.975))
    return float(low), float(high)


def reliability(made: pd.DataFrame) -> pd.DataFrame:
    """By band of confidence: count, mean confidence, share of right names."""
    band = pd.cut(made["confidence"], BANDS, right=False)
    told = pd.DataFrame({"sure": made["confidence"], "right": made["kind"] == made["name"]})
    found = told.groupby(band, observed=True)
    return found.agg(count=("sure", "size"), sure=("sure", "mean"), right=("right", "mean"))


def miscalibration(made: pd.DataFrame) -> float:
    """How far confidence and share of right names are apart (expected calibration error)."""
    found = reliability(made)
    return float((found["count"] * (found["sure"] - found["right"]).abs()).sum() / len(made))
