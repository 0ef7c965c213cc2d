"""What is wrong with a log's times and places: gaps, poses that were not measured anew, jumps."""

import numpy as np
from numpy.typing import NDArray

from realitygap.values import Floats

__all__ = ["gaps", "jumps", "many", "repeats"]

GAP_S, GAP_STEPS = 1.0, 3.0
"""A step longer than both, seconds and usual steps, is a gap."""
FARTHER = 5.0
"""A place is out of reach that is so many times as fast as nearly all others, and as far off."""

Mask = NDArray[np.bool_]


def many(count: int, noun: str) -> str:
    """A count of things, in words."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def gaps(t: Floats, run: NDArray[np.int64]) -> Mask:
    """[n] the first row after each gap, of times that grow within a run."""
    step, within = np.diff(t), np.diff(run) == 0
    usual = float(np.median(step[within])) if within.any() else 0.0
    return np.append(False, within & (step > max(GAP_S, GAP_STEPS * usual)))


def repeats(pose: Floats, moved: Mask) -> Mask:
    """[n] rows whose pose [n, …] is that of the row before, to the bit, though the robot `moved` [n]."""
    return np.append(False, (np.diff(pose, axis=0) == 0).all(axis=1)) & moved


def jumps(t: Floats, place: Floats, run: NDArray[np.int64]) -> tuple[Mask, Mask]:
    """[n] each row whose place [n, 2], or NaN, is out of reach of the one seen before; and those that are
    alone there: the next is in reach of the one before."""
    cut, alone = np.zeros((2, len(t)), bool)
    seen = np.flatnonzero(np.isfinite(place).all(axis=1))
    seen = seen[~repeats(place[seen], np.full(len(seen), True))] if len(seen) else seen
    if len(seen) < 10:
        return cut, alone
    within = np.diff(run[seen]) == 0
    way, step = np.hypot(*np.diff(place[seen], axis=0).T), np.diff(t[seen])
    fast, far = (FARTHER * np.quantile(of[within], 0.9) for of in (way / step, way))

    def off(a: int, b: int) -> bool:
        length = float(np.hypot(*(place[b] - place[a])))
        return bool(run[a] == run[b] and length > far and length > fast * (t[b] - t[a]))

    last = seen[0]
    for k, after in zip(seen[1:], [*seen[2:], None], strict=True):
        if off(last, k):
            if after is not None and run[after] == run[last] and not off(last, after):
                alone[k] = True
                continue
            cut[k] = True
        last = k
    return cut, alone
