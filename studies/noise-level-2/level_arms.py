"""The arms of the second study of the level of noise: read, judged, and set against every other analysis."""

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import level_tests as lt
import numpy as np
import pandas as pd
from common import estimate, number, settings, table
from level_tests import PLAN, Peak, Scores

HERE = Path(__file__).resolve().parent
DESIGN = tomllib.loads((HERE / "arms.toml").read_text("utf-8"))["arm"]
"""By arm, in the plan's order; T5 was not run."""
KEY = ["task", "seed_set", "run", "evolved_level", "individual"]
FEEDS = {"infrared": "obstacle-avoidance", "ambient": "light-seeking"}
"""The channel that a task feeds."""
LIMITS = {"infrared": 2.0, "ambient": 1.0}
"""Deviations of the noise beyond which a model is too wrong for a claim about noise (the plan)."""
BEYOND = "without units beyond the limit"
FITTEST = "fittest individual"


def probability(p: float) -> str:
    """A p-value as printed."""
    return "< .0001" if p < 1e-4 else f"{p:.4f}".lstrip("0") if p < 0.9999 else "1"


@dataclass(frozen=True, eq=False)
class Arm:
    """One arm: its champions, and again by other scores and other individuals."""

    name: str
    settings: dict[str, Any]
    champions: Scores
    again: dict[str, Scores]
    calibration: pd.DataFrame
    beyond: list[int]

    @property
    def void(self) -> bool:
        """Whether the models err too much, on too many units, for any claim about noise."""
        return len(self.beyond) > PLAN["misfit"] * self.calibration["unit"].nunique()

    @cached_property
    def judged(self) -> pd.DataFrame:
        """The planned comparisons."""
        return lt.judge(self.champions)

    @cached_property
    def robust(self) -> dict[str, pd.DataFrame]:
        """The same by each other analysis, with a tenth of the permutations; they change no verdict."""
        fewer = PLAN["permutations"] // 10
        return {
            name: lt.judge(scores, permutations=fewer, bound=0.0 if name == "fitness" else PLAN["bound"])
            for name, scores in self.again.items()
        }

    @cached_property
    def mixed(self) -> dict[tuple[str, str], lt.Tested]:
        """Mixed models beside (b) by means and (d)."""
        return lt.by_mixed_models(self.champions)

    @cached_property
    def peak(self) -> Peak:
        """(e) as planned."""
        return lt.peak_of(self.champions)

    @cached_property
    def peaks(self) -> dict[str, Peak]:
        """(e) by the other analyses."""
        return {name: lt.peak_of(scores) for name, scores in self.again.items() if name != "fitness"}

    def word(self, claim: dict[str, str]) -> str:
        """The verdict on a claim."""
        if self.void:
            return "no claim"
        return self.peak.word if claim["key"] == "e" else lt.verdict(list(of(self.judged, claim)["found"]))


def of(judged: pd.DataFrame, claim: dict[str, str]) -> pd.DataFrame:
    """A claim's comparisons."""
    return judged[(judged["claim"] == claim["key"]) & (judged["by"] == claim["by"])]


def read_arm(name: str) -> Arm:
    """An arm from its archived tables."""
    folder = f"noise-level-2/{name}"
    who = table(f"{folder}/controllers.csv")
    cells = table(f"{folder}/cells.csv").pivot(index=KEY, columns="comparison_level")
    cells = cells.loc[pd.MultiIndex.from_frame(who[KEY])].reset_index(drop=True)
    champion = (who["individual"] == "champion").to_numpy()
    whole = Scores(who, cells["score"], cells["score_home"])
    champions = whole.keep(champion)
    calibration = table(f"{folder}/calibration.csv").dropna(subset="ratio")
    fed = [channel for channel, task in FEEDS.items() if task in set(who["task"])]
    far = calibration["ratio"] > calibration["channel"].map(LIMITS)
    beyond = sorted(set(calibration.loc[far & calibration["channel"].isin(fed), "unit"]))
    again = {
        "without jitter": Scores(who, cells["without_jitter"], cells["without_jitter_home"]).keep(champion),
        "layout alone": Scores(who, cells["layout"], cells["layout_home"]).keep(champion),
        "fitness": _fitness(champions),
        FITTEST: replace(whole, score=whole.home).keep(~champion),
    }
    if beyond and not champions.who["home_unit"].isin(beyond).all():
        again[BEYOND] = champions.keep(~champions.who["home_unit"].isin(beyond).to_numpy())
    return Arm(name, settings(f"{folder}/study.toml"), champions, again, calibration, beyond)


def _fitness(champions: Scores) -> Scores:
    """Fitness on the robot in place of the scores, in deviations within the task; alike at every level."""
    made = []
    for name in ("fitness_situated", "fitness_situated_home"):
        of_task = champions.who.groupby("task")[name]
        scaled = (champions.who[name] - of_task.transform("mean")) / of_task.transform("std", ddof=0)
        made.append(pd.DataFrame(dict.fromkeys(champions.score.columns, scaled)))
    return Scores(champions.who, *made)


def secondary(arm: Arm, row: Any) -> Iterator[tuple[str, float, str, Any]]:
    """A comparison by each other analysis that has it: name, sign, text, and its row if it has one."""
    for name, judged in arm.robust.items():
        asked = (
            row.claim in "bc" and row.by != "failures"
            if name == "fitness"
            else row.claim != "d" or name == BEYOND
        )
        other = judged[(judged[["claim", "by", "against"]] == [row.claim, row.by, row.against]).all(axis=1)]
        if asked and len(other):
            one = next(other.itertuples())
            yield name, np.sign(one.statistic), f"{number(one.effect, signed=True)}, {one.found}", one
    if row.by in ("means", "slopes") and (row.claim, row.against) in arm.mixed:
        fit = arm.mixed[row.claim, row.against]
        yield (
            "mixed model",
            np.sign(fit.statistic),
            f"{number(fit.effect, signed=True)}, p {probability(fit.p)}",
            None,
        )


def contrary(arm: Arm, claim: dict[str, str]) -> dict[str, list[str]]:
    """The other analyses that contradict a claim's verdict, for the headline.

    Of every comparison, found or not: an analysis of another sign, as the plan asks; where it was found, one
    by which it is not; where half a point was excluded, one by which it is not. Of (e): another word.
    """
    if claim["key"] == "e":
        other = [
            f"{arm.name} {name} ({peak.word})"
            for name, peak in arm.peaks.items()
            if peak.word != arm.peak.word
        ]
        return {"otherwise": other}
    made: dict[str, list[str]] = {"of another sign": [], "not found": [], "half a point not excluded": []}
    for row in of(arm.judged, claim).itertuples():
        where = f"{'over' if row.claim == 'd' else 'against'} {row.against}"
        if row.claim == "c" and row.difference * row.statistic < 0:
            made["of another sign"].append(f"{arm.name} means {where}")
        for name, sign, _, other in secondary(arm, row):
            text = f"{arm.name} {name} {where}"
            if sign * row.statistic < 0:
                made["of another sign"].append(text)
            elif row.found == "for" and other is not None and other.found != "for":
                made["not found"].append(text)
            if row.found == "absent" and name not in ("fitness", "mixed model") and other.found != "absent":
                span = estimate(other.difference, other.low, other.high, signed=True)
                made["half a point not excluded"].append(f"{text} by {span}")
    return made


def headline(arms: Sequence[Arm], claim: dict[str, str]) -> str:
    """The joint verdict of the arms that a headline needs, and every analysis that contradicts it."""
    agreed = [arm for arm in arms if arm.name in PLAN["agree"]]
    words = {arm.word(claim) for arm in agreed}
    parts = [words.pop() if len(words) == 1 else "they differ"]
    told = [contrary(arm, claim) for arm in agreed]
    for kind in told[0]:
        if named := [text for one in told for text in one[kind]]:
            parts.append(f"{kind}: {', '.join(named)}")
    return "; ".join(parts)
