"""`evolve`, `reproduce`, `merge`, `show`, `replay`, `export`, `report`: from words to a folder and back."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from tests.conftest import draw_nothing

from realitygap.api import evolve, merge
from realitygap.cli import realitygap
from realitygap.errors import StudyError, UsageError
from realitygap.world.robot import load_profile

TRIALS = {"retest_trials": 2, "fresh_trials": 3, "task.seconds": 2}
SETS = [word for key, value in TRIALS.items() for word in ("--set", f"{key}={value}")]
SMALL = ("--evaluations", "70", "--workers", "1", *SETS)
TWO = ("light", "--noise", "double", "--seed", "7", "--runs", "2")
PAGE = Path(__file__).resolve().parents[2] / "docs" / "machines.md"


def stopped(*_, **__):
    """What Ctrl-C makes of a function."""
    raise KeyboardInterrupt


def evolved(*words: object) -> dict:
    """What `evolve` of a small study printed; its page is undrawn."""
    with pytest.MonkeyPatch.context() as patch:
        draw_nothing(patch)
        result = CliRunner().invoke(realitygap, ["evolve", *map(str, words), *SMALL, "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A small finished study of two runs, made by `evolve`, and what that printed."""
    folder = tmp_path_factory.mktemp("studies") / "small"
    return folder, evolved(*TWO, "--out", folder)


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """A user's task with two inputs, a study of it, and what `evolve` printed; tests leave all as it is."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "front.py").write_text(
        "from realitygap import Start, Task\n"
        "def score(path, room):\n    return 1.0 - path.contact.mean()\n"
        "task = Task(name='front', arena='obstacle-avoidance', feeds='proximity', sensors=(2, 3),\n"
        "            start=Start(x_cm=25, y_cm=25), score=score)\n"
    )
    return folder / "front.py", folder / "study", evolved(folder / "front.py", "--out", folder / "study")


def test_evolve_says_what_show_says(study, json_of, call):
    """The figures at the end of `evolve` are those that `show` reads back, of all runs or one by number or
    name; without --json a line a run."""
    folder, printed = study
    runs = printed["runs"]
    assert json_of("show", folder)["runs"] == runs and printed["report"].endswith("index.html")
    assert json_of("show", folder, 2)["runs"] == json_of("show", folder, runs[1]["name"])["runs"] == runs[1:]
    facts = [runs[1][key] for key in ("run", "task", "noise", "seed", "evaluations", "finished")]
    assert facts == [2, "light-seeking", 2.0, 7, 70, True] and len(runs[1]["tests"]) == 6
    assert "light-seeking/double/2" in call("show", folder).stdout
    assert "# best during evolution" in call("show", folder, 1).stdout


def test_a_champion_can_be_saved_driven_and_replayed(study, call, json_of, tmp_path):
    """What `show STUDY RUN` prints is a controller; a replay is as the run was, with its noise and length."""
    folder, _ = study
    file = tmp_path / "champion.txt"
    file.write_text(call("show", folder, 1).stdout)
    words = ("--pose", "15,35,10", "--noise", "double", "--seed", 3, "--seconds", 2)
    driven = json_of("simulate", "light", "--controller", file, *words)
    replayed = json_of("replay", folder, 1, *words)
    assert driven["x_cm"] == replayed["x_cm"] and driven["score"] == replayed["score"]
    for who in ("champion", "fittest", "69"):
        made = json_of("replay", folder, 1, "--individual", who)
        assert (made["noise"], len(made["t_s"]), made["x_cm"][0], made["y_cm"][0]) == (2.0, 20, 15, 35)
    assert json_of("replay", folder, 1, "--profile", "khepera")["profile"] == "khepera"


@pytest.mark.parametrize(
    ("words", "file"),
    [
        (("replay", "--seconds", 1, "--picture"), "path.png"),
        (("replay", "--seconds", 1, "--picture"), "film.mp4"),
        (("show", "--picture"), "network.svg"),
    ],
)
def test_pictures_and_films(study, call, tmp_path, words, file):
    """A replay's path and film, a champion's network."""
    result = call(words[0], study[0], 1, *words[1:], tmp_path / file)
    assert result.exit_code == 0, result.output
    assert (tmp_path / file).stat().st_size > 1000


def test_exports(study, call, tmp_path):
    """Source of a champion."""
    source = call("export", "source", study[0], 1, "--name", "seeker", "--out", tmp_path)
    assert source.exit_code == 0 and "bytes of state" in source.stdout
    assert {file.name for file in tmp_path.iterdir()} >= {"seeker.h", "seeker.c"}


@pytest.mark.usefixtures("undrawn")
def test_a_report_can_be_made_again_and_a_study_resumed(study, json_of, refused):
    """`report` makes the page anew; --resume needs no options again, and refuses other ones by name."""
    folder, printed = study
    (folder / "report" / "index.html").unlink()
    made = json_of("report", folder)
    assert Path(made["report"]).is_file() and [len(table["rows"]) for table in made["tables"]] == [2]
    resumed = json_of("evolve", "light", "--resume", "--workers", 1, "--out", folder)
    assert resumed["runs"] == printed["runs"] and resumed["tables"] == made["tables"]
    assert "--resume" in refused("evolve", "light", *SMALL, "--out", folder)
    twice = ("evolve", "light", "--noise", 0, "--noise", "zero", "--out", folder / "none")
    assert "is there twice" in refused(*twice)
    for words, named in (
        (("light", "--seed", 8), "seed"),
        (("light", "--set", "variation.mutation=0.2"), "variation.mutation"),
        (("light", "--profile", "khepera"), "profile.toml"),
        (("avoidance",), "light-seeking"),
    ):
        assert named in refused("evolve", *words, "--resume", "--out", folder)
    for words, named in ((("show", 3), "3"), (("replay", 1, "--individual", 70), "--individual")):
        assert named in refused(words[0], folder, *words[1:])


@pytest.mark.usefixtures("undrawn")
def test_a_study_from_a_configuration(study, json_of, call, tmp_path):
    """A study's own TOML makes the same runs again; with another robot others, and the study keeps it."""
    words = ("light", "--config", study[0] / "study.toml")
    assert evolved(*words, "--out", tmp_path / "again")["runs"] == study[1]["runs"]
    other = evolved(*words, "--profile", "khepera", "--out", tmp_path / "other")
    assert other["runs"] != study[1]["runs"]
    assert json_of("replay", tmp_path / "other", 1)["profile"] == "khepera"


def test_a_task_of_ones_own(own, json_of, call, tmp_path):
    """A user's task with two inputs evolves, and its champion is saved, driven and replayed."""
    (task, study, made), champion = own, tmp_path / "champion.txt"
    champion.write_text(call("show", study, 1).stdout)
    words = ("--pose", "25,25,0", "--seconds", 2)
    driven = json_of("simulate", task, "--controller", champion, *words)
    assert made["runs"][0]["champion"].strip() in champion.read_text()
    assert {len(row) for row in driven["inputs"]} == {2}
    assert driven["x_cm"] == json_of("replay", study, 1, *words)["x_cm"]


@pytest.fixture
def another_user(monkeypatch, tmp_path):
    """Somebody who has agreed to run nothing yet; a call forgets what was agreed to in this process."""
    from realitygap.study import folder

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "elsewhere"))
    folder._known.cache_clear()
    return folder._known.cache_clear


def test_a_strangers_task_file_is_asked_about(own, call, refused, json_of, monkeypatch, another_user):
    """`show` runs nothing; `replay` refuses, or asks on a terminal; --trust and a yes are remembered."""
    _, study, _ = own
    assert json_of("show", study)["runs"][0]["champion"]
    for words in (("replay", study, 1), ("report", study), ("transfer", study, "--robot", "twin")):
        assert f"show {study} --trust`" in refused(*words) and "front.py" in refused(*words)
    monkeypatch.setattr("realitygap.cli.console.at_terminal", lambda: True)
    no = call("replay", study, 1, input="n\n")
    assert no.exit_code == 130 and "this program must run" in no.stderr
    yes = call("replay", study, 1, input="y\n")
    assert yes.exit_code == 0 and "score" in yes.stdout
    another_user()
    assert call("replay", study, 1).exit_code == 0


def test_a_strangers_configuration_runs_no_program_unasked(call, refused, another_user, tmp_path):
    """One that --config names runs with --trust only; one that the user names is the user's."""
    ran, program = tmp_path / "ran", "import pathlib\nclass Way: pass\n"
    (tmp_path / "their.py").write_text(f"{program}pathlib.Path({str(ran)!r}).touch()\n")
    (tmp_path / "their.toml").write_text('[evolution]\nalgorithm = "their.py:Way"\n')
    words = ("evolve", "light", "--config", tmp_path / "their.toml", "--out", tmp_path / "out")
    assert "give --trust" in refused(*words) and not ran.exists()
    with pytest.raises(StudyError, match="trust=True"):
        evolve("light", config=tmp_path / "their.toml", out=tmp_path / "out")
    assert not ran.exists() and not (tmp_path / "out").exists()
    assert call(*words, "--trust").exit_code == 2 and ran.exists()  # it is no algorithm
    assert call(*words, "--set", "evolution.algorithm=random", "--evaluations", 3).exit_code == 0


def test_ctrl_c_says_how_to_go_on(tmp_path):
    """Ctrl-C ends in one line with the command that resumes; the study can be read."""
    folder = tmp_path / "my  study"
    words = ("evolve", "light", "--evaluations", "1000000", "--workers", "1", "--out", str(folder))
    command = [sys.executable, "-m", "realitygap", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as made:
        for line in made.stderr:
            if line.startswith("evolving"):
                break
        made.send_signal(signal.SIGINT)
        last = made.stderr.read().splitlines()[-1]
    assert made.returncode == 130 and last.startswith("stopped")
    assert f"realitygap evolve light --out {shlex.quote(str(folder))} --resume" in last
    shown = CliRunner().invoke(realitygap, ["show", str(folder), "--json"])
    assert json.loads(shown.stdout)["runs"][0]["finished"] is False


@pytest.mark.usefixtures("undrawn")
def test_the_functions_do_what_the_commands_do(study, tmp_path):
    """From Python, with a watched page and a spread: a condition each, and the command's own fitnesses."""
    one = {"noise": 2, "seed": 7, "runs": 2, "evaluations": 70, "workers": 1, "settings": TRIALS}
    made = evolve("light", spread=[0, 0.1], out=tmp_path / "study", watch=True, **one)
    assert [(one.noise, one.spread) for one in made.config.conditions] == [(2.0, 0.0), (2.0, 0.1)]
    assert "finished" in (tmp_path / "study" / "watch.html").read_text("utf-8")
    assert [run.best_fitness for run in made.runs[:2]] == [run["best_fitness"] for run in study[1]["runs"]]
    with pytest.raises(UsageError, match="watch: a shard has no page"):
        evolve("light", out=tmp_path / "other", shard="1/2", watch=True, **one)


def _job(words: tuple[str, ...], shards: int) -> str:
    """The Slurm template of the docs, with another command and size."""
    script = re.search(r"```sh\n(#!/bin/bash.*?)```", PAGE.read_text("utf-8"), re.S)[1]
    shown, size = re.search(r"^(realitygap .*) --shard \$SLURM_ARRAY_TASK_ID/(\d+)", script, re.M).groups()
    assert f"#SBATCH --array=1-{size}\n" in script
    command = shlex.join([sys.executable, "-m", "realitygap", *words])
    return script.replace(shown, command).replace(f"ID/{size}", f"ID/{shards}")


@pytest.mark.usefixtures("undrawn")
def test_an_array_job_is_the_study(study, call, json_of, refused, monkeypatch, tmp_path):
    """The docs' array job does its shard, and goes on; all shards merged are the study of one process."""
    monkeypatch.chdir(tmp_path)
    words = ("evolve", *TWO, "--evaluations", "70", *SETS, "--out", "many")
    Path("job.sh").write_text(_job(words, 2))
    environment = {**os.environ, "SLURM_ARRAY_TASK_ID": "1"}
    for _ in range(2):  # once more, as after a requeue
        job = subprocess.run(["bash", "job.sh"], env=environment, capture_output=True, text=True)
        assert job.returncode == 0, job.stderr
        assert "shard 1/2 in many-shard-1-of-2\n" in job.stdout
        assert "when all are done: realitygap merge many-shard-*-of-2" in job.stdout
    assert "missing: shard 2/2" in refused("merge", "many-shard-1-of-2")
    second = json_of(*words, "--shard", "2/2", "--workers", "1")
    assert (second["study"], second["shard"]) == ("many-shard-2-of-2", "2/2")
    with pytest.raises(StudyError, match="missing: shard 2/2"):
        merge("many-shard-1-of-2")
    whole = merge(("many-shard-2-of-2", "many-shard-1-of-2"), out="whole", workers=1)
    merged = json_of("merge", "many-shard-1-of-2", "many-shard-2-of-2", "--workers", "1")
    assert merged["study"] == "many" and Path(merged["report"]).is_file()
    assert [run.best_fitness for run in whole.runs] == [run["best_fitness"] for run in merged["runs"]]
    assert merged["runs"] == study[1]["runs"] and merged["tables"] == study[1]["tables"]
    assert "many exists already" in refused("merge", "many-shard-1-of-2", "many-shard-2-of-2")
    monkeypatch.setattr("realitygap.transfer.scores.marks_of", stopped)
    again = call("merge", "many-shard-1-of-2", "many-shard-2-of-2", "--out", "again")
    assert again.exit_code == 130 and "in again; resume with `realitygap report again`" in again.stderr


@pytest.fixture
def calibrations(monkeypatch):
    """Calls for a calibration, which here takes no time and gives another robot; the first is stopped."""
    calls = []

    def made(folder, *, unit, noise, seed, workers, on_progress, **_):
        calls.append((folder, unit, noise, seed))
        on_progress("wheels", 1, 2)
        if len(calls) == 1:
            raise KeyboardInterrupt
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "robot.toml").write_text(load_profile("khepera").to_toml())
        return folder / "robot.toml"

    monkeypatch.setattr("realitygap.calibration.unit.calibrated_unit", made)
    page = "report/index.html"  # other tests look at it
    monkeypatch.setattr("realitygap.report.build.build_report", lambda study, **_: study / page)
    return calls


def test_reproduce_records_calibrates_and_resumes(calibrations, call, refused, json_of, tmp_path):
    """Stopped while recording, it goes on with the options it had; the study keeps the calibrated robot."""
    folder = tmp_path / "study"
    words = ("--runs", 1, "--evaluations", 66, "--workers", 1, "--no-transfer", "--out", folder)
    stop = call("reproduce", *words, "--seed", 4)
    assert stop.exit_code == 130 and "recording the robot: 1/2" in stop.stderr
    assert f"realitygap reproduce --no-transfer --out {folder} --resume" in stop.stderr.splitlines()[-1]
    assert "--resume" in refused("reproduce", *words)
    assert "seed = 4, not 5" in refused("reproduce", "--resume", "--seed", 5, "--out", folder)
    resume = ("reproduce", "--no-transfer", "--workers", 1, "--resume", "--out", folder)
    made = json_of(*resume)
    assert [run["evaluations"] for run in made["runs"]] == [66] * 6 and made["runs"][0]["seed"] == 4
    assert calibrations == [(folder / "calibration" / "unit-1", 1, 1.0, 4)] * 2
    assert load_profile(folder / "profile.toml").name == "khepera"
    again = call(*resume, "--json")
    assert json.loads(again.stdout) == made and len(calibrations) == 2  # one that was begun keeps its robot
    assert again.stderr.splitlines()[-1].startswith("took ")
    (tmp_path / "letters.txt").write_text("mine")
    assert "letters.txt" in refused("reproduce", "--out", tmp_path)
