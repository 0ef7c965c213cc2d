"""A real robot under a camera: a video file serves as the live camera, a twin in real time as the robot."""

from __future__ import annotations

import math
import shutil
import tomllib
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from realitygap.calibration.record import plate_of
from realitygap.errors import FilmError, StudyError, UsageError
from realitygap.film.camera import CameraModel
from realitygap.film.disk import load_disk
from realitygap.film.live import LiveCamera
from realitygap.film.tag import load_marker
from realitygap.film.video import FilmReader, FilmWriter
from realitygap.study.load import Study, load_study
from realitygap.track import read_track
from realitygap.transfer.camera import OverheadTracker
from realitygap.transfer.run import load_transfers
from realitygap.twin import camera as twin_camera
from realitygap.twin.camera import OverheadCamera
from realitygap.values import Pose
from tests.served import Served
from tests.transfer.helpers import transfer

SECONDS, FPS = 1.0, 25
STANDS = Pose.from_degrees(24.0, 26.0, 30.0)
"""Where the robot of the camera's film stands at first; then it turns on the spot, 90° a second."""

COVERED = 3
"""So many frames of the film show no robot before it is seen."""


@pytest.fixture
def study(finished, tmp_path) -> Study:
    """A copy of the finished small study, of one's own."""
    return load_study(shutil.copytree(finished.folder, tmp_path / "copy"))


@pytest.fixture(scope="module")
def arena(finished):
    """Where it drives."""
    return finished.task("obstacle-avoidance").arena


@pytest.fixture(scope="module")
def camera(arena, tmp_path_factory) -> CameraModel:
    """The camera's calibration."""
    file = tmp_path_factory.mktemp("eye") / "camera.json"
    return OverheadTracker(file, arena, unit=1, noise=1.0, radius_cm=2.9).camera


@pytest.fixture(scope="module")
def tag_camera(arena, tmp_path_factory) -> CameraModel:
    """Its calibration by a robot that wears a tag."""
    file, tag = tmp_path_factory.mktemp("eye") / "camera.json", load_marker("apriltag:16h5:4")
    return OverheadTracker(file, arena, unit=1, noise=1.0, radius_cm=2.9, marker=tag).camera


@pytest.fixture(scope="module")
def video(arena, tmp_path_factory) -> Path:
    """What the camera sees."""
    return seen_from_above(tmp_path_factory.mktemp("eye") / "eye.mp4", arena)


def seen_from_above(file: Path, arena, plate=None, *, nobody: int = COVERED, then=None) -> Path:
    """A film of nobody for three frames, then of a robot that turns; for its last two thirds, if need be,
    with another plate."""
    turn, count = math.radians(90.0) / FPS, 3 * FPS
    poses = [Pose(x=STANDS.x, y=STANDS.y, heading=STANDS.heading + turn * k) for k in range(count)]
    with ExitStack() as opened:
        eye = opened.enter_context(OverheadCamera(arena.plain(), unit=1, view="drawn", plate=plate))
        later = eye
        if then is not None:
            later = opened.enter_context(OverheadCamera(arena.plain(), unit=1, view="drawn", plate=then))
        film = opened.enter_context(FilmWriter(file, rate=FPS, made_by="the tests"))
        away = Pose(x=-50.0, y=-50.0, heading=0.0)
        for k in range(nobody):
            film.add(eye.frame(away, 900 + k))
        for k, pose in enumerate(poses):
            film.add((eye if k < FPS else later).frame(pose, k))
    return file


@pytest.fixture(scope="module")
def robot(arena):
    """A twin in real time, which stands between two tests; and how it is carried."""
    with Served(arena.plain(), unit=1) as twin:
        yield f"serial:{twin.device}", lambda one, pose: twin.place(pose)


def test_the_eye_reads_the_start_and_films_the_drive(study, robot, camera, video):
    """Asked until it is seen; the simulation begins there; the film is tracked from the drive's beginning."""
    port, carry = robot
    told: list[Pose | None] = []

    def found(one, requested, seen):
        told.append(seen)
        return seen is not None

    settings = {"robots": (port,), "seconds": SECONDS, "carry": carry, "camera": camera, "found": found}
    one = transfer(study, [1], camera_device=str(video), film=True, **settings)[0]
    assert told[:COVERED] == [None] * COVERED and len(told) == COVERED + 1
    assert math.dist((one.pose.x, one.pose.y), (STANDS.x, STANDS.y)) < 0.05
    assert one.pose.heading_deg == pytest.approx(STANDS.heading_deg, abs=1.0)
    assert one.simulated.x[0] == pytest.approx(one.pose.x, abs=1e-5)
    assert one.situated_from == "film" and one.filmed and one.view == f"camera {video}"
    facts = tomllib.loads((one.folder / "transfer.toml").read_text())
    assert facts["wished"] != facts["pose"] and 0 <= facts["film_lead_s"] < 0.5
    path = one.situated
    assert path.lost == one.lost_steps == 0 and one.late_steps < len(path) / 2
    assert np.hypot(path.x - STANDS.x, path.y - STANDS.y).max() < 0.1
    # the frame after the one that was looked at is the film's first
    begun = STANDS.heading_deg + 90.0 * (1 / FPS + facts["film_lead_s"])
    assert path.heading_deg == pytest.approx(begun + 90.0 * path.t, abs=2.0)
    track = read_track(one.folder / "track.csv")
    with FilmReader(one.folder / "film.mp4") as film:
        times = [frame.t_s for frame in film]
    assert times == pytest.approx(np.arange(len(times)) / FPS, abs=1e-3) and len(track) == len(times)
    assert (one.folder / "camera.json").is_file() and (one.folder / "tails.png").is_file()


def test_an_eye_that_only_watches_keeps_no_film(study, robot, camera, video):
    """Without --film the path is from the camera; without watching from the counters, from the seen start."""
    port, carry = robot
    settings = {"robots": (port,), "seconds": SECONDS, "carry": carry, "camera": camera}
    settings["found"] = lambda one, requested, seen: seen is not None
    counted = transfer(study, [1], camera_device=str(video), path_from="wheels", **settings)[0]
    assert counted.situated_from == "counters"
    assert counted.situated.x[0] == pytest.approx(STANDS.x, abs=0.05)
    one = transfer(study, [1], camera_device=str(video), **settings)[0]
    assert one.situated_from == "camera" and not one.filmed and one.lost_steps == 0
    assert not (one.folder / "film.mp4").exists() and (one.folder / "track.csv").is_file()
    assert (one.folder.parent / "start-1.earlier-1" / "steps.csv").is_file()  # nothing is thrown away
    assert len(load_transfers(study.folder)) == 1


def test_a_robot_may_wear_a_disk_of_its_own(study, robot, camera, arena, tmp_path, monkeypatch):
    """The camera looks for it, with the film it is kept, and the trial cannot be taken for one with another.

    Its patches are the shipped disk's, exchanged: a tracker of that one would see the robot look back.
    """
    radii = twin_camera.MIDDLE_RADIUS, twin_camera.FRONT_RADIUS
    monkeypatch.setattr(twin_camera, "MIDDLE_RADIUS", radii[1])
    monkeypatch.setattr(twin_camera, "FRONT_RADIUS", radii[0])
    video, mine = seen_from_above(tmp_path / "eye.mp4", arena), tmp_path / "mine.toml"
    mine.write_text("centre_radius_cm = 0.45\nfront_radius_cm = 0.7\n")
    port, carry = robot
    settings = {
        "robots": (port,),
        "seconds": SECONDS,
        "carry": carry,
        "camera": camera,
        "camera_device": str(video),
    }
    settings["found"] = lambda one, requested, seen: seen is not None
    for film in (False, True):
        one = transfer(study, [1], disk=mine, film=film, **settings)[0]
        assert one.pose.heading_deg == pytest.approx(STANDS.heading_deg, abs=1.0) and one.lost_steps == 0
        assert np.hypot(one.situated.x - STANDS.x, one.situated.y - STANDS.y).max() < 0.1
    assert load_disk(one.folder / "disk.toml") == load_disk(mine)
    again = transfer(study, [1], disk=mine, **settings)[0]  # it is there already
    assert str(again.to_dict()) == str(one.to_dict())
    with pytest.raises(StudyError, match=r"made with disk\.centre_radius_cm = 0\.45, not 0\.7"):
        transfer(study, [1], **settings)


def test_a_robot_may_wear_a_tag(study, robot, tag_camera, arena, tmp_path):
    """A live camera looks for a robot's AprilTag; its trial is not taken for one with another marker."""
    tag = load_marker("apriltag:16h5:4,angle=180")
    video = seen_from_above(tmp_path / "eye.mp4", arena, plate_of(tag))
    port, carry = robot
    settings = {"robots": (port,), "seconds": SECONDS, "carry": carry, "camera": tag_camera}
    settings |= {"camera_device": str(video)}
    settings["found"] = lambda one, requested, seen: seen is not None
    one = transfer(study, [1], marker=str(tag), **settings)[0]
    assert one.pose.heading_deg == pytest.approx(STANDS.heading_deg, abs=1.0) and one.lost_steps == 0
    assert np.hypot(one.situated.x - STANDS.x, one.situated.y - STANDS.y).max() < 0.05
    assert tomllib.loads((one.folder / "transfer.toml").read_text())["marker"] == str(tag)
    assert transfer(study, [1], marker=tag, **settings)[0] == one  # it is there already
    assert one.trouble is None
    with pytest.raises(StudyError, match="made with marker = 'apriltag:16h5:4,angle=180', not None"):
        transfer(study, [1], **settings)


def test_a_start_that_is_not_seen_may_be_taken_on_a_persons_word(study, robot, camera, video):
    """With a person's word from the requested pose; with nobody to ask it is refused."""
    port, carry = robot
    settings = {"robots": (port,), "seconds": SECONDS, "carry": carry, "camera": camera}
    with pytest.raises(FilmError, match="not seen where it was carried"):
        transfer(study, [1], camera_device=str(video), **settings)
    one = transfer(
        study, [1], camera_device=str(video), path_from="wheels", found=lambda *_: True, **settings
    )[0]
    facts = tomllib.loads((one.folder / "transfer.toml").read_text())
    assert facts["wished"] == facts["pose"]


def test_an_eye_that_cannot_be_used_is_refused(study, camera, video, tmp_path):
    """By name: no calibration, no camera, no robot under it, nothing that opens, pictures of another size."""
    port, carry = "serial:/dev/no-such-port", lambda one, pose: None
    settings = {"robots": (port,), "carry": carry}
    with pytest.raises(UsageError, match=r"camera_device: expected the camera above .* and its calibration"):
        transfer(study, camera_device=0, **settings)
    with pytest.raises(UsageError, match="camera: expected the camera above"):
        transfer(study, camera=camera, **settings)
    with pytest.raises(UsageError, match="a camera and a disk of its own"):
        transfer(study, disk="mine.toml")
    with pytest.raises(FilmError, match="it cannot be opened"):
        transfer(study, camera=camera, camera_device=str(tmp_path / "none.mp4"), **settings)
    with pytest.raises(FilmError, match="it cannot be opened"):
        LiveCamera(tmp_path / "none.mp4")
    with LiveCamera(video) as live:
        assert live.look().shape == (480, 640)
        with pytest.raises(FilmError, match="no film to finish"):
            live.finish(0.0)
