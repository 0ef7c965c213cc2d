"""`experiment noise`: from words to tables, refusals, Ctrl-C."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.experiments.noise_parts import quick_units

from realitygap.experiments.noise import NoiseConfig

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ROBOT, BASE = f"{EXAMPLES / 'own_robot.py'}:FiveEyes", str(EXAMPLES / "five_eyes.toml")
SMALL = (
    "--levels", "0,1", "--runs", 3, "--units", 1, "--starts", 2, "--evaluations", 40,
    "--seconds", 2, "--tasks", "avoidance", "--workers", 1,
)  # fmt: skip


@pytest.fixture(scope="module")
def units():
    """Units that need neither recordings nor a twin."""
    with quick_units() as patch:
        yield patch


def test_noise_comes_to_tables_and_a_report(units, json_of, call, refused, tmp_path):
    """The command makes the experiment that its options say; --json has its table; `report` makes the
    page again."""
    out = tmp_path / "study"
    told = json_of("experiment", "noise", "--out", out, *SMALL)
    (task,) = told["tasks"].values()
    assert told["study"] == str(out) and [row["runs"] for row in task["levels"]] == [3, 3]
    assert (out / "results" / "cells.csv").is_file() and Path(told["report"]).exists()
    made = NoiseConfig.from_folder(out)
    assert made == NoiseConfig(
        levels=(0, 1), runs=3, units=1, starts=2, evaluations=40, seconds=2.0,
        tasks=("obstacle-avoidance",),
    )  # fmt: skip
    again = call("experiment", "noise", "--out", out, "--resume")  # omitted options keep their saved values
    assert again.exit_code == 0 and "noise-matched level: obstacle-avoidance" in again.stdout
    Path(told["report"]).unlink()
    assert json_of("report", out)["tasks"] == told["tasks"]
    assert Path(told["report"]).is_file()
    assert "--resume" in refused("experiment", "noise", "--out", out, *SMALL)
    other = refused("experiment", "noise", "--out", out, *SMALL, "--resume", "--seed", 7)
    assert "made with seed = 1995, not 7" in other


def test_what_cannot_be_done_is_refused(refused, tmp_path):
    """Wrong levels, a task that is none: one line, before any work."""
    out = ("experiment", "noise", "--out", tmp_path / "study")
    assert "got 'loud'" in refused(*out, "--levels", "0,loud")
    assert "unknown task 'football'" in refused(*out, "--tasks", "football")
    assert "--starts" in refused(*out, "--starts", 1)
    assert not (tmp_path / "study").exists()


def test_ctrl_c_says_how_to_go_on(units, call, tmp_path):
    """Stopped by Ctrl-C the command says so in a line, with the command that goes on; exit code 130."""
    import realitygap.experiments.noise as experiment

    def stopped(*_, **__):
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiment.Rig, "drive", stopped)
        result = call("experiment", "noise", "--out", tmp_path / "study", *SMALL)
    assert result.exit_code == 130 and result.stdout == ""
    last = result.stderr.splitlines()[-1]
    assert last.startswith("stopped; finished work is kept in") and "--resume" in last


CARRIED = """
from realitygap.robots import Body, Channel
class Carried(Body):
    channels = (Channel(name="proximity", sensors=5, high=4095),)
    reset = sense = act = stop = close = lambda self, *_: None
"""


def test_what_no_robot_of_ones_own_can_do_is_refused(refused, tmp_path):
    """Units, another noise, sensors that it lacks, carrying it, no base: one line, before any work."""
    out = ("experiment", "noise", "--out", tmp_path / "study", "--robot")
    own = (*out, ROBOT, "--base", BASE)
    assert "--units: belongs to the twin" in refused(*own, "--units", 1)
    assert "--twin-noise: belongs to the twin" in refused(*own, "--twin-noise", 2)
    assert "--tasks obstacle-avoidance" in refused(*own)
    assert "base: expected the rough profile" in refused(*out, ROBOT)
    assert "robot: expected twin, got 'twin:3'. Its units" in refused(*out, "twin:3", "--base", BASE)
    carried = tmp_path / "carried.py"
    carried.write_text(CARRIED)
    assert "it has no `enter`" in refused(*out, f"{carried}:Carried", "--base", BASE)
    assert not (tmp_path / "study").exists()


def test_a_resumed_robot_of_ones_own_is_named_again(refused, tmp_path):
    """A program that a folder names is not run before a person has named it."""
    made = NoiseConfig(units=1, tasks=("obstacle-avoidance",), robot=ROBOT, base=BASE)
    (tmp_path / "noise-study.toml").write_text(made.to_toml())
    out = ("experiment", "noise", "--out", tmp_path, "--resume")
    assert f"--robot: expected {ROBOT}" in refused(*out)
    assert f"--robot: expected {ROBOT}" in refused(*out, "--robot", "twin")


def test_the_twin_is_no_synonym_for_the_robot_of_a_resumed_study(refused, tmp_path):
    """A study of Enki's robot does not go on where the twin is asked for."""
    (tmp_path / "noise-study.toml").write_text(NoiseConfig(robot="enki:khepera").to_toml())
    out = ("experiment", "noise", "--out", tmp_path, "--resume", "--tasks", "obstacle-avoidance")
    assert "--robot: expected enki:khepera" in refused(*out, "--robot", "twin")
