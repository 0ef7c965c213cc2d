"""The noise experiment: its design, its tables, its comparisons, interruptions, refusals."""

from __future__ import annotations

import csv
import json
import math
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

from realitygap.errors import StudyBusyError, StudyError, StudyInterruptedError
from realitygap.experiments.noise import NoiseConfig, NoiseExperiment, noise_experiment
from realitygap.simulation.simulation import Simulation
from realitygap.study.load import load_study
from realitygap.study.provenance import project_commit
from realitygap.work.folder import lock
from tests.experiments.noise_parts import quick_units, tables, tiny, unit_profile, wearing

COMPARING = "comparing with the simulations"


@pytest.fixture(scope="module")
def units():
    """Quick units for all tests of this file."""
    with quick_units() as patch:
        yield patch


@pytest.fixture(scope="module")
def done(units, tmp_path_factory) -> Path:
    """The folder of a finished tiny experiment; tests leave it as it is."""
    folder = tmp_path_factory.mktemp("noise") / "study"
    noise_experiment(folder, tiny(), workers=1)
    return folder


@pytest.fixture
def copy(done, tmp_path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(done, tmp_path / "copy"))


def rows(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / "results" / name).open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_design_is_crossed(tmp_path):
    """Every controller is there once; the runs of a task and level take turns with the units."""
    every = NoiseExperiment(tmp_path, NoiseConfig()).controllers()
    assert len(every) == len({one.name for one in every}) == 400
    first = [one for one in every if (one.task, one.level) == ("light-seeking", 0.5)]
    assert sorted((one.run, one.home) for one in first)[:4] == [(1, 1), (2, 2), (3, 3), (4, 1)]
    assert len(first) == 40


def test_every_controller_meets_every_level(done):
    """cells.csv has each controller at each level; controllers.csv has each once, with its home."""
    made, cells = rows(done, "controllers.csv"), rows(done, "cells.csv")
    who = ("task", "run", "evolved_level")
    assert len(made) == 8 and len(cells) == 16
    assert [[row[key] for key in who] for row in made for _ in (0, 1)] == [[r[k] for k in who] for r in cells]
    assert [row["comparison_level"] for row in cells] == ["0", "1"] * 8
    assert [row["home_unit"] for row in made] == ["1", "2"] * 4
    for row in cells:
        assert 0 <= float(row["score"]) <= 10 and math.isfinite(float(row["noisiness"]))
        assert all(0 <= float(row[f"score_unit_{unit}"]) <= 10 for unit in (1, 2))
    for row in made:
        same = [cell for cell in cells if all(cell[key] == row[key] for key in who)]
        own = [cell for cell in same if cell["comparison_level"] == row["evolved_level"]]
        assert own[0]["fitness_simulated"] == row["fitness_simulated"]
        drop = float(row["fitness_simulated"]) - float(row["fitness_situated"])
        assert float(row["drop"]) == pytest.approx(drop, abs=1e-4 * float(row["fitness_simulated"]))
        of_units = [float(row[f"fitness_situated_unit_{u}"]) for u in (1, 2)]
        assert float(row["fitness_situated"]) == pytest.approx(sum(of_units) / 2, rel=1e-4)


def test_the_settings_and_the_calibration_are_told(done):
    """study.toml has the settings, the command and the versions; calibration.csv a row a channel."""
    told = tomllib.loads((done / "results" / "study.toml").read_text())
    assert NoiseConfig.from_folder(done) == tiny()
    assert told["levels"] == [0, 1] and told["twin_trials"] == 48 and told["versions"]["mujoco"]
    assert told["versions"]["commit"] == told["versions_at_start"]["commit"] == project_commit()
    assert told["command"].startswith("realitygap experiment noise --levels 0,1 --runs 2 --units 2")
    assert list(told["seconds"]) == ["calibrate", "evolve", "situated", "simulated"]
    kept = [tuple(row.values()) for row in rows(done, "calibration.csv")]
    assert kept == [(unit, "infrared", "9", "20", "0.45", "0.3") for unit in "12"]


def test_all_levels_are_compared_on_the_same_starts(done):
    """Controllers of a task start from the same places on every unit."""
    design = NoiseExperiment(done, tiny())
    for one in design.controllers():
        starts = [(pose.x, pose.y) for pose in design.starts(one.task, 1, 1)]
        for of_unit in design.read_driven(one).poses[:, :, 0, :2]:
            assert of_unit == pytest.approx(np.array(starts), abs=1e-9)


def test_a_controller_keeps_its_bands_on_every_robot(done):
    """In the simulation of another unit a network is fed as its home made it; the rest is the unit's."""
    design = NoiseExperiment(done, tiny())
    worn = design.simulation("obstacle-avoidance", 2, 1, 1.0).profile
    assert worn.name == "unit 2"
    assert worn.infrared.bands == design.profile(1).infrared.bands != design.profile(2).infrared.bands


@pytest.mark.parametrize("home", [1, 2])
def test_every_unit_is_compared_with_its_own_simulation(copy, home):
    """Paths of units that are their simulations score 10 without noise; those of one unit alone do not."""
    design = NoiseExperiment(copy, tiny())
    one = next(one for one in design.controllers() if one.home == home)
    networks = load_study(design.evolved_folder(one.study)).networks(one.task, design.genes(one))
    scores = []
    for drawn_as in (None, home):
        poses = np.empty_like(design.read_driven(one).poses)
        for u in (1, 2):
            robot = wearing(unit_profile(drawn_as or u), unit_profile(home))
            quiet = Simulation(design.task(one.task), robot, 0.0)
            for k, start in enumerate(design.starts(one.task, 1, 1)):
                path = quiet.trajectory(networks, stream=0, pose=start)[0].track
                poses[u - 1, k] = np.column_stack([path.x, path.y, path.heading])
        np.savez(design.driven_file(one), poses=poses)
        scores.append(design.compare(one, lambda _: None)["cells"][0]["score"])
    assert scores[0] == 10.0 > scores[1]


def test_an_experiment_that_is_stopped_in_every_phase_comes_to_the_same_bits(done, units, tmp_path):
    """Ctrl-C at any moment, and half a file of a killed process, change nothing; files are kept."""
    folder = tmp_path / "study"
    moments = (("calibrating to the units", 1), ("evolving", 1), ("on the twin", 2), (COMPARING, 3))
    for phase, least in moments:

        def stop(event, phase=phase, least=least):
            if event.phase == phase and event.done >= least:
                raise KeyboardInterrupt

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("realitygap.work.progress.EVERY_S", 0.0)  # no event is left out
            begun = (folder / "noise-study.toml").is_file()
            with pytest.raises(StudyInterruptedError, match="kept"):
                noise_experiment(folder, tiny(), workers=1, resume=begun, on_progress=stop)
    assert 2 <= len(list(folder.glob("simulated/*.json"))) < 8 == len(list(folder.glob("situated/*.npz")))
    last = NoiseExperiment(folder, tiny()).controllers()[-1]
    NoiseExperiment(folder, tiny()).driven_file(last).with_suffix(".99.part").write_bytes(b"half a")
    results = noise_experiment(folder, None, workers=1, resume=True)
    assert tables(results) == tables(done / "results")


def test_trials_that_the_camera_lost_are_left_out_and_counted(units, copy):
    """A lost trial is taken from both sides; a controller that is lost all over has no score."""
    shutil.rmtree(copy / "simulated")
    design = NoiseExperiment(copy, tiny())
    first, second = design.controllers()[:2]
    for one, lost in ((first, np.s_[0, 1, 5:]), (second, np.s_[:, :, 5:])):
        poses = design.read_driven(one).poses.copy()
        poses[lost] = np.nan
        np.savez(design.driven_file(one), poses=poses)
    noise_experiment(copy, tiny(), workers=1, resume=True)
    made = {(r["task"], r["run"], r["evolved_level"]): r for r in rows(copy, "controllers.csv")}
    keys = [(one.task, str(one.run), f"{one.level:g}") for one in (first, second)]
    assert [made[key]["trials"] for key in keys] == ["5", "0"]
    assert made[keys[1]]["fitness_situated"] == made[keys[1]]["drop"] == ""
    told = tomllib.loads((copy / "results" / "study.toml").read_text())
    assert told["twin_trials_lost"] == 7


def test_other_settings_and_folders_are_refused(done, tmp_path):
    """An experiment goes on only with its own settings, in its own folder, and in one process at a time."""
    with pytest.raises(StudyError, match=r"made with starts = 3, not 4\. Leave it as it was"):
        noise_experiment(done, tiny(starts=4), resume=True)
    with pytest.raises(StudyError, match=r"already holds a finished study .*--resume"):
        noise_experiment(done, tiny())
    with pytest.raises(StudyError, match="no study of the level of noise there"):
        noise_experiment(tmp_path / "none", None, resume=True)
    (tmp_path / "letters.txt").write_text("dear")
    with pytest.raises(StudyError, match=r"but other files \(letters.txt\)"):
        noise_experiment(tmp_path, tiny())
    with lock(done), pytest.raises(StudyBusyError, match="working on this study"):
        noise_experiment(done, tiny(), resume=True)


def test_edited_settings_and_calibrations_are_refused(copy):
    """--resume does not go on with other settings, or another robot, than the experiment was made with."""
    robot = copy / "calibration" / "unit-1" / "robot.toml"
    text = robot.read_text()
    assert "track_cm = 5." in text
    robot.write_text(text.replace("track_cm = 5.", "track_cm = 6.", 1))
    with pytest.raises(StudyError, match=r"keeps a different profile.toml"):
        noise_experiment(copy, resume=True, workers=1)
    file = copy / "noise-study.toml"
    file.write_text(file.read_text().replace("starts = 3", "starts = 4"))
    with pytest.raises(StudyError, match=r"study.toml has been edited since"):
        noise_experiment(copy, NoiseConfig.from_folder(copy), resume=True, workers=1)


def test_spoilt_files_of_controllers_are_refused_by_name(copy):
    """A flipped bit in what a controller did is noticed: another figure is not believed."""
    design = NoiseExperiment(copy, tiny())
    one = design.controllers()[0]
    for file, read in (
        (design.driven_file(one), lambda: design.read_driven(one).poses.tolist()),
        (design.compared_file(one), lambda: json.dumps(design.read_compared(one))),
    ):
        data, noticed, expected = file.read_bytes(), 0, read()
        for at in range(0, len(data), len(data) // 40):
            file.write_bytes(data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :])
            try:
                assert read() == expected
            except StudyError as error:
                assert str(file) in str(error) and "Delete it and resume" in str(error)
                noticed += 1
        file.write_bytes(data)
        assert noticed >= 30
