"""What a newcomer types wrong in the first hour is named in one line, with exit code 2."""

from dataclasses import replace

import pytest

from realitygap.world.robot import load_profile

AT = ("--pose", "25,25,0")
SIMULATE = ("simulate", "avoidance", "--controller", "constant:1,1", *AT)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("evolv",), "No such command 'evolv'"),
        (("evolve", "flying"), "unknown task 'flying'"),
        (("evolve", "light", "--noise", "loud"), "--noise"),
        (("evolve", "light", "--set", "variation.mutatoin=0.1"), "mutatoin"),
        (("evolve", "light", "--shard", "4/3"), "expected I/N, share I (from 1 to N) of N"),
        ((*SIMULATE[:-2], "--pose", "25,25"), "expected x, y (cm) and heading (degrees) as in 25,25,90"),
        ((*SIMULATE[:-2], "--pose", 25, 25, 90), "as in 25,25,90, got '25'"),
        ((*SIMULATE, "--seconds", 10**9), "seconds: expected a number from 0.1 (one step) to"),
        ((*SIMULATE, "--arena", "garden"), "unknown arena 'garden'"),
        ((*SIMULATE, "--profile", "no/such.toml"), "Give the path of a profile's .toml file"),
        ((*SIMULATE, "--picture", "path.bmp"), "ending in .png or .svg or .pdf"),
        ((*SIMULATE, "--picture", "no/folder/path.png"), "the folder 'no/folder' does not exist"),
        (("simulate", "avoidance", "--controller", "nobody.txt", *AT), "nobody.txt"),
        (("probe", "avoidance", "--pose", "15,15,0"), "overlaps the cylinder"),
        (("probe", "avoidance", "--pose", "0.25,0.35,90"), "Are these metres? In cm it is 25,35,90"),
        (("transfer", "study", "--robot"), "(see `realitygap transfer --help`)"),
        (("evolve", "avoidance", "--runs", "1.5e0"), "'1.5e0' is not a valid whole number"),
        (("figures", "study", "--width", "8.4"), "expected a width with its unit, as in 8.4cm"),
        (("record", "--robot", "twn", "--plan", "all", "--out", "x"), "twn"),
        (("calibrate", "no.sam", "--out", "robot.toml"), "no.sam"),
    ],
    ids=lambda value: " ".join(map(str, value)) if isinstance(value, tuple) else None,
)
def test_a_wrong_word_is_refused_by_name(refused, words, named):
    """What a person typed wrong is named in the one line that they get."""
    assert named in refused(*words)


def test_a_broken_file_is_refused_by_name(refused, tmp_path):
    """A genotype and a profile that cannot be read; a folder that is no study."""
    (tmp_path / "genes.txt").write_text("slot 0\nslot 1")
    (tmp_path / "mine.toml").write_text("name = ")
    assert "genes.txt" in refused("simulate", "light", "--controller", tmp_path / "genes.txt", *AT)
    assert "mine.toml" in refused(*SIMULATE, "--profile", tmp_path / "mine.toml")
    assert str(tmp_path) in refused("show", tmp_path)


@pytest.mark.parametrize(
    ("sensors", "said"),
    [(20, "expected at most 16 for a network, got all 20 proximity"), (0, "has no proximity sensors")],
)
def test_a_robot_with_no_sensors_for_a_task_or_too_many_is_refused(refused, tmp_path, sensors, said):
    """Each command says what the task asks of the robot's profile, not what a genotype is."""
    paper = load_profile("paper")
    eyes = replace(paper.infrared, sensors=(3 * paper.infrared.sensors)[:sensors])
    (tmp_path / "mine.toml").write_text(replace(paper, infrared=eyes).to_toml(), "utf-8")
    for words in (SIMULATE, ("evolve", "avoidance", "--evaluations", 9, "--out", tmp_path / "out")):
        assert said in refused(*words, "--profile", tmp_path / "mine.toml")


def test_a_file_that_cannot_be_written_is_refused_before_the_work(refused, monkeypatch, tmp_path):
    """In a folder without rights or on a read-only disk: not after minutes of fitting."""
    monkeypatch.setattr("os.access", lambda path, mode: path != tmp_path)
    said = refused("calibrate", "rec", "--out", tmp_path / "made.toml")
    assert f"the folder {str(tmp_path)!r} does not exist or cannot be written to" in said


@pytest.mark.filterwarnings("ignore:Couldn't get spec for numba")  # says numba-cuda, first imported here
def test_without_what_a_gpu_takes_the_cure_is_said(refused, monkeypatch, tmp_path):
    """Before anything is begun."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert 'pip install "realitygap[cuda]"' in refused("evolve", "light", "--engine", "cuda")
    assert not list(tmp_path.iterdir())
