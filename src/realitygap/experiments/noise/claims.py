"""The three claims about noise levels, stated in advance, and the verdicts on them.

`docs/noise-level.md` has the same texts and the analysis as planned before there were data.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from realitygap.experiments.noise.contrasts import Effect, holm, paired
from realitygap.experiments.noise.crossed import Crossed
from realitygap.values import Floats

__all__ = [
    "ALPHA", "CLAIMS", "VERDICTS", "Claim", "Contrast", "Finding", "Split", "coarse_levels",
    "judge_claims", "judge_home", "split_diagonal",
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One claim: `key` a, b or c; a title; its statement; its test.

    `measured`: how the measured quantity differs from the stated one.
    """

    key: str
    title: str
    text: str
    test: str
    measured: str = ""


_STATED = tomllib.loads(Path(__file__).with_name("claims.toml").read_text("utf-8"))
CLAIMS = tuple(Claim(**one) for one in _STATED["claim"])

VERDICTS = {
    "opposite": "the robot's level is below zero or double noise, and above neither",
    "elsewhere": "it is below any level: another level does better",
    "supported": "it is above zero and above double noise, the paper's comparison",
    "in part": "it is above one of the two",
    "not supported": "it is above neither",
}
"""In the order in which they are tried. Above: Cliff's delta positive in every seed set alone, and the p of
all sets together, Holm-corrected over all planned comparisons, below .05. Below: likewise negative."""

ALPHA = 0.05
RESAMPLES = 2000


@dataclass(frozen=True, kw_only=True)
class Contrast:
    """The robot's level against another, for one claim; `found` is above, below or open.

    `first`, `second`: numbers of controllers on either side (the same ones for claim a); `sets`: the effect
    in each seed set alone.
    """

    level: float
    other: float
    first: int
    second: int
    means: tuple[float, float]
    effect: Effect
    sets: Mapping[int, Effect]
    p_holm: float = 1.0
    found: str = "open"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A claim, its contrasts, and the verdict on it; `coarse` are the levels that decide it."""

    claim: Claim
    contrasts: tuple[Contrast, ...]
    coarse: tuple[float, ...]
    verdict: str


def judge_claims(data: Crossed, *, resamples: int = RESAMPLES) -> tuple[Finding, ...]:
    """All three claims by the planned analysis, with one Holm correction over all their contrasts.

    Args:
        data: one task's controllers, or all.
        resamples: of the bootstrap; 0: no intervals.
    """
    others = [float(level) for level in data.levels if level != data.robot]
    weights = data.resamples(resamples)
    tests = {
        "a": (_by_comparison, data.score), "b": (_by_evolved, data.at(data.robot)),
        "c": (_by_evolved, data.own()),
    }  # fmt: skip
    made = {key: [_contrast(data, *test, other, weights) for other in others] for key, test in tests.items()}
    corrected = iter(holm([c.effect.p for contrasts in made.values() for c in contrasts]))
    coarse = coarse_levels(data.levels.tolist(), data.robot)
    findings = []
    for claim in CLAIMS:
        contrasts = tuple(_found(contrast, next(corrected)) for contrast in made[claim.key])
        findings.append(
            Finding(claim=claim, contrasts=contrasts, coarse=coarse, verdict=verdict(contrasts, coarse))
        )
    return tuple(findings)


def judge_home(data: Crossed, *, resamples: int = RESAMPLES) -> tuple[Contrast, ...]:
    """Claim (c) on the calibration unit alone: each controller against the same simulation that it evolved
    in.

    Not planned, so Holm's correction is over these contrasts alone. Levels without such scores in any task
    and seed set are left out.
    """
    wanted = set(zip(data.task.tolist(), data.seed_set.tolist(), strict=True))
    data = data.only(np.isfinite(data.own(home=True)))
    cells = set(zip(data.task.tolist(), data.seed_set.tolist(), data.evolved.tolist(), strict=True))
    there = [level for level in data.levels.tolist() if all((*pair, level) in cells for pair in wanted)]
    if data.robot not in there:
        return ()
    others = [level for level in there if level != data.robot]
    weights = data.resamples(resamples)
    made = [_contrast(data, _by_evolved, data.own(home=True), other, weights) for other in others]
    corrected = holm([c.effect.p for c in made])
    return tuple(_found(contrast, p) for contrast, p in zip(made, corrected, strict=True))


@dataclass(frozen=True, kw_only=True)
class Split:
    """The diagonal's difference from one level in two steps, in either order.

    `diagonal` is the sum of `evolved_first` and `comparison_after`, and of `comparison_first` and
    `evolved_after`, for means; Cliff's deltas do not add up.

    Attributes:
        evolved_first: the robot's evolved level against the other, both judged at the robot's level.
        comparison_after: controllers evolved at the other level, judged at the robot's and at that.
        comparison_first: controllers evolved at the robot's level, judged at that and at the other.
        evolved_after: the robot's evolved level against the other, both judged at the other level.
    """

    other: float
    diagonal: Effect
    evolved_first: Effect
    comparison_after: Effect
    comparison_first: Effect
    evolved_after: Effect


def split_diagonal(data: Crossed, *, resamples: int = RESAMPLES) -> tuple[Split, ...]:
    """The diagonal's difference from every other level, split into evolved and comparison level."""
    weights, every = data.resamples(resamples), np.arange(len(data))
    mine, made = np.flatnonzero(data.evolved == data.robot), []
    for other in (float(level) for level in data.levels if level != data.robot):
        theirs = np.flatnonzero(data.evolved == other)
        made.append(
            Split(
                other=other,
                diagonal=_by_evolved(data, data.own(), other, every, weights)[0],
                evolved_first=_by_evolved(data, data.at(data.robot), other, every, weights)[0],
                comparison_after=_by_comparison(data, data.score, other, theirs, weights)[0],
                comparison_first=_by_comparison(data, data.score, other, mine, weights)[0],
                evolved_after=_by_evolved(data, data.at(other), other, every, weights)[0],
            )
        )
    return tuple(made)


def coarse_levels(levels: Sequence[float], robot: float) -> tuple[float, ...]:
    """Zero and double, if the study has them; with neither, the nearest levels below and above."""
    paper = tuple(level for level in (0.0, 2 * robot) if level in levels and level != robot)
    if paper:
        return paper
    below, above = [lv for lv in levels if lv < robot], [lv for lv in levels if lv > robot]
    return tuple([max(below)] if below else []) + tuple([min(above)] if above else [])


def verdict(contrasts: Sequence[Contrast], coarse: Sequence[float]) -> str:
    """The verdict on a claim: see VERDICTS."""
    deciding = [c.found for c in contrasts if c.other in coarse]
    if "below" in deciding and "above" not in deciding:
        return "opposite"
    if any(c.found == "below" for c in contrasts):
        return "elsewhere"
    above = deciding.count("above")
    return "not supported" if not above else "supported" if above == len(deciding) else "in part"


def _found(contrast: Contrast, p: float) -> Contrast:
    deltas = [effect.delta for effect in contrast.sets.values()]
    signs = {float(np.sign(delta)) if math.isfinite(delta) else 0.0 for delta in deltas}  # nan: none there
    word = "open" if p >= ALPHA or len(signs) > 1 else {1.0: "above", -1.0: "below"}.get(signs.pop(), "open")
    return replace(contrast, p_holm=p, found=word)


def _contrast(
    data: Crossed, compare: _Compare, values: Floats, other: float, weights: Floats | None
) -> Contrast:
    every = np.arange(len(data))
    whole, first, second = compare(data, values, other, every, weights)
    alone = {s: np.flatnonzero(data.seed_set == s) for s in data.sets}
    sets = {s: compare(data, values, other, rows, None)[0] for s, rows in alone.items()}
    means = float(first.mean()), float(second.mean())
    return Contrast(
        level=data.robot, other=other, first=len(first), second=len(second), means=means, effect=whole,
        sets=sets,
    )  # fmt: skip


_Compared = tuple[Effect, Floats, Floats]
_Compare = Callable[[Crossed, Floats, float, NDArray[np.int64], Floats | None], _Compared]


def _by_comparison(
    data: Crossed, scores: Floats, other: float, rows: NDArray[np.int64], weights: Floats | None
) -> _Compared:
    """The same controllers' scores at the robot's level and at another."""
    first, second = scores[rows, data.index(data.robot)], scores[rows, data.index(other)]
    return paired(first, second, None if weights is None else weights[:, rows]), first, second


def _by_evolved(
    data: Crossed, values: Floats, other: float, rows: NDArray[np.int64], weights: Floats | None
) -> _Compared:
    """Controllers evolved at the robot's level against those evolved at another."""
    mine, theirs = rows[data.evolved[rows] == data.robot], rows[data.evolved[rows] == other]
    return data.between(values, mine, theirs, weights), values[mine], values[theirs]
