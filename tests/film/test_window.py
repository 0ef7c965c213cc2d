"""What the tracker looks at closely."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from realitygap.film.camera import CameraModel
from realitygap.film.disk import Disk
from realitygap.film.finder import REACH_CM, Finder
from realitygap.film.pattern import correlation, pattern_of, responses, spots
from realitygap.film.window import lay_out, optics_of, sightings
from tests.film import slow_masks
from tests.film.scene import Renderer, Scene

SCENES = (
    Scene(),
    Scene(noise=15),
    Scene(glare=130),
    Scene(hidden=0.9),
    Scene(contrast=0.2),
    Scene(floor=250),
)


def some_cameras(camera: CameraModel) -> list[CameraModel]:
    """With and without a lens that bends, or folds the picture back; the disk on its plane, or off it."""
    told = {"lens_cm": (40.0, 30.0, 120.0), "radial": (-0.2, 0.03)}
    return [
        camera,
        replace(camera, radial=(0.0, 0.0)),
        replace(camera, **told),
        replace(camera, radial=(-1.5, 0)),
    ]


def test_a_window_lies_where_the_camera_says(camera: CameraModel) -> None:
    """The compiled camera takes a square's places to the pixels that the camera does, to the last bit."""
    axis = np.arange(-30, 31) * 0.31
    for one in some_cameras(camera):
        for height in (3.0, 5.5) if one.lens_cm else (one.plane_cm,):
            columns, rows, ends = *np.empty((2, 61, 61), np.float32), np.empty(4)
            for x, y in ((30.0, 40.0), (-20.0, 95.0), (400.0, -900.0)):
                lay_out(optics_of(one, height), np.array([x, y]), axis, columns, rows, ends)
                right = one.columns_rows(x + axis, (y + axis)[:, None], height)
                assert columns.tobytes() == right[0].astype(np.float32).tobytes()
                assert rows.tobytes() == right[1].astype(np.float32).tobytes()
                assert ends.tolist() == [columns.min(), columns.max(), rows.min(), rows.max()]


@pytest.mark.parametrize("scene", SCENES)
def test_compiled_masks_find_what_plain_ones_do(camera: CameraModel, poses: np.ndarray, scene: Scene) -> None:
    """In windows on the disk, beside it and on noise: the same patches to the last bit, the same quality but
    for the rounding of sums."""
    disk, random = Disk(), np.random.default_rng(5)
    finder, renderer, count = Finder(camera, disk), Renderer(scene), 0
    square, pattern = finder._square(REACH_CM), pattern_of(disk)
    for k, pose in enumerate(poses[:8]):
        picture = renderer.picture(pose)
        if k == 7:
            picture = random.integers(0, 255, picture.shape, np.uint8)
        place = np.array(pose[:2]) + random.normal(0, 0.8, 2)
        window, room = finder._laid_out(picture, place, square), square.room
        for kept in room:
            kept[:] = np.nan
        found = sightings(window, square.aim, room, square.tops, square.found)
        masks = [kept[:, : len(window)] for kept in (room.for_centre, room.for_front, room.fine)]
        plain = slow_masks.sightings(*masks[:2], square.aim, len(square.found))
        assert [tuple(points) for points in square.found[:found].tolist()] == plain
        for mine, whole in zip(masks, responses(window, disk, 1 / finder._step), strict=True):
            made = ~np.isnan(mine)
            assert np.allclose(mine[made], whole[made], atol=1e-3)
        count += found
        for points in square.found[:found]:
            columns, rows = np.empty((2, len(pattern.white), 1), np.float32)
            spots(pattern, points, finder._step, columns, rows)
            seen = cv2.remap(masks[2], columns, rows, cv2.INTER_LINEAR)[:, 0].astype(np.float64)
            ahead = (points[2:] - points[:2]) / np.hypot(*(points[2:] - points[:2])) / finder._step
            where = points[:2] + pattern.places @ np.array([ahead, [-ahead[1], ahead[0]]])
            assert np.allclose(np.hstack([columns, rows]), where, atol=1e-4)
            right = slow_masks.correlation(seen, pattern)
            assert correlation(seen, pattern, np.empty((4, 5))) == pytest.approx(right, abs=1e-10)
    assert count >= 6


@pytest.mark.parametrize("radius_cm", [2.75, 6.0, 11.0])
def test_a_disk_larger_than_the_window_is_judged_as_by_whole_masks(
    camera: CameraModel, poses: np.ndarray, radius_cm: float
) -> None:
    """Beyond the window the picture is as at its edge, not what an earlier window left there."""
    disk = Disk(radius_cm=radius_cm)
    finder, renderer = Finder(camera, disk), Renderer(Scene())
    square = finder._square(REACH_CM)
    for kept in square.room:
        kept[:] = 1e4
    judged = 0
    for pose in poses[:8]:
        picture, place = renderer.picture(pose), np.array(pose[:2]) + 0.9
        seen = finder.near(picture, place)
        if seen is not None:
            window = finder._laid_out(picture, place, square)
            found = (seen.points - place) / finder._step + square.aim.half
            whole = responses(window, disk, 1 / finder._step)[2]
            assert seen.quality == pytest.approx(finder._quality(whole, found.ravel()), abs=1e-4)
            judged += 1
    assert judged >= 6
