"""Tails, as in the paper's figures 3 and 5.

"After processing an entire sequence, the lines, one per frame, joining the centre of the Khepera to
its leading edge, were overlaid on the final frame to produce an image of the Khepera with a white
'tail' behind it." (§6)
"""

import math
from pathlib import Path

import cv2
import numpy as np

from realitygap.errors import FilmError
from realitygap.files import atomic_write
from realitygap.film.camera import CameraModel
from realitygap.film.marker import Marker
from realitygap.film.video import Image
from realitygap.track import Track
from realitygap.values import Floats

__all__ = ["draw_tails", "save_tails"]

_WIDE_PX = 1200
"""Narrower pictures are drawn larger, by a whole factor, so that the lines are fine."""

_BRIGHTEST = 110
"""The floor is darkened to this, so that white shows on it (0 black, 255 white)."""

_SHIFT = 4
"""OpenCV draws between pixels in units of 1 / 2^shift."""


def draw_tails(frame: Image, track: Track, camera: CameraModel, marker: Marker) -> Image:
    """A frame [height, width, 3] under the white lines of a track, one for each frame in which the
    robot was found; larger than the frame if that is small. The frame is darkened where its floor
    is so bright that white would not show.

    Args:
        frame: the picture.
        track: of the film, a row a frame.
        camera: calibrated.
        marker: what the robot wears.
    """
    camera.check_size(frame.shape[1], frame.shape[0], "the frame")
    factor = max(1, math.ceil(_WIDE_PX / frame.shape[1]))
    height, width = frame.shape[:2]
    picture = cv2.resize(frame, (factor * width, factor * height), interpolation=cv2.INTER_CUBIC)
    strokes = _strokes(track, camera, marker)
    dark = min(1.0, _BRIGHTEST / max(_floor_under(frame, strokes), 1.0))
    picture = np.rint(picture * dark).astype(np.uint8)
    lines = np.rint(((strokes + 0.5) * factor - 0.5) * 2**_SHIFT).astype(np.int32)
    veil = np.zeros(picture.shape[:2], np.uint8)
    for line in lines:
        cv2.polylines(veil, [line.reshape(-1, 1, 2)], False, 255, max(1, factor // 2), cv2.LINE_AA, _SHIFT)
    part = (veil / 255.0)[..., None]
    return np.asarray(np.rint(picture + (255 - picture) * part), np.uint8)


def save_tails(path: str | Path, picture: Image) -> None:
    """Write a picture [height, width, 3] as PNG.

    Raises:
        FilmError: a name that does not end in .png.
    """
    if Path(path).suffix.lower() != ".png":
        raise FilmError(f"{path}: expected a picture's name ending in .png.")
    done, data = cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))
    if not done:
        raise FilmError(f"{path}: cannot be made into a picture.")
    atomic_write(path, data.tobytes())


def _strokes(track: Track, camera: CameraModel, marker: Marker) -> Floats:
    """From centre to leading edge, [n, 2, 2] px, where the robot was found."""
    seen = track.only(track.found)
    centre = np.stack([seen.x, seen.y], 1)
    edge = centre + marker.radius_cm * np.stack([np.cos(seen.heading), np.sin(seen.heading)], 1)
    return camera.to_pixels(np.stack([centre, edge], 1), marker.height_cm)


def _floor_under(frame: Image, strokes: Floats) -> float:
    """How bright the picture is along the path; 0 if there is none."""
    height, width = frame.shape[:2]
    columns, rows = np.rint(strokes[:, 0]).astype(int).clip(0, (width - 1, height - 1)).T
    return float(np.quantile(frame[rows, columns].mean(axis=1), 0.75)) if len(rows) else 0.0
