"""Static friction of the wheels (§3.2.2), from their delay at standing starts."""

from typing import NamedTuple

import numpy as np

from realitygap.calibration.recordings import WheelRecording
from realitygap.kernels.types import STEP_S
from realitygap.values import Floats

__all__ = ["Friction", "measure_friction"]

MOVING_SHARE = 0.1
"""A wheel has started when it exceeds this share of the commanded speed."""


class Friction(NamedTuple):
    """`|I|` that frees a resting wheel (cm/s²): between `low` and `high` by the standing starts."""

    value: float
    low: float
    high: float
    starts: int


def measure_friction(recording: WheelRecording, measured: Floats) -> Friction | None:
    """The range of thresholds that explains the wheels' delays at standing starts.

    A wheel that rests under a command of speed v adds v/0.1 s to I each step: if it starts in its
    n-th step, the threshold lies between n − 1 and n times that. `measured` are its speeds [n, 2], cm/s.
    """
    lows, highs = [], []
    for rows in recording.trials():
        for w in range(2):
            command, speed = recording.commands[rows, w], measured[rows, w]
            for k in np.flatnonzero((command != 0) & (np.concatenate([[0.0], command[:-1]]) == 0)):
                rested = k == 0 or (k >= 5 and np.all(command[k - 5 : k] == 0) and abs(speed[k - 1]) < 0.05)
                going = speed[k : k + 5]
                if not rested or len(going) < 5 or not np.all(command[k : k + 5] == command[k]):
                    continue
                final = abs(going[-1])
                moved = np.flatnonzero(np.abs(going) > MOVING_SHARE * max(final, 0.2))
                if final > 0.2 and len(moved):
                    lows.append(moved[0] * final / STEP_S)
                    highs.append((moved[0] + 1) * final / STEP_S)
    if not lows:
        return None
    low, high = float(np.quantile(lows, 0.75)), float(np.quantile(highs, 0.25))
    value = 0.0 if low == 0 else (low + high) / 2
    return Friction(value, min(low, high), max(low, high), len(lows))
