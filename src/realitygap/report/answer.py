"""What a study found, said first: for each task a sentence with its test, a plot of the runs, one caveat.

Noise levels are compared by the champions' correspondence scores where they drove a robot, else by their test
scores in simulation. Which of several means is the highest was not known beforehand, so the test is one for
all pairs: Games and Howell's, which is Tukey's without the assumption of equal variances.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import tukey_hsd

from realitygap.report.evolution import Mean, TaskPart, mean_of
from realitygap.report.scores import PaperRow, ScoreTable
from realitygap.report.style import COLUMN, INK, MUTED, NoiseStyle, new_figure, noise_styles, number
from realitygap.robots.address import ROBOT

__all__ = ["Answer", "RunsRow", "answer_figure", "answer_of", "caveats", "counted", "draw_runs"]

SIGNIFICANT = 0.05
FEW_STARTS = 8
"""Below this number of starts two different robots can look alike."""
TOP = 10.0
"""The highest correspondence score."""
MOST = 3
"""Other levels that a sentence names one by one."""
WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
STAND_INS = {
    "twin": "the twin is a physics model of the robot that shares no code with the simulation",
    "stranger": "the stranger is a second twin, outside the family of laws that a calibration can fit",
    "Enki": "Enki is EPFL’s simulator",
}


def counted(many: int, noun: str) -> str:
    """As in a sentence: one run, five runs, 12 runs."""
    return f"{WORDS[many] if many < len(WORDS) else many} {noun}{'s' * (many != 1)}"


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a task's runs say of its noise levels.

    Attributes:
        what: is compared, such as "correspondence score"; where: such as "on the twin".
        unit: of the values; places: decimal places shown.
        names: of the levels with values, rising; values: of each run, in `unit`.
        own: half the 95 % interval of a run's own value, by level; what a level with one run shows.
        paper: rows of the paper's table by level, where it has a score to compare with.
    """

    what: str
    where: str
    unit: str
    places: int
    names: Mapping[float, str]
    values: Mapping[float, Sequence[float]]
    own: Mapping[float, float]
    paper: Mapping[float, Sequence[PaperRow]]

    @cached_property
    def means(self) -> dict[float, Mean]:
        """Over the runs of each level, best first; a single run's interval is its own."""
        found = {level: mean for level, of in self.values.items() if (mean := mean_of(of)) is not None}
        for level, mean in found.items():
            if mean.count == 1:
                found[level] = replace(mean, half=self.own.get(level, math.nan))
        return dict(sorted(found.items(), key=lambda one: -one[1].value))

    @cached_property
    def p_values(self) -> dict[float, float]:
        """Of the best level's difference from each other one; empty where one has a single run."""
        levels = list(self.means)
        if len(levels) < 2 or min(mean.count for mean in self.means.values()) < 2:
            return {}
        with np.errstate(all="ignore"):
            found = tukey_hsd(*(self.values[level] for level in levels), equal_var=False).pvalue[0, 1:]
        return dict(zip(levels[1:], map(float, found), strict=True))

    def text(self, level: float) -> str:
        """A level's mean with its unit, and ± where its interval is known."""
        text = self.means[level].text(self.places)
        return f"({text}) {self.unit}" if self.unit and "±" in text else f"{text} {self.unit}".rstrip()

    def _number(self, value: float) -> str:
        return number(value, self.places)

    @property
    def found(self) -> str:
        """The answer in some words."""
        if not self.means:
            return "There is no score yet"
        level, *others = self.means
        if not others:
            whose = "The champion" if self.means[level].count == 1 else "The champions"
            return f"{whose} evolved at {self.names[level]} noise: {self.what} {self.text(level)}"
        if len(self._highest) > 1:
            return f"{_listed(self._highest).capitalize()} noise came out alike"
        return f"{self.names[level].capitalize()} noise came out best"

    @property
    def detail(self) -> str:
        """The rest of the sentence: the numbers, the paper's order, the test."""
        if not self.means:
            return "no run has finished."
        level, *others = self.means
        if not others:
            count = self.means[level].count
            of = "one run" if count == 1 else f"mean of {counted(count, 'run')}"
            of += ", ± its 95 % interval" * ("±" in self.text(level))
            if self.paper.get(level):
                of += f"; the paper’s runs: {number(self._paper_mean(level), 1)}"
            return f"{self.where} ({of}). No other level has a score to compare it with."
        rest = [f"{self._number(self.means[one].value)} at {self.names[one]}" for one in sorted(others)]
        against = f"{_listed(rest)} noise"
        if len(others) > MOST:
            low, high = (self._number(self.means[one].value) for one in (others[-1], others[0]))
            against = f"{low} to {high} at the {counted(len(others), 'other level')}"
        best = f"{self.what} {self.where} {self.text(level)}, against {against}"
        return f"{best}{self._paper_order(level)}; {self._tested()}."

    @property
    def _highest(self) -> list[str]:
        """The levels whose means are shown as the highest."""
        shown = {level: self._number(mean.value) for level, mean in sorted(self.means.items())}
        return [self.names[level] for level, text in shown.items() if text == shown[next(iter(self.means))]]

    def _paper_mean(self, level: float) -> float:
        return float(np.mean([row.correspondence for row in self.paper[level]]))

    def _paper_order(self, best: float) -> str:
        if not all(map(self.paper.get, self.means)):
            return ""
        theirs = max(self.means, key=self._paper_mean)
        if theirs == best and len(self._highest) == 1:
            return ", as in the paper"
        return f" (in the paper {self.names[theirs]} noise did best)"

    def _tested(self) -> str:
        counts, p = sorted(mean.count for mean in self.means.values()), dict(sorted(self.p_values.items()))
        few = counted(counts[0], "run") if counts[0] == counts[-1] else f"{counts[0]} to {counts[-1]} runs"
        if counts[0] < 2:
            return f"with {few} a level chance may have chosen the order"
        if not all(map(math.isfinite, p.values())):
            return f"with {few} a level, some without any spread, no test is possible"
        yes, no = ([self.names[k] for k in p if (p[k] < SIGNIFICANT) is kind] for kind in (True, False))
        shown = _listed([f"{_p(p[k])} against {self.names[k]}" for k in p])
        verdict = f"the difference is{' not' * bool(no)} significant"
        if len(p) > MOST:
            shown = " to ".join(dict.fromkeys((_p(min(p.values())), _p(max(p.values())))))
            verdict = f"the difference is significant from {len(yes)} of these {len(p)}"
        elif yes and no:
            verdict = f"the difference from {_listed(no)} noise is not significant, "
            verdict += f"the one from {_listed(yes)} noise is"
        return f"with {few} a level {verdict} (Games–Howell test: {shown})"


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _p(value: float) -> str:
    return "p < 0.001" if value < 0.001 else f"p = {value:.2g}"


def answer_of(part: TaskPart, tables: Sequence[ScoreTable]) -> Answer:
    """A task's answer: by the first score table that has correspondence scores, else by test scores."""
    table = next((one for one in tables if any(c.values("correspondence") for c in one.classes)), None)
    if table is not None:
        ends = [(m.low, m.high, c.level) for c in table.classes for m in c.marks]
        own = {level: (high - low) / 2 for low, high, level in ends if low is not None and high is not None}
        return Answer(
            what="correspondence score",
            where="on a robot" if table.kind == ROBOT else f"on the {table.kind}",
            unit="", places=1, own=own,
            names={c.level: c.name for c in table.classes},
            values={c.level: c.values("correspondence") for c in table.classes},
            paper={c.level: c.paper for c in table.classes if c.paper},
        )  # fmt: skip
    level = 1.0 if 1.0 in part.levels else min(part.levels, default=1.0)
    scale, tested = part.task.fitness_scale, [(c.level, row) for c in part.conditions for row in c.rows]
    means = {at: mean for at, row in tested if (mean := row.mean("champion", level)) is not None}
    return Answer(
        what="test score", where=f"in simulation at {part.levels.get(level, '')} noise",
        unit=part.unit, places=part.places,
        own={at: mean.half / scale for at, mean in means.items()},
        names={c.level: c.name for c in part.conditions},
        values={c.level: [value / scale for value in c.means("champion", level)] for c in part.conditions},
        paper={},
    )  # fmt: skip


def caveats(kinds: Sequence[str], robots: int, starts: int) -> list[str]:
    """How far a study's results bear, a sentence each.

    Args:
        kinds: of robots that were driven.
        robots: their number.
        starts: the smallest number of starts behind a correspondence score; 0 without any.
    """
    names = [kind.split()[0] for kind in kinds]
    if not names:
        return ["No robot was driven: all scores are of the simulation, and say nothing about a robot."]
    found = [f"{said[0].upper()}{said[1:]}." for name, said in STAND_INS.items() if name in names]
    if ROBOT not in names:
        found = ["No robot was driven, and what holds here need not hold on one.", *found]
    if robots == 1:
        found.append("All trials were on one unit: another may come out otherwise.")
    if 0 < starts < FEW_STARTS:
        found.append(f"Scores rest on {counted(starts, 'start')}; fewer than eight tend to be too high.")
    return found


def answer_figure(answer: Answer, levels: Sequence[float]) -> Figure:
    """A row a noise level, highest noise first. `levels` are all of the page, so that each has one look."""
    styles, rows = noise_styles(levels), []
    for level in sorted(answer.means, reverse=True):
        name, theirs = f"{answer.names[level]} noise", [r.correspondence for r in answer.paper.get(level, ())]
        rows.append(RunsRow(name, styles[level], answer.values[level], answer.means[level], theirs))
    figure = new_figure(COLUMN * 1.2, 0.62 + 0.44 * len(rows), layout="constrained")
    label = f"{answer.what} {answer.where}" + (f" ({answer.unit})" if answer.unit else "")
    draw_runs(figure.add_subplot(), rows, label, TOP if answer.what == "correspondence score" else None)
    return figure


class RunsRow(NamedTuple):
    """Some runs in a plot: each one's value, their mean, and the paper's runs."""

    name: str
    look: NoiseStyle
    values: Sequence[float]
    mean: Mean
    paper: Sequence[float] = ()


def draw_runs(ax: Axes, rows: Sequence[RunsRow], label: str, top: float | None = None) -> None:
    """A row each, the first below: means with their 95 % intervals, runs above them, the paper's below them.
    Values are scores from 0 to `top`, if there is one."""
    for y, (_, look, values, mean, theirs) in enumerate(rows):
        ends = np.array([mean.value - mean.half, mean.value + mean.half])
        ends = ends if top is None else np.clip(ends, 0.0, top)
        if np.isfinite(ends).all():
            ax.plot(ends, [y, y], color=look.colour, linestyle=look.line, marker="|", markersize=7)
        ax.plot(
            [mean.value], [y], look.marker, color=look.colour, markersize=7, markeredgecolor=INK, zorder=4
        )
        ax.plot(
            np.sort(values), np.full(len(values), y + 0.27), look.marker, color=look.colour, markersize=4,
            markerfacecolor="none", zorder=3, visible=mean.count > 1,
        )  # fmt: skip
        if theirs:
            ax.plot(theirs, np.full(len(theirs), y - 0.27), "x", color=MUTED, markersize=3.5)
            ax.plot([np.mean(theirs)], [y - 0.27], "*", color=MUTED, markersize=8, markeredgecolor=INK,
                    markeredgewidth=0.5, zorder=3)  # fmt: skip
    ax.set(ylim=(-0.55, len(rows) - 0.45), yticks=range(len(rows)), xlabel=label)
    ax.set_yticklabels([row.name for row in rows])
    if top is not None:
        ax.set_xlim(-0.2, top + 0.2)
    elif ax.get_xlim()[0] > 0:
        ax.set_xlim(left=0)
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="x")
    ax.set_axisbelow(True)
