"""Human judges: blind pairs of trials, their ratings, and the agreement of the score with them."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from realitygap.correspondence.setting import Setting
from realitygap.correspondence.trials import Trial
from realitygap.errors import TrackError
from realitygap.files import read_table
from realitygap.values import Floats

__all__ = ["Agreement", "Pair", "agreement", "blind_pairs", "read_marks"]

Row = dict[str, Any]
MARKS = ("pair", "judge", "mark")
FRAMES_HZ = 10
MARGIN_CM = 4.0
"""Around the tracks, where no arena is known."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two sets of trials of one controller, for the page and its key.

    Attributes:
        name: of the pair; the judges never see it.
        a, b: the trials; those of one start are shown together.
        score: the computed score, 0 to 10.
    """

    name: str
    a: Sequence[Trial]
    b: Sequence[Trial]
    score: float


class Agreement(NamedTuple):
    """Agreement of ratings and score, over pairs.

    Attributes:
        judges: number of judges.
        pairs: number of rated pairs.
        r, rho: Pearson's and Spearman's correlation of mean rating and score; NaN if one is constant.
        interval: of r, 95 %, by bootstrap over the pairs.
        difference: mean rating minus score.
        between_judges: mean Pearson r of a judge with the mean of the others; None for one judge.
    """

    judges: int
    pairs: int
    r: float
    rho: float
    interval: tuple[float, float]
    difference: float
    between_judges: float | None


def blind_pairs(
    pairs: Sequence[Pair], setting: Setting, *, seed: int = 0
) -> tuple[dict[str, Any], list[Row]]:
    """The page's data and the key: order and sides are random, names are numbers.

    Returns:
        the page's data, which reveal neither sides nor names; and rows of the key.
    """
    draw = np.random.default_rng(seed)
    places = np.concatenate([np.stack([t.x, t.y]) for pair in pairs for t in (*pair.a, *pair.b)], axis=1)
    low, high = places.min(axis=1) - MARGIN_CM, places.max(axis=1) + MARGIN_CM
    size, low = (setting.arena.size_cm, np.zeros(2)) if setting.arena else ((high - low).tolist(), low)
    shown, key = [], []
    for number, i in enumerate(draw.permutation(len(pairs)), start=1):
        pair = pairs[int(i)]
        swapped = bool(draw.random() < 0.5)
        both = _side_by_side(pair)
        left, right = ([_film(two[side], low) for two in both] for side in (swapped, not swapped))
        shown.append({"pair": number, "left": left, "right": right})
        key.append({"pair": number, "name": pair.name, "left": "b" if swapped else "a", "score": pair.score})
    return {"size_cm": size, "rate": FRAMES_HZ, "pairs": shown}, key


def read_marks(*paths: str | Path) -> dict[int, dict[str, float]]:
    """Ratings by pair and judge, from CSV files with columns pair, judge, mark, or folders of them.

    Raises:
        TrackError: names file and line.
    """
    places = [Path(path) for path in paths]
    files = [one for place in places for one in (sorted(place.glob("*.csv")) if place.is_dir() else [place])]
    marks: dict[int, dict[str, float]] = defaultdict(dict)
    for file in files:
        table = read_table(file, TrackError, needs=MARKS)
        pairs, given = table.whole("pair"), table.numbers("mark")
        table.refuse(pairs < 1, "pair", "a pair's number", pairs)
        table.refuse((given < 0) | (given > 10), "mark", "a mark from 0 to 10", given)
        for pair, judge, mark in zip(pairs.tolist(), table.texts("judge"), given.tolist(), strict=True):
            if (earlier := marks[pair].setdefault(judge or "judge", mark)) != mark:
                raise TrackError(
                    f"{file}: pair {pair}: judge {judge!r} gives it {earlier:g} and {mark:g}. Leave one out; "
                    "two judges need two names."
                )
    if not marks:
        raise TrackError(f"{places[0]}: expected ratings, columns {', '.join(MARKS)}; got none.")
    return dict(marks)


def agreement(marks: dict[int, dict[str, float]], scores: dict[int, float]) -> Agreement:
    """Agreement of ratings with scores, both by the pair's number.

    Raises:
        TrackError: a rating of a pair that is not in the key, or fewer than three pairs.
    """
    from scipy.stats import rankdata

    strange = sorted(set(marks) - set(scores))
    if strange:
        raise TrackError(f"ratings: pair {strange[0]} is not in the key. Give the key of their page.")
    if len(marks) < 3:
        raise TrackError(f"ratings: expected three pairs or more, got {len(marks)}.")
    numbers = sorted(marks)
    means = np.array([np.mean(list(marks[n].values())) for n in numbers])
    computed = np.array([scores[n] for n in numbers])
    judges = sorted({judge for of in marks.values() for judge in of})
    rows = np.random.default_rng(0).integers(0, len(means), (2000, len(means)))
    with np.errstate(invalid="ignore"):
        made = [float(np.corrcoef(computed[row], means[row])[0, 1]) for row in rows]
        r, rho = (float(np.corrcoef(*map(of, (computed, means)))[0, 1]) for of in (np.asarray, rankdata))
    low, high = np.nanquantile(made, [0.025, 0.975]) if np.isfinite(made).any() else (np.nan, np.nan)
    return Agreement(
        len(judges), len(numbers), r, rho, (float(low), float(high)), float((means - computed).mean()),
        _between(marks, judges),
    )  # fmt: skip


def _between(marks: dict[int, dict[str, float]], judges: Sequence[str]) -> float | None:
    found = []
    for judge in judges:
        both = [
            (of[judge], float(np.mean([m for j, m in of.items() if j != judge])))
            for of in marks.values() if judge in of and len(of) > 1
        ]  # fmt: skip
        if len(both) >= 3:
            found.append(np.corrcoef(*np.array(both).T)[0, 1])
    kept = [r for r in found if np.isfinite(r)]
    return float(np.mean(kept)) if kept else None


def _side_by_side(pair: Pair) -> list[tuple[Trial, Trial]]:
    """Trials of a and b that are shown together: of one start, or in order if no start is shared."""

    def of(trials: Sequence[Trial], start: str | None = None) -> list[Trial]:
        return sorted((t for t in trials if start in (None, t.start)), key=lambda t: (t.start, t.unit))

    shared = sorted({t.start for t in pair.a} & {t.start for t in pair.b})
    made = []
    for start in shared or (None,):
        a, b = of(pair.a, start), of(pair.b, start)
        made += [(a[k % len(a)], b[k % len(b)]) for k in range(max(len(a), len(b)))]
    return made


def _film(trial: Trial, origin: Floats) -> dict[str, list[float]]:
    x, y, heading = (trial.x - origin[0]).round(2), (trial.y - origin[1]).round(2), trial.heading.round(3)
    return {"x": x.tolist(), "y": y.tolist(), "h": heading.tolist()}
