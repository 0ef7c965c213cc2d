"""One calibrated camera and one clean film for all tests of films."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from realitygap.film.calibrate import Calibration, KnownFrame, calibrate_camera
from realitygap.film.camera import CameraModel
from realitygap.film.disk import Disk
from realitygap.film.video import FilmWriter
from realitygap.values import Pose
from tests.film.scene import Lens, Renderer, Scene, wander

STRIDE = 4
"""The tests' robot is filmed at 25 / STRIDE frames a second: few frames, a long way."""


def pinhole(radial: tuple[float, float] = (-0.05, 0.01), plane_cm: float = 3.0) -> CameraModel:
    """The tests' camera, looking through its picture's middle, as its construction says."""
    lens = Lens()
    inside = np.array([[lens.focal, 0, 319.5], [0, lens.focal, 239.5], [0, 0, 1.0]])
    turn = lens.rotation()
    shift = turn @ (np.array([0, 0, plane_cm]) - lens.place)
    return CameraModel(
        width_px=640,
        height_px=480,
        homography=inside @ np.column_stack([turn[:, 0], turn[:, 1], shift]),
        radial=radial,
        plane_cm=plane_cm,
        lens_cm=lens.place,
    )


def known_frames(scene: Scene, count: int = 12, seed: int = 3) -> list[KnownFrame]:
    """Frames of a robot all over the floor that the camera sees."""
    draw, renderer = np.random.default_rng(seed), Renderer(scene)
    spots = [(x, y) for y in (4, 21, 38) for x in (5, 18, 32, 45)]
    frames = []
    for number, (x, y) in enumerate(spots[:count]):
        pose = (x + draw.uniform(-2, 2), y + draw.uniform(-2, 2), draw.uniform(-math.pi, math.pi))
        known = Pose(x=pose[0], y=pose[1], heading=pose[2])
        frames.append(KnownFrame(name=f"f{number:02}.png", picture=renderer.picture(pose), pose=known))
    return frames


def write_film(path: Path, scene: Scene, poses: np.ndarray, quality: float = 18) -> Path:
    """A film of a robot at these poses, one a frame."""
    renderer = Renderer(scene)
    with FilmWriter(path, rate=25 / STRIDE, made_by="the tests' renderer", quality=quality) as film:
        for pose in poses:
            film.add(renderer.picture(pose))
    return path


@pytest.fixture(scope="session")
def frames() -> list[KnownFrame]:
    """Frames for a calibration, in an empty room."""
    return known_frames(Scene(cylinders=()))


@pytest.fixture(scope="session")
def calibration(frames: list[KnownFrame]) -> Calibration:
    """The camera as a person would calibrate it."""
    return calibrate_camera(frames, Disk(), lens_height_cm=Scene().lens.place[2])


@pytest.fixture(scope="session")
def camera(calibration: Calibration) -> CameraModel:
    """The calibrated camera."""
    return calibration.camera


@pytest.fixture(scope="session")
def poses() -> np.ndarray:
    """Where the robot of the tests' films is in each frame, [n, 3]."""
    return wander(160)[::STRIDE]


@pytest.fixture(scope="session")
def clean_film(tmp_path_factory: pytest.TempPathFactory, poses: np.ndarray) -> Path:
    """A film with nothing against it."""
    return write_film(tmp_path_factory.mktemp("film") / "clean.mp4", Scene(), poses)


@pytest.fixture
def errors_of() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """Turns a track and the truth into errors: mm and degrees of the frames that were found."""

    def errors(track, truth):
        found = track.found
        off = 10 * np.hypot(track.x - truth[:, 0], track.y - truth[:, 1])
        turned = np.abs((track.heading_deg - np.degrees(truth[:, 2]) + 180) % 360 - 180)
        return off[found], turned[found]

    return errors
