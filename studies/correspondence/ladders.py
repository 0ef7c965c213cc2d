"""Known differences, to try a score on: one robot against itself with one thing made worse, by steps.

Infrared gain 1 → 0.15 makes a robot less responsive, and so does light gain where a controller waits for
a certain light; noise × 1 → × 8 makes it noisier. Controllers that only compare two sides do not heed a
light gain. Steering does for all light seekers what the gain does for these: of the turn that it means
to make, the robot makes 1 → 0.15.

Nothing here sets anything: it serves analyse.py and the tests.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.stats import spearmanr
from studies.correspondence.kinds import KINDS, Behaviour

from realitygap.correspondence.score import ANOTHER, Comparison, compare, exemplar_scale
from realitygap.correspondence.setting import Setting, setting_of
from realitygap.correspondence.trials import Trial
from realitygap.report.scores import PAPER_ROWS
from realitygap.tasks.load import load_task
from realitygap.world.robot import Profile, load_profile

STARTS = 12
_PRINTED = [row for levels in PAPER_ROWS.values() for rows in levels.values() for row in rows]
PAPER_SCORES = {
    phrase: float(np.mean([row.correspondence for row in _PRINTED if row.differences == phrase]))
    for phrase in {row.differences: 0 for row in _PRINTED}
}
"""Mean correspondence scores that the paper's judges gave with each phrase."""
GAINS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
NOISES = (1.0, 1.5, 2.0, 3.0, 4.5, 6.0, 8.0)
"""Factors on the observed noise."""
COMPARERS = ("two way turner", "bobber")
"""Light seekers that compare two sides: their gain is no ladder."""


def behaviours(seed: int = 0) -> list[Behaviour]:
    """One robot of each of the paper's kinds, by task."""
    return [Behaviour(task=task, kind=kind, seed=seed) for task, kinds in KINDS.items() for kind in kinds]


def ladders_of(behaviour: Behaviour) -> tuple[str, ...]:
    """What a behaviour's ladders are made of: "noise", and "gain" and "steering" where it heeds them."""
    if behaviour.task == "obstacle-avoidance":
        return ("gain", "noise")
    return ("steering", "noise") if behaviour.kind in COMPARERS else ("gain", "steering", "noise")


@dataclass(frozen=True, kw_only=True)
class Ladder:
    """One robot against itself, worse and worse.

    Attributes:
        behaviour: the robot.
        what: "gain", "steering" or "noise".
        steps: the ladder's values.
        rungs: the comparison at each.
    """

    behaviour: Behaviour
    what: str
    steps: tuple[float, ...]
    rungs: tuple[Comparison, ...]

    @property
    def scores(self) -> list[float]:
        """Score at each step."""
        return [rung.score for rung in self.rungs]

    @property
    def spearman(self) -> float:
        """Of the steps away from 1 with the scores, downwards: 1 is monotone; NaN: flat."""
        return float(spearmanr(range(0, -len(self.steps), -1), self.scores).statistic)


@cache
def lives(behaviour: Behaviour, **changed: Any) -> list[Trial]:
    """Its trials, for all tests that ask for them."""
    return behaviour.trials(STARTS, **changed)


def climb(behaviour: Behaviour, what: str) -> Ladder:
    """A ladder of `what`, "gain", "steering" or "noise"; it begins at 1, the robot as it is."""
    steps = NOISES if what == "noise" else GAINS
    ours = lives(behaviour)
    rungs = []
    for step in steps:
        profile = WORSE[what](load_profile("paper"), step) if what in WORSE else None
        noise = step if what == "noise" else 1.0
        worse = {} if step == 1 else {"profile": profile, "noise": noise}
        theirs = lives(behaviour, again=5, **worse)
        rungs.append(against(behaviour, ours, theirs))
    return Ladder(behaviour=behaviour, what=what, steps=steps, rungs=tuple(rungs))


def with_steering(profile: Profile, share: float) -> Profile:
    """The robot with a wider track, so that it makes a `share` of the turn that its wheels mean."""
    return replace(profile, wheels=replace(profile.wheels, track_cm=profile.wheels.track_cm / share))


def with_gain(profile: Profile, gain: float) -> Profile:
    """The robot with all infrared and light sensors' gains changed."""
    infrared, ambient = profile.infrared, profile.ambient
    near = tuple(replace(s, a=s.a * gain, b=s.b * gain) for s in infrared.sensors)
    lit = tuple(replace(s, gain=s.gain * gain) for s in ambient.sensors)
    return replace(profile, infrared=replace(infrared, sensors=near), ambient=replace(ambient, sensors=lit))


WORSE = {"gain": with_gain, "steering": with_steering}


def against(behaviour: Behaviour, a: Sequence[Trial], b: Sequence[Trial]) -> Comparison:
    """Two sets of trials of a behaviour's task on the exemplars' scale."""
    setting = setting_for(behaviour.task)
    return compare(a, b, setting, scale=exemplar_scale(setting.exemplars, len(a), len(b)), resamples=2)


def setting_for(task: str) -> Setting:
    """The setting of one of the paper's tasks."""
    return setting_of([], load_task(task))


def phrase_scores(comparisons: Iterable[Comparison]) -> dict[str, tuple[float, int]]:
    """Mean score and count of each of the paper's phrases that was said first, be it of another behaviour."""
    found = defaultdict(list)
    for made in comparisons:
        phrase = made.differences.removeprefix(f"{ANOTHER}, ").split(",")[0]
        if phrase in PAPER_SCORES:
            found[phrase].append(made.score)
    return {phrase: (float(np.mean(scores)), len(scores)) for phrase, scores in found.items()}


def order_of_phrases(said: dict[str, tuple[float, int]], *, least: int = 3) -> float:
    """Spearman's rho of mean scores by phrase with the paper's; phrases said `least` times count."""
    phrases = [phrase for phrase, (_, count) in said.items() if count >= least]
    ours = [said[phrase][0] for phrase in phrases]
    return float(spearmanr(ours, [PAPER_SCORES[phrase] for phrase in phrases]).statistic)
