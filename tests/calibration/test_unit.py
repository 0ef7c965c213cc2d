"""One call makes a unit's profile; what is there is kept, and another unit's folder is refused."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

import realitygap.calibration.calibrate as calibrate
from realitygap.calibration import unit as module
from realitygap.calibration.unit import PARTS, calibrated_robot, calibrated_unit
from realitygap.errors import CalibrationError
from realitygap.world.robot import load_profile

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SETTINGS = {"unit": 11, "noise": 1.0, "seed": 3}


@pytest.fixture
def jobs(monkeypatch):
    """What is recorded and fitted, in this order; here recordings are but a mark."""
    started: list[str] = []

    class Marks:
        def __init__(self, size, *, one_thread=False):
            assert one_thread and 1 <= size <= len(PARTS)

        def work(self, setup, jobs, tell):
            for job in jobs:
                setup().carry_out(job, tell)

        def close(self):
            pass

    def mark(unit, name, report):
        started.append(name)
        place = unit.recordings / name / "recording.toml"
        place.parent.mkdir(parents=True)
        place.write_text(name)
        report(name, 1, 1)

    monkeypatch.setattr(module, "Processes", Marks)
    monkeypatch.setattr(module.Unit, "record", mark)
    monkeypatch.setattr(
        module.Unit, "fitted", lambda unit, names, **how: started.append(" ".join(["fit", *how])) or names
    )
    monkeypatch.setattr(module.Unit, "profile", lambda unit, fits: repr(fits))
    return started


def test_what_is_there_is_not_made_again(tmp_path, jobs):
    """Finished recordings are kept, a half one is begun anew, a finished profile returned at once."""
    folder = tmp_path / "unit"
    half = folder / "recordings" / "wheels.part"
    assert calibrated_unit(folder, **SETTINGS, workers=2) == folder / "robot.toml"
    assert jobs == ["ambient", "fit", "wheels", "fit", "infrared-wall", "infrared-cylinder", "fit"]
    jobs.clear()
    assert calibrated_unit(folder, **SETTINGS) == folder / "robot.toml" and not jobs
    (folder / "robot.toml").unlink()
    (folder / "recordings" / "wheels").rename(half)
    calibrated_unit(folder, **SETTINGS)
    assert jobs == ["fit", "wheels", "fit", "fit"]


@pytest.mark.parametrize("change", [{"unit": 12}, {"noise": 2.0}, {"seed": 4}])
def test_another_units_folder_is_refused(tmp_path, jobs, change):
    """Its settings are named: what was expected, what came."""
    calibrated_unit(tmp_path / "unit", **SETTINGS)
    with pytest.raises(CalibrationError, match=r"unit\.toml: .*expected .*got .*another folder"):
        calibrated_unit(tmp_path / "unit", **{**SETTINGS, **change})


def test_a_robot_of_ones_own_is_recorded_and_fitted(tmp_path, monkeypatch):
    """Its wall is recorded through its own class, and its noise and sensors are found."""

    class Here:
        """Does the jobs in this process."""

        def __init__(self, size, *, one_thread=False):
            pass

        def work(self, setup, jobs, tell):
            for job in jobs:
                setup().carry_out(job, tell)

        def close(self):
            pass

    monkeypatch.setattr(module, "Processes", Here)
    monkeypatch.setattr(module, "PARTS", ("infrared-wall",))
    quick = partial(calibrate.calibrate, form="extended", beside=False)  # of all forms it takes half a minute
    monkeypatch.setattr(calibrate, "calibrate", lambda recordings, base, **_: quick(recordings, base))
    robot, base = f"{EXAMPLES / 'own_robot.py'}:FiveEyes", str(EXAMPLES / "five_eyes.toml")
    made = load_profile(calibrated_robot(tmp_path / "unit", robot=robot, base=base, seed=3))
    assert len(made.infrared.sensors) == 5 and abs(made.noise.proximity - 60) < 6
    assert made.provenance.fits[0].ratio < 1.0 and made.infrared != load_profile(base).infrared
