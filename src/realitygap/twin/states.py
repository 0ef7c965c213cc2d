"""Recorded states: where the robot was, for the camera and for testing the tracker, never for a score."""

from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from realitygap.errors import ConfigError
from realitygap.track import read_track
from realitygap.twin.arithmetic import cos_sin, one_arctan2

__all__ = ["States", "heading_of"]


def heading_of(pose: NDArray[np.float64]) -> float:
    """Heading (rad, −π to π) of a pose [7]."""
    w, x, y, z = pose[3:7].tolist()
    return float(one_arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


class States(NamedTuple):
    """[n] times (ms) and [n, 7] poses: x, y, z (m) and a quaternion.

    No Track: a robot that tips or is lifted has more than a heading, and the camera draws it so.
    """

    time_ms: NDArray[np.int64]
    pose: NDArray[np.float64]

    @classmethod
    def standing(cls, time_ms: ArrayLike, x_cm: ArrayLike, y_cm: ArrayLike, heading: ArrayLike) -> Self:
        """States of a robot that stands upright.

        Args:
            time_ms, x_cm, y_cm: [n].
            heading: [n] rad.
        """
        t = np.asarray(time_ms, np.int64)
        half = np.asarray(heading, np.float64) / 2.0
        pose = np.zeros((len(t), 7))
        pose[:, 0], pose[:, 1] = np.asarray(x_cm) / 100.0, np.asarray(y_cm) / 100.0
        pose[:, 3], pose[:, 6] = cos_sin(half)
        return cls(t, pose)

    @classmethod
    def from_file(cls, path: str | Path) -> Self:
        """States of a sealed file (t_s, x_cm, y_cm, heading_deg and further columns).

        Raises:
            ConfigError: the file is not such a table; names the line.
        """
        truth = read_track(path, seen_by="truth", error=ConfigError)
        return cls.standing(np.rint(truth.t * 1000.0).astype(np.int64), truth.x, truth.y, truth.heading)
