"""`list`, `best`, `compare`, `figures`, `open`: what there is, and what came out, in 80 columns."""

from __future__ import annotations

import re
import webbrowser
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.stats import ttest_ind
from tests.conftest import draw_nothing

from realitygap.cli import realitygap
from realitygap.study.load import load_study

SMALL = ("--evaluations", "7e1", "--workers", "1", "--seed", "7", "--set", "retest_trials=2", "--set",
         "fresh_trials=3", "--set", "task.seconds=2")  # fmt: skip


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """Two small studies of light seeking: three runs at observed noise, two at zero; and what was printed."""
    folder, said = tmp_path_factory.mktemp("studies"), []
    for name, noise, runs in (("first", "observed", 3), ("quiet", "zero", 2)):
        words = ["evolve", "light", "--noise", noise, "--runs", str(runs), "--out", str(folder / name)]
        with pytest.MonkeyPatch.context() as patch:
            draw_nothing(patch)
            made = CliRunner().invoke(realitygap, [*words, *SMALL])
        assert made.exit_code == 0, made.output
        said.append(made.stdout)
    return folder, said


def test_evolve_ends_with_what_came_out(two, call):
    """Two figures a run in their unit, the answer, a link to the page; none is wider than a terminal."""
    folder, (first, _) = two
    lines = first.splitlines()
    assert re.search(r"run  name +best during evolution +test score", lines[0])
    assert re.fullmatch(r" +1  light-seeking/observed/1 +[\d.]+ +[\d.]+ ± [\d.]+", lines[1])
    found = r"light-seeking: The champions evolved at observed noise: test score \([\d.]+ ± [\d.]+\) × 10⁻⁶"
    assert re.search(f"{found} cm⁻² in simulation at observed noise", " ".join(first.split()))
    assert lines[-1] == f"report {(folder / 'first' / 'report' / 'index.html').as_uri()}"
    for words in (("show", folder / "first", 1), ("show", folder / "first", "--verbose"), ("list",)):
        lines += call(*words).stdout.splitlines()
    assert max(len(line) for line in lines if str(folder) not in line) <= 80
    assert "e-0" not in "".join(lines)


def test_the_best_run_is_that_of_the_highest_test_score(two, call, json_of):
    """Shown, and taken wherever a RUN is; a study of several tasks would ask for one."""
    folder, _ = two
    study = load_study(folder / "first")
    best = max(study.runs, key=lambda run: run.fitness)
    made = json_of("best", folder / "first")
    assert made["best"][0]["run"] == best.id
    assert made["runs"][0]["test_score"]["mean"] == pytest.approx(best.fitness)
    assert f"best: run {best.id}, {best.name}: test score" in call("best", folder / "first").stdout
    for word in ("best", "best:light", "best:observed"):
        assert json_of("replay", folder / "first", word, "--seconds", 1)["run"] == best.id
    assert json_of("show", folder / "first" / "study.db", "best")["runs"] == made["runs"]


def test_two_studies_are_compared_as_scipy_does(two, call, json_of, refused, tmp_path):
    """At the noise that both were tested at, by Welch's test; one run is too few, another task none."""
    folder, _ = two
    words = ("compare", folder / "first", folder / "quiet")
    (made,) = json_of(*words)["contrasts"]
    values = [
        [run.tests["champion", "observed"].mean() / 1e-6 for run in load_study(folder / name).runs]
        for name in ("first", "quiet")
    ]
    expected = ttest_ind(*values, equal_var=False)
    half = (expected.confidence_interval().high - expected.confidence_interval().low) / 2
    assert made["tested"] == 1 and [made["runs_a"], made["runs_b"]] == [pytest.approx(v) for v in values]
    gap = {"mean": np.mean(values[0]) - np.mean(values[1]), "half": half, "p": expected.pvalue}
    assert made["difference"] == pytest.approx(gap)
    result = call(*words, "--picture", tmp_path / "compared.svg")
    assert re.search(
        r"difference −?[\d.]+ ± [\d.]+: (not )?significant \(Welch's t-test, p = ", result.stdout
    )
    assert b"<text" not in (tmp_path / "compared.svg").read_bytes()
    assert "study.db is missing" in refused("compare", folder / "first", tmp_path)


def test_figures_for_a_paper(two, call, refused, tmp_path):
    """As wide as asked, with fonts that need no installing, and the same bytes each time."""
    folder, _ = two
    names = ("robot", "light-seeking-curves")
    for kind in ("pdf", "svg"):
        words = ("figures", folder / "first", *names, "--format", kind, "--width", "84mm", "--out")
        assert call(*words, tmp_path / "a").exit_code == call(*words, tmp_path / "b").exit_code == 0
        for name in names:
            made, again = (tmp_path / place / f"{name}.{kind}" for place in "ab")
            assert made.read_bytes() == again.read_bytes()
            if kind == "svg":
                width = float(re.search(r'<svg .*?width="([\d.]+)pt"', made.read_text(), re.S)[1])
                assert width / 72 * 25.4 == pytest.approx(84, abs=1)
    assert b"/FontFile2" in (tmp_path / "a" / "robot.pdf").read_bytes()
    assert "light-seeking-curves" in refused("figures", folder / "first", "curves")


def test_what_there_is(two, json_of, call, monkeypatch):
    """Of each kind, or one; studies below a folder, whatever else lies there."""
    folder, _ = two
    made = json_of("list", "studies", folder)["studies"]
    assert made == {str(folder / name): f"light-seeking: {n} of {n} runs finished"
                    for name, n in (("first", 3), ("quiet", 2))}  # fmt: skip
    monkeypatch.chdir(folder.parent)
    said = call("list").stdout
    for word in ("thymio", "obstacle-avoidance-large", "FILE.py", "twin:UNIT", f"{folder.name}/quiet"):
        assert word in said


@pytest.mark.usefixtures("undrawn")
def test_a_report_is_opened(two, call, monkeypatch):
    """In a browser; it is made where it is missing."""
    folder, seen = two[0], []
    monkeypatch.setattr(webbrowser, "open", lambda address: seen.append(address) or True)
    page = folder / "quiet" / "report" / "index.html"
    page.unlink()
    assert call("open", folder / "quiet").stdout.splitlines()[-1] == page.as_uri() == seen[0]
    assert page.is_file() and call("open", folder / "quiet").stderr == ""


def test_a_controller_of_another_task_is_warned_about(two, call, tmp_path):
    """By what the file of a champion says of itself; at its own task there is no word."""
    folder, _ = two
    champion: Path = tmp_path / "champion.txt"
    champion.write_text(call("show", folder / "first", 1).stdout)
    words = ("--controller", champion, "--seconds", 1)
    other = call("simulate", "avoidance", *words)
    assert other.exit_code == 0 and other.stderr == (
        "warning: this controller evolved at light-seeking with ambient sensors; here it is fed proximity\n"
    )
    assert call("simulate", "light", *words).stderr == ""
