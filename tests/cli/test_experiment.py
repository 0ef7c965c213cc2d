"""`experiment noise` and `experiment robots`: from words to tables, refusals, Ctrl-C."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.experiments.noise_parts import quick_units

from realitygap.experiments.experiment import open_folder
from realitygap.experiments.noise import NoiseConfig
from realitygap.experiments.robots import KNOWN, RobotsConfig

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ROBOT, BASE = f"{EXAMPLES / 'own_robot.py'}:FiveEyes", str(EXAMPLES / "five_eyes.toml")
SMALL = ("--levels", "0,1", "--starts", 2, "--evaluations", 40, "--seconds", 2, "--workers", 1)
NOISE = ("experiment", "noise", *SMALL, "--runs", 3, "--units", 1, "--tasks", "avoidance")
ROBOTS = ("experiment", "robots", *SMALL, "--runs", 1)
TABLE = "report/tables/robots.csv"


@pytest.fixture(scope="module")
def units():
    """Units that need neither recordings nor a twin."""
    with quick_units() as patch:
        yield patch


@pytest.fixture
def no_enki(monkeypatch):
    """A machine without Enki's library."""
    monkeypatch.setattr("realitygap.robots.enki.LIBRARY", "libenki-missing.so")


def stopped(*_, **__):
    """What Ctrl-C makes of a function."""
    raise KeyboardInterrupt


def test_noise_comes_to_tables_and_a_report(units, json_of, call, refused, tmp_path):
    """The command makes the experiment that its options say; --json has its table; `report` the page."""
    out = tmp_path / "study"
    made = json_of(*NOISE, "--out", out)
    (task,) = made["tasks"].values()
    assert made["study"] == str(out) and [row["runs"] for row in task["levels"]] == [3, 3]
    assert (out / "results" / "cells.csv").is_file()
    assert NoiseConfig.from_folder(out) == NoiseConfig(
        levels=(0, 1), runs=3, units=1, starts=2, evaluations=40, seconds=2, tasks=("obstacle-avoidance",)
    )
    again = call("experiment", "noise", "--out", out, "--resume")  # omitted options keep their saved values
    assert again.exit_code == 0 and "noise-matched level: obstacle-avoidance" in again.stdout
    (told,) = json_of("experiment", "noise", "--out", out, "--resume", "--misfit")["evolve_at"]
    assert (told["misfit"], told["runs"]) == (0.45, 3) and "evolve_at" not in made
    Path(made["report"]).unlink()
    assert json_of("report", out)["tasks"] == made["tasks"] and Path(made["report"]).is_file()
    assert "--resume" in refused(*NOISE, "--out", out)
    assert "made with seed = 1995, not 7" in refused(*NOISE, "--out", out, "--resume", "--seed", 7)


@pytest.mark.usefixtures("undrawn")
def test_robots_come_to_a_matrix(units, no_enki, json_of, call, refused, tmp_path):
    """The twin is carried through, Enki is left out and says how to get it; resumed, all is the same."""
    out = tmp_path / "study"
    made = json_of(*ROBOTS, "--out", out)
    assert [one["robot"] for one in made["left_out"]] == list(KNOWN[1:])
    assert all("apt install libenki-dev g++" in one["why"] for one in made["left_out"])
    (twin,) = made["robots"]
    (error,) = twin["model_error_over_noise"]
    assert (error["channel"], error["median"]) == ("proximity", 0.45)
    assert set(twin["tasks"]["obstacle-avoidance"]["levels"][0]["score_by_level"]) == {"0", "1"}
    page, before = Path(made["report"]).read_text(), (out / TABLE).read_text()
    assert "Left out" in page and 'href="../twin-1/report/index.html"' in page
    assert before.startswith(",twin,a real Khepera (readings only),a real Thymio II (readings only)\n")
    assert "score at" not in page.split("</table>")[0]  # of a single run a level
    again = call("experiment", "robots", "--out", out, "--resume", "--workers", 1)
    assert again.exit_code == 0 and "enki:epuck is left out" in again.stderr
    Path(made["report"]).unlink()
    assert json_of("report", out)["robots"][0]["tasks"] == twin["tasks"] and Path(made["report"]).is_file()
    assert (out / TABLE).read_text() == before and "--resume" in refused(*ROBOTS, "--out", out)


@pytest.mark.usefixtures("undrawn")
def test_ctrl_c_says_how_to_go_on(units, call, monkeypatch, tmp_path):
    """Stopped, each says in a line which command ends as if nothing had happened; exit code 130."""
    with monkeypatch.context() as patch:
        patch.setattr("realitygap.experiments.noise.Rig.drive", stopped)
        noise = call(*NOISE, "--out", tmp_path / "noise")
        robots = call(*ROBOTS, "--robot", "twin", "--out", tmp_path / "robots")
    for name, result in (("noise", noise), ("robots", robots)):
        assert (result.exit_code, result.stdout) == (130, "")
        last = f"realitygap experiment {name} --out {tmp_path / name} --resume"
        assert last in result.stderr.splitlines()[-1]
    assert (
        call("experiment", "robots", "--out", tmp_path / "robots", "--resume", "--workers", 1).exit_code == 0
    )
    assert call(*ROBOTS, "--robot", "twin", "--out", tmp_path / "whole").exit_code == 0
    for file in (TABLE, "twin-1/results/cells.csv", "twin-1/results/controllers.csv"):
        assert (tmp_path / "robots" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()


FIRST = {
    "realitygap.study.runner.open_folder": ("evolve", "light"),
    "realitygap.experiments.reproduction.open_to_begin": ("reproduce",),
    "realitygap.experiments.noise.check_robot": ("experiment", "noise"),
    "realitygap.experiments.robots.check_robot": ("experiment", "robots", "--robot", "twin"),
}
"""Commands, by what each calls before it keeps its settings."""


@pytest.mark.parametrize("first", FIRST, ids=lambda first: " ".join(FIRST[first][:2]))
def test_a_mistyped_folder_is_noted_and_ctrl_c_promises_nothing(first, call, monkeypatch, tmp_path):
    """--resume of a folder without work says that it starts anew; stopped before that, no command is told
    that would go on with the usual settings instead of those that were given."""
    monkeypatch.setattr(first, stopped)
    result = call(*FIRST[first], "--resume", "--out", tmp_path / "mistyped", "--workers", 1)
    assert result.exit_code == 130 and result.stdout == ""
    noted, *_, last = result.stderr.splitlines()
    assert noted.startswith(f"note: --resume: nothing was begun in {tmp_path / 'mistyped'}; starting there")
    assert last == f"stopped before the work in {tmp_path / 'mistyped'} began; give the command again"


def test_what_cannot_be_done_is_refused(no_enki, refused, tmp_path):
    """One line before any work: a robot of one's own that lacks something, one that is not there."""
    own = ("experiment", "noise", "--out", tmp_path / "study", "--robot", ROBOT)
    assert "base: expected the rough profile" in refused(*own)
    assert "--tasks obstacle-avoidance" in refused(*own, "--base", BASE)
    robots = (*ROBOTS, "--out", tmp_path / "study", "--robot")
    assert "apt install libenki-dev g++" in refused(*robots, "enki:epuck")
    assert "use record, calibrate, evolve and transfer" in refused(*robots, "epuck:/dev/x")
    assert not (tmp_path / "study").exists()


def test_a_program_that_a_folder_names_is_not_run_before_a_person_has(refused, tmp_path):
    """Who resumes with a robot of one's own names it again; the twin is no synonym for it."""
    made = NoiseConfig(units=1, tasks=("obstacle-avoidance",), robot=ROBOT, base=BASE)
    asked = RobotsConfig(robots=(ROBOT,), base=BASE)
    for name, settings in (("noise", made), ("robots", asked)):
        (tmp_path / name).mkdir()
        open_folder(tmp_path / name, type(settings), settings, resume=False)
    for name, more in (("noise", ()), ("noise", ("--robot", "twin")), ("robots", ())):
        said = refused("experiment", name, "--out", tmp_path / name, "--resume", *more)
        assert f"--robot: expected {ROBOT}" in said
