"""What shows that a score is right: known differences, and what it makes of them.

Nothing here sets anything: it is run by the tests and by the command that draws the figures of
docs/correspondence.md.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from realitygap.correspondence.exemplars.ladders import GAINS, NOISES, Behaviour
from realitygap.correspondence.names import NONE, namer
from realitygap.correspondence.scale import exemplar_scale
from realitygap.correspondence.score import Comparison, compare
from realitygap.correspondence.setting import Setting, setting_of
from realitygap.correspondence.statistics import correlation
from realitygap.correspondence.trials import Trial
from realitygap.correspondence.words import ANOTHER, PAPER_SCORES
from realitygap.tasks.load import load_task

__all__ = ["Ladder", "against", "climb", "held_out", "order_of_phrases", "phrase_scores"]

STARTS = 12


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
        return correlation([-float(i) for i in range(len(self.steps))], self.scores, resamples=1).rho


def climb(behaviour: Behaviour, what: str, *, starts: int = STARTS) -> Ladder:
    """A ladder of `what`, "gain", "steering" or "noise"."""
    steps = NOISES if what == "noise" else GAINS
    ours = behaviour.trials(starts)
    rungs = []
    for step in steps:
        worse = {"noise": 1.0, "gain": 1.0, "steering": 1.0, what: step}
        theirs = behaviour.trials(
            starts, again=5, noise=worse["noise"], gain=worse["gain"], steering=worse["steering"]
        )
        rungs.append(against(behaviour, ours, theirs))
    return Ladder(behaviour=behaviour, what=what, steps=steps, rungs=tuple(rungs))


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
    return correlation(ours, [PAPER_SCORES[phrase] for phrase in phrases], resamples=1).rho


def held_out(task: str, trials: dict[str, Sequence[Trial]]) -> dict[str, float]:
    """Share of trials of each kind that get their kind's name (a kind of nobody: "none of these")."""
    from realitygap.correspondence.exemplars.kinds import KINDS

    setting = setting_for(task)
    names = namer(setting)
    return {
        kind: float(np.mean([
            found.name == (kind if kind in KINDS[task] else NONE) for found in names.name(of, setting)
        ]))
        for kind, of in trials.items()
    }  # fmt: skip
