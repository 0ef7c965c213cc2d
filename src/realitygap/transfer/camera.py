"""The camera over a robot: a twin's is rendered from its recorded states, a real robot's films it live.

Frames are tracked one by one in memory, or written to a film that is tracked like any other.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from realitygap.errors import FilmError
from realitygap.files import atomic_write, to_toml
from realitygap.film.calibrate import KnownFrame, calibrate_camera
from realitygap.film.camera import CameraModel, load_camera
from realitygap.film.disk import Disk, load_disk
from realitygap.film.tag import Marker
from realitygap.kernels.types import STEP_S
from realitygap.track import Track
from realitygap.transfer.paths import of_track
from realitygap.values import Closing, Pose, steps_in
from realitygap.world.arena import Arena

if TYPE_CHECKING:
    from realitygap.film.tracker import Tracked
    from realitygap.transfer.spec import TrialSpec
    from realitygap.twin.camera import OverheadCamera

__all__ = [
    "FILM", "TRACK", "ConfirmPose", "LiveOverhead", "OverheadTracker", "known_poses",
]  # fmt: skip

FPS = 25
"""Frames a second of a film."""
FILM, CAMERA, TRACK, TAILS = "film.mp4", "camera.json", "track.csv", "tails.png"
DISK = "disk.toml"
"""File beside a film, if the disk is not the shipped one."""

LEAST_POSES, GRIDS = 16, range(4, 10)
"""Poses for calibrating a camera, on the coarsest grid with this many free places."""

GOLDEN_DEG = 222.4922
"""Turn from one known pose to the next: distinct headings in all directions."""

MARGIN_CM = 0.5
TOUCH_CM = 1e-6
"""Distance of known poses from walls, and tolerance of positions for rounding."""

QUALITY = 23
"""H.264's rate factor: it drops some of the pixels' noise, which makes films far smaller."""

FIRST = 10**6
"""First number of calibration frames: their pixels' noise differs from the films'."""


def known_poses(arena: Arena, radius_cm: float) -> list[Pose]:
    """Free positions all over the floor, each with a heading of its own."""
    width, depth = arena.size_cm
    near = radius_cm + MARGIN_CM
    places: list[tuple[float, float]] = []
    for n in GRIDS:
        across, along = np.linspace(near, width - near, n), np.linspace(near, depth - near, n)
        grid = [(float(x), float(y)) for y in along for x in across]
        places = [place for place in grid if arena.obstacle_at(*place, near - TOUCH_CM) is None]
        if len(places) >= LEAST_POSES:
            break
    return [Pose.from_degrees(x, y, k * GOLDEN_DEG % 360.0) for k, (x, y) in enumerate(places)]


class OverheadTracker:
    """The camera over a unit's arena, which watches trials without keeping a film.

    Args:
        file: keeps the camera's calibration.
        arena: what it looks at.
        unit: whose arena.
        noise: the twin's noise scale.
        radius_cm: of the robot's body.
        marker: what the robot wears; the shipped disk if None.
        period_s: from one look to the next, where it only watches: a step.

    Raises:
        FilmError: no camera explains what is seen.
    """

    def __init__(
        self,
        file: Path,
        arena: Arena,
        *,
        unit: int,
        noise: float,
        radius_cm: float,
        marker: Marker | None = None,
        period_s: float = STEP_S,
    ) -> None:
        self.period_s = period_s
        self.marker = marker or load_disk()
        self._arena, self._unit, self._noise = arena.plain(), unit, noise
        self.camera = self._calibrated(file, known_poses(arena, radius_cm))

    def _calibrated(self, file: Path, poses: list[Pose]) -> CameraModel:
        """The calibration by known poses, kept in `file`; processes that make it at one time make the same.

        The known frames are drawn: the lens is the renderer's too, and results do not depend on a GL library.
        """
        if file.is_file():
            return load_camera(file)
        pictures = [self._eye.frame(pose, FIRST + k) for k, pose in enumerate(poses)]
        frames = [
            KnownFrame(name=f"pose {k}", picture=picture, pose=pose)
            for k, (pose, picture) in enumerate(zip(poses, pictures, strict=True), start=1)
        ]
        camera = calibrate_camera(frames, self.marker).camera
        file.parent.mkdir(parents=True, exist_ok=True)
        camera.save(file)
        return camera

    def _camera(self, *, view: str = "drawn", grey: bool = False) -> OverheadCamera:
        from realitygap.calibration.record import plate_of
        from realitygap.twin.camera import OverheadCamera

        plate, unit, noise = plate_of(self.marker), self._unit, self._noise
        return OverheadCamera(self._arena, unit=unit, noise=noise, view=view, plate=plate, grey=grey)

    @cached_property
    def _eye(self) -> OverheadCamera:
        """The camera that only watches: drawn, in grey."""
        return self._camera(grey=True)

    def watch(self, folder: Path, truth: Track, stream: int) -> tuple[Track, str]:
        """Track a robot by its true places, once a step; keep the track, but no film.

        Args:
            folder: the trial's.
            truth: where the robot was, from the trial's beginning to its end.
            stream: number of the first frame, which names its pixels' noise.

        Returns:
            The track, and how the frames were made, in words.
        """
        track = self.track(truth, stream)
        track.write_csv(folder / TRACK)
        return track, str(self._eye.metadata["view"])

    def track(self, truth: Track, stream: int) -> Track:
        """The same track, not kept."""
        import cv2

        from realitygap.film.tracker import Tracker

        frames, threads = self._eye.watched(truth, fps=1 / self.period_s, first=stream), cv2.getNumThreads()
        cv2.setNumThreads(1)  # on so small pictures a second one only waits, at full load
        try:
            return Tracker(self.camera, self.marker).follow(frames)
        finally:
            cv2.setNumThreads(threads)

    def film(
        self, folder: Path, truth: Track, stream: int, view: str, facts: Mapping[str, Any]
    ) -> tuple[Track, str]:
        """The same by a film, 25 frames a second: film, camera, track and tails into the folder.

        `view` names its renderer, `facts` are further metadata.
        """
        from realitygap.film.video import FilmWriter

        with self._camera(view=view) as camera:
            notes = {**camera.metadata, **facts}
            made = {"rate": FPS, "made_by": notes["view"], "notes": notes, "quality": QUALITY}
            with FilmWriter(folder / FILM, **made) as film:
                for _, frame in camera.frames(truth, fps=FPS, first=stream):
                    film.add(frame)
        return keep_film(folder, self.camera, self.marker).track, notes["view"]


def keep_film(folder: Path, camera: CameraModel, marker: Marker) -> Tracked:
    """Track the film in a trial's folder: camera, track, tails and a disk of your own.

    Args:
        folder: the trial's.
        camera: its calibration.
        marker: what the robot wears.

    Raises:
        FilmError: the film is not of this camera, or shows no marker.
    """
    from realitygap.film.printed import draw_tails, save_tails
    from realitygap.film.tracker import track_film

    tracked = track_film(folder / FILM, camera, marker)
    camera.save(folder / CAMERA)
    if isinstance(marker, Disk) and marker != load_disk():
        atomic_write(folder / DISK, to_toml(marker.to_dict()))
    tracked.track.write_csv(folder / TRACK)
    save_tails(folder / TAILS, draw_tails(tracked.last_frame, tracked.track, camera, marker))
    return tracked


ConfirmPose = Callable[["TrialSpec", Pose, Pose | None], bool]
"""Gets the requested pose and the seen one (None: not seen), and returns whether to start there; if none is
seen, from the requested pose, on a person's word. If False, the camera looks again."""


class LiveOverhead(Closing):
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
        found: ConfirmPose | None,
        says: Callable[[str], object] | None = None,
    ) -> None:
        from realitygap.film.live import LiveCamera
        from realitygap.film.tracker import Tracker

        self.camera, self.marker, self._found, self._says = camera, marker, found, says
        self._new_tracker = lambda: Tracker(camera, marker)
        self._new_tracker()  # refuses a camera that cannot see this marker
        self._live = LiveCamera(source, size=(camera.width_px, camera.height_px))
        self.source = self._live.source
        self._trouble: str | None = None
        self._lead_s = 0.0

    def close(self) -> None:
        self._live.close()

    def start(self, one: TrialSpec, requested: Pose) -> Pose:
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
    def filming(self, spec: TrialSpec, folder: Path) -> Iterator[None]:
        """Film the block, which is the drive; then `path` has its track."""
        self._live.film(folder / FILM)
        begun = time.monotonic()
        try:
            yield
        except BaseException:
            with suppress(FilmError):
                self._live.finish(time.monotonic())
            raise
        filmed = self._live.finish(begun + spec.seconds)
        self._trouble, self._lead_s = filmed.trouble, begun - filmed.first_at

    def path(self, spec: TrialSpec, folder: Path, period_s: float) -> tuple[Track, dict[str, Any]]:
        """The path in the last film, and facts of it; the film is kept only if requested.

        Raises:
            FilmError: the robot is not seen in any frame.
        """
        from realitygap.film.tracker import track_film

        if spec.film:
            tracked = keep_film(folder, self.camera, self.marker)
        else:
            tracked = track_film(folder / FILM, self.camera, self.marker)
            tracked.track.write_csv(folder / TRACK)
            (folder / FILM).unlink()
        trouble = "; ".join(filter(None, (self._trouble, tracked.trouble))) or None
        facts = {"view": f"camera {self.source}", "film_lead_s": round(self._lead_s, 6), "trouble": trouble}
        steps = steps_in(spec.seconds, period_s)
        return of_track(tracked.track, steps, self._lead_s, period_s=period_s), facts
