"""What is used of a drive's log: runs end at gaps and jumps, and poses that were not measured anew go."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from realitygap.calibration.recordings import WheelRecording
from realitygap.logs.cuts import gaps, jumps, many, repeats

__all__ = ["cleaned", "first_pulses"]

BRIDGED = 10.0
"""Counters bridge a gap in which no wheel turned by more than so many fast steps."""
NAMED, PARTS = 3, 40
"""Cuts that are named; parts of the counters' range, whose ways are compared."""


def cleaned(recording: WheelRecording, at: Callable[[int], str]) -> WheelRecording:
    """A copy whose trials are cut at gaps of its clock and at jumps of its poses, without poses that repeat
    while it moved, or that are alone out of reach; a warning says how many. `at`: where a row stands."""
    t, trial, pose = recording.t_s, recording.trial, recording.pose
    counted = bool(np.isfinite(recording.counters).any())
    drive = np.nan_to_num(recording.counters if counted else recording.commands)
    turned = np.abs(np.diff(drive, axis=0, prepend=drive[:1]) if counted else drive).max(axis=1)
    cut = gaps(t, trial)
    if counted and not recording.from_speeds:  # which say how far it went meanwhile
        cut &= turned > BRIDGED * np.quantile(turned, 0.95)
    found = {"gap": cut}
    if pose is not None:
        again = repeats(np.nan_to_num(pose, nan=-1e9), turned > 0) & np.isfinite(pose[:, 0])
        jump, alone = jumps(t, np.where(again[:, None], np.nan, pose[:, :2]), trial)
        pose, cut = np.where((again | alone)[:, None], np.nan, pose), cut | jump
        found = {"repeated pose": again, "out-of-reach pose": alone, "jump": jump, **found}
    said = ", ".join(many(rows.sum(), noun) for noun, rows in found.items() if rows.any())
    if not said:
        return recording
    if cut.any():
        trial = np.cumsum(cut | (np.diff(trial, prepend=-1) != 0)) - 1
        where = ", ".join(at(k) for k in np.flatnonzero(cut)[:NAMED].tolist())
        said += f" (cut at {where}{' …' if cut.sum() > NAMED else ''}): {many(int(trial[-1]) + 1, 'piece')}"
    warning = f"{recording.source}: left out: {said}"
    return replace(recording, pose=pose, trial=trial, warnings=(*recording.warnings, warning))


def first_pulses(recording: WheelRecording) -> float:
    """Pulses per mm by how far poses and counters go, with which a fit can begin; NaN without poses."""
    if recording.pose is None:
        return math.nan
    seen = np.flatnonzero(np.isfinite(recording.pose[:, 0]))
    count = recording.counters.mean(axis=1)
    part = np.rint(count[seen] / max(np.ptp(count), 1e-9) * PARTS)
    at = seen[np.diff(part, prepend=math.inf) != 0]
    within = np.diff(recording.trial[at]) == 0
    way = np.hypot(*np.diff(recording.pose[at, :2], axis=0).T)[within].sum()
    pulses = np.abs(np.diff(count[at]))[within].sum()
    return float(pulses / way / 10) if way and pulses else math.nan
