"""The camera over the wheels' floor: calibrated, then used to track the robot in its film.

Its pictures go through the tracker like any film; the twin's true poses only draw the pictures.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.plan import camera_places
from realitygap.film.calibrate import KnownFrame, calibrate_camera
from realitygap.film.marker import Marker, Tag, load_marker
from realitygap.film.tracker import Tracker
from realitygap.twin.camera import OverheadCamera
from realitygap.twin.plate import Plate
from realitygap.twin.states import States
from realitygap.values import Closing, Pose

__all__ = ["FloorCamera", "plate_of"]

STEP_MS = 100
FRAMES = 10_000
"""Frame numbers reserved for each trial: more than its steps."""


def plate_of(marker: Marker | None) -> Plate | None:
    """How a twin's camera draws a tag on the robot; None: it wears the disk."""
    if not isinstance(marker, Tag):
        return None
    return Plate(marker.cells, marker.points / 100, marker.height_cm / 100)


class FloorCamera(Closing):
    """The overhead camera of a twin's unit, calibrated with frames of the robot at known places.

    Args:
        room, unit, noise, seed: as the twin's. The pictures are drawn, so they do not depend on this
            machine's renderer.
        marker: what the robot wears; the shipped disk if None.
    """

    def __init__(
        self, room: Mapping[str, Any], *, unit: int, noise: float, seed: int, marker: Marker | None = None
    ) -> None:
        self._marker, plate = marker or load_marker(), plate_of(marker)
        self._camera = OverheadCamera(room, unit=unit, noise=noise, view="drawn", seed=seed, plate=plate)
        try:
            known = camera_places()
            places = States.standing(
                range(len(known)), [p.x for p in known], [p.y for p in known], [p.heading for p in known]
            )
            frames = [
                KnownFrame(name=str(k), picture=self._picture(places.pose[k], k), pose=pose)
                for k, pose in enumerate(known)
            ]
            self._model = calibrate_camera(frames, self._marker).camera
        except BaseException:
            self._camera.close()
            raise

    def poses(self, film: Path, steps: Sequence[int], trial: int) -> dict[int, Pose]:
        """Tracked poses at steps (100 ms) of a trial's film, without those at which the robot is lost."""
        states = States.from_file(film)
        tracker = Tracker(self._model, self._marker)
        seen: dict[int, Pose] = {}
        for step in steps:
            due = int(states.time_ms[0]) + STEP_MS * step
            row = int(np.searchsorted(states.time_ms, due, side="right")) - 1
            found = tracker.see(self._picture(states.pose[row], FRAMES * (trial + 1) + step))
            if found is not None:
                seen[step] = found[0]
        return seen

    def close(self) -> None:
        self._camera.close()

    def _picture(self, pose: NDArray[np.float64], number: int) -> NDArray[np.uint8]:
        """A frame in grey levels; its number seeds its noise."""
        import cv2

        frame = self._camera.frame(pose, number)
        return np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)
