"""A rig: trials on a unit of the twin, one after the other in one process, watched in windows."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from realitygap.control.genotype import Genotype
from realitygap.errors import UsageError
from realitygap.film.tag import Tag
from realitygap.robots.drive import Recording
from realitygap.tasks import load_task
from realitygap.track import Track
from realitygap.transfer.paths import score
from realitygap.transfer.rig import Rig, _refuse_elsewhere
from realitygap.values import Pose
from realitygap.world.robot import load_profile

TASK, PAPER = load_task("avoidance"), load_profile("paper")
DRIVER = Genotype.braitenberg(TASK.feeds).controller()
POSE = Pose(x=25.0, y=25.0, heading=0.5)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keeps the camera's calibration, so that there is one."""
    return tmp_path_factory.mktemp("cameras")


def rig(folder: Path, **settings: object) -> Rig:
    return Rig(TASK, PAPER, **{"robot": "twin:1", "folder_for_camera": folder, **settings})  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def used(folder: Path) -> Iterator[SimpleNamespace]:
    """A rig that has made a trial, and that trial."""
    with rig(folder) as one:
        yield SimpleNamespace(rig=one, first=one.drive(DRIVER, 7, POSE, 2.0))


def same(one: tuple[Track, Recording], two: tuple[Track, Recording]) -> bool:
    names = (("t", "x", "y", "heading"), ("proximity", "commands"))
    return all(
        np.array_equal(getattr(a, name), getattr(b, name))
        for a, b, these in zip(one, two, names, strict=True)
        for name in these
    )


def test_a_path_has_a_row_a_step(used: SimpleNamespace) -> None:
    """From the start on, in cm and rad, with what was read and done, and it can be scored."""
    path, recording = used.first
    assert path.t == pytest.approx(np.arange(21) / 10) and path.lost == 0 and path.seen_by == "camera"
    begun = (path.x[0], path.y[0], path.heading[0])
    assert begun == pytest.approx((POSE.x, POSE.y, POSE.heading), abs=0.06)
    assert recording.proximity.shape == (20, 8) and recording.commands.shape == (20, 2)
    assert np.hypot(path.end.x - path.x[0], path.end.y - path.y[0]) > 1.0
    assert np.isfinite(score(path, TASK, PAPER))


def test_without_its_camera_a_twin_is_where_it_was(folder: Path) -> None:
    """From its start on: scored over its whole length, with the true track of the same drive."""
    with rig(folder) as one:
        one.filmed = False
        path, _ = one.drive(DRIVER, 7, POSE, 2.0)
    assert path.lost == 0 and path.seen_by == "truth" and len(path) == 21
    assert (path.x[0], path.y[0], path.heading[0]) == (POSE.x, POSE.y, POSE.heading)


def test_a_trial_does_not_know_what_was_before_it(used: SimpleNamespace, folder: Path) -> None:
    """On a used rig and on a fresh one: the same bits; another stream: others."""
    second = used.rig.drive(DRIVER, 8, POSE, 2.0)
    with rig(folder) as fresh:
        assert same(fresh.drive(DRIVER, 8, POSE, 2.0), second)
        assert same(fresh.drive(DRIVER, 7, POSE, 2.0), used.first)
    assert not same(used.first, second)


def test_a_twin_that_wears_a_tag_is_tracked_by_it(tmp_path: Path) -> None:
    """Calibrated and watched with a marker that sits off its middle and turned: never lost, within 0.3 mm of
    where it was."""
    tag = Tag.parse("aruco:5x5_100:2,size=32,x=-12,y=5,angle=90")
    with rig(tmp_path) as one:
        one.marker = tag
        one.trial(DRIVER, 9, POSE, 1.0, sealed=tmp_path / "sealed.csv")
        truth = one.truth(tmp_path / "sealed.csv", 1.0)
        track = one.tracker.track(truth, 9)
    assert track.lost == 0
    rows = np.searchsorted(truth.t, truth.t[0] + track.t + 1e-6, side="right") - 1
    assert np.hypot(track.x - truth.x[rows], track.y - truth.y[rows]).max() < 0.03


@pytest.mark.parametrize("told", [Pose(x=250.0, y=250.0, heading=0.5), Pose(x=25.0, y=25.0, heading=28.6)])
def test_a_robot_that_is_not_at_its_start_is_refused(told: Pose) -> None:
    """As one that tells its pose in millimetres or degrees."""
    with pytest.raises(UsageError, match="robot: pose: expected its start"):
        _refuse_elsewhere(told, Pose(x=25.0, y=25.0, heading=0.5))
