"""`reproduce` begins with a calibration, and goes on from wherever it was stopped."""

import json

import pytest
from click.testing import CliRunner

from realitygap.cli import realitygap
from realitygap.world.robot import load_profile

WORDS = ("--runs", 1, "--evaluations", 66, "--workers", 1, "--no-transfer")


@pytest.fixture
def calibrations(monkeypatch):
    """Calls for a calibration, which here takes no time and gives a robot of its own."""
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


def test_it_records_calibrates_and_resumes_with_what_was_asked(calibrations, refused, json_of, tmp_path):
    """Stopped while recording, it goes on with the options it had; the study keeps the calibrated robot."""
    folder = tmp_path / "study"
    words = [str(word) for word in ("reproduce", *WORDS, "--seed", 4, "--out", folder)]
    stopped = CliRunner().invoke(realitygap, words)
    assert stopped.exit_code == 130
    assert "recording the robot: 1/2" in stopped.stderr
    assert f"realitygap reproduce --no-transfer --out {folder} --resume" in stopped.stderr.splitlines()[-1]
    assert "--resume" in refused("reproduce", *WORDS, "--out", folder)
    assert "seed = 4, not 5" in refused("reproduce", "--resume", "--seed", 5, "--out", folder)
    made = json_of("reproduce", "--no-transfer", "--workers", 1, "--resume", "--out", folder)
    assert [run["evaluations"] for run in made["runs"]] == [66] * 6 and made["runs"][0]["seed"] == 4
    assert calibrations == [(folder / "calibration" / "unit-1", 1, 1.0, 4)] * 2
    assert load_profile(folder / "profile.toml").name == "khepera"
    assert [(table["task"], len(table["rows"])) for table in made["tables"]] == [
        ("obstacle-avoidance", 3), ("light-seeking", 3),
    ]  # fmt: skip
    words = ["reproduce", "--no-transfer", "--workers", "1", "--resume", "--out", str(folder), "--json"]
    again = CliRunner().invoke(realitygap, words)
    assert json.loads(again.stdout) == made and len(calibrations) == 2  # one that was begun keeps its robot
    took = again.stderr.splitlines()[-1]
    assert took.startswith("took 0:") and "finished already 0:" in took and "scoring behaviour 0:" in took


def test_a_wrong_robot_is_refused_before_anything_is_made(calibrations, refused, tmp_path):
    """A profile that there is not leaves no folder."""
    assert "nobody" in refused("reproduce", *WORDS, "--profile", "nobody", "--out", tmp_path / "none")
    assert not (tmp_path / "none" / "reproduce.toml").exists() and not calibrations


def test_other_files_are_refused_before_anything_is_recorded(calibrations, refused, tmp_path):
    """Nobody waits a minute to hear that the folder is another's."""
    (tmp_path / "letters.txt").write_text("mine")
    assert "letters.txt" in refused("reproduce", *WORDS, "--out", tmp_path)
    assert not calibrations
