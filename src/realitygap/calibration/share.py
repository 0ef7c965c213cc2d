"""Calibration by a share of a robot's recorded places."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from realitygap.calibration.calibrate import Calibration, calibrate
from realitygap.calibration.recordings import Recording, SensorRecording
from realitygap.errors import CalibrationError
from realitygap.world.robot import Profile

__all__ = ["calibrate_share", "thinned"]


def thinned(recording: SensorRecording, share: float, seed: int) -> SensorRecording:
    """The recording with a share of its places, at least one, and none between them; a larger share contains
    a smaller one."""
    place = recording.place()
    drawn = np.random.default_rng(seed).permutation(place.max() + 1)
    rows = np.isin(place, drawn[: max(1, round(share * len(drawn)))])
    names = ("distance_cm", "bearing_deg", "repeat", "counts", "pose", "speed_cm_s")
    there = {name: column for name in names if (column := getattr(recording, name)) is not None}
    return replace(recording, edges=None, **{name: column[rows] for name, column in there.items()})


def calibrate_share(
    recordings: Sequence[Recording], base: Profile, *, share: float, seed: int, **how: Any
) -> Calibration:
    """A calibration by a share of the places; recordings of wheels are used whole.

    Recordings with too few readings left to fit are dropped, the last first; without any the base is
    returned.

    Args:
        recordings: of one kind, the most informative first.
        base: a profile.
        share: of the places of each, above 0.
        seed: of the choice of places.
        how: its form, and the rest, as of `calibrate`.
    """
    kept = [thinned(one, share, seed) if isinstance(one, SensorRecording) else one for one in recordings]
    for few in range(len(kept), 0, -1):
        try:
            return calibrate(kept[:few], base, beside=False, **how)
        except CalibrationError:
            continue
    return calibrate([], base, beside=False, **how)
