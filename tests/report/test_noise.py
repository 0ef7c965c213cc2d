"""The report of a study of noise: what it says of known truths, and what it refuses."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from realitygap.errors import UsageError
from realitygap.experiments.noise.claims import CLAIMS
from realitygap.report.noise import report as noise
from realitygap.report.noise.asides import falls_words
from realitygap.report.noise.facts import gather_facts
from realitygap.report.noise.figures import claims_figure, map_figure
from realitygap.report.noise.report import noise_summary
from realitygap.report.noise.results import read_results
from realitygap.report.noise.tables import names_table, paper_table
from realitygap.report.page import Picture
from realitygap.world.profile import load_profile
from tests.experiments.crosses import TASKS, comparison, flat, study, write

SMALL = (0.0, 1.0, 2.0)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small study with a clear peak at the robot's level, and its report."""
    out = tmp_path_factory.mktemp("noise")
    write(study(comparison(1.0, by=3.0), seed=1, runs=8, levels=SMALL), out)
    told: list[tuple[int, int, str]] = []
    assert noise.build_noise_report(out, on_progress=lambda *now: told.append(now)).name == "index.html"
    assert [done for done, _, _ in told] == list(range(told[0][1] + 1))
    return out


@pytest.fixture(scope="module")
def summary(built: Path) -> dict[str, Any]:
    """What is told of it in JSON."""
    return noise_summary(built)


def test_the_page_has_claims_verdicts_warnings_and_limits(built: Path) -> None:
    """It stands alone, states the claims as they were stated beforehand, and hides no warning."""
    text = (built / "report" / "index.html").read_text("utf-8")
    plain = text.replace("&#39;", "'")
    assert all(claim.text in plain for claim in CLAIMS)
    assert 'class="word">supported' in text
    assert 'class="word">not supported' in text
    assert "Before you read on" in text
    assert "pseudo-reality" in text
    assert "the twin's noise was set by us" in plain.lower()
    assert not re.search(r'(src|href)="https?:', text)
    assert len(set(re.findall(r'\bid="([^"]+)"', text))) == len(re.findall(r'\bid="([^"]+)"', text))
    assert ">nan<" not in text
    linked = set(re.findall(r'href="((?:tables|figures)/[^"]+)"', text))
    assert len(linked) == 8 + 19
    assert all((built / "report" / name).is_file() for name in linked)


def test_the_summary_is_json_and_says_what_was_found(summary: dict[str, Any]) -> None:
    """Verdicts, effects, intervals and the paragraph, without NaN."""
    assert json.loads(json.dumps(summary, allow_nan=False)) == json.loads(json.dumps(summary))
    assert [claim["verdict"] for claim in summary["claims"]] == ["supported", "not supported", "supported"]
    against_zero = summary["scopes"]["both tasks"]["contrasts"]["a"][0]
    assert against_zero["against"] == 0.0
    low, high = against_zero["difference_interval"]
    assert 0 < low < against_zero["difference"] < high
    assert set(against_zero["delta_by_seed_set"]) == {"1", "2"}
    top = summary["scopes"]["both tasks"]["curves"]["a"]["at_level"]
    assert top["value"] == pytest.approx(1.0, abs=0.45)
    assert summary["scopes"][TASKS[0]]["noisiness"]["at_level"]["value"] == pytest.approx(1.0, abs=0.2)
    assert (
        "Claim (a), that tracks look most like a simulation as noisy as the robot, is supported"
        in (summary["paragraph"])
    )
    assert "light the calibrated model's error is up to 2.0 deviations" in summary["paragraph"]


def test_the_same_results_give_the_same_page(built: Path, tmp_path: Path) -> None:
    """To the byte."""
    shutil.copytree(built / "results", tmp_path / "results")
    again = noise.build_noise_report(tmp_path)
    assert again.read_bytes() == (built / "report" / "index.html").read_bytes()


def said(out: Path) -> str:
    return str(noise_summary(out)["paragraph"])


def test_a_robot_of_ones_own_is_called_a_robot(built: Path, tmp_path: Path, monkeypatch) -> None:
    """Where a robot of the user's own drove, nothing on its page speaks of a twin, in no figure either."""
    save = Picture.save  # as the page has them, without the files beside it
    monkeypatch.setattr(Picture, "save", lambda picture, folder, **settings: save(picture, None, **settings))
    shutil.copytree(built / "results", tmp_path / "results")
    lines("study.toml", lambda rows: ['robot = "my_robot.py:Mine"', *rows])(tmp_path / "results")
    page = noise.build_noise_report(tmp_path).read_text("utf-8")
    shown = page[page.index("<body") : page.index('<section id="made"')]
    assert "twin" not in shown.lower() and "on the robot" in shown and "my_robot.py:Mine" in shown


def test_nothing_found_is_said_as_plainly(tmp_path: Path) -> None:
    """Without any effect the paragraph claims none, and says that sets disagree."""
    text = said(write(study(flat, runs=8, levels=SMALL), tmp_path))
    assert text.count("is not supported") == 3
    assert "none of the three showed the paper's effect; that does not show that there is no effect" in text
    assert text.count("Not shown does not mean none") == 3
    assert "The seed sets disagree about" in text


def test_the_wrong_way_round_is_said(tmp_path: Path) -> None:
    """A valley at the robot's level, and a peak elsewhere, are called what they are."""
    valley = said(write(study(comparison(1.0, by=-3.0), runs=8, levels=SMALL), tmp_path / "valley"))
    assert "is reversed" in valley
    assert "Reliably better than the robot's level: levels 0 and 2" in valley
    shifted = said(write(study(comparison(2.0, by=3.0), runs=8), tmp_path / "shifted"))
    assert "another level does better" in shifted


def test_the_claims_are_about_the_noise_that_was_measured(tmp_path: Path) -> None:
    """On a twin whose noise scale is 2 the simulation's level 1 is as noisy: a peak there is the claim's."""
    out = write(study(comparison(1.0, by=3.0), runs=8), tmp_path)
    turned = lambda rows: [row.replace("twin_noise = 1.0", "twin_noise = 2.0") for row in rows]  # noqa: E731
    lines("study.toml", turned)(out / "results")
    summary = noise_summary(out)
    assert summary["robot_level"] == 1.0 and summary["settings"]["twin_noise"] == 2.0
    assert summary["claims"][0]["verdict"] == "supported"
    assert "its noise scale is 2" in summary["paragraph"]


def test_the_papers_words_stand_at_its_levels_only() -> None:
    """A study without zero, observed and double noise has nothing beside the paper's averages, whose marks
    stand at 0, 1 and 2: not at the level that stands for the robot's."""
    facts = gather_facts(study(flat, runs=2, levels=(0.5, 1.7), robot=0.5), resamples=0)
    assert {row[-1] for row in paper_table(facts).texts()} == {"–"}
    drawn = [line for ax in claims_figure(facts).axes for line in ax.lines if line.get_marker() == "*"]
    assert len(drawn) == 2
    for line in drawn:
        assert np.asarray(line.get_xdata()) == pytest.approx(np.sqrt([0, 1, 2]))


def test_one_run_a_cell_has_no_intervals_but_a_report(tmp_path: Path) -> None:
    """The smallest study: one task, one set, one run, two levels, a figure that is not known."""
    data = study(flat, runs=1, sets=1, levels=(0.0, 1.0), tasks=TASKS[:1])
    noisiness = np.full_like(data.noisiness, np.nan)
    write(replace(data, noisiness=noisiness), tmp_path)
    told = tmp_path / "results" / "study.toml"
    few = told.read_text().replace("units = 3", "units = 1").replace("seed_sets = 2", "seed_sets = 1")
    told.write_text(few)
    page = noise.build_noise_report(tmp_path).read_text("utf-8")
    assert "<dt>unit</dt><dd>1</dd>" in page and "<dt>seed set</dt><dd>1</dd>" in page
    assert "<dt>starts</dt><dd>8</dd>" in page
    contrast = noise_summary(tmp_path)["scopes"][TASKS[0]]["contrasts"]["c"][0]
    assert contrast["delta_interval"] is None
    assert contrast["found"] == "open"


def test_scores_of_the_home_unit_may_come_in_a_file_of_their_own(
    built: Path, summary: dict[str, Any], tmp_path: Path
) -> None:
    """home.csv, with some levels only, makes claim (c) for the calibration unit alone; broken, it is
    refused."""
    folder = shutil.copytree(built / "results", tmp_path / "results")
    assert "On the calibration unit alone" not in summary["paragraph"]
    cells = (folder / "cells.csv").read_text().splitlines()
    head = cells[0].split(",")[:6]
    some = [row for row in (line.split(",")[:6] for line in cells[1:]) if row[3] == row[4] != "2.0"]
    (folder / "home.csv").write_text("\n".join(map(",".join, [head, *some])) + "\n")
    report = noise.NoiseReport(read_results(folder))
    assert [c.other for c in report.facts.headline.home] == [0.0]
    same = report.facts.headline.findings[2].contrasts[0]
    assert report.facts.headline.home[0].effect[:3] == same.effect[:3]
    assert report.facts.headline.home[0].means == same.means
    assert "On the calibration unit alone" in report.paragraph
    assert "calibration unit alone" in report.tables["both-tasks-home"].title
    (folder / "home.csv").write_text("\n".join(map(",".join, [head, *some, some[0]])) + "\n")
    with pytest.raises(UsageError, match=r"home\.csv, line \d+: expected each controller once a level"):
        read_results(folder)


def test_scores_for_each_unit_are_read_from_the_cells(built: Path, tmp_path: Path) -> None:
    """cells.csv with a column a unit gives each controller the score of its own home."""
    folder = shutil.copytree(built / "results", tmp_path / "results")
    lines("cells.csv", lambda t: [t[0] + ",score_unit_1,score_unit_2,score_unit_3",
                                  *(f"{row},1.0,2.0,3.0" for row in t[1:])])(folder)  # fmt: skip
    data = read_results(folder).data
    assert (data.home_score == data.home[:, None]).all()


def test_a_fall_from_home_that_shrinks_with_noise_is_found() -> None:
    """Fitness that falls less the noisier its evolution was is said to, with rho; level falls are not."""
    data = study(flat, runs=20, levels=SMALL)
    level = gather_facts(data, resamples=0).falls
    assert falls_words(level).count("no change of the fall with evolved noise is shown") == 2
    falls = (0.02 * (3 - data.evolved) + 0.1 * data.home) * data.simulated
    found = gather_facts(replace(data, situated_foreign=data.situated_home - falls), resamples=0).falls
    assert falls_words(found).count("the fall shrinks with evolved noise") == 2
    assert all(fall.shown and fall.rho.high < 0 for fall in found)


def test_beside_the_twins_model_error_stands_a_real_robots(built: Path, summary: dict[str, Any]) -> None:
    """The calibration's table ends with the profile khepera's ratios, and words compare the two."""
    found = beside(built, summary["paragraph"], "ratio_over_all")
    assert found == "over all readings, so that dark ones flatter them"


def test_like_is_compared_with_like(built: Path, summary: dict[str, Any], tmp_path: Path) -> None:
    """A study that keeps both figures is held against the robot's where readings are not dark."""
    out = shutil.copytree(built, tmp_path / "study")
    file = out / "results" / "calibration.csv"
    head, *rows = file.read_text().splitlines()
    file.write_text("\n".join([f"{head},ratio_over_all", *(f"{row},0.5" for row in rows)]) + "\n")
    told = noise_summary(out)
    found = beside(out, told["paragraph"], "ratio")
    assert found == "on places held out, where readings are neither dark nor saturated"
    assert told["calibration"][0]["ratio_over_all"] == 0.5
    assert summary["calibration"][0]["ratio_over_all"] is None


def beside(out: Path, words: str, figure: str) -> str:
    """How the calibration's table says that it counts; table and words have this figure of the khepera."""
    table = noise.NoiseReport(read_results(out / "results")).tables["calibration"]
    fits = {fit.channel: f"{getattr(fit, figure):.2f}" for fit in load_profile("khepera").provenance.fits}
    assert {row[1]: row[4] for row in table.texts() if row[0] == "a real Khepera"} == fits
    assert f"a real robot's tables: {fits['ambient']}" in words
    return table.title.split("in counts, ")[1].split(". ▲")[0]


def test_behaviours_that_are_as_frequent_are_told_by_name() -> None:
    """No table hangs on the order of a set, which is another in each process."""
    data = study(flat, runs=2, levels=SMALL)
    names = np.array([f"kind {i % 4}" for i in range(len(data))])
    told = names_table(gather_facts(replace(data, name=names), resamples=0)).texts()
    assert [row[1] for row in told] == ["kind 0", "kind 1", "kind 2", "kind 3"] * 2


def test_fitness_that_rises_on_the_twin_is_not_called_below(tmp_path: Path) -> None:
    """Where situated fitness exceeds the simulated, the drop is told as a signed difference."""
    data = study(flat, runs=8, levels=SMALL, tasks=TASKS[:1])
    assert "is below that in simulation by 0.0" in said(write(data, tmp_path / "falls"))
    data = replace(data, situated=data.simulated + 0.1)
    words = said(write(data, tmp_path / "rises"))
    assert "below that in simulation" not in words
    assert "fitness in simulation minus that on the twin is −0.100 at 0, −0.100 at 1" in words


def test_the_map_shows_every_mean() -> None:
    """A number a cell, for each task all sets and each set alone: 2 × 3 panels of 9 cells."""
    figure = map_figure(study(flat, runs=2, levels=SMALL))
    assert [len(ax.texts) for ax in figure.axes] == [9] * 6


def lines(file: str, change: Callable[[list[str]], list[str]]) -> Callable[[Path], None]:
    """A change of a results file's lines."""

    def spoil(folder: Path) -> None:
        path = folder / file
        path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")

    return spoil


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: (f / "study.toml").unlink(), r"study\.toml: no such file"),
        (lambda f: (f / "cells.csv").unlink(), r"cells\.csv: no such file. Let the study finish"),
        (lines("cells.csv", lambda t: t[:-1]), r"every controller at every level, got none at 2 for light"),
        (lines("cells.csv", lambda t: [*t, t[1]]), r"cells\.csv, line \d+: expected each controller once"),
        (lines("cells.csv", lambda t: [t[0].replace("layout", "lay"), *t[1:]]), "expected columns .*layout"),
        (lines("cells.csv", lambda t: [t[0], t[1].replace(",0.0,", ",x,"), *t[2:]]), "line 2: .*number.*'x'"),
        (lines("cells.csv", lambda t: [t[0], t[1].replace(",0.0,", ",3,"), *t[2:]]), "study's levels 0, 1"),
        (lines("controllers.csv", lambda t: t[:1]), "expected a row for each controller"),
        (lines("controllers.csv", lambda t: [*t, t[1]]), "expected each controller once"),
        (lines("controllers.csv", lambda t: t[:2]), "but not in controllers"),
        (lines("study.toml", lambda t: t[1:]), "levels: expected a list"),
        (lines("study.toml", lambda t: [x for x in t if "twin_noise" not in x]), "twin_noise: expected"),
        (lines("study.toml", lambda t: ["["]), r"study\.toml: not a TOML file"),
    ],
)  # fmt: skip
def test_broken_results_are_refused(
    built: Path, tmp_path: Path, spoil: Callable[[Path], None], message: str
) -> None:
    """One clear message names the file, the line and the column; the page that was there stays."""
    folder = shutil.copytree(built / "results", tmp_path / "results")
    spoil(folder)
    with pytest.raises(UsageError, match=message) as refused:
        noise.build_noise_report(tmp_path)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "report").exists()


def test_a_controller_that_was_lost_is_left_out_and_said(built: Path, tmp_path: Path) -> None:
    """Where the camera lost all of a controller's trials its figures are empty: the others are reported."""
    folder = shutil.copytree(built / "results", tmp_path / "results")
    who = read_results(folder).data
    key = f"{who.task[0]},{who.seed_set[0]},{who.run[0]},{float(who.evolved[0])}"

    def without(kept: int) -> Callable[[list[str]], list[str]]:
        empty = lambda row: ",".join([f if k < kept else "" for k, f in enumerate(row.split(","))])  # noqa: E731
        return lambda rows: [empty(row) if row.startswith(key) else row for row in rows]

    lines("cells.csv", without(5))(folder)
    lines("controllers.csv", without(7))(folder)
    report = noise.NoiseReport(read_results(folder))
    assert len(report.results.data) == len(who) - 1 and report.results.lost == 1
    assert "One controller has no score" in report.paragraph


def test_what_is_read_is_what_was_written(tmp_path: Path) -> None:
    """Reading a study's tables gives its scores back."""
    data = study(flat, runs=2)
    read = read_results(write(data, tmp_path) / "results").data
    np.testing.assert_allclose(read.score, data.score, rtol=1e-5)
    assert (read.evolved == data.evolved).all()
    assert read.tasks == list(TASKS)
