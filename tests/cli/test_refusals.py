"""Every wrong word ends in one clear line that names what was wrong; exit code 2."""

import errno
import os
import subprocess
import sys
from dataclasses import replace

import click
import pytest

from realitygap.cli.failure import DEBUG, StoppedError, guarded
from realitygap.errors import RealityGapError, StudyError
from realitygap.world.robot import load_profile

SIMULATE = ("simulate", "avoidance", "--controller", "constant:1,1", "--pose", 25, 25, 0)
PROBE = ("probe", "avoidance", "--pose", 25, 25, 0)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("evolv",), "evolv"),
        (("evolve",), "TASK"),
        (("evolve", "flying"), "flying"),
        (("evolve", "light", "--noise", "loud"), "--noise"),
        (("evolve", "light", "--runs", 0), "--runs"),
        (("evolve", "light", "--evaluations", "many"), "--evaluations"),
        (("evolve", "light", "--seed", -1), "--seed"),
        (("evolve", "light", "--workers", 0), "--workers"),
        (("evolve", "light", "--engine", "gpu"), "--engine"),
        (("evolve", "light", "--profile", "nobody"), "nobody"),
        (("reproduce", "--runs", -5), "--runs"),
        (("reproduce", "--seed", 2.5), "--seed"),
        (("simulate", "avoidance", "--pose", 25, 25, 0), "--controller"),
        (("simulate", "avoidance", "--controller", "constant:1,1"), "--pose"),
        ((*SIMULATE, "--seconds", 0), "--seconds"),
        ((*SIMULATE, "--seconds", -1), "--seconds"),
        ((*SIMULATE, "--seconds", "nan"), "--seconds"),
        ((*SIMULATE, "--seconds", 0.25), "--seconds"),
        ((*SIMULATE, "--noise", "nan"), "--noise"),
        ((*SIMULATE, "--noise", -1), "--noise"),
        ((*SIMULATE, "--seed", -3), "--seed"),
        ((*SIMULATE, "--profile", "mine"), "mine"),
        ((*SIMULATE, "--arena", "garden"), "garden"),
        ((*SIMULATE, "--picture", "path.bmp"), "--picture"),
        ((*SIMULATE, "--picture", "no/such/folder/path.png"), "--picture"),
        (("simulate", "avoidance", "--controller", "constant:1", "--pose", 25, 25, 0), "constant"),
        (("simulate", "avoidance", "--controller", "constant:99,0", "--pose", 25, 25, 0), "99"),
        (("simulate", "avoidance", "--controller", "no-such-file", "--pose", 25, 25, 0), "no-such-file"),
        (("probe", "swimming", "--pose", 25, 25, 0), "swimming"),
        (("probe", "avoidance", "--pose", 15, 15, 0), "cylinder"),
        (("probe", "avoidance", "--pose", 21, 15, 0), "--pose"),
        (("probe", "avoidance", "--pose", 1, 25, 0), "wall"),
        (("probe", "avoidance", "--pose", -40, 25, 0), "--pose"),
        (("probe", "avoidance", "--pose", "inf", 25, 0), "--pose"),
        (("probe", "avoidance", "--pose", 25, 25, "nan"), "--pose"),
        (("probe", "avoidance", "--pose", 25, 25, "east"), "--pose"),
        (("probe", "avoidance", "--pose", 25, 25), "--pose"),
        ((*PROBE, "--repeat", 0), "--repeat"),
        ((*PROBE, "--repeat", 10**9), "--repeat"),
        (("profile", "show", "nobody"), "nobody"),
        (("arena", "show", "nowhere"), "nowhere"),
        (("show", "no/such/study"), "no/such/study"),
        (("report", "no/such/study"), "no/such/study"),
        (("replay", "no/such/study", 1), "no/such/study"),
        ((*PROBE, "--arena", "no/such.toml"), "Give the path of an arena's .toml file"),
        ((*PROBE, "--profile", "no/such.toml"), "Give the path of a profile's .toml file"),
        (("twin", "serve", "--arena", "light", "--twin-noise", 11), "at most 10"),
        (("twin", "serve", "--arena", "light", "--noise", 11), "--noise"),
        (("twin", "serve", "--arena", "light", "--baud", "any"), "--baud"),
        (("record", "--robot", "twin", "--plan", "all", "--out", "x", "--twin-noise", 11), "at most 10"),
        (("record", "--robot", "epuck:x", "--plan", "all", "--out", "x", "--baud", 9600), "Leave it out"),
        (("robot", "check", "--robot", "thymio:x", "--baud", "any"), "thymio:x has no rate"),
        (("experiment", "noise", "--twin-noise", 11), "at most 10"),
    ],
    ids=lambda value: " ".join(map(str, value)) if isinstance(value, tuple) else None,
)
def test_a_wrong_word_is_refused_by_name(refused, words, named):
    """What a person typed wrong is named in the one line that they get."""
    assert named in refused(*words)


@pytest.mark.parametrize(
    "text",
    ["", "a genotype it is not", "\x00\x01\x02", "slot 0\nslot 1"],
    ids=["empty", "words", "bytes", "broken"],
)
def test_a_broken_genotype_is_refused(refused, tmp_path, text):
    """A genotype's file that cannot be read is named."""
    file = tmp_path / "genes.txt"
    file.write_text(text)
    assert "genes.txt" in refused("simulate", "light", "--controller", file, "--pose", 15, 35, 0)


def test_a_broken_profile_is_refused_by_file(refused, tmp_path):
    """A robot's file that is no TOML is named."""
    file = tmp_path / "mine.toml"
    file.write_text("name = ")
    assert "mine.toml" in refused(*PROBE, "--profile", file)


@pytest.mark.parametrize("words", [SIMULATE, ("evolve", "avoidance", "--evaluations", 9)])
@pytest.mark.parametrize(
    ("sensors", "told"),
    [(20, "expected at most 16 for a network, got all 20 proximity"), (0, "has no proximity sensors")],
)
def test_a_robot_with_no_sensors_for_a_task_or_too_many_is_refused(refused, tmp_path, words, sensors, told):
    """Each command says what the task asks of the robot's profile, not what a genotype is."""
    paper = load_profile("paper")
    eyes = replace(paper.infrared, sensors=(3 * paper.infrared.sensors)[:sensors])
    (tmp_path / "mine.toml").write_text(replace(paper, infrared=eyes).to_toml(), "utf-8")
    out = () if words is SIMULATE else ("--out", tmp_path / "out")
    assert told in refused(*words, *out, "--profile", tmp_path / "mine.toml")


def test_a_folder_that_is_no_study_is_refused(refused, tmp_path):
    """`show` of a folder without a study names the folder."""
    assert str(tmp_path) in refused("show", tmp_path)


@pytest.mark.parametrize(
    ("failure", "code", "says"),
    [
        (StudyError("no study here"), 2, "error: no study here"),
        (RealityGapError("not your doing"), 1, "error: not your doing"),
        (PermissionError(errno.EACCES, "Permission denied", "out"), 2, "error: Permission denied: out"),
        (OSError(errno.ENOSPC, "No space left on device"), 2, "error: No space left on device. Free some"),
        (OSError(errno.EROFS, "Read-only", "out"), 2, "error: Read-only: out. Check the path"),
        (OSError(errno.EIO, "Input/output error"), 1, "error: Input/output error"),
        (StoppedError("stopped; resume with `x`"), 130, "stopped; resume with `x`"),
        (click.Abort(), 130, "stopped"),
        (KeyboardInterrupt(), 130, "stopped"),
        (ZeroDivisionError("two\nlines"), 1, "error: unexpected ZeroDivisionError: two lines"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else None,
)
def test_every_failure_ends_in_one_line_and_a_code(capsys, failure, code, says):
    """Whatever goes wrong, stderr gets one line, and the exit code tells whose turn it is."""

    def work() -> None:
        raise failure

    assert guarded(work) == code
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert said[0].startswith(says)


def test_a_damaged_file_is_not_taken_for_ctrl_c(call, monkeypatch):
    """What Python says of one that ends too early, click takes for the end of the input: "stopped"."""

    def broken(*_, **__):
        raise EOFError("marshal data too short")

    monkeypatch.setattr("realitygap.tasks.load_task", broken)
    result = call("probe", "avoidance", "--pose", 25, 25, 0)
    assert result.exit_code == 1 and "unexpected EOFError: marshal data too short" in result.stderr


@pytest.mark.parametrize(
    "words",
    [("calibrate", "rec", "--out"), ("track", "film.mp4", "--out"), ("replay", "study", 1, "--picture")],
)
def test_a_file_that_cannot_be_written_is_refused_before_the_work(refused, monkeypatch, tmp_path, words):
    """In a folder without rights or on a read-only disk: not after minutes of fitting."""
    file = tmp_path / ("made.csv" if "track" in words else "made.png" if 1 in words else "made.toml")
    monkeypatch.setattr("os.access", lambda path, mode: path != tmp_path)
    assert f"{str(file)!r} cannot be written; check its rights" in refused(*words, file)


def test_a_folder_that_cannot_be_one_is_named_with_a_cure(refused, tmp_path):
    """--out that is a file, or below one, says what to do about it."""
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        said = refused("record", "--robot", "twin", "--plan", "wheels", "--out", out)
        assert str(out) in said and said.endswith("Check the path and its rights, or take another.")


def test_a_broken_database_is_the_users_to_mend(capsys):
    """An error of SQLite that a room let through is one line too."""
    import sqlite3

    def work() -> None:
        raise sqlite3.OperationalError("database or disk is full")

    assert guarded(work) == 2
    assert "database or disk is full" in capsys.readouterr().err


def test_debug_shows_where(capsys, monkeypatch):
    """With REALITYGAP_DEBUG=1 the traceback comes before the line."""
    monkeypatch.setenv(DEBUG, "1")
    assert guarded(lambda: 1 // 0) == 1
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_a_closed_stream_is_no_failure(closed, tmp_path):
    """What would be printed there goes nowhere; the rest of the work is done."""
    words = f"{sys.executable} -m realitygap show nothing {closed}; {sys.executable} -m realitygap simulate"
    words += f" avoidance --controller constant:5,5 --pose 25 25 90 --picture {tmp_path}/made.png {closed}"
    made = subprocess.run(["sh", "-c", words], capture_output=True, text=True, check=False)
    assert made.returncode == 0 and (tmp_path / "made.png").is_file()
    error = [] if "2>" in closed else ["error: nothing: no such folder. Give a study's folder, such as"]
    assert [line.partition(" `")[0] for line in made.stderr.splitlines()] == error


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
def test_a_full_disk_under_stdout_ends_in_one_line():
    """Output that cannot be written ends in one line, without a complaint of the interpreter's."""
    with open("/dev/full", "w") as full:
        code = [sys.executable, "-m", "realitygap", "profile", "show", "paper"]
        made = subprocess.run(code, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert made.returncode == 2
    said = "error: No space left on device. Free some space, or take another place; what was saved is kept."
    assert made.stderr.splitlines() == [said]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
@pytest.mark.parametrize("stdout", [subprocess.PIPE, None], ids=["stderr", "both"])
@pytest.mark.parametrize("debug", ["0", "1"])
def test_a_full_disk_under_stderr_keeps_the_exit_code(stdout, debug, monkeypatch):
    """Where nothing can be said, not even where it failed, the code still tells whose doing it was."""
    monkeypatch.setenv(DEBUG, debug)
    with open("/dev/full", "w") as full:
        code = [sys.executable, "-m", "realitygap", "profile", "show", "papier" if stdout else "paper"]
        made = subprocess.run(code, stdout=stdout or full, stderr=full, check=False)
    assert made.returncode == 2


def test_a_reader_that_has_seen_enough_is_no_failure():
    """`realitygap … | head -0` ends quietly."""
    code = [sys.executable, "-m", "realitygap", "profile", "show", "paper"]
    with subprocess.Popen(code, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as made:
        made.stdout.close()
        said = made.stderr.read()
    assert said == ""


@pytest.mark.filterwarnings("ignore:Couldn't get spec for numba")  # says numba-cuda, first imported here
@pytest.mark.parametrize("words", [("evolve", "light"), ("reproduce",), ("experiment", "noise")])
def test_without_what_a_gpu_takes_the_cure_is_said(words, refused, monkeypatch, tmp_path):
    """Before anything is begun."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    told = refused(*words, "--engine", "cuda")
    assert "numba-cuda" in told and 'pip install "realitygap[cuda]"' in told
    assert not list(tmp_path.iterdir())
