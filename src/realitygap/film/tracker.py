"""The tracker: the robot's pose in every frame of a film (§6).

The whole first frame is searched; then a window round where its last two places say that it goes; and the
whole frame again whenever the robot was lost, or what the window shows is less like it than what would be
believed anywhere. Only where to look is carried over from frame to frame: a frame in which its marker is not
seen is reported as lost, never guessed.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from realitygap.errors import FilmError
from realitygap.film.camera import CameraModel
from realitygap.film.disk import CLOSE_CM, REACH_CM, Sighting
from realitygap.film.tag import Marker, finder_of
from realitygap.film.video import FilmReader, Image
from realitygap.track import COLUMNS, Track
from realitygap.values import Floats, Pose

__all__ = ["Tracked", "Tracker", "track_film"]

Row = tuple[float, tuple[Pose, float] | None]
"""A frame's time (s), and pose and quality if the robot is seen."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracked:
    """The results of tracking a film: the track, the last frame [height, width, 3], and in words what was
    wrong with the film (None: nothing)."""

    track: Track
    last_frame: Image
    trouble: str | None


class Tracker:
    """Follows one marker from frame to frame; `doubt` says why it was lost, or that another
    one is in view, if known."""

    def __init__(self, camera: CameraModel, marker: Marker) -> None:
        self._finder, self._marker = finder_of(camera, marker), marker
        self._last: Floats | None = None
        self._step: Floats | None = None
        self.best_quality, self.doubt = 0.0, ""

    def see(self, picture: Image) -> tuple[Pose, float] | None:
        """The robot's pose in a picture [height, width], and its quality, or None."""
        finder, last, step, seen = self._finder, self._last, self._step, None
        if last is not None:
            place, reach_cm = (last, REACH_CM) if step is None else (last + step, CLOSE_CM)
            seen = self._believed(finder.near(picture, place, reach_cm), finder.known_again)
        if seen is None or seen.quality < finder.found_anew:  # a likeness, of a robot that has gone far?
            seen = self._believed(finder.anywhere(picture), finder.found_anew) or seen
            if seen is None and not self.doubt:
                self.doubt = finder.why_not(picture)
        self._last = None if seen is None else np.array([seen.pose.x, seen.pose.y])
        self._step = None if last is None or self._last is None else self._last - last
        return None if seen is None else (seen.pose, seen.quality)

    def look_about(self, whole: Image, pose: Pose) -> None:
        """Doubt a robot that was just found if, with it covered, its marker is still seen in the picture."""
        if self.doubt:
            return
        camera, marker, place = self._finder.camera, self._marker, (pose.x, pose.y)
        reach = 1.2 * marker.radius_cm * camera.pixels_per_cm(place, marker.height_cm)
        middle = np.rint(camera.to_pixels(place, marker.height_cm)).astype(int).tolist()
        rest = cv2.circle(whole.copy(), middle, math.ceil(reach), int(np.median(whole)), cv2.FILLED)
        other = self._finder.anywhere(rest)
        if other is not None and other.quality >= self._finder.found_anew:
            at = f"({other.pose.x:.0f}, {other.pose.y:.0f}) cm"
            self.doubt = f"another {marker.name} like the robot's is seen at {at}: cover all but the robot's"

    def follow(self, frames: Iterable[tuple[float, Image]]) -> Track:
        """The track of pictures with their times (s), one after the other; none is kept."""
        return _track([(t_s, self.see(picture)) for t_s, picture in frames])

    def no_detection_message(self, frames: int) -> str:
        """The message if the robot is seen in none of the frames."""
        name = self._marker.name
        cure = (
            f"Check that the robot carries the {name}, that the camera was calibrated for this film, "
            f"and that the {name} is given in its true size."
        )
        return (
            f"no robot's {name} is seen in any of its {frames} frames (best quality "
            f"{self.best_quality:.2f}, needed {self._finder.found_anew:g}). {self.doubt or cure} Or "
            f"track it with another program: `realitygap score` reads its CSV, columns {', '.join(COLUMNS)}."
        )

    def _believed(self, seen: Sighting | None, least: float) -> Sighting | None:
        self.best_quality = max(self.best_quality, 0.0 if seen is None else seen.quality)
        return seen if seen is not None and seen.quality >= least else None


def track_film(
    film: str | Path,
    camera: CameraModel,
    marker: Marker,
    on_progress: Callable[[int, int | None], None] | None = None,
) -> Tracked:
    """Track the robot through a film.

    Args:
        film: any film that PyAV reads.
        camera: which took it.
        marker: what the robot carries.
        on_progress: called now and then with frames done, and frames in all if known.

    Raises:
        FilmError: not a film, a film of another size, or one in which no disk is seen.
    """
    tracker, rows = Tracker(camera, marker), list[Row]()
    report = on_progress or (lambda done, total: None)
    with FilmReader(film) as reader:
        for frame in reader:
            if not rows:
                camera.check_size(frame.grey.shape[1], frame.grey.shape[0], str(film))
            elif frame.grey.shape != (camera.height_px, camera.width_px):
                raise FilmError(f"{film}: its pictures change size at {frame.t_s:.2f} s. Cut the film there.")
            seen = None if frame.damaged else tracker.see(frame.grey)
            if seen is not None and (not rows or rows[-1][1] is None):
                tracker.look_about(frame.grey, seen[0])
            rows.append((frame.t_s, seen))
            if len(rows) % 10 == 0:
                report(len(rows), reader.frames_expected)
        last = frame.colour()
    report(len(rows), len(rows))
    track = _track(rows)
    if not track.found.any():
        raise FilmError(f"{film}: {tracker.no_detection_message(len(track))}")
    trouble = "; ".join(filter(None, (reader.trouble, tracker.doubt))) or None
    return Tracked(track=track, last_frame=last, trouble=trouble)


def _track(rows: list[Row]) -> Track:
    lost = Pose(x=math.nan, y=math.nan, heading=math.nan), 0.0
    seen = [(t_s, *(one or lost)) for t_s, one in rows]
    columns = np.array([(t_s, pose.x, pose.y, pose.heading, quality) for t_s, pose, quality in seen]).T
    t, x, y, heading, quality = columns
    return Track(t=t, x=x, y=y, heading=heading, quality=quality, seen_by="camera")
