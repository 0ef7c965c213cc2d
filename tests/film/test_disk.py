"""The disk and its TOML, tails."""

import cv2
import numpy as np

from realitygap.film.disk import Disk
from realitygap.film.printed import draw_tails, save_tails
from realitygap.track import Track


def test_tails_join_centre_and_leading_edge(tmp_path, camera):
    """Each found frame leaves a white line from the centre to the leading edge, a lost one none."""
    lost = np.nan
    rows = Track.from_degrees(
        np.arange(5) * 0.04, [20, 21, lost, lost, 24], [25, 25.5, lost, lost, 26], [0, 10, lost, lost, 40]
    )
    frame = np.full((480, 640, 3), 200, np.uint8)
    picture = draw_tails(frame, rows, camera, Disk())
    factor = picture.shape[1] // 640
    for x, y, heading in zip(rows.x, rows.y, rows.heading, strict=True):
        if np.isnan(x):
            continue
        for ahead in (0.1, 1.4, 2.65):
            spot = camera.to_pixels([x + ahead * np.cos(heading), y + ahead * np.sin(heading)], 3.0)
            column, row = np.rint((spot + 0.5) * factor - 0.5).astype(int)
            assert picture[row - 1 : row + 2, column - 1 : column + 2].max() > 190
    assert np.median(picture) < 130
    assert (picture > 180).all(-1).sum() < 3 * 2.75 * 11 * factor * 4
    save_tails(tmp_path / "tails.png", picture)
    assert (cv2.imread(str(tmp_path / "tails.png"))[..., ::-1] == picture).all()
