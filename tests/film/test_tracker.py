"""The tracker against sealed truth."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from realitygap.film.disk import Disk
from realitygap.film.tracker import Tracker, track_film
from tests.film.conftest import pinhole, write_film
from tests.film.scene import Lens, Renderer, Scene

HARD = {
    "noise": (Scene(noise=15), 18),
    "blur": (Scene(blur=2.2), 18),
    "glare": (Scene(glare=130), 18),
    "low contrast": (Scene(contrast=0.2), 18),
    "strong compression": (Scene(), 38),
    "partly hidden": (Scene(hidden=0.9), 18),
    "white floor": (Scene(floor=250), 18),
    "black floor": (Scene(floor=35), 18),
}


@pytest.fixture(scope="module")
def clean(clean_film, camera):
    """The clean film's track, and what was told on the way: frames done, and how many there are."""
    told = []
    return track_film(clean_film, camera, Disk(), lambda *frames: told.append(frames)).track, told


def test_clean_film_is_exact(clean, poses, errors_of):
    """On a clean film no frame is lost, the mean error is under 0.4 mm and 0.5°, the worst under 1.5 mm."""
    track, _ = clean
    off, turned = errors_of(track, poses)
    assert track.lost == 0
    assert off.mean() < 0.4
    assert off.max() < 1.5
    assert turned.mean() < 0.5
    assert np.allclose(track.t, np.arange(len(poses)) * 4 / 25, atol=1e-3)


def test_places_are_not_off_to_one_side(poses):
    """Through a camera known by its construction the mean error along x and along y is under 0.1 mm. One
    calibrated with the finder itself would make up for a finder whose places are all off to one side."""
    straight = Scene(lens=replace(Lens(), bend=(0, 0, 0), middle=(319.5, 239.5)))
    renderer, tracker = Renderer(straight), Tracker(pinhole((0, 0)), Disk())
    seen = [tracker.see(renderer.picture(pose))[0] for pose in poses[::2]]
    off = np.array([(pose.x, pose.y) for pose in seen]) - poses[::2, :2]
    assert np.abs(off.mean(axis=0)).max() < 0.01


@pytest.mark.parametrize("condition", HARD)
def test_hard_films_are_tracked(condition, tmp_path, camera, poses, errors_of):
    """Noise, blur, glare, low contrast, compression and a cable over the disk lose no frame, and
    the mean error stays under 0.6 mm and 1.5°, the worst under 1.5 mm."""
    scene, quality = HARD[condition]
    truth = poses[:16]
    track = track_film(write_film(tmp_path / "film.mp4", scene, truth, quality), camera, Disk()).track
    off, turned = errors_of(track, truth)
    assert track.lost == 0
    assert off.mean() < 0.6
    assert off.max() < 1.5
    assert turned.mean() < 1.5


def test_lost_robot_is_lost_and_found_again(camera, errors_of):
    """While nothing of the robot, or not its front patch, is seen the frame is lost, never guessed;
    a robot that a hand has moved is found at once."""
    renderer, bare = Renderer(Scene()), Renderer(Scene(robot=False))
    blind = Renderer(Scene(disk=(2.75, 0.7, 0.0, 1.95)))
    lone = Renderer(Scene(disk=(2.75, 0.0, 0.45, 1.95)))
    tracker, here, there = Tracker(camera, Disk()), (20.0, 22.0, 0.5), (33.0, 26.0, -2.0)
    seen = [
        tracker.see(picture)
        for picture in (
            renderer.picture(here),
            bare.picture(here),
            blind.picture(here),
            lone.picture(here),
            renderer.picture(here),
            renderer.picture(there),
        )
    ]
    assert [one is not None for one in seen] == [True, False, False, False, True, True]
    pose, quality = seen[-1]
    assert np.hypot(pose.x - there[0], pose.y - there[1]) < 0.05
    assert quality > 0.9


@pytest.mark.parametrize("step_cm", [-2.4, -1.8, 1.8, 2.4, 3.3])
def test_a_fast_robot_is_followed(step_cm, camera):
    """A robot that goes 1.8 to 3.3 cm between two frames, ahead or back, is where it is, not where something
    near its last place resembles it: there its own patches, taken for each other, are a likeness too."""
    renderer, tracker = Renderer(Scene()), Tracker(camera, Disk())
    turns = np.arange(12) * step_cm / 9
    truth = np.stack([25 + 9 * np.sin(turns), 22 - 9 * np.cos(turns), turns], 1)
    for at in truth:
        pose, _ = tracker.see(renderer.picture(at))
        assert np.hypot(pose.x - at[0], pose.y - at[1]) < 0.15
        assert abs(np.sin(pose.heading - at[2])) < 0.05
        assert np.cos(pose.heading - at[2]) > 0


def test_height_of_the_disk_is_corrected(camera, errors_of):
    """A disk higher than the calibration's is put right when the lens's height is known, and would
    be millimetres off otherwise."""
    tall, pose = Renderer(Scene(disk_height=7.0)), (40.0, 40.0, 1.0)
    right, _ = Tracker(camera, Disk(height_cm=7.0)).see(tall.picture(pose))
    wrong, _ = Tracker(camera, Disk()).see(tall.picture(pose)) or (None, 0)
    assert np.hypot(right.x - 40, right.y - 40) < 0.06
    assert wrong is None or np.hypot(wrong.x - 40, wrong.y - 40) > 0.5


@pytest.mark.parametrize("grain", [1, 2, 3, 4, 6])
def test_spotted_floor_is_no_robot(camera, grain):
    """Light and dark spots of any size, as strong as the picture allows, are not taken for the disk."""
    draw, tracker = np.random.default_rng(grain), Tracker(camera, Disk())
    for _ in range(4):
        spots = cv2.GaussianBlur(draw.normal(0, 1, (480, 640)), (0, 0), grain)
        picture = np.clip(128 + 50 * spots / spots.std(), 0, 255).astype(np.uint8)
        assert tracker.see(picture) is None
