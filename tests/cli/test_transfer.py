"""`realitygap transfer`, as a person types it, and its part in `reproduce`."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest
from tests.served import Served

from realitygap import Genotype, load_study, load_transfers, marks_of
from realitygap.cli.transfer import _found as found
from realitygap.study.config import Condition, StudyConfig
from realitygap.study.runner import run_study
from realitygap.values import Pose
from realitygap.work.archive import read_file

SHORT = ("--seconds", 0.5, "--workers", 1)
WHEELS = ("--path-from", "wheels")


@pytest.fixture(scope="module")
def original(tmp_path_factory) -> Path:
    """A study of two runs, one of each task, with short trials."""
    fields = {"seed": 7, "evaluations": 70, "retest_trials": 2, "fresh_trials": 3}
    conditions = (Condition(task="avoidance", noise=1.0), Condition(task="light", noise=2.0))
    config = StudyConfig(conditions=conditions, runs=1, **fields).with_settings(["task.seconds=2.0"])
    return run_study(tmp_path_factory.mktemp("transfers") / "study", config, workers=1).folder


@pytest.fixture
def study(original, tmp_path) -> Path:
    """The study's folder, of one's own."""
    return shutil.copytree(original, tmp_path / "study")


def test_two_units_as_json_and_as_text(study, json_of, call):
    """Each run drives each robot from each start; what is there already is told again. A driven controller's
    row of scores has distances of what its robot read and did. A run by name lasts as long as its task."""
    words = ("transfer", study, "--robot", "twin:1", "--robot", "twin:2", "--starts", 2, *WHEELS, *SHORT)
    made = json_of(*words)["transfers"]
    assert [(one["robot"], one["run"], one["start"]) for one in made] == [
        (robot, run, start) for robot in ("twin-1", "twin-2") for run in (1, 2) for start in (1, 2)
    ]
    assert all(one["fitness_simulated"] > 0 and one["late_steps"] == 0 for one in made)
    result = call(*words)
    assert (result.exit_code, result.stderr) == (0, "")  # nothing was left to be done
    assert result.stdout.count("light-seeking/double/1") == 4
    for row in marks_of(load_study(study)):
        assert 0 <= row.readings < 1 and 0 <= row.commands < 1 and 0 <= row.replay_cm < 5
    named = json_of("transfer", study, "light-seeking/double/1", "--robot", "twin:3", "--workers", 1)
    assert [(one["run"], one["seconds"]) for one in named["transfers"]] == [(2, 2.0)]


def test_a_controller_of_ones_own_drives_in_an_individuals_place(study, json_of, refused, tmp_path):
    """From the same starts, in a folder of its own; a champion's genotype in a file to the champion's bits.
    What was driven by another text of the file is not gone on with."""
    words = ("transfer", study, "--robot", "twin:1", *WHEELS, *SHORT)
    run, own = load_study(study).run(1), tmp_path / "own.py"
    Genotype(run.champion, 8).save(tmp_path / "champion.txt")
    own.write_text("class Turn:\n    def decide(self, inputs):\n        return 5, -5\n")
    evolved = json_of(*words, 1)["transfers"]
    driven = json_of(*words, 1, "--controller", tmp_path / "champion.txt")["transfers"]
    for mine, theirs in zip(driven, evolved, strict=True):
        folder = study / "controllers" / "champion" / "transfer" / "twin-1"
        assert Path(mine["folder"]).parents[1] == folder and mine["pose"] == theirs["pose"]
        for name in ("simulated.csv", "situated.csv"):
            assert read_file(Path(mine["folder"]), name) == read_file(Path(theirs["folder"]), name)
    turned = json_of(*words, "--controller", f"{own}:Turn")["transfers"]
    assert [(one["run"], one["individual"]) for one in turned] == [(1, "own-Turn"), (2, "own-Turn")]
    assert len(load_transfers(study)) == 1 and turned[0]["fitness_situated"] < 0.5
    own.write_text(own.read_text().replace("5, -5", "5, 5"))
    assert "made with controller = 'own.py:Turn, sha256" in refused(*words, "--controller", f"{own}:Turn")


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--robot", "serial:/dev/null", "--film"), "realitygap camera track"),
        (("--robot", "serial:/dev/null", "--camera-device", "0"), "--camera FILE"),
        (("--robot", "serial:/dev/null", "--camera", "camera.json"), "--camera-device DEVICE"),
        (("--robot", "twin", "--marker", "aruco:4x4_50:99"), "has the numbers 0 to 49, got 99"),
    ],
)
def test_a_wrong_word_is_refused_by_name(study, refused, words, named):
    """Runs, robots and numbers that cannot be are named in one line."""
    assert named in refused("transfer", study, *words)


def test_a_person_is_told_where_to_put_the_robot(study, call):
    """x, y and the heading in numbers and words; Enter starts; without a person nothing moves."""
    with Served({"size_cm": [60, 60]}, unit=1, pose=(30, 30, 0)) as twin:
        robot = f"serial:{twin.device}"
        words = ["transfer", study, 1, "--robot", robot, "--seconds", "0.5", "--baud", "any"]
        nobody = call(*words, input="")
        assert nobody.exit_code == 130 and "finished trials are kept" in nobody.stderr
        result = call(*words, "--verbose", input="\n")
    assert result.exit_code == 0, result.output
    assert "Put the robot at x = 2" in result.stderr and "counter-clockwise from +x" in result.stderr
    assert "counters" in result.stdout
    assert call(*words, "--verbose").stdout == result.stdout  # it is there already
    file = next(study.glob("transfer/serial-*/*/start-1/transfer.toml"))
    assert tomllib.loads(file.read_text())["baud"] == 38400  # the one that answered


def test_a_person_is_told_where_the_camera_sees_the_robot(monkeypatch, capsys):
    """Not seen, or far from its start: asked; near: started from there."""
    asked: list[str] = []
    monkeypatch.setattr("click.prompt", lambda question, **_: asked.append(question) or "w")
    start = Pose.from_degrees(20, 20, 90)
    assert found(None, start, None) and found(None, start, Pose.from_degrees(25, 20, 90))
    assert "as if it were exactly" in asked[0] and "That is far off" in asked[1]
    assert found(None, start, Pose.from_degrees(21, 20, 85)) and len(asked) == 2
    said = capsys.readouterr().err
    assert "does not see the robot" in said and "1.0 cm and 5° from the requested pose" in said


def test_ctrl_c_says_how_to_go_on(study):
    """In one line with the command that goes on, and no half trial counts."""
    words = ["transfer", str(study), "--robot", "twin", "--starts", "500", "--workers", "2", *WHEELS]
    command = [sys.executable, "-m", "realitygap", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as made:
        while made.poll() is None and not load_transfers(study):
            time.sleep(0.1)
        made.send_signal(signal.SIGINT)
        last = made.stderr.read().splitlines()[-1]
    assert made.returncode == 130 and last.startswith("stopped; finished trials are kept")
    assert f"`realitygap {' '.join(words)}`" in last and load_transfers(study)


@pytest.mark.usefixtures("undrawn")
def test_reproduce_transfers_before_it_reports(json_of, refused, monkeypatch, tmp_path):
    """Every champion drives unit 1 from each start, the first of each condition is filmed; then the page is
    made. With the paper's profile nothing is calibrated."""
    asked, out = [], tmp_path / "study"
    monkeypatch.setattr("realitygap.report.build.marks_of", lambda study: [])  # other tests look at them

    def transfer(study, options, **settings):
        asked.append(options)
        assert not (study.folder / "report" / "index.html").exists()
        return []

    monkeypatch.setattr("realitygap.experiments.reproduction.run_transfer", transfer)
    words = ("reproduce", "--runs", 1, "--evaluations", 66, "--workers", 1, "--profile", "paper")
    words = (*words, "--starts", 3, "--out", out)
    assert json_of(*words)["transfers"] == []
    assert (out / "report" / "index.html").is_file() and not (out / "calibration").exists()
    (made,) = asked
    assert (made.robots, made.runs, made.starts) == (("twin:1",), (), 3)
    assert made.film == [(run, 1) for run in range(1, 7)]
    assert "transfers" not in json_of(*words, "--resume", "--no-transfer") and len(asked) == 1
    # `evolve` does not continue it as if it were of one task
    assert "conditions" in refused("evolve", "light", "--resume", "--out", out)
