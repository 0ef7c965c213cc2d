"""`realitygap transfer`, as a person types it, and its part in `reproduce`."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner
from tests.served import Served

import realitygap.transfer.run as study_transfer
from realitygap import Genotype, load_study, load_transfers
from realitygap.cli import realitygap
from realitygap.film.video import FilmWriter
from realitygap.study.config import Condition, StudyConfig
from realitygap.study.runner import run_study
from realitygap.tasks import load_task
from realitygap.transfer.camera import OverheadTracker
from realitygap.transfer.record import trial_content
from realitygap.twin.camera import OverheadCamera
from realitygap.values import Pose
from realitygap.world.arena import Arena

SHORT = ("--seconds", 0.5, "--workers", 1)


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


def test_a_controller_of_ones_own_drives_in_an_individuals_place(study, json_of, refused, tmp_path):
    """From the same starts, in a folder of its own; a champion's genotype in a file to the champion's bits.
    What was driven by another text of the file is not gone on with."""
    words = ("transfer", study, "--robot", "twin:1", "--no-watch", *SHORT)
    run, own = load_study(study).run(1), tmp_path / "own.py"
    Genotype(run.champion, 8).save(tmp_path / "champion.txt")
    own.write_text("class Turn:\n    def decide(self, inputs):\n        return 5, -5\n")
    evolved = json_of(*words, 1)["transfers"]
    told = json_of(*words, 1, "--controller", tmp_path / "champion.txt")["transfers"]
    for mine, theirs in zip(told, evolved, strict=True):
        folder = study / "controllers" / "champion" / "transfer" / "twin-1"
        assert Path(mine["folder"]).parents[1] == folder and mine["pose"] == theirs["pose"]
        for name in ("simulated.csv", "situated.csv"):
            assert trial_content(Path(mine["folder"]), name) == trial_content(Path(theirs["folder"]), name)
    turned = json_of(*words, "--controller", f"{own}:Turn")["transfers"]
    assert [(one["run"], one["individual"]) for one in turned] == [(1, "own-Turn"), (2, "own-Turn")]
    assert len(load_transfers(study)) == 1 and turned[0]["fitness_situated"] < 0.5
    own.write_text(own.read_text().replace("5, -5", "5, 5"))
    assert "made with controller = 'own.py:Turn, sha256" in refused(*words, "--controller", f"{own}:Turn")
    for more, said in (
        (("--controller", f"{own}:Drive"), "expected 'Drive' in it. It has Turn"),
        (("--controller", "braitenberg", "--individual", "fittest"), "individual: expected none with"),
        (("--controller", "braitenberg", "--shard", "1/2"), "shard: expected none with"),
    ):
        assert said in refused(*words, *more)


def test_two_units_as_json_and_as_text(study, json_of, call):
    """Each run drives each robot from each start; what is there already is told again."""
    words = ("transfer", study, "--robot", "twin:1", "--robot", "twin:2", "--starts", 2, "--no-watch", *SHORT)
    made = json_of(*words)["transfers"]
    assert [(one["robot"], one["run"], one["start"]) for one in made] == [
        (robot, run, start) for robot in ("twin-1", "twin-2") for run in (1, 2) for start in (1, 2)
    ]
    assert all(trial_content(Path(one["folder"]), "situated.csv") for one in made)
    assert all(one["fitness_simulated"] > 0 and one["late_steps"] == 0 for one in made)
    result = call(*words)
    assert result.exit_code == 0
    assert result.stdout.count("light-seeking/double/1") == 4
    assert result.stderr == ""  # nothing was left to be done


def test_a_run_by_name_with_its_own_length(study, json_of):
    """RUN may be a name; a trial lasts as long as the task's."""
    made = json_of("transfer", study, "light-seeking/double/1", "--robot", "twin", "--workers", 1)
    assert [(one["run"], one["seconds"]) for one in made["transfers"]] == [(2, 2.0)]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("9", "--robot", "twin"), "'9'"),
        (("--robot", "twn"), "twn"),
        (("--robot", "twin:one"), "'one'"),
        (("--robot", "serial:/dev/no-such-port"), "/dev/no-such-port"),
        (("--robot", "serial:/dev/null"), "/dev/null"),
        (("--robot", "serial:/dev/null", "--film"), "realitygap track"),
        (("--robot", "serial:/dev/null", "--eye", "0"), "--camera FILE"),
        (("--robot", "serial:/dev/null", "--camera", "camera.json"), "--eye DEVICE"),
        (("--robot", "serial:/dev/null", "--camera", "no.json", "--eye", "0"), "no.json"),
        (("--robot", "twin", "--camera", "camera.json", "--eye", "0"), "camera of its own"),
        (("--robot", "twin", "--disk", "mine.toml"), "disk of its own"),
        (("--robot", "twin", "--marker", "aruco:4x4_50:99"), "has the numbers 0 to 49, got 99"),
        (("--robot", "twin", "--view", "mujoco"), "view: expected a filmed twin"),
        (("--robot", "twin", "--film", "--view", "mujoco", "--marker", "aruco"), "expected drawn with"),
        (("--robot", "serial:/dev/null", "--marker", "aruco"), "marker: expected eye too"),
        (("--robot", "serial:/dev/null", "--disk", "mine.toml"), "--eye DEVICE"),
        (("--robot", "serial:/dev/null", "--twin-noise", "2"), "--twin-noise scales a twin's noise"),
        (("--robot", "twin", "--twin-noise", "11"), "--twin-noise"),
        (("--robot", "twin", "--starts", "0"), "--starts"),
        (("--robot", "twin", "--seconds", "0.25"), "--seconds"),
        (("--robot", "twin", "--twin-noise", "-1"), "--twin-noise"),
        (("--robot", "twin", "--individual", "best"), "--individual"),
        ((), "--robot"),
    ],
)
def test_a_wrong_word_is_refused_by_name(study, refused, words, named):
    """Runs, robots and numbers that cannot be are named in one line."""
    assert named in refused("transfer", study, *words)


def test_a_study_without_runs_is_refused(study, refused, tmp_path):
    """A folder without a study, a study without a finished run, a folder in the way."""
    import sqlite3

    from realitygap.study.store import _seal

    assert "no study" in refused("transfer", tmp_path, "--robot", "twin")
    (study / "transfer").write_text("in the way")
    assert "rights" in refused("transfer", study, "--robot", "twin", *SHORT)
    with sqlite3.connect(study / "study.db") as database:
        database.execute("UPDATE run SET finished = 0, champion = NULL")
        for (number,) in database.execute("SELECT id FROM run").fetchall():
            _seal(database, number)
    database.close()
    assert "no run is finished" in refused("transfer", study, "--robot", "twin")
    assert "no champion" in refused("transfer", study, 1, "--robot", "twin")


def test_a_rate_belongs_to_a_robot_with_a_choice(study, refused):
    """Beside one that has it, it may stand; where none has it, it would do nothing in silence."""
    words = ("transfer", study, 1, "--seconds", 0.5, "--baud", 9600, "--robot", "enki:khepera")
    assert "--baud: expected a Khepera or a twin; enki:khepera:1 has no rate" in refused(*words)
    assert "--baud" not in refused(*words, "--robot", "serial:/dev/nowhere")


def test_a_person_is_told_where_to_put_the_robot(study):
    """x, y and the heading in numbers and words; Enter starts; without a person nothing moves."""
    with Served({"size_cm": [60, 60]}, unit=1, pose=(30, 30, 0)) as twin:
        robot = f"serial:{twin.device}"
        words = ["transfer", str(study), "1", "--robot", robot, "--seconds", "0.5", "--baud", "any"]
        nobody = CliRunner().invoke(realitygap, words, input="")
        assert nobody.exit_code == 130
        assert "finished trials are kept" in nobody.stderr
        result = CliRunner().invoke(realitygap, words, input="\n")
    assert result.exit_code == 0, result.output
    assert "Put the robot at x = 2" in result.stderr and "counter-clockwise from +x" in result.stderr
    assert "counters" in result.stdout
    assert CliRunner().invoke(realitygap, words).stdout == result.stdout  # it is there already
    file = next(study.glob("transfer/serial-*/*/start-1/transfer.toml"))
    assert tomllib.loads(file.read_text())["baud"] == 38400  # the one that answered


def test_a_person_is_told_where_the_camera_sees_the_robot(study, tmp_path):
    """Not seen: asked again; seen far off: asked; seen near: started from there, and filmed."""
    arena = load_task("avoidance").arena
    camera = tmp_path / "camera.json"
    OverheadTracker(camera, arena, unit=1, noise=1.0, radius_cm=2.9)
    with Served(arena.plain(), unit=1) as twin:
        words = ["transfer", str(study), "1", "--robot", f"serial:{twin.device}", "--seconds", "0.5"]
        told = CliRunner().invoke(realitygap, words, input="")
        requested = [float(one) for one in re.findall(r"[xy] = ([\d.]+) cm|: (-?\d+)°", told.stderr)
                  for one in one if one]  # fmt: skip
        twin.place(Pose.from_degrees(*requested))
        places = [(-50.0, -50.0, 0.0), (requested[0] + 5.0, *requested[1:]), *[tuple(requested)] * 30]
        video = filmed(tmp_path / "eye.mp4", arena, places)
        words += ["--camera", str(camera), "--eye", str(video), "--film", "--json"]
        result = CliRunner().invoke(realitygap, words, input="\n\n\n")
    assert result.exit_code == 0, result.output
    assert "does not see the robot" in result.stderr and "far off" in result.stderr
    assert re.search(r"0\.[01] cm and [01]° from the requested pose", result.stderr)
    made = json.loads(result.stdout)["transfers"][0]
    assert made["situated_from"] == "film" and made["filmed"] and made["lost_steps"] == 0


def filmed(file: Path, arena: Arena, places: list[tuple[float, ...]]) -> Path:
    """A film of the twin at these places, one a frame."""
    with (
        OverheadCamera(arena.plain(), unit=1, view="drawn") as eye,
        FilmWriter(file, rate=25, made_by="the tests") as film,
    ):
        for k, place in enumerate(places):
            film.add(eye.frame(Pose.from_degrees(*place), k))
    return file


def test_ctrl_c_names_the_shards_own_folder(study, call, monkeypatch):
    """Where its trials are kept, and not the study's, which a shard does not change."""

    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("realitygap.transfer.run.run_transfer", stopped)
    told = call("transfer", study, "--robot", "twin", "--shard", "1/2").stderr
    assert f"trials are kept in {study}-transfer-shard-1-of-2/transfer; the same command" in told


def test_ctrl_c_says_how_to_go_on(study):
    """Ctrl-C ends in one line with the command that goes on, and leaves no half trial that counts."""
    words = ["transfer", str(study), "--robot", "twin", "--starts", "500", "--workers", "2", "--no-watch"]
    command = [sys.executable, "-m", "realitygap", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as made:
        assert made.stderr is not None
        while made.poll() is None and not study_transfer.load_transfers(study):
            time.sleep(0.1)
        made.send_signal(signal.SIGINT)
        said = made.stderr.read().splitlines()
    assert made.returncode == 130
    assert said[-1].startswith("stopped; finished trials are kept")
    assert f"`realitygap {' '.join(words)}`" in said[-1]
    assert study_transfer.load_transfers(study)


@pytest.mark.usefixtures("undrawn")
def test_reproduce_transfers_before_it_reports(json_of, refused, monkeypatch, tmp_path):
    """Two tasks are evolved at three levels, here in the paper's simulation, and their page is made. Every
    champion drives unit 1 from each start; the first of one run of each condition is filmed."""
    asked, out = [], tmp_path / "study"
    monkeypatch.setattr("realitygap.report.build.marks_of", lambda study: [])  # other tests look at them

    def transfer(study, options, **settings):
        asked.append(options)
        assert not (study.folder / "report" / "index.html").exists()
        return []

    monkeypatch.setattr("realitygap.experiments.reproduction.run_transfer", transfer)
    words = ("reproduce", "--runs", 1, "--evaluations", 66, "--workers", 1, "--profile", "paper")
    words = (*words, "--starts", 3, "--out", out)
    told = json_of(*words)
    assert told["transfers"] == []
    assert [(run["task"], run["noise"]) for run in told["runs"]] == [
        (task, noise) for task in ("obstacle-avoidance", "light-seeking") for noise in (0.0, 1.0, 2.0)
    ]
    assert (out / "report" / "index.html").is_file() and not (out / "calibration").exists()
    (made,) = asked
    assert made.robots == ("twin:1",) and made.runs == () and made.starts == 3
    assert made.film == [(run, 1) for run in range(1, 7)]
    asked.clear()
    assert "transfers" not in json_of(*words, "--resume", "--no-transfer")
    assert not asked
    assert len(json_of("show", out)["runs"]) == 6
    # `evolve` does not continue it as if it were of one task
    assert "conditions" in refused("evolve", "light", "--resume", "--out", out)


def test_distances_without_a_camera(study, call):
    """A transferred controller's row has distances of what its robot read and did; others have none."""
    from realitygap.study.load import load_study
    from realitygap.transfer.scores import marks_of

    call("transfer", study, 1, "--robot", "twin:1", "--starts", 2, "--no-watch", *SHORT)
    driven, *others = marks_of(load_study(study))
    assert driven.run == 1
    assert 0 <= driven.readings < 1 and 0 <= driven.commands < 1 and 0 <= driven.replay_cm < 5
    assert all(one.readings is one.replay_cm is None for one in others)
