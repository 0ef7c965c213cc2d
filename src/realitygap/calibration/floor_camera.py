"""The camera over the wheels' floor: calibrated, then used to track the robot in its film.

Its pictures go through the tracker like any film; the twin's true poses only draw the pictures.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.calibration.plan import camera_places
from realitygap.film.calibrate import KnownFrame, calibrate_camera
from realitygap.film.tag import Marker, Tag, load_marker
from realitygap.film.tracker import Tracker
from realitygap.track import read_track
from realitygap.twin.camera import OverheadCamera, Plate
from realitygap.values import Closing, Pose

__all__ = ["FloorCamera", "plate_of"]

STEP_S = 0.1
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
        self._camera = OverheadCamera(room, unit=unit, noise=noise, seed=seed, plate=plate, grey=True)
        try:
            known = camera_places()
            frames = [
                KnownFrame(name=str(k), picture=self._camera.frame(pose, k), pose=pose)
                for k, pose in enumerate(known)
            ]
            self._model = calibrate_camera(frames, self._marker).camera
        except BaseException:
            self._camera.close()
            raise

    def poses(self, film: Path, steps: Sequence[int], trial: int) -> dict[int, Pose]:
        """Tracked poses at steps (100 ms) of a trial's film, without those at which the robot is lost."""
        truth = read_track(film, seen_by="truth")
        tracker = Tracker(self._model, self._marker)
        seen: dict[int, Pose] = {}
        for step in steps:
            row = int(np.searchsorted(truth.t, truth.t[0] + STEP_S * step + 1e-6, side="right")) - 1
            pose = Pose(x=truth.x[row], y=truth.y[row], heading=truth.heading[row])
            found = tracker.see(self._camera.frame(pose, FRAMES * (trial + 1) + step))
            if found is not None:
                seen[step] = found[0]
        return seen

    def close(self) -> None:
        self._camera.close()
