"""`evolve`, `reproduce`, `show`, `replay` and `report`: from words to a folder and back."""

import json
import signal
import subprocess
import sys

import pytest
from click.testing import CliRunner
from tests.conftest import draw_nothing

from realitygap.api import evolve, merge
from realitygap.cli import realitygap
from realitygap.errors import ConfigError, StudyError, UsageError

SMALL = (
    "--evaluations", "70", "--workers", "1",
    "--set", "retest_trials=2", "--set", "fresh_trials=3", "--set", "task.seconds=2",
)  # fmt: skip


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A small finished study of two runs, made by `evolve`, and what that printed; its page is undrawn."""
    folder = tmp_path_factory.mktemp("studies") / "small"
    words = ["evolve", "light", "--noise", "double", "--seed", "7", "--runs", "2", *SMALL]
    with pytest.MonkeyPatch.context() as patch:
        draw_nothing(patch)
        result = CliRunner().invoke(realitygap, [*words, "--out", str(folder), "--json"])
    assert result.exit_code == 0, result.output
    return folder, json.loads(result.stdout)


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
    words = ["evolve", str(folder / "front.py"), *SMALL, "--out", str(folder / "study"), "--json"]
    with pytest.MonkeyPatch.context() as patch:
        draw_nothing(patch)
        result = CliRunner().invoke(realitygap, words)
    assert result.exit_code == 0, result.output
    return folder / "front.py", folder / "study", json.loads(result.stdout)


def test_evolve_tells_what_show_tells(study, json_of):
    """The figures at the end of `evolve` are those that `show` reads back."""
    folder, printed = study
    assert json_of("show", folder)["runs"] == printed["runs"]
    assert printed["report"].endswith("index.html")


def test_every_run_has_its_figures(study):
    """`show` names each run's task, noise, seed, evaluations, best fitness and champion."""
    _, printed = study
    assert [run["run"] for run in printed["runs"]] == [1, 2]
    for run in printed["runs"]:
        assert (run["task"], run["noise"], run["seed"]) == ("light-seeking", 2.0, 7)
        assert (run["evaluations"], run["finished"]) == (70, True)
        assert run["best_fitness"] > 0
        assert {(test["who"], test["noise"]) for test in run["tests"]} == {
            (who, noise) for who in ("fittest", "champion") for noise in (0.0, 1.0, 2.0)
        }


def test_one_run_by_number_or_by_name(study, json_of):
    """RUN is a number or a name; both give the same one run."""
    folder, printed = study
    by_number = json_of("show", folder, 2)["runs"]
    assert by_number == json_of("show", folder, printed["runs"][1]["name"])["runs"] == printed["runs"][1:]


def test_a_champion_can_be_saved_and_driven(study, call, json_of, tmp_path):
    """What `show STUDY RUN` prints, saved to a file, is a controller for `simulate`."""
    folder, _ = study
    file = tmp_path / "champion.txt"
    file.write_text(call("show", folder, 1).stdout)
    words = ("--pose", 15, 35, 10, "--noise", "double", "--seed", 3, "--seconds", 2)
    driven = json_of("simulate", "light", "--controller", file, *words)
    replayed = json_of("replay", folder, 1, *words)
    assert driven["x_cm"] == replayed["x_cm"]
    assert driven["score"] == replayed["score"]


def test_replay_takes_the_runs_own_noise_and_length(study, json_of):
    """Without options a replay is as the run was: its noise, its length, a start of the task's."""
    folder, _ = study
    made = json_of("replay", folder, 1)
    assert made["noise"] == 2.0
    assert len(made["t_s"]) == 20
    assert (made["x_cm"][0], made["y_cm"][0]) == (15, 35)


@pytest.mark.parametrize("who", ["fittest", "0", "69"])
def test_any_individual_can_be_replayed(study, json_of, who):
    """The fittest and every evaluation can be replayed."""
    folder, _ = study
    assert len(json_of("replay", folder, 2, "--individual", who)["t_s"]) == 20


@pytest.mark.parametrize(
    ("option", "file"), [("--picture", "path.png"), ("--animation", "film.gif"), ("--animation", "film.mp4")]
)
def test_a_replay_can_be_drawn_and_filmed(study, call, tmp_path, option, file):
    """A replay leaves the picture or film that was asked for."""
    folder, _ = study
    result = call("replay", folder, 1, "--seconds", 1, option, tmp_path / file)
    assert result.exit_code == 0, result.output
    assert (tmp_path / file).stat().st_size > 1000


def test_a_network_can_be_drawn(study, call, tmp_path):
    """`show STUDY RUN --picture` draws the champion's network."""
    folder, _ = study
    assert call("show", folder, 1, "--picture", tmp_path / "network.svg").exit_code == 0
    assert (tmp_path / "network.svg").read_text().startswith("<?xml")


@pytest.mark.usefixtures("undrawn")
def test_a_report_can_be_made_again(study, json_of):
    """`report` makes the page anew."""
    folder, _ = study
    page = folder / "report" / "index.html"
    page.unlink()
    told = json_of("report", folder)
    assert told["report"] == str(page)
    assert [len(table["rows"]) for table in told["tables"]] == [2]
    resumed = json_of("evolve", "light", "--resume", "--workers", 1, "--out", folder)
    assert told["tables"] == resumed["tables"]
    assert page.is_file()


def test_the_texts_for_people(study, call):
    """Without --json, `show` has a line a run and one run has its genotype."""
    folder, _ = study
    assert "light-seeking/double/2" in call("show", folder).stdout
    assert "# best fitness" in call("show", folder, 1).stdout


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("show", 3), "3"),
        (("show", "avoidance/zero/1"), "avoidance/zero/1"),
        (("replay", 9), "9"),
        (("replay", 1, "--individual", "best"), "--individual"),
        (("replay", 1, "--individual", 70), "--individual"),
        (("replay", 1, "--pose", -5, 0, 0), "--pose"),
        (("replay", 1, "--animation", "film.avi"), "--animation"),
    ],
)
def test_a_wrong_word_about_a_study_is_refused_by_name(study, refused, words, named):
    """A run, individual or file that there cannot be is named."""
    folder, _ = study
    command, *others = words
    assert named in refused(command, folder, *others)


def test_a_study_is_not_overwritten(study, refused):
    """`evolve` into a finished study is refused and says what to do."""
    folder, _ = study
    assert "--resume" in refused("evolve", "light", *SMALL, "--out", folder)


@pytest.mark.usefixtures("undrawn")
def test_resuming_needs_no_options_again(study, json_of):
    """With --resume omitted options keep their saved values; a finished study stays as it is."""
    folder, printed = study
    resumed = json_of("evolve", "light", "--resume", "--workers", 1, "--out", folder)
    assert resumed["runs"] == printed["runs"]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("light", "--seed", 8), "seed"),
        (("light", "--noise", "zero"), "noise"),
        (("light", "--set", "variation.mutation=0.2"), "variation.mutation"),
        (("avoidance",), "light-seeking"),
    ],
)
def test_resuming_with_another_configuration_is_refused(study, refused, words, named):
    """--resume with settings that the study was not made with is refused by key."""
    folder, _ = study
    assert named in refused("evolve", *words, "--resume", "--out", folder)


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("variation.mutatoin=0.1", "mutatoin"),
        ("variation.mutation=2", "mutation"),
        ("rows", "rows"),
        ("evolution.rows=0", "rows"),
        ("task.seconds=-1", "seconds"),
    ],
)
def test_a_wrong_setting_is_refused_by_key(refused, tmp_path, setting, named):
    """--set with an unknown key or a wrong value names it, and makes no folder."""
    assert named in refused("evolve", "light", "--set", setting, "--out", tmp_path / "none")
    assert not (tmp_path / "none" / "study.db").exists()


def test_a_title_that_is_no_text_is_refused(refused, tmp_path):
    """Bytes in another encoding than UTF-8, as a terminal passes them, cannot be written in study.toml."""
    words = ("evolve", "avoidance", "--set", "title=a\udcfc", "--out", tmp_path / "out")
    assert "study.toml: expected text in UTF-8" in refused(*words)
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("undrawn")
def test_evolving_from_a_configuration(study, json_of, tmp_path):
    """A study's own TOML, given to --config, makes the same runs again."""
    folder, printed = study
    words = ("--config", folder / "study.toml", "--workers", 1)
    made = json_of("evolve", "light", *words, "--out", tmp_path / "again")
    assert made["runs"] == printed["runs"]


@pytest.mark.usefixtures("undrawn")
def test_a_profile_is_given_as_an_option_or_as_a_setting(json_of, study, call, tmp_path):
    """`evolve --profile FILE` evolves what `--set profile=FILE` does, and that robot's study keeps it."""
    _, printed = study
    words = ("evolve", "light", "--noise", "double", "--seed", 7, "--runs", 2, *SMALL)
    mine = tmp_path / "mine.toml"
    mine.write_text(call("profile", "show", "khepera").stdout)
    by_option = json_of(*words, "--profile", mine, "--out", tmp_path / "option")
    by_setting = json_of(*words, "--set", f"profile={mine}", "--out", tmp_path / "setting")
    assert by_option["runs"] == by_setting["runs"] != printed["runs"]
    replayed = json_of("replay", tmp_path / "option", 1)
    assert replayed["profile"] == "khepera"
    other = json_of("replay", tmp_path / "option", 1, "--profile", "paper")
    assert other["profile"] == "paper" and other["ambient"] != replayed["ambient"]


def test_resuming_with_another_robot_is_refused(study, refused):
    """A study keeps the robot that it was evolved with."""
    folder, _ = study
    assert "profile.toml" in refused("evolve", "light", "--profile", "khepera", "--resume", "--out", folder)


def test_a_task_of_ones_own(own, json_of, call, tmp_path):
    """A user's task with two inputs evolves, and its champion is saved, driven and replayed."""
    (task, study, made), champion = own, tmp_path / "champion.txt"
    champion.write_text(call("show", study, 1).stdout)
    words = ("--pose", 25, 25, 0, "--seconds", 2)
    driven = json_of("simulate", task, "--controller", champion, *words)
    assert made["runs"][0]["champion"].strip() in champion.read_text()
    assert {len(row) for row in driven["inputs"]} == {2}
    assert driven["x_cm"] == json_of("replay", study, 1, *words)["x_cm"]


@pytest.mark.skipif(sys.platform == "darwin", reason="its file names are UTF-8")
def test_a_task_may_lie_in_a_folder_named_in_another_encoding(own, call, tmp_path):
    """A folder from a system with Latin-1 names is a folder as any other."""
    folder = tmp_path / "w\udcfc"
    folder.mkdir()
    (folder / "task.py").write_bytes(own[0].read_bytes())
    assert call("probe", folder / "task.py", "--pose", 25, 25, 0).exit_code == 0


def test_ctrl_c_says_how_to_go_on(tmp_path):
    """Ctrl-C ends in one line with the command that resumes; the study can be read."""
    folder = tmp_path / "long"
    words = ("evolve", "light", "--evaluations", "1000000", "--workers", "1", "--out", str(folder))
    command = [sys.executable, "-m", "realitygap", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as made:
        for line in made.stderr:
            if line.startswith("evolving"):
                break
        made.send_signal(signal.SIGINT)
        said = made.stderr.read().splitlines()
    assert made.returncode == 130
    assert said[-1].startswith("stopped")
    assert f"realitygap evolve light --out {folder} --resume" in said[-1]
    shown = CliRunner().invoke(realitygap, ["show", str(folder), "--json"])
    assert json.loads(shown.stdout)["runs"][0]["finished"] is False


@pytest.mark.usefixtures("undrawn")
def test_the_function_evolves_what_the_command_does(study, tmp_path):
    """From Python, with a watched page and a spread: a condition each, and the command's own fitnesses."""
    printed = study[1]
    small = {"retest_trials": 2, "fresh_trials": 3, "task.seconds": 2}
    made = evolve(
        "light", noise=2, spread=[0, 0.1], seed=7, runs=2, evaluations=70, workers=1, settings=small,
        out=tmp_path / "study", watch=True,
    )  # fmt: skip
    assert [(one.noise, one.spread) for one in made.config.conditions] == [(2.0, 0.0), (2.0, 0.1)]
    assert "finished" in (tmp_path / "study" / "watch.html").read_text("utf-8")
    assert [run.best_fitness for run in made.runs[:2]] == [run["best_fitness"] for run in printed["runs"]]
    with pytest.raises(ConfigError, match="spread: expected a number"):
        evolve("light", spread="much", out=tmp_path / "none")


@pytest.mark.usefixtures("undrawn")
def test_shards_from_python_are_the_study(study, tmp_path):
    """Each makes its share, beside the study; merged they are the command's; what is no shard is refused."""
    printed = study[1]
    small = {"retest_trials": 2, "fresh_trials": 3, "task.seconds": 2}
    one = {"noise": 2, "seed": 7, "runs": 2, "evaluations": 70, "workers": 1, "settings": small}
    shares = [evolve("light", out=tmp_path / "whole", shard=f"{i}/2", **one) for i in (1, 2)]
    assert [[run.finished for run in share.runs] for share in shares] == [[True, False], [False, True]]
    with pytest.raises(StudyError, match="missing: shard 2/2"):
        merge([shares[0]])
    made = merge((share.folder for share in reversed(shares)), workers=1)  # as of `Path.glob`
    assert made.folder == tmp_path / "whole" and (made.folder / "report" / "index.html").is_file()
    assert [run.best_fitness for run in made.runs] == [run["best_fitness"] for run in printed["runs"]]
    with pytest.raises(UsageError, match="watch: a shard has no page"):
        evolve("light", out=tmp_path / "other", shard="1/2", watch=True, **one)
    with pytest.raises(ConfigError, match="shard: expected I/N"):
        evolve("light", out=tmp_path / "other", shard="3/2", **one)
    assert {path.name for path in tmp_path.iterdir()} == {"whole", "whole-shard-1-of-2", "whole-shard-2-of-2"}


def test_a_strangers_task_file_is_asked_about(own, call, refused, json_of, monkeypatch, tmp_path):
    """`show` runs nothing; `replay` refuses, or asks on a terminal; --trust and a yes are remembered."""
    from realitygap.study import folder as sources

    _, study, _ = own
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "elsewhere"))
    sources._known.cache_clear()
    assert json_of("show", study)["runs"][0]["champion"]
    for words in (("replay", study, 1), ("report", study), ("transfer", study, "--robot", "twin")):
        assert "--trust" in refused(*words) and "front.py" in refused(*words)
    monkeypatch.setattr("realitygap.cli.notes.at_terminal", lambda: True)
    replay = ["replay", str(study), "1"]
    no = CliRunner().invoke(realitygap, replay, input="n\n")
    assert no.exit_code == 130 and "this program must run" in no.stderr
    yes = CliRunner().invoke(realitygap, replay, input="y\n")
    assert yes.exit_code == 0 and "score" in yes.stdout
    sources._known.cache_clear()
    assert call(*replay).exit_code == 0
