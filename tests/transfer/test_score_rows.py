"""The marks of tables 1 and 2 follow from a study and its transfers, and from nothing else."""

from __future__ import annotations

import json
import math
import pickle
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from realitygap.cli import realitygap
from realitygap.files import to_toml
from realitygap.study.load import Study, load_study
from realitygap.study.runner import run_study
from realitygap.transfer import scores as module
from realitygap.transfer.record import archive
from realitygap.transfer.scores import MARKS, marks_of
from realitygap.work.pool import messages_of
from tests.study.helpers import small

SECONDS, STARTS = 8, 3
AVOIDER, SEEKER = 1, 2


@pytest.fixture(scope="module")
def evolved(tmp_path_factory) -> Path:
    """A run of each task, trials long enough to be named."""
    config = small().with_settings([f"task.seconds={SECONDS}"])
    return run_study(tmp_path_factory.mktemp("marked") / "study", config, workers=1).folder


@pytest.fixture
def study(evolved: Path, tmp_path: Path) -> Study:
    """A copy to which transfers may be added."""
    return load_study(shutil.copytree(evolved, tmp_path / "study"))


def drive(
    study: Study, number: int, *, radius: float = 3.0, robot: str = "twin-1", lose: bool = False
) -> None:
    """Transfers of a run: simulated circles of 3 cm from several starts, situated ones of a radius."""
    run = study.run(number)
    for start in range(1, STARTS + 1):
        folder = study.folder / "transfer" / robot / run.name.replace("/", "-") / f"start-{start}"
        folder.mkdir(parents=True)
        _write(folder / "simulated.csv", 3.0, start, lose=False)
        _write(folder / "situated.csv", radius, start, lose=lose and start == 1)
        unit = int(robot.split("-")[1])
        facts = {
            "run": run.id, "name": run.name, "task": run.task, "noise": run.noise, "individual": "champion",
            "robot": robot, "unit": unit, "twin_noise": 1.0, "start": start, "seconds": float(SECONDS),
            "pose": {"x_cm": 25.0, "y_cm": 25.0, "heading_deg": 0.0}, "film": False,
            "situated_from": "camera", "late_steps": 0, "fitness": {"simulated": 0.5, "situated": 0.4},
        }  # fmt: skip
        (folder / "transfer.toml").write_text(to_toml(facts), encoding="utf-8")


def _write(path: Path, radius: float, start: int, *, lose: bool) -> None:
    """A circle at 6 cm/s from the middle of the room."""
    rows = ["t_s,x_cm,y_cm,heading_deg"]
    for k in range(10 * SECONDS + 1):
        turn = 0.6 * k / radius
        heading = turn + start
        x = 25 + radius * (math.sin(heading) - math.sin(start))
        y = 25 - radius * (math.cos(heading) - math.cos(start))
        place = ",," if lose and 20 < k < 60 else f"{x:.6f},{y:.6f},{math.degrees(heading) % 360:.6f}"
        rows.append(f"{k / 10:.1f},{place}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def test_a_run_that_drove_no_robot_is_named_and_scored_in_simulation(study: Study) -> None:
    """Type and behaviour score are of the simulation; the others are missing, and why is said."""
    for mark in marks_of(study):
        assert mark.type and 0 < mark.share <= 1 and 0 <= mark.behaviour <= 10
        assert mark.correspondence is None and mark.differences is None
        assert "no transfer" in mark.why


def test_the_same_paths_correspond_and_others_do_not(study: Study) -> None:
    """Equal paths are observably identical; narrow circles beside wide ones score lower, with words."""
    drive(study, AVOIDER)
    same = marks_of(study)[0]
    assert same.correspondence == 10 and same.differences == "observably identical" and same.why == ""
    assert (same.starts, same.units, same.kind) == (STARTS, 1, "twin")
    shutil.rmtree(study.folder / "transfer")
    drive(study, AVOIDER, radius=1.0)
    other = marks_of(study)[0]
    assert other.correspondence < 6 and other.differences != same.differences
    assert other.low <= other.correspondence <= other.high
    assert (other.type, other.behaviour) == (same.type, same.behaviour)


def test_a_trial_in_which_the_robot_was_lost_is_left_out_and_said(study: Study) -> None:
    """The others are scored; the reason names robot and start."""
    drive(study, AVOIDER, lose=True)
    mark = marks_of(study)[0]
    assert mark.starts == STARTS - 1 and mark.correspondence is not None
    assert "twin-1, start 1" in mark.why and "lost" in mark.why


def test_marks_are_computed_once(study: Study, monkeypatch) -> None:
    """What is kept is read; a transfer that comes to be is marked, and a broken file is done without."""
    drive(study, AVOIDER)
    before = marks_of(study)
    made = []
    original = module.ScoreJob.row
    monkeypatch.setattr(module.ScoreJob, "row", lambda job: made.append(job.run.id) or original(job))
    assert marks_of(load_study(study.folder)) == before and made == []
    drive(study, SEEKER)
    marks_of(study)
    assert made == [SEEKER]
    (study.folder / MARKS).write_text("{")
    assert marks_of(study)[0] == before[0] and made == [SEEKER, AVOIDER, SEEKER]


def test_rows_of_another_version_are_made_anew(finished, tmp_path, monkeypatch):
    """The version is part of a row's key: a kernel that changed leaves no old row."""
    study = load_study(shutil.copytree(finished.folder, tmp_path / "study"))
    marks_of(study)
    before = set(json.loads((study.folder / MARKS).read_text()))
    monkeypatch.setattr("realitygap.transfer.scores._version", lambda: ("0", "another"))
    marks_of(study)
    assert not before & set(json.loads((study.folder / MARKS).read_text()))


class Posted:
    """A pool whose jobs and answers travel as messages do."""

    def work(self, setup, jobs, tell) -> None:
        for job in pickle.loads(pickle.dumps(list(jobs)))[::-1]:
            for message in messages_of(pickle.loads(pickle.dumps(setup)), job):
                tell(pickle.loads(pickle.dumps(message)))

    def close(self) -> None:
        pass


def test_rows_are_the_same_whoever_makes_them(study: Study, monkeypatch) -> None:
    """Other processes in any order make the rows of this one, and the same file of them."""
    drive(study, AVOIDER)
    here, file = marks_of(study), study.folder / MARKS
    kept = file.read_bytes()
    file.unlink()
    monkeypatch.setattr("realitygap.transfer.scores.FEW", 0)
    assert marks_of(study, workers=Posted()) == here and file.read_bytes() == kept


def test_packed_trials_are_scored_as_folders_are(study: Study) -> None:
    """`score` reads a run's trials, the folder of transfers and the study, whether packed or not."""
    drive(study, AVOIDER, radius=2.0)
    home = study.folder / "transfer"
    places = [study.folder, home, home / "twin-1", next(home.glob("*/*"))]
    before = [scored(place) for place in places]
    track = next(home.glob("*/*")) / "start-1" / "situated.csv"
    named = CliRunner().invoke(realitygap, ["classify", str(track), "--json"]).stdout
    archive(track.parents[1])
    assert not [*home.glob("*/*/start-*")]
    assert [scored(place) for place in places] == before
    assert CliRunner().invoke(realitygap, ["classify", str(track), "--json"]).stdout == named != ""


def scored(place: Path) -> dict:
    """What `realitygap score` prints of a folder, but for its name."""
    made = CliRunner().invoke(realitygap, ["score", str(place), "--json"])
    assert made.exit_code == 0, made.output
    return {key: value for key, value in json.loads(made.stdout).items() if key != "a"}
