"""`realities`: one loop on several realities, from words to a matrix; what is left out; refusals; Ctrl-C."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.experiments.noise_parts import quick_units

from realitygap.errors import ConfigError
from realitygap.experiments.realities import AT_HAND, Realities

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ROBOT, BASE = f"{EXAMPLES / 'own_robot.py'}:FiveEyes", str(EXAMPLES / "five_eyes.toml")
SMALL = (
    "--levels", "0,1", "--runs", 1, "--starts", 2, "--evaluations", 40, "--seconds", 2, "--workers", 1,
)  # fmt: skip
TWIN = (*SMALL, "--only", "--robot", "twin")


@pytest.fixture(scope="module")
def units():
    """A twin that needs neither recordings nor a process."""
    with quick_units() as patch:
        yield patch


@pytest.fixture
def no_enki(monkeypatch):
    """A machine without Enki's library."""
    monkeypatch.setattr("realitygap.robots.enki.LIBRARY", "libenki-missing.so")


@pytest.mark.usefixtures("undrawn")
def test_what_is_at_hand_comes_to_a_matrix(units, no_enki, json_of, call, refused, tmp_path):
    """The twin is carried through, Enki is left out and says how to get it; resumed, all is the same."""
    out = tmp_path / "study"
    told = json_of("realities", "--out", out, *SMALL)
    assert [one["robot"] for one in told["left_out"]] == list(AT_HAND[1:])
    assert all("apt install libenki-dev g++" in one["why"] for one in told["left_out"])
    (twin,) = told["realities"]
    (error,) = twin["model_error_over_noise"]
    assert (error["channel"], error["median"]) == ("proximity", 0.45)
    assert set(twin["tasks"]["obstacle-avoidance"]["levels"][0]["score_by_level"]) == {"0", "1"}
    page = Path(told["report"]).read_text()
    assert "Left out" in page and 'href="../twin-1/report/index.html"' in page
    assert (out / "twin-1" / "report" / "index.html").is_file()
    head, first, *_, last = (out / "report" / "tables" / "realities.csv").read_text().splitlines()
    assert head == ",twin,a real Khepera (readings only),a real Thymio II (readings only)"
    assert first == "proximity: error / noise,0.5,3.4 to 3.7,10.2" and last.startswith("noise-matched level,")
    assert "score at" not in page.split("</table>")[0]  # of a single run a level
    before = (out / "report" / "tables" / "realities.csv").read_bytes()
    again = call("realities", "--out", out, "--resume", "--workers", 1)
    assert again.exit_code == 0 and "enki:epuck is left out" in again.stderr
    errors = "proximity: error / noise 0.5 3.4 to 3.7 10.2"
    assert again.stdout.splitlines()[1].split() == errors.split()
    assert (out / "report" / "tables" / "realities.csv").read_bytes() == before
    assert "--resume" in refused("realities", "--out", out, *SMALL)
    assert "made with seed = 1995, not 7" in refused("realities", "--out", out, "--resume", "--seed", 7)


def test_a_reality_that_is_named_must_be_there(no_enki, refused, tmp_path):
    """One line with the cure, and no folder; so with what is no reality, and with a base of nobody."""
    out = ("realities", "--out", tmp_path / "study", *SMALL)
    assert "apt install libenki-dev g++" in refused(*out, "--robot", "enki:epuck")
    assert "Enki's robots are khepera, epuck, thymio2" in refused(*out, "--robot", "enki:alice")
    assert "use record, calibrate, evolve and transfer" in refused(*out, "--robot", "epuck:/dev/x")
    assert "base: expected a robot of your own, whose profile it is" in refused(*out, "--base", BASE)
    assert "base: expected the rough profile" in refused(*out, "--robot", ROBOT)
    assert "only: expected robots named with --robot" in refused(*out, "--only")
    assert "--starts" in refused("realities", "--out", tmp_path / "study", "--starts", 1)
    assert not (tmp_path / "study").exists()


@pytest.mark.usefixtures("undrawn")
def test_ctrl_c_says_how_to_go_on(units, call, monkeypatch, tmp_path):
    """Stopped by Ctrl-C it says so in a line, and `--resume` ends as if nothing had happened."""
    import realitygap.experiments.noise as experiment

    def stopped(*_, **__):
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiment.Rig, "drive", stopped)
        result = call("realities", "--out", tmp_path / "study", *TWIN)
    assert result.exit_code == 130 and result.stdout == ""
    assert f"realitygap realities --out {tmp_path / 'study'} --resume" in result.stderr.splitlines()[-1]
    assert call("realities", "--out", tmp_path / "study", "--resume", "--workers", 1).exit_code == 0
    assert call("realities", "--out", tmp_path / "whole", *TWIN).exit_code == 0
    files = ["report/tables/realities.csv", "twin-1/results/cells.csv", "twin-1/results/controllers.csv"]
    for file in files:
        assert (tmp_path / "study" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()


def test_a_program_that_a_folder_names_is_not_run_before_a_person_has(refused, tmp_path):
    """Who resumes with a robot of one's own names it again."""
    asked = Realities(robots=(ROBOT,), only=True, base=BASE)
    (tmp_path / "realities.toml").write_text(asked.to_toml())
    assert f"--robot: expected {ROBOT}" in refused("realities", "--out", tmp_path, "--resume")


def test_each_reality_is_an_experiment_of_noise_of_its_own():
    """The same design for all; a Thymio drives in a room that it fits."""
    asked = Realities(robots=("enki", ROBOT), base=BASE, seconds=5.0)
    assert asked.every == (*AT_HAND, ROBOT) and asked.robots == ("enki:khepera", ROBOT)
    studies = [asked.study(robot) for robot in asked.every]
    assert [one.robot for one in studies] == [None, *AT_HAND[1:], ROBOT]
    assert {(one.units, one.seconds, one.tasks) for one in studies} == {(1, 5.0, ("obstacle-avoidance",))}
    assert [one.arena for one in studies] == [None, None, None, "obstacle-avoidance-large", None]
    assert [one.base for one in studies] == [None, None, None, None, BASE]
    assert Realities(robots=("enki:epuck",), only=True).every == ("enki:epuck",)
    with pytest.raises(ConfigError, match="runs: expected a whole number"):
        Realities(runs=0)


def test_an_arena_takes_the_tasks_place_throughout(units, tmp_path):
    """The controllers evolve, drive and are compared in it; a Thymio's body is free at its start."""
    from tests.experiments.noise_parts import tiny

    from realitygap.experiments.noise import NoiseExperiment
    from realitygap.experiments.noise_run import noise_experiment
    from realitygap.study.load import load_study
    from realitygap.tasks.load import load_task
    from realitygap.world.arena import load_arena

    large = load_arena("obstacle-avoidance-large")
    start = load_task("avoidance").start
    assert large.obstacle_at(start.x_cm, start.y_cm, start.radius_cm + 8.0) is None
    config = tiny(tasks=("obstacle-avoidance",), arena=large.name, units=1, runs=1)
    noise_experiment(tmp_path, config, workers=1)
    assert NoiseExperiment(tmp_path, config).task("obstacle-avoidance").arena == large
    assert load_study(tmp_path / "evolved" / "unit-1").task("obstacle-avoidance").arena == large
    with pytest.raises(ConfigError, match="arena: expected none with several tasks"):
        tiny(arena=large.name)
