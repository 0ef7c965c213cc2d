"""The camera model: there and back, its file, its calibration."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from realitygap.errors import FilmError
from realitygap.film.calibrate import calibrate_camera, read_frames
from realitygap.film.camera import load_camera
from realitygap.film.disk import Disk
from realitygap.values import Pose
from tests.film.conftest import pinhole
from tests.film.scene import Lens

PLACES = st.tuples(st.floats(0, 50), st.floats(2, 45))


@given(PLACES, st.floats(0, 20), st.floats(-0.15, 0.15), st.floats(-0.05, 0.05))
def test_there_and_back(place, height, k1, k2):
    """A place's pixel shows that place, at any height and through any mild lens."""
    camera = pinhole((k1, k2))
    back = camera.to_floor(camera.to_pixels(place, height), height)
    assert np.allclose(back, place, atol=1e-6)


def test_agrees_with_the_renderer():
    """Without a bent lens the model and the renderer, which share nothing, see the same, at each height."""
    straight = replace(Lens(), bend=(0, 0, 0), middle=(319.5, 239.5))
    for height in (0.0, 3.0, 7.0):
        seen = pinhole((0, 0)).to_pixels([12.0, 31.0], height)
        assert np.allclose(seen, straight.pixel(12.0, 31.0, height), atol=1e-9)


def test_file_keeps_every_number(tmp_path):
    """A camera read back from its file is the same camera."""
    camera = pinhole()
    camera.save(tmp_path / "camera.json")
    assert load_camera(tmp_path / "camera.json").to_dict() == camera.to_dict()


def test_calibration_explains_its_frames(calibration):
    """Every frame of a good calibration is used, and explained within 0.4 mm and 0.5°."""
    facts = calibration.to_dict()
    assert facts["used"] == facts["frames"] == 12
    assert facts["worst_mm"] < 0.4
    assert facts["worst_heading_deg"] < 0.5
    assert np.allclose(calibration.camera.lens_cm, Lens().place, atol=0.8)


def test_one_wrong_pose_spoils_nothing(frames, calibration):
    """A mistyped pose is left out and named; the camera is as good without it."""
    wrong = replace(frames[5], pose=Pose(x=frames[5].pose.x + 3, y=frames[5].pose.y, heading=0.3))
    made = calibrate_camera([*frames[:5], wrong, *frames[6:]], Disk())
    assert [r.frame for r in made.residuals if not r.used] == [wrong.name]
    places = np.array([[10.0, 10.0], [40.0, 35.0], [25.0, 25.0]])
    assert np.allclose(made.camera.to_pixels(places), calibration.camera.to_pixels(places), atol=0.3)


def test_wrong_poses_are_refused(frames):
    """Poses that belong to other frames, or headings the wrong way round, are no calibration."""
    frames = frames[:9]
    turned = [replace(f, pose=g.pose) for f, g in zip(frames, frames[5:] + frames[:5], strict=True)]
    with pytest.raises(FilmError, match="no camera explains"):
        calibrate_camera(turned, Disk())
    mirrored = [replace(f, pose=replace(f.pose, heading=f.pose.heading + math.pi)) for f in frames]
    with pytest.raises(FilmError, match="no camera explains"):
        calibrate_camera(mirrored, Disk())


def write_frames(folder, frames):
    """The frames as a person would bring them."""
    for frame in frames:
        cv2.imwrite(str(folder / frame.name), frame.picture)
    rows = [f"{f.name},{f.pose.x},{f.pose.y},{f.pose.heading_deg}" for f in frames]
    (folder / "poses.csv").write_text("\n".join(["frame,x_cm,y_cm,heading_deg", *rows]) + "\n")


def test_frames_are_read_back(tmp_path, frames):
    """A folder of pictures and its table come back as they were written; in metres they are refused."""
    write_frames(tmp_path, frames[:4])
    read = read_frames(tmp_path, tmp_path / "poses.csv")
    assert [f.name for f in read] == [f.name for f in frames[:4]]
    assert all((a.picture == b.picture).all() for a, b in zip(read, frames[:4], strict=True))
    assert all(math.isclose(a.pose.x, b.pose.x) for a, b in zip(read, frames[:4], strict=True))
    metres = [replace(f, pose=replace(f.pose, x=f.pose.x / 100, y=f.pose.y / 100)) for f in frames[:4]]
    write_frames(tmp_path, metres)
    with pytest.raises(FilmError, match=r"poses.csv: expected poses all over the floor .* in metres\?"):
        read_frames(tmp_path, tmp_path / "poses.csv")
