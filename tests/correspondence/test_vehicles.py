"""Names of robots that are not ours: hand-written controllers on Enki's Khepera and e-puck."""

import os
import shutil

import numpy as np
import pytest

from realitygap.correspondence.names import namer
from tests.correspondence.ladders import Named, miscalibration, right, setting_for
from tests.correspondence.vehicles import called_by_name, everybody

if not os.path.exists("/usr/include/enki/PhysicalEngine.h") or shutil.which("g++") is None:
    pytest.skip("Enki is not installed here: apt install libenki-dev g++", allow_module_level=True)


@pytest.fixture(scope="module")
def made():
    """Each vehicle on each robot, two trials; what they are called."""
    drives = list(everybody(range(100, 102)))
    setting = setting_for("obstacle-avoidance")
    found = namer(setting).name([drive.trial for drive in drives], setting)
    return [(d, Named(d.kind, name.name, name.confidence)) for d, name in zip(drives, found, strict=True)]


def test_nine_of_ten_vehicles_get_their_names(made):
    """Of trials that show what their controller is written to do, nine of ten are named after it."""
    assert right([name for drive, name in made if drive.shown]) >= 0.9


def test_a_name_is_as_sure_as_it_is_right(made):
    """Confidence and share of right names agree, on robots and controllers that no exemplar was made with."""
    assert miscalibration([name for _, name in made]) < 0.15
    sure = [name for _, name in made if name.confidence >= 0.9]
    assert len(sure) > len(made) / 2 and right(sure) >= 0.93


@pytest.mark.parametrize("seconds", [3, 6, 10])
def test_a_short_trials_name_is_as_sure_as_it_is_right(made, seconds):
    """Less of a behaviour is seen in less time, so the name is given with less confidence."""
    setting = setting_for("obstacle-avoidance")
    names = namer(setting).name([drive.trial.cut(seconds) for drive, _ in made], setting)
    right_ones = np.mean([name.name == drive.kind for (drive, _), name in zip(made, names, strict=True)])
    assert abs(np.mean([name.confidence for name in names]) - right_ones) < 0.09


def test_a_smooth_avoider_follows_no_wall(made):
    """What swings smoothly round obstacles, either way, is not surely called a wall follower."""
    smooth = [name for drive, name in made if drive.family in ("Webots", "pyePuck", "by distance")]
    assert len(smooth) == 12
    assert not [name for name in smooth if name.name == "wall follower" and name.confidence > 0.8]


def test_a_large_robots_name_is_as_sure_as_it_is_right():
    """On a Thymio, which sees nothing beside it, who shows its behaviour gets its name."""
    drives = [drive for drive in everybody(range(100, 104), ("thymio2",)) if drive.shown]
    names = called_by_name(drives)
    made = [Named(d.kind, name.name, name.confidence) for d, name in zip(drives, names, strict=True)]
    assert right(made) >= 0.8
    assert abs(np.mean([name.confidence for name in made]) - right(made)) < 0.12
