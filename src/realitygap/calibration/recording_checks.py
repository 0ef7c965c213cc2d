"""What seems odd in a recording: units mixed up, sensors that look dead. Names file, line, sensor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import RecordingError

__all__ = ["check_readings", "check_steps"]

Array = NDArray[np.float64]

FULL = 1023
REACH_CM = 20.0
"""Twice the way that a Khepera's infrared goes: beyond it nothing reads as on a near object."""
BRIGHT = 300.0
ENOUGH = 12
"""Places from which on a sensor that always reads alike is thought to be dead."""
SATURATED_SHARE = 0.8


def check_readings(
    path: str | Path,
    lines: Sequence[int],
    *,
    kind: str,
    distance_cm: Array,
    bearing_deg: Array,
    counts: Array,
) -> tuple[str, ...]:
    """Warnings about sensor readings [n, S] at [n] distances and bearings in a file's lines.

    Raises:
        RecordingError: readings that no robot in centimetres and degrees can have had.
    """
    far = (distance_cm > REACH_CM) & (counts.max(axis=1) > BRIGHT)
    if kind == "infrared" and far.any():
        k = int(np.flatnonzero(far)[0])
        raise RecordingError(
            f"{path}, line {lines[k]}: distance_cm: {int(counts[k].max())} counts at {distance_cm[k]:g} cm, "
            "where infrared sees nothing. Are these millimetres? Divide them by 10."
        )
    warned = []
    turned = np.unique(np.abs(bearing_deg[np.isfinite(bearing_deg)]))
    if len(turned) >= ENOUGH and turned[-1] < 6.4 and (turned != np.rint(turned)).any():
        warned.append(f"{path}: bearing_deg never passes {turned[-1]:.2f}: are these radians?")
    if len(counts) >= ENOUGH:
        warned += _sensors(path, kind, counts)
    return tuple(warned)


def check_steps(commands: Array, counters: Array) -> tuple[str, ...]:
    """Warnings about wheels [n, 2]: a counter that stands although its wheel was driven."""
    out = []
    for side, name in enumerate(("left", "right")):
        driven = np.abs(commands[:, side]).max(initial=0.0) > 0
        if driven and np.ptp(counters[:, side]) == 0:
            out.append(f"counter_{name} never changes although the wheel was driven: it looks dead")
    return tuple(out)


def _sensors(path: str | Path, kind: str, counts: Array) -> list[str]:
    out = []
    for i, values in enumerate(counts.T):
        if np.ptp(values) == 0:
            out.append(f"{path}: sensor {i} reads {values[0]:g} everywhere: it looks dead")
        elif kind == "infrared" and (values >= FULL).mean() > SATURATED_SHARE:
            out.append(f"{path}: sensor {i} is saturated in {(values >= FULL).mean():.0%} of the readings")
        elif kind == "infrared" and np.percentile(values, 99) - np.percentile(values, 1) < 30:
            span = f"{values.min():g} to {values.max():g}"
            out.append(f"{path}: sensor {i} hardly changes ({span}): it looks dead")
    return out
