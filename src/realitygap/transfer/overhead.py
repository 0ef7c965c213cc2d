"""The camera over a real robot: it reads the start pose, and films the drive."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from realitygap.errors import FilmError
from realitygap.track import Track
from realitygap.transfer.film import FILM, TRACK, keep_film
from realitygap.transfer.paths import of_track
from realitygap.transfer.plan import Situation
from realitygap.values import Closing, Pose

if TYPE_CHECKING:
    from realitygap.film.camera import CameraModel
    from realitygap.film.live import Filmed
    from realitygap.film.tag import Marker

__all__ = ["Found", "Overhead"]

Found = Callable[[Situation, Pose, Pose | None], bool]
"""Gets the requested pose and the seen one (None: not seen), and returns whether to start there; if none is
seen, from the requested pose, on a person's word. If False, the camera looks again."""


@dataclass(kw_only=True)
class FilmOfDrive:
    """The film of one drive; complete when the drive is over."""

    overhead: Overhead
    situation: Situation
    folder: Path
    begun: float
    period_s: float
    filmed: Filmed | None = None

    def path(self, facts: dict[str, Any]) -> Track:
        """The situated path from the tracker; the film is kept only if requested.

        Raises:
            FilmError: the robot is not seen in any frame.
        """
        from realitygap.film.tracker import track_film

        assert self.filmed is not None
        one, folder, lead = self.situation, self.folder, self.begun - self.filmed.first_at
        camera, marker = self.overhead.camera, self.overhead.marker
        if one.film:
            tracked = keep_film(folder, camera, marker)
        else:
            tracked = track_film(folder / FILM, camera, marker)
            tracked.track.write_csv(folder / TRACK)
            (folder / FILM).unlink()
        facts |= {"view": f"camera {self.overhead.source}", "film_lead_s": round(lead, 6)}
        facts["trouble"] = "; ".join(filter(None, (self.filmed.trouble, tracked.trouble))) or None
        return of_track(tracked.track, round(one.seconds / self.period_s), lead, period_s=self.period_s)


class Overhead(Closing):
    """An open, calibrated camera over a real robot's arena; a context manager.

    Args:
        source: a camera's number, a video file or a stream.
        camera: its calibration.
        marker: what the robot wears.
        found: asks a person about the start; without one the robot must be seen.
        says: called with the reason why it is not seen, if known.
    """

    def __init__(
        self,
        source: str | int,
        camera: CameraModel,
        marker: Marker,
        found: Found | None,
        says: Callable[[str], object] | None = None,
    ) -> None:
        from realitygap.film.live import LiveCamera
        from realitygap.film.tracker import Tracker

        self.camera, self.marker, self._found, self._says = camera, marker, found, says
        self._new_tracker = lambda: Tracker(camera, marker)
        self._new_tracker()  # refuses a camera that cannot see this marker
        self._live = LiveCamera(source, size=(camera.width_px, camera.height_px))
        self.source = self._live.source

    def close(self) -> None:
        self._live.close()

    def start(self, one: Situation, requested: Pose) -> Pose:
        """The robot's pose: as seen, or the requested one on the person's word."""
        while True:
            picture = self._live.look()
            self.camera.check_size(picture.shape[1], picture.shape[0], f"live camera {self.source!r}")
            tracker = self._new_tracker()
            seen = tracker.see(picture)
            pose = None if seen is None else seen[0]
            if self._found is None:
                if pose is None:  # nobody can be asked
                    cure = "Check that it wears the marker and that the calibration is of this camera."
                    told = f"{one.name}, start {one.start}: the robot is not seen where it was carried."
                    raise FilmError(f"{told} {tracker.doubt or cure}")
                return pose
            if pose is None and tracker.doubt and self._says is not None:
                self._says(tracker.doubt)
            if self._found(one, requested, pose):
                return requested if pose is None else pose

    @contextmanager
    def filming(self, one: Situation, folder: Path, period_s: float) -> Iterator[FilmOfDrive]:
        """Film the block, which is the drive; afterwards its path is available by steps."""
        self._live.film(folder / FILM)
        begun = time.monotonic()
        film = FilmOfDrive(overhead=self, situation=one, folder=folder, begun=begun, period_s=period_s)
        try:
            yield film
        except BaseException:
            with suppress(FilmError):
                self._live.finish(time.monotonic())
            raise
        film.filmed = self._live.finish(film.begun + one.seconds)
