"""Every study's run.py carries its design out, as small as can be, to the tables that analyse.py reads."""

from __future__ import annotations

import csv
import importlib.util
import io
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import pytest

import realitygap.calibration.unit
from realitygap.robots.address import Address
from realitygap.tasks.load import load_task
from realitygap.world.robot import load_profile
from studies import common
from tests.experiments.noise_parts import SimulatedRig, quick_units, unit_by_hand

STUDIES = Path(__file__).resolve().parents[2] / "studies"
SMALL = ("--runs", "1", "--evaluations", "40", "--seconds", "2", "--workers", "1")


def script(study: str, name: str = "run") -> ModuleType:
    """A study's run.py as a module, or another of its files."""
    spec = importlib.util.spec_from_file_location(
        f"{name}_{study.replace('-', '_')}", STUDIES / study / f"{name}.py"
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def head(file: Path) -> list[str]:
    with file.open(newline="") as rows:
        return next(csv.reader(rows))


def test_the_first_study(tmp_path):
    """Two sets of runs on one unit, compared at every level: the archived columns."""
    with quick_units():
        words = ("--runs", "2", "--units", "1", *SMALL[2:], "--out", str(tmp_path))
        script("noise-level").main(words)
    for name in ("controllers.csv", "cells.csv"):
        now, kept = head(tmp_path / "results" / name), list(common.table(f"noise-level/default-again/{name}"))
        assert [key for key in now if "_unit_" not in key] == [key for key in kept if "_unit_" not in key]


@pytest.mark.parametrize("arm", ["E", "T2"])
def test_an_arm_of_the_second_study(tmp_path, arm):
    """A run a level and set on two units, champions and fittest: the archived columns."""
    with quick_units():
        script("noise-level-2").main((arm, "--units", "2", *SMALL, "--out", str(tmp_path)))
    for name in ("controllers.csv", "cells.csv", "calibration.csv", "without-camera.csv"):
        now = head(tmp_path / "results" / name)
        assert sorted(now) == sorted(common.table(f"noise-level-2/{arm}/{name}")), name
    rows = (tmp_path / "results" / "controllers.csv").read_text().splitlines()[1:]
    levels, tasks = (5, 1) if arm == "E" else (4, 2)
    assert len(rows) == 2 * 2 * levels * tasks


def test_measure_or_randomise(tmp_path, monkeypatch):
    """A run of each of the 22 conditions: the archived columns, without the tables that analyse.py makes."""
    run = script("measure-or-randomise")

    class Rig(SimulatedRig):
        tracker = None

        def __init__(self, task: Any, profile: Any, *, robot: Any, **others: Any) -> None:
            super().__init__(task, profile, robot=str(robot), **others)
            self.robot, self.profile = robot, profile

    def shared(folder: Path, *, of: Path, **_: Any) -> Path:
        return unit_by_hand(folder, unit=int(of.parent.name.removeprefix("unit-")))

    with quick_units() as patch:
        monkeypatch.setattr(run, "calibrated_unit", realitygap.calibration.unit.calibrated_unit)
        monkeypatch.setattr(run, "calibrated_again", shared)
        monkeypatch.setattr(run, "Rig", Rig)
        assert patch
        run.main(("--robot", "twin", "--units", "2", *SMALL, "--starts", "2", "--out", str(tmp_path)))
    for name in ("controllers.csv", "calibration.csv"):
        assert head(tmp_path / "results" / name) == list(common.table(f"measure-or-randomise/T/{name}"))
    assert len((tmp_path / "results" / "controllers.csv").read_text().splitlines()) == 1 + 22


def test_an_arm_of_misfit_and_noise(tmp_path, monkeypatch):
    """Two units, six simulations, four levels, one individual: tables that analyse.py takes."""
    run, analyse = script("misfit"), script("misfit", "analyse")

    class Rig(SimulatedRig):
        def __init__(self, task: Any, profile: Any, *, robot: Any, **others: Any) -> None:
            super().__init__(task, profile, robot=str(robot), **others)
            self.robot, self.profile = Address.parse(str(robot)), profile

    def whole(folder: Path, *, unit: int | str, **_: Any) -> Path:
        return unit_by_hand(folder, unit=unit)

    def again(folder: Path, *, of: Path, **_: Any) -> Path:
        return unit_by_hand(folder, unit=int(of.name.removeprefix("unit-")))

    with quick_units() as patch:
        monkeypatch.setattr(run, "calibrated_unit", whole)
        monkeypatch.setattr(run, "calibrated_again", again)
        monkeypatch.setattr(run.Study, "misfit", lambda study, place: float(place.number))
        patch.setattr("realitygap.experiments.noise.Rig", Rig)
        run.main(("T", "--realities", "2", *SMALL, "--starts", "2", "--out", str(tmp_path / "T")))
        half = ("--only", "2", "--out", str(tmp_path / "T-2"))
        run.main(("T", "--realities", "2", *SMALL, "--starts", "2", *half))
    (arm,) = analyse.read(tmp_path)
    cells = pd.read_csv(tmp_path / "T-2" / "results" / "cells.csv").assign(misfit=0)
    both = arm.cells[arm.cells["set"] == 2].assign(misfit=0).reset_index(drop=True)
    pd.testing.assert_frame_equal(both, cells)
    kept = script("misfit", "keep").kept(tmp_path / "T")
    tracks = np.load(io.BytesIO(kept["misfit/T/tracks.npy"]))
    assert tracks.shape == (len(arm.models.rows), 2, 5, 3) and tracks.max() < 1200
    assert len([name for name in kept if "/profiles/" in name]) == 12
    assert len(list((tmp_path / "T" / "situated").glob("*.npz"))) == len(arm.rows)
    assert len(arm.rows) == 2 * 6 * 4 and len(arm.cells) == 6 * len(arm.rows)
    assert set(arm.rows["set"]) == {1, 2} and arm.rows["fitness_situated"].notna().all()
    assert "| nominal | 2 | 11.00 |" in analyse.by_simulation(arm)


def test_a_rivals_robots_are_about_the_nominal_one():
    """By the plan's deviations, and the next trial's is another; no sensor leaves the body."""
    run = script("misfit")
    made = run.Engine("nominal, spread × 2")(load_task("avoidance"), load_profile("enki-khepera"), 1.0)
    nominal = load_profile("enki-khepera").to_kernel().proximity
    gains = np.log([robot.proximity.a / nominal.a for robot in made.robots])
    assert gains.std() == pytest.approx(2 * run.RIVAL["gain"], rel=0.1) and abs(gains.mean()) < 0.05
    reach = [np.hypot(*robot.proximity.place.T).max() for robot in made.robots]
    assert max(reach) < 2.6
    worlds = made.worlds(np.array([5, 6, 205], np.uint64))
    assert worlds[0][0].robot is worlds[2][0].robot is not worlds[1][0].robot
