"""Whether a track's heading agrees with its way: a robot with two wheels goes where it looks, or back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.trials import Trial
from realitygap.errors import TrackError

__all__ = ["agreement", "doubt_of_disk", "with_doubts"]

Floats = NDArray[np.float64]

MOVES_CM, ENOUGH_CM = 0.5, 20.0
"""Ways over two steps that show a direction, and how much of them says anything."""
CONTRADICTS, EXPLAINS, BETTER = 0.3, 0.9, 0.1
"""Agreement below which a heading is doubted; and another reading of it is believed that agrees so well, and
so much better. Of 132 tracks, simulated and filmed on the twin, the lowest agreement is 0.45 (a robot that
slid along walls), and no other reading that agrees so well was better at all."""
READINGS: dict[str, Callable[[Floats], Floats]] = {
    "is it in radians? Convert it to degrees": np.degrees,
    "does y run downwards, or heading_deg clockwise? Turn the sign of one of them": np.negative,
    "is heading_deg 0 where the robot looks along y? Subtract it from 90": lambda h: np.pi / 2 - h,
    "is heading_deg that of the axle? Turn it by 90": lambda h: h + np.pi / 2,
}
"""Mistakes by their cure, and the heading (rad) as it should have been read."""


def agreement(trials: Sequence[Trial]) -> tuple[float, float, str]:
    """How well headings agree with ways: 1 along them, −1 across.

    Returns:
        The agreement as it stands; that of the best other reading of the heading; and its cure.
    """
    as_is, way = _agreement(trials, np.asarray)
    if way < ENOUGH_CM:
        return 1.0, 0.0, ""
    cure, best = max(
        ((cure, _agreement(trials, other)[0]) for cure, other in READINGS.items()), key=lambda pair: pair[1]
    )
    return as_is, best, cure


def doubt_of_disk(trial: Trial) -> tuple[str, ...]:
    """What to ask where a tracker's own heading contradicts the way that it saw."""
    if agreement([trial])[0] >= CONTRADICTS:
        return ()
    return (
        f"{trial.source}: heading_deg contradicts the way from row to row: does the disk sit turned on the "
        "robot, or was the camera calibrated with other headings?",
    )


def with_doubts(trials: Sequence[Trial]) -> list[Trial]:
    """The trials of one file, with a word about a heading that seems wrong.

    Raises:
        TrackError: the heading contradicts the way, and another reading of it does not.
    """
    as_is, best, cure = agreement(trials)
    told = f"{trials[0].source}: heading_deg contradicts the way from row to row"
    if best > EXPLAINS and best > as_is + BETTER:
        raise TrackError(f"{told}: {cure}.")
    if as_is >= CONTRADICTS:
        return list(trials)
    return [replace(trial, doubt=f"{told}: is it the robot's, in degrees?") for trial in trials]


def _agreement(trials: Sequence[Trial], read: Callable[[Floats], Floats]) -> tuple[float, float]:
    """Mean cosine of twice the angle between heading and way, weighted by the way; and the way, cm."""
    total = way = 0.0
    for trial in trials:
        dx, dy = trial.x[2:] - trial.x[:-2], trial.y[2:] - trial.y[:-2]
        length = np.hypot(dx, dy)
        apart = np.arctan2(dy, dx) - read(trial.heading[1:-1])
        seen = length > MOVES_CM
        total += float((length * np.cos(2.0 * apart))[seen].sum())
        way += float(length[seen].sum())
    return total / max(way, 1e-9), way / 2.0
