"""The three claims about the level of noise, stated beforehand, and the verdicts on them.

`docs/noise-level.md` has the same texts and the analysis as it was planned before there were data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["CLAIMS", "VERDICTS", "Claim"]


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One claim: `key` a, b or c; a title; what it says; how it is tested."""

    key: str
    title: str
    text: str
    test: str


CLAIMS = (
    Claim(
        key="a",
        title="Comparison level",
        text="A robot's tracks look most like a simulation whose noise equals the robot's, whatever the "
        "controller was evolved under.",
        test="Paired: the same controller against the simulation at both levels; all controllers. "
        "Wilcoxon's signed-rank test.",
    ),
    Claim(
        key="b",
        title="Evolved level",
        text="Judged against one and the same simulation, whose noise equals the robot's, controllers "
        "evolved at the robot's noise score best.",
        test="Unpaired: controllers evolved at either level, of one task and home unit. Mann and "
        "Whitney's test, stratified.",
    ),
    Claim(
        key="c",
        title="The paper's diagonal",
        text="Judged each against the simulation that it was evolved in, controllers evolved at the "
        "robot's noise score best.",
        test="Unpaired, as (b).",
    ),
)

VERDICTS = {
    "opposite": "the robot's level is below zero or double noise, and above neither",
    "elsewhere": "it is below any level: another level does better",
    "supported": "it is above zero and above double noise, the paper's comparison",
    "in part": "it is above one of the two",
    "not supported": "it is above neither",
}
"""In the order in which they are tried. Above: Cliff's delta positive in every seed set alone, and the
p of all sets together, by Holm over all planned comparisons, below .05. Below: likewise negative."""
