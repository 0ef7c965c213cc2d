"""The study of the level of noise: its design, its tables, interruptions, refusals."""

from __future__ import annotations

import csv
import math
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

from realitygap.errors import ConfigError, LineError, StudyBusyError, StudyError, StudyInterruptedError
from realitygap.experiments.folder import Seconds
from realitygap.experiments.noise import simulated
from realitygap.experiments.noise.config import NoiseConfig, levels_of, tasks_of
from realitygap.experiments.noise.plan import (
    Evolved,
    controllers,
    evolved_folder,
    simulated_file,
    situated_file,
)
from realitygap.experiments.noise.run import noise_study
from realitygap.experiments.noise.simulated import read_compared
from realitygap.experiments.noise.situated import read_situated
from realitygap.experiments.noise.stage import Stage
from realitygap.study.load import load_study
from realitygap.study.lock import lock
from realitygap.study.versions import project_commit
from realitygap.work.progress import Reporter
from tests.experiments.noise_parts import SimulatedRig, quick_units, tables, tiny

COMPARING = "comparing with the simulations"


@pytest.fixture(scope="module")
def units():
    """Quick units for all tests of this file."""
    with quick_units() as patch:
        yield patch


@pytest.fixture(scope="module")
def done(units, tmp_path_factory) -> Path:
    """The folder of a finished tiny study; tests leave it as it is."""
    folder = tmp_path_factory.mktemp("noise") / "study"
    noise_study(folder, tiny(), workers=1)
    return folder


def rows(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / "results" / name).open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_design_is_crossed():
    """Every controller is there once; the runs of a set take turns with the units; sets are alike."""
    config = NoiseConfig()
    every = controllers(config)
    assert len(every) == len({one.name for one in every}) == config.controllers == 400
    assert config.twin_trials == 9600
    first = [one for one in every if (one.task, one.seed_set, one.level) == ("light-seeking", 1, 0.5)]
    assert sorted((one.run, one.home) for one in first)[:4] == [(1, 1), (2, 2), (3, 3), (4, 1)]
    assert len(first) == 20


def test_every_controller_meets_every_level(done):
    """cells.csv has each controller at each level; controllers.csv has each once, with its home."""
    made, cells = rows(done, "controllers.csv"), rows(done, "cells.csv")
    who = ("task", "seed_set", "run", "evolved_level")
    assert len(made) == 8 and len(cells) == 16
    assert [[row[key] for key in who] for row in made for _ in (0, 1)] == [[r[k] for k in who] for r in cells]
    assert [row["comparison_level"] for row in cells] == ["0", "1"] * 8
    assert [row["home_unit"] for row in made] == ["1", "2"] * 4
    for row in cells:
        assert 0 <= float(row["score"]) <= 10 and math.isfinite(float(row["noisiness"]))
    for row in made:
        same = [cell for cell in cells if all(cell[key] == row[key] for key in who)]
        own = [cell for cell in same if cell["comparison_level"] == row["evolved_level"]]
        assert own[0]["fitness_simulated"] == row["fitness_simulated"]
        drop = float(row["fitness_simulated"]) - float(row["fitness_situated"])
        assert float(row["drop"]) == pytest.approx(drop, abs=1e-4 * float(row["fitness_simulated"]))
        of_units = [float(row[f"fitness_situated_unit_{u}"]) for u in (1, 2)]
        assert float(row["fitness_situated"]) == pytest.approx(sum(of_units) / 2, rel=1e-4)


def test_every_unit_has_a_score_of_its_own(done):
    """What a unit's column says hangs on that unit's trials alone; unlike units come to unlike scores."""
    cells = rows(done, "cells.csv")
    for row in cells:
        assert all(0 <= float(row[f"score_unit_{unit}"]) <= 10 for unit in (1, 2))
    assert any(row["score_unit_1"] != row["score_unit_2"] for row in cells)
    stage, one = Stage(done, tiny()), controllers(tiny())[0]
    kept = read_situated(stage, one)
    alone = kept._replace(poses=kept.poses.copy())
    alone.poses[1] = np.nan  # the camera saw nothing of unit 2
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulated, "read_situated", lambda *_: alone)
        seen = simulated.compare_all(stage, one)
    for before, now in zip(read_compared(stage, one)["cells"], seen["cells"], strict=True):
        assert now["score_unit_1"] == before["score_unit_1"]
        assert math.isnan(now["score_unit_2"])
    assert seen["trials"] == 3


def test_the_settings_and_the_calibration_are_told(done):
    """study.toml has the settings, the command and the versions; calibration.csv a row a channel."""
    told = tomllib.loads((done / "results" / "study.toml").read_text())
    assert NoiseConfig.from_folder(done) == tiny()
    assert told["levels"] == [0, 1] and told["twin_trials"] == 48 and told["versions"]["mujoco"]
    assert told["versions"]["commit"] == told["versions_at_start"]["commit"] == project_commit()
    assert told["command"].startswith(
        "realitygap experiment noise --levels 0,1 --runs 2 --seed-sets 1 --units 2"
    )
    assert list(told["seconds"]) == ["calibrate", "evolve", "situated", "simulated"]
    kept = [tuple(row.values()) for row in rows(done, "calibration.csv")]
    assert kept == [(unit, "infrared", "9", "20", "0.45", "0.3") for unit in "12"]


def test_all_levels_are_compared_on_the_same_starts(done):
    """Controllers of a task start from the same places on every unit; no two trials share a stream."""
    stage = Stage(done, tiny())
    kept = [(one, read_situated(stage, one)) for one in controllers(tiny())]
    for one, paths in kept:
        starts = [(pose.x, pose.y) for pose in stage.starts(one.task, one.seed_set, 1)]
        for of_unit in paths.poses[:, :, 0, :2]:
            assert of_unit == pytest.approx(np.array(starts), abs=1e-9)
    streams = np.concatenate([paths.streams.ravel() for _, paths in kept])
    assert len(np.unique(streams)) == len(streams) == 48


def test_a_controller_keeps_its_bands_on_every_robot(done):
    """In the simulation of another unit a network is fed as its home made it; the rest is the unit's."""
    stage = Stage(done, tiny())
    worn = stage.simulation("obstacle-avoidance", 2, 1, 1.0).profile
    assert worn.name == "unit 2"
    assert worn.infrared.bands == stage.profile(1).infrared.bands != stage.profile(2).infrared.bands


def test_home_seeds_differ(done):
    """No two studies of evolution begin alike: each has a seed and a profile of its own."""
    made = [load_study(evolved_folder(done, tiny(), Evolved(1, unit, 1, (0.0, 1.0)))) for unit in (1, 2)]
    assert made[0].config.seed != made[1].config.seed
    assert [study.profile.name for study in made] == ["unit 1", "unit 2"]
    assert not np.array_equal(made[0].genotypes(1)[0], made[1].genotypes(1)[0])


def test_a_study_that_is_stopped_in_every_phase_comes_to_the_same_bits(done, units, tmp_path):
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
                noise_study(folder, tiny(), workers=1, resume=begun, on_progress=stop)
    assert 2 <= len(list(folder.glob("simulated/*.json"))) < 8 == len(list(folder.glob("situated/*.npz")))
    half = situated_file(folder, controllers(tiny())[-1]).with_suffix(".99.part")
    half.write_bytes(b"half a")
    results = noise_study(folder, None, workers=1, resume=True)
    assert tables(results) == tables(done / "results")


def test_a_finished_study_is_only_gathered_again(done, units, tmp_path):
    """Resumed when all is done, nothing is made again, and the tables are the same."""
    copy = Path(shutil.copytree(done, tmp_path / "copy"))
    times = {path: path.stat().st_mtime_ns for path in copy.rglob("*.npz")}
    assert tables(noise_study(copy, tiny(), resume=True)) == tables(done / "results")
    assert {path: path.stat().st_mtime_ns for path in copy.rglob("*.npz")} == times


def test_trials_that_the_camera_lost_are_left_out_and_counted(done, units, tmp_path):
    """A lost trial is taken from both sides; a controller that is lost all over has no score."""
    copy = Path(shutil.copytree(done, tmp_path / "copy"))
    shutil.rmtree(copy / "simulated")
    first, second = controllers(tiny())[:2]
    for one, lost in ((first, np.s_[0, 1, 5:]), (second, np.s_[:, :, 5:])):
        file = situated_file(copy, one)
        with np.load(file) as kept:
            poses, streams = kept["poses"], kept["streams"]
        poses[lost] = np.nan
        np.savez(file, poses=poses, streams=streams)
    noise_study(copy, tiny(), workers=1, resume=True)
    made = {(r["task"], r["run"], r["evolved_level"]): r for r in rows(copy, "controllers.csv")}
    keys = [(one.task, str(one.run), f"{one.level:g}") for one in (first, second)]
    assert [made[key]["trials"] for key in keys] == ["5", "0"]
    assert made[keys[1]]["fitness_situated"] == made[keys[1]]["drop"] == ""
    told = tomllib.loads((copy / "results" / "study.toml").read_text())
    assert told["twin_trials_lost"] == 7


def test_a_line_that_is_lost_is_taken_up_again(done, units, tmp_path):
    """A trial whose line is lost is begun again and comes to the same bits; not for ever."""
    copy = Path(shutil.copytree(done, tmp_path / "copy"))
    first = controllers(tiny())[0]
    lost = iter([True, True, False, True, True, True])

    class Bad(SimulatedRig):
        def drive(self, *words, **settings):
            if next(lost, False):
                raise LineError("no answer")
            return super().drive(*words, **settings)

    before = situated_file(copy, first).read_bytes()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("realitygap.experiments.noise.situated.Rig", Bad)
        situated_file(copy, first).unlink()
        with pytest.raises(LineError):
            noise_study(copy, tiny(), workers=1, resume=True)
        noise_study(copy, tiny(), workers=1, resume=True)
    assert situated_file(copy, first).read_bytes() == before


def test_progress_ends_with_nothing_left(units, tmp_path, monkeypatch):
    """Each phase tells how far it is, and at the end no time is left; its time is kept as it goes."""
    heard, kept = [], {}
    monkeypatch.setattr("realitygap.experiments.phases.KEEP_S", 0.0)
    monkeypatch.setattr("realitygap.work.progress.EVERY_S", 0.0)

    def hear(event):
        heard.append(event)
        if event.done < event.total:  # as a kill would leave it
            kept[event.phase] = list(Seconds(tmp_path / "study").read())

    noise_study(tmp_path / "study", tiny(tasks=("obstacle-avoidance",)), workers=1, on_progress=hear)
    for phase, name in (("evolving", "evolve"), ("on the twin", "situated"), (COMPARING, "simulated")):
        assert kept[phase][-1] == name
    phases = list(dict.fromkeys(event.phase for event in heard))
    assert phases == [
        "calibrating to the units", "evolving", "on the twin", "comparing with the simulations",
    ]  # fmt: skip
    for phase in phases:
        of_phase = [event for event in heard if event.phase == phase]
        assert of_phase[-1].done == of_phase[-1].total
        assert [event.done for event in of_phase] == sorted(event.done for event in of_phase)
    assert heard[-1].seconds_left in (None, 0.0)


def test_work_found_done_does_not_shorten_the_time_left(monkeypatch):
    """Only what this session did tells the pace: 3 s of 100 s of work took 6 s, so 97 s take 194 s."""
    now = [0.0]
    monkeypatch.setattr("realitygap.work.progress.time.monotonic", lambda: now[0])
    heard = []
    reporter = Reporter(heard.append, {"evolving": 500.0, "on the twin": 100.0}, patience_s=2.0)
    reporter.phase("evolving", done=0, total=10, what="runs")
    reporter.found(10, 0.0)
    reporter.end()
    reporter.phase("on the twin", done=0, total=100, what="controllers")
    now[0] = 6.0
    reporter.add(3.0, done=3)
    assert heard[1].done == 10 and heard[1].seconds_left is None
    assert heard[-1].seconds_left == pytest.approx(194.0)


def test_other_settings_are_refused_by_their_key(done):
    """A study goes on only with the settings that it was made with."""
    with pytest.raises(StudyError, match=r"made with starts = 3, not 4\. Leave it as it was"):
        noise_study(done, tiny(starts=4), resume=True)
    with pytest.raises(StudyError, match=r"levels = \[0.0, 1.0\], not \[0.0, 1.0, 2.0\]"):
        noise_study(done, tiny(levels=(2, 0, 1)), resume=True)
    with pytest.raises(StudyError, match=r"already holds a finished study .*--resume"):
        noise_study(done, tiny())


def test_a_folder_with_something_else_is_refused(tmp_path):
    """Neither other files nor an empty folder are taken for a study."""
    with pytest.raises(StudyError, match="no study of the level of noise there"):
        noise_study(tmp_path / "none", None, resume=True)
    (tmp_path / "letters.txt").write_text("dear")
    with pytest.raises(StudyError, match=r"but other files \(letters.txt\)"):
        noise_study(tmp_path, tiny())


def test_a_second_process_is_refused(done):
    """Whoever comes while another works on the folder is told so."""
    with lock(done), pytest.raises(StudyBusyError, match="working on this study"):
        noise_study(done, tiny(), resume=True)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"runs": 3, "seed_sets": 2}, r"runs: .* each of 2 seed sets, got 3\. Give a multiple of 2"),
        ({"levels": (1, 1)}, "levels: expected two or more, all different"),
        ({"levels": (0, 99)}, "noise: expected .* from 0 to 10"),
        ({"starts": 1}, "starts: expected a whole number from 2"),
        ({"units": 0}, "units: expected a whole number from 1"),
        ({"twin_noise": 11.0}, "twin_noise: expected a number from 0 to 10"),
        ({"tasks": ()}, "tasks: expected different ones of obstacle-avoidance, light-seeking"),
        ({"seconds": 1.0}, r"seconds: expected a multiple of 0\.1 from 2 on, got 1\.0"),
        ({"seed": -1}, "seed: expected a whole number, 0 or more"),
    ],
)
def test_wrong_settings_are_refused_by_name(wrong, says):
    """A setting that makes no sense is refused: what was expected, and what came."""
    with pytest.raises(ConfigError, match=says):
        tiny(**wrong)


def test_levels_and_tasks_are_read_as_they_are_typed():
    """Levels by name or number, sorted; tasks by a word; a study's file reads back to an equal one."""
    assert levels_of("0, observed,0.25") == (0.0, 1.0, 0.25)
    assert NoiseConfig(levels=levels_of("4,zero")).levels == (0.0, 4.0)
    assert tasks_of("both") == ("obstacle-avoidance", "light-seeking")
    assert tasks_of("light") == ("light-seeking",)
    config = tiny(twin_noise=2.0)
    assert NoiseConfig.from_dict(tomllib.loads(config.to_toml())) == config


@pytest.mark.parametrize(("old", "new", "words"), [
    ("twin_noise = 1.0", "twin_noise = 2.0", "study.toml has been edited .*: twin_noise was 1.0, now 2.0"),
    ("starts = 3", "starts = 4", "starts was 3, now 4"),
])  # fmt: skip
def test_edited_settings_are_refused(done, tmp_path, old, new, words):
    """--resume does not go on with other settings than those that the study was made with."""
    folder = Path(shutil.copytree(done, tmp_path / "study"))
    file = folder / "noise-study.toml"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(StudyError, match=words):
        noise_study(folder, NoiseConfig.from_folder(folder), resume=True, workers=1)


def test_an_edited_calibration_is_refused(done, tmp_path):
    """Nor with another robot than the controllers evolved in."""
    folder = Path(shutil.copytree(done, tmp_path / "study"))
    robot = folder / "calibration" / "unit-1" / "robot.toml"
    text = robot.read_text()
    assert "track_cm = 5." in text
    robot.write_text(text.replace("track_cm = 5.", "track_cm = 6.", 1))
    with pytest.raises(StudyError, match=r"keeps a different profile.toml .*: wheels.track_cm was"):
        noise_study(folder, resume=True, workers=1)


def test_spoilt_files_of_controllers_are_refused_by_name(done):
    """A flipped bit in what a controller did is noticed: another figure is not believed."""
    stage = Stage(done, tiny())
    one = controllers(tiny())[0]
    for file, read in ((situated_file(done, one), read_situated), (simulated_file(done, one), read_compared)):
        data, noticed, expected = file.read_bytes(), 0, repr(read(stage, one))
        for at in range(0, len(data), len(data) // 40):
            file.write_bytes(data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :])
            try:
                assert repr(read(stage, one)) == expected
            except StudyError as error:
                assert str(file) in str(error) and "Delete it and resume" in str(error)
                noticed += 1
        file.write_bytes(data)
        assert noticed >= 30
