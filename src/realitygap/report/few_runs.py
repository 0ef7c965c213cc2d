"""What few runs at each level can show: their averages beside the paper's and a kept study's."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure

from realitygap.report.page import Words
from realitygap.report.scores import ScoreClass, ScoreTable
from realitygap.report.statistics import mean_of
from realitygap.report.style import COLUMN, INK, MUTED, new_figure, noise_styles

__all__ = ["KEPT_FILE", "few_figure", "few_sentences", "few_words", "kept_scores", "shows_few"]

KEPT_FILE = Path(__file__).parent / "kept_scores.csv"
"""Correspondence scores of `realitygap experiment noise`, the diagonal; made by docs/figures/kept_scores.py.
"""

Kept = Mapping[float, Sequence[float]]

KEPT_EVALUATIONS = 1000
DRAWS = 20_000
NUMBERS = ("one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
HIGHEST = 10.0
PLACES = {"paper": -0.3, "here": -0.08, "kept": 0.22}
"""Offsets of the three from a level's position on the axis."""


def kept_scores(task: str) -> Kept:
    """Scores of the kept study's runs by noise level, over three units; {} for other tasks."""
    found: dict[float, list[float]] = {}
    for row in csv.DictReader(KEPT_FILE.read_text("utf-8").splitlines()):
        if row["task"] == task:
            found.setdefault(float(row["noise"]), []).append(float(row["score"]))
    return found


def shows_few(table: ScoreTable) -> bool:
    """Whether the kept study is comparable with a table: of champions, on the twin with default noise."""
    return (table.kind, table.individual) == ("twin", "champion") and bool(_told(table))


def few_figure(table: ScoreTable) -> Figure:
    """Averages by noise level: a star for the paper's, a marker with dots for these runs', dots with a bar
    for the kept study's."""
    figure = new_figure(COLUMN * 1.25, COLUMN * 0.85, layout="constrained")
    ax, classes, kept = figure.add_subplot(), _told(table), kept_scores(table.task)
    styles = noise_styles(one.level for one in classes)
    for place, one in enumerate(classes):
        look = styles[one.level]
        if one.paper_average:
            ax.plot(place + PLACES["paper"], one.paper_average[1], "*", color=INK, markersize=9)
        _draw_runs(ax, place + PLACES["here"], one.values("correspondence"), look.colour, look.marker)
        _draw_kept(ax, place + PLACES["kept"], kept[one.level], look.colour)
    ax.set_xticks(range(len(classes)), [f"{one.name} noise" for one in classes])
    ax.set_xlim(-0.55, len(classes) - 0.45)
    ax.set_ylim(0, HIGHEST + 0.3)
    ax.set_ylabel("correspondence score")
    ax.grid(axis="y")
    ax.set_axisbelow(True)
    handles: list[Artist | ErrorbarContainer] = [
        ax.plot([], [], "*", color=INK, markersize=9)[0],
        ax.errorbar([], [], yerr=[], fmt="o", color=MUTED, markersize=6, capsize=3),
        ax.plot([], [], ".", color=MUTED, markersize=4)[0],
    ]
    words = ["the paper", "here", "kept study"]
    ax.legend(handles, words, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, columnspacing=1.2)
    return figure


def _draw_runs(ax: Axes, x: float, scores: Sequence[float], colour: str, marker: str) -> None:
    mean = mean_of(scores)
    assert mean is not None
    ax.plot([x + 0.09] * len(scores), scores, marker, color=colour, markersize=2.5, markerfacecolor="none")
    ends = np.clip([mean.value - mean.half, mean.value + mean.half], 0, HIGHEST)
    ax.errorbar(x, mean.value, yerr=abs(ends - mean.value)[:, None], fmt=marker, color=colour, capsize=3)


def _draw_kept(ax: Axes, x: float, scores: Sequence[float], colour: str) -> None:
    """Dots side by side in order, so that equal ones do not hide each other."""
    ranked = np.sort(np.asarray(scores))
    aside = (np.arange(len(ranked)) * 5 % 9 - 4) / 4 * 0.1
    ax.plot(x + aside, ranked, ".", color=colour, markersize=3, alpha=0.55)
    mean = mean_of(ranked)
    assert mean is not None
    ax.errorbar(x, mean.value, yerr=mean.half, fmt="_", color=INK, markersize=13, capsize=2, linewidth=1)


def few_words(table: ScoreTable, evaluations: int) -> Words:
    """Caption and text alternative of the figure; `evaluations` are those of the table's runs."""
    kept = kept_scores(table.task)
    said = []
    for one in _told(table):
        here, there = mean_of(one.values("correspondence")), mean_of(kept[one.level])
        assert here is not None and there is not None
        printed = f"the paper {one.paper_average[1]:g}, " if one.paper_average else ""
        said.append(f"{one.name} noise: {printed}here {here.value:.1f}, kept study {there.value:.1f}")
    many = max(map(len, kept.values()))
    caption = (
        "Average correspondence scores. Star: the paper’s judges, five runs. Filled marker: these runs, with "
        f"the 95 % interval of their mean; hollow: each run. Dots: the {many} runs at each level of an "
        "earlier, kept study (docs/noise-level.md), with a cross for their mean and interval: each "
        "evolved in a simulation calibrated to one of three units, and drove all three."
    )
    if evaluations != KEPT_EVALUATIONS:
        caption += f" Those runs had {KEPT_EVALUATIONS} evaluations each, these have {evaluations}."
    return Words(f"Average correspondence scores. {'; '.join(said)}.", caption)


def few_sentences(table: ScoreTable) -> list[str]:
    """What this many runs at each level can and cannot show, by drawing as many from the kept study."""
    classes = _told(table)
    counts = [len(one.values("correspondence")) for one in classes]
    runs, kept = min(counts), kept_scores(table.task)
    spans = []
    for one in classes:
        pool = np.asarray(kept[one.level])
        means = pool[np.random.default_rng(1995).integers(0, len(pool), (DRAWS, runs))].mean(axis=1)
        low, high = np.quantile(means, [0.025, 0.975])
        spans.append(f"{low:.1f} to {high:.1f} at {one.name} noise")
    many = max(map(len, kept.values()))
    alone = all(mark.units == 1 for one in classes for mark in one.marks if mark.correspondence is not None)
    more = ", the more so as all of these drove one and the same unit" if alone else ""
    count = NUMBERS[runs - 1] if runs <= len(NUMBERS) else str(runs)
    begins = f"{count.capitalize()} run{'s' * (runs > 1)} a level"
    return [
        f"{begins} can show what kind of score to expect: drawn from the {many} of the kept study, "
        f"the average of {count} is, 95 times in 100, {', '.join(spans)}.",
        f"{begins} cannot show which level is best where these ranges overlap: another {count} "
        f"may well come out in another order{more}.",
    ]


def _told(table: ScoreTable) -> list[ScoreClass]:
    """The levels at which both these runs and the kept study have scores."""
    kept = kept_scores(table.task)
    return [one for one in table.classes if one.level in kept and one.paper and one.values("correspondence")]
