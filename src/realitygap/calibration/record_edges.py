"""Places between those of a grid: where a sensor's reading jumps from one bearing to the next, because a ray
just meets a thing or just misses it.

The gap is halved towards the jump, so a few places tell where rays end as exactly as a far denser grid.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.plan import Place
from realitygap.values import Floats

__all__ = ["FINE", "TWICE", "look_between"]

Read = Callable[[float], Floats]
"""The mean readings [S] at a bearing, degrees."""
Row = Sequence[str]


class Journal(Protocol):
    """The rows of the stops that are finished, by their keys."""

    done: dict[tuple[str, ...], Sequence[Row]]

    def add(self, rows: Sequence[Row]) -> None: ...


FINE = 120
"""Bearings of a grid from which on a jump can be told from a slope."""
TWICE = 2
"""Readings at a place between: enough to know on which side of a jump it is."""
HALVINGS = 7
"""From 2 degrees between bearings to a sixty-fourth of a degree."""
LEAST, SURE, STEEPER, KEPT = 0.02, 6.0, 2.0, 0.7
"""A jump is larger than this share of the full scale, than so many deviations of the noise, and than so many
times what is read on either side; and of it so much is found again in one half of the gap."""
PLACED = 3
"""Columns before the readings: distance, bearing, repeat."""


def look_between(
    grid: Journal, edges: Journal, at: Callable[[float, float], Place],
    read: Callable[[Place], Sequence[Row]], top: float, told: Callable[[int, int], None],
) -> int:  # fmt: skip
    """Read between the bearings of a finished grid, where readings jump; returns at how many places.

    Args:
        grid: its rows.
        edges: of the further places; those that it has are not read again.
        at: the place at a distance (cm) and a bearing.
        read: brings the robot there and returns its rows.
        top: the full scale, counts.
        told: called at first and after each jump with the number of those followed, and of all.
    """
    counts = {key: _counts(rows) for key, rows in grid.done.items()}
    noise = float(np.sqrt(np.median([there.var(axis=0, ddof=1).max() for there in counts.values()])))
    mean: dict[tuple[str, ...], Floats] = {key: there.mean(axis=0) for key, there in counts.items()}
    mean |= {key: _counts(rows).mean(axis=0) for key, rows in edges.done.items()}

    def reading(distance: float, bearing: float) -> Floats:
        place = at(distance, bearing)
        if place.key not in mean:
            made = read(place)
            edges.add(made)
            mean[place.key] = _counts(made).mean(axis=0)
        return np.asarray(mean[place.key])

    distances = sorted({float(distance) for distance, _ in grid.done})
    gap = 360.0 / (len(grid.done) // len(distances))
    found = []
    for distance in distances:
        there = partial(reading, distance)
        ring = np.array([there(k * gap) for k in range(round(360.0 / gap))])
        found += [(there, k * gap, sensors) for k, sensors in _jumps(ring, max(LEAST * top, SURE * noise))]
    told(0, len(found))
    for k, (there, bearing, sensors) in enumerate(found, 1):
        _halve(there, bearing, bearing + gap, sensors, HALVINGS)
        told(k, len(found))
    return len(edges.done)


def _counts(rows: Sequence[Row]) -> Floats:
    """[repeats, S] readings at a place."""
    return np.array([row[PLACED:] for row in rows], np.float64)


def _jumps(ring: Floats, least: float) -> list[tuple[int, NDArray[np.bool_]]]:
    """After which bearings readings [n, S] jump by more than `least`, and those of which sensors [S]."""
    step = np.abs(np.roll(ring, -1, axis=0) - ring)
    beside = np.maximum(np.roll(step, 1, axis=0), np.roll(step, -1, axis=0))
    jumps = (step > least) & (step > STEEPER * beside)
    return [(k, jumps[k]) for k in np.flatnonzero(jumps.any(axis=1)).tolist()]


def _halve(read: Read, low: float, high: float, sensors: NDArray[np.bool_], halvings: int) -> None:
    """Read in the middle of a gap in which sensors jump, and go on in the halves in which one still does."""
    middle = round((low + high) / 2.0, 3)  # as the table has it
    before, between, after = (read(bearing) for bearing in (low, middle, high))
    least = KEPT * np.abs(after - before)
    for ends, off in (((low, middle), between - before), ((middle, high), after - between)):
        still = sensors & (np.abs(off) > least)
        if halvings > 1 and still.any():
            _halve(read, *ends, still, halvings - 1)
