"""Beside a reproduction's averages: the paper's, the kept study's, and what few runs can show."""

from __future__ import annotations

import csv
import re
import runpy
import shutil
from pathlib import Path

import numpy as np
import pytest

from realitygap.report import build_report
from realitygap.report.few_runs import (
    KEPT_FILE,
    few_figure,
    few_sentences,
    few_words,
    kept_scores,
    shows_few,
)
from realitygap.report.scores import ScoreTable, score_tables
from realitygap.study.load import Study
from realitygap.tasks import load_task
from tests.report.test_scores import AVOID, EXAMPLE, LEVELS, SPREAD, marks

DOCS = Path(__file__).parents[2] / "docs"


def table(scores: dict[float, list[float]] = SPREAD, **changes) -> ScoreTable:
    """A table of made-up marks of obstacle avoidance."""
    return score_tables(AVOID, LEVELS, marks(scores, **changes))[0]


def spans(sentence: str) -> list[tuple[float, float]]:
    """The ranges that a sentence names."""
    return [(float(a), float(b)) for a, b in re.findall(r"([\d.]+) to ([\d.]+) at", sentence)]


def test_the_kept_scores_are_the_kept_studys_diagonal() -> None:
    """What the package carries is what its script makes of docs/noise-level: forty runs a cell."""
    made = runpy.run_path(str(DOCS / "figures" / "kept_scores.py"))["table"]()
    assert KEPT_FILE.read_text("utf-8") == made
    cells = csv.DictReader((DOCS / "noise-level" / "default" / "cells.csv").read_text("utf-8").splitlines())
    own = [
        float(row["score"])
        for row in cells
        if (row["task"], row["evolved_level"], row["comparison_level"]) == ("light-seeking", "2", "2")
    ]
    kept = kept_scores("light-seeking")
    assert sorted(kept) == [0, 1, 2] and kept[2.0] == own and {len(v) for v in kept.values()} == {40}
    assert kept_scores("follow-the-wall") == {}


def test_the_figure_shows_the_papers_averages_these_runs_and_the_kept_ones() -> None:
    """A star, a mark at the mean with its runs, forty dots with their mean, at each level."""
    (ax,) = few_figure(table()).axes
    drawn = {line.get_marker(): line for line in ax.lines if len(line.get_xdata()) == 1}
    stars = [line.get_ydata() for line in ax.lines if line.get_marker() == "*"]
    assert [float(ys[0]) for ys in stars if len(ys)] == [6.2, 8.0, 6.8]
    for marker, level in (("o", 0.0), ("s", 1.0), ("^", 2.0)):
        assert drawn[marker].get_ydata()[0] == pytest.approx(np.mean(SPREAD[level]))
        (runs,) = [x for x in ax.lines if x.get_marker() == marker and len(x.get_xdata()) == 2]
        assert list(runs.get_ydata()) == SPREAD[level]
    dots = [sorted(line.get_ydata()) for line in ax.lines if len(line.get_xdata()) == 40]
    kept = kept_scores(AVOID.name)
    assert dots == [sorted(kept[level]) for level in LEVELS]
    crosses = [float(x.get_ydata()[0]) for x in ax.lines if x.get_markersize() == 13]
    assert crosses == pytest.approx([np.mean(kept[level]) for level in LEVELS])
    told = few_words(table(), 1000)
    assert "zero noise: the paper 6.2, here 5.0, kept study 7.3" in told.alt
    assert "1000 evaluations" not in told.caption and "these have 200." in few_words(table(), 200).caption


def test_the_legend_covers_no_score() -> None:
    """It stands outside the axes, since a score may be anywhere in them, 0 included."""
    figure = few_figure(table({0.0: [0.2], 1.0: [0.0], 2.0: [9.9]}))
    figure.canvas.draw()
    (ax,) = figure.axes
    legend = ax.get_legend()
    assert legend is not None and not legend.get_window_extent().overlaps(ax.get_window_extent())


def test_two_sentences_say_what_so_many_runs_can_show() -> None:
    """Ranges of the mean of as many, drawn from the kept runs: narrower with more, about the kept means."""
    can, cannot = few_sentences(table({level: [5.0, 6.0, 7.0, 8.0, 9.0] for level in LEVELS}))
    assert can.startswith("Five runs a level can show") and cannot.startswith("Five runs a level cannot show")
    assert "another five may well come out in another order, the more so" in cannot
    kept = kept_scores(AVOID.name)
    for (low, high), level in zip(spans(can), LEVELS, strict=True):
        error = np.std(kept[level]) / np.sqrt(5)
        assert low < np.mean(kept[level]) < high
        assert high - low == pytest.approx(2 * 1.96 * error, rel=0.15)
    wide = spans(few_sentences(table({level: [5.0] for level in LEVELS}))[0])
    assert all(w[0] < n[0] and n[1] < w[1] for w, n in zip(wide, spans(can), strict=True))
    assert "one and the same unit" not in few_sentences(table(units=3))[1]


def test_only_what_may_be_compared_stands_side_by_side() -> None:
    """Champions on the twin as it is; nothing beside a robot, a noisier twin, or without scores."""
    assert shows_few(table())
    for changes in ({"kind": "robot"}, {"kind": "twin with 2 times its noise"}, {"individual": "fittest"}):
        assert not shows_few(table(**changes))
    assert not shows_few(table(correspondence=None))
    mine = load_task(str(EXAMPLE))
    assert not any(map(shows_few, score_tables(mine, LEVELS, marks(SPREAD, task=mine.name))))


@pytest.mark.usefixtures("undrawn")
def test_the_page_of_a_reproduction_has_it(
    played: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With its sentences, where there are scores; light seeking drove no twin here and has none."""
    monkeypatch.setattr("realitygap.report.build.is_paper", lambda study, parts: True)
    monkeypatch.setattr("realitygap.report.build.marks_of", lambda study: marks(SPREAD))
    folder = shutil.copytree(played.folder, tmp_path / "study")
    text = build_report(folder).read_text("utf-8")
    assert 'id="obstacle-avoidance-few"' in text and 'id="light-seeking-few"' not in text
    assert all(f"<p>{sentence}</p>" in text for sentence in few_sentences(table()))
