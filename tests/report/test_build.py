"""The page holds all that a study has, whatever its shape, and needs nothing beside itself."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from realitygap.errors import StudyInterruptedError
from realitygap.experiments.reproduction import again
from realitygap.report import build_report
from realitygap.report.build import is_paper
from realitygap.report.evolution import PER_CONDITION, parts_of
from realitygap.report.page import Picture
from realitygap.study.config import StudyConfig
from realitygap.study.load import Study, load_study
from realitygap.study.runner import EVOLVING, Progress, run_study
from realitygap.tasks import load_task
from realitygap.world.arena import load_arena
from realitygap.world.robot import FittedChannel, Provenance, load_profile
from tests.report.scenes import draw_only, few

EXAMPLE = Path(__file__).parents[2] / "examples" / "follow_the_wall.py"
FEW = {"evaluations": 70, "seed": 3}


class _Tags(HTMLParser):
    """Collects a page's tags, and checks that every one that is opened is closed."""

    VOID = frozenset({"meta", "br", "link", "img", "hr", "input"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.seen: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag, attrs) -> None:
        self.seen.append((tag, dict(attrs)))


def _page(study: Study) -> str:
    return (study.folder / "report" / "index.html").read_text("utf-8")


def _reported(folder: Path, config: StudyConfig) -> str:
    """The page of a study carried out in this process."""
    return build_report(run_study(folder, config, workers=1).folder).read_text("utf-8")


def test_the_page_is_self_contained_and_well_formed(paper: Study) -> None:
    """Nothing is fetched, ids are unique, links lead somewhere, pictures have a text, and no NaN is shown."""
    text = _page(paper)
    tags = _Tags(text)
    assert tags.open == []
    assert not re.search(r"<(script[^>]*\ssrc|link|iframe|img)\b", text)
    assert "url(http" not in text and "@import" not in text
    ids = [attrs["id"] for _, attrs in tags.seen if "id" in attrs]
    assert len(ids) == len(set(ids))
    for tag, attrs in tags.seen:
        target = attrs.get("href") or ""
        if tag == "a" and target.startswith("#"):
            assert target[1:] in ids
        elif tag == "a":
            assert (paper.folder / "report" / target).is_file()
        if tag == "svg":
            named = attrs.get("role") in ("img", "group") and attrs.get("aria-label")
            assert named or attrs.get("aria-hidden") == "true"
    assert not re.search(
        r"\bnan\b", re.sub(r"<(script|svg).*?</\1>", "", text, flags=re.DOTALL), re.IGNORECASE
    )


def test_the_page_has_the_papers_figures_and_tables(paper: Study) -> None:
    """Figures 1 to 6, tables 1 and 2, each figure as PNG and SVG, each table as CSV."""
    text = _page(paper)
    for label in (*(f"<b>Figure {k}.</b>" for k in range(1, 7)), "<h3>Table 1</h3>", "<h3>Table 2</h3>"):
        assert label in text
    figures = paper.folder / "report" / "figures"
    names = {path.stem for path in figures.glob("*.png")}
    assert names == {path.stem for path in figures.glob("*.svg")}
    assert {f"light-seeking-{what}" for what in ("arena", "curves", "paths", "all-paths")} <= names
    assert sum("network" in name for name in names) == 12
    assert "prefers-color-scheme: dark" in text and "unfinished" not in text
    words = " ".join(text.split())
    assert "the same two tasks (with seconds = 0.5), robot, networks and genetic algorithm" in words
    assert "The simulator was fitted to recordings" not in words
    for name in paper.versions():
        assert f"<dt>{name}</dt>" in text


def test_the_tables_are_the_studys_own_numbers(paper: Study) -> None:
    """Means over the fresh trials in the database."""
    path = paper.folder / "report" / "tables" / "light-seeking.csv"
    rows = list(csv.DictReader(path.read_text("utf-8").splitlines()))
    assert len(rows) == 9
    run = paper.run(int(rows[3]["run"]))
    assert (run.task, run.noise, rows[3]["noise"]) == ("light-seeking", 1.0, "observed")
    for who in ("fittest", "champion"):
        assert float(rows[3][f"{who}_double_mean"]) == pytest.approx(np.mean(run.tests[(who, 2.0)]))
    assert float(rows[3]["stored_fitness"]) == pytest.approx(run.best_fitness)


def test_the_report_is_the_same_when_made_again(paper: Study, monkeypatch) -> None:
    """To the byte: page, figures and tables. Of a kind of figures one is drawn again, the others are kept."""
    save, drawn = Picture.save, set[str]()

    def one_of_each(picture: Picture, folder: Path, **settings: int) -> str:
        if (kind := re.sub("obstacle-avoidance|light-seeking|network.*", "", picture.name)) in drawn:
            return (folder / f"{picture.name}.svg").read_text("utf-8")
        drawn.add(kind)
        return save(picture, folder, **settings)

    monkeypatch.setattr(Picture, "save", one_of_each)
    folder = paper.folder / "report"
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    seen: list[tuple[int, int]] = []
    build_report(paper.folder, on_progress=lambda done, total, name: seen.append((done, total)))
    assert before == {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert seen == sorted(seen) and seen[0][0] == 0 and seen[-1][0] == seen[-1][1]


def test_a_figure_shows_the_median_run(paper: Study) -> None:
    """Of two runs the one whose champion does less well on fresh trials at its own noise."""
    for part in parts_of(paper):
        for condition in part.conditions:
            row = condition.chosen
            assert row is not None
            means = [one.mean("champion", condition.level).value for one in condition.rows]
            assert row.mean("champion", condition.level).value == min(means)


def test_only_the_papers_study_is_called_so(paper: Study) -> None:
    """Another algorithm, other rates, another arena or robot is not; a Khepera that was measured is."""

    def like(**changes: object) -> bool:
        same = {key: getattr(paper, key) for key in ("config", "profile", "task", "runs")}
        study = SimpleNamespace(**{**same, **changes})
        return is_paper(study, parts_of(study))

    assert like()
    for setting in ("evolution.algorithm=random", "variation.mutation=0.1"):
        assert not like(config=paper.config.with_settings([setting]))
    wide = load_arena("light-seeking")
    assert not like(task=lambda name: replace(load_task(name), arena=wide))
    assert not like(profile=load_profile("thymio"))
    fits = (FittedChannel(channel="infrared", form="paper", rmse=20.0),)
    mine = replace(load_profile("paper"), name="mine", provenance=Provenance(base="paper", fits=fits))
    assert like(profile=mine)


def test_a_users_task_at_a_noise_of_its_own_has_a_page(tmp_path: Path) -> None:
    """One condition, one run, at a level without a name; it is not called the paper's, nor "1 runs"."""
    text = _reported(tmp_path / "study", few(StudyConfig.single(EXAMPLE, 0.5, **FEW)))
    assert "0.5 noise" in text and "Figure 1" not in text and "realitygap reproduce" not in text
    assert "one run ·" in text and "1 runs" not in text and "average</th>" not in text
    assert "type of behaviour" not in text and "as in the paper;" not in text
    assert again(load_study(tmp_path / "study")) == ""


def test_many_runs_are_limited_to_what_a_person_can_look_at(tmp_path: Path, monkeypatch) -> None:
    """The page says so, shows some, and its CSV has all."""
    draw_only(monkeypatch, lambda name: "network" not in name)
    runs = 2 * PER_CONDITION + 2
    text = _reported(tmp_path / "study", few(StudyConfig.single("avoidance", 1.0, runs=runs, evaluations=64)))
    assert f"the first {PER_CONDITION} runs of each noise level" in text and "averages are over all" in text
    report = tmp_path / "study" / "report"
    csv_text = (report / "tables" / "obstacle-avoidance.csv").read_text("utf-8")
    assert len(csv_text.splitlines()) == 1 + runs + 1
    drawn = len(list((report / "figures").glob("*-network-*.png")))
    assert drawn in (PER_CONDITION, PER_CONDITION + 1)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("finished", [0, 1])
def test_an_unfinished_study_has_a_page_that_says_so(tmp_path: Path, monkeypatch, finished: int) -> None:
    """From before its first checkpoint on."""
    monkeypatch.setattr("realitygap.work.progress.EVERY_S", 0.0)

    def stop(progress: Progress) -> None:
        if progress.phase == EVOLVING and progress.runs_done == finished:
            raise KeyboardInterrupt

    config = few(StudyConfig.single("light", 1.0, runs=3, **FEW))
    with pytest.raises(StudyInterruptedError):
        run_study(tmp_path / "study", config, workers=1, on_progress=stop)
    text = build_report(tmp_path / "study").read_text("utf-8")
    assert "This study is unfinished" in text and f"{finished} of 3 runs are finished" in text
