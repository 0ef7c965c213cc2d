"""Paths that can be laid side by side: of the simulation, of a camera's track, of the wheels' counters.

A path is a table of columns t_s, x_cm, y_cm, heading_deg (−180 < h ≤ 180): a row a step of 0.1 s, the
first one the start. Where the robot was not seen there is no pose: NaN, an empty field in its file.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from realitygap import whole
from realitygap.errors import StudyError
from realitygap.kernels.params import STEP_S
from realitygap.kernels.params import Path as Ground
from realitygap.values import Pose, Trajectory

if TYPE_CHECKING:
    from realitygap.film.track import Track
    from realitygap.tasks.task import Task
    from realitygap.world.profile import Profile

__all__ = [
    "COLUMNS",
    "Table",
    "lost_steps",
    "of_counters",
    "of_track",
    "of_trajectory",
    "read_path",
    "score",
    "write_path",
]

Floats = NDArray[np.float64]
Table = dict[str, Floats]

COLUMNS = ("t_s", "x_cm", "y_cm", "heading_deg")
TOUCH_CM = 0.1
"""A body nearer than this to something touches it: as exactly as a film shows."""

SAME_S = 0.001
APART_S = 0.25
"""Frames nearer than the one to a step show that step; farther apart than the other they show none."""

BRIDGED_STEPS = 5
"""A score goes straight across a gap of so many steps at most."""


def of_trajectory(trajectory: Trajectory) -> Table:
    """The path of a simulated trial."""
    one, end = trajectory, trajectory.end
    return _table(np.append(one.x, end.x), np.append(one.y, end.y), np.append(one.heading, end.heading))


def of_track(track: Track, steps: int, begin_s: float = 0.0) -> Table:
    """A camera's track at the times of the steps, from `begin_s` on: between the two frames about each.

    A step beside which the robot was lost, or nothing was filmed, is a gap: nothing is guessed.
    """
    found, t = track.found, track.t_s
    times = begin_s + np.arange(steps + 1) * STEP_S
    after = np.searchsorted(t, times - SAME_S)
    last = np.minimum(after, len(t) - 1)
    before = np.where(np.abs(t[last] - times) <= SAME_S, last, after - 1)
    known = (after < len(t)) & (before >= 0) & found[last] & found[before] & (t[last] - t[before] <= APART_S)
    if not known.any():
        return _table(*np.full((3, steps + 1), np.nan))
    heading = np.unwrap(np.radians(track.heading_deg[found]))
    columns = (track.x_cm[found], track.y_cm[found], heading)
    return _table(*(np.where(known, np.interp(times, t[found], column), np.nan) for column in columns))


def lost_steps(path: Table) -> int:
    """How many of a path's rows have no pose."""
    return int(np.isnan(path["x_cm"]).sum())


def of_counters(counters: Floats, start: Pose, *, cm_per_pulse: float, axle_cm: float) -> Table:
    """The path that the wheels' counters [steps + 1, 2] tell, from a known start (odometry).

    A step's arc is driven at its mean heading; a row of NaN (nothing read) keeps the counters before.
    """
    pulses = counters.copy()
    for k in range(len(pulses)):
        if np.isnan(pulses[k]).any():
            pulses[k] = pulses[k - 1] if k else 0.0
    left, right = np.diff(pulses, axis=0).T * cm_per_pulse
    turn = (right - left) / axle_cm
    heading = start.heading + np.concatenate([[0.0], np.cumsum(turn)])
    mean = heading[:-1] + turn / 2.0
    chord = (left + right) / 2.0 * np.sinc(turn / (2.0 * np.pi))
    x = start.x + np.concatenate([[0.0], np.cumsum(chord * np.cos(mean))])
    y = start.y + np.concatenate([[0.0], np.cumsum(chord * np.sin(mean))])
    return _table(x, y, heading)


def score(path: Table, task: Task, profile: Profile) -> float:
    """The task's own score of a path: ground speeds from successive poses.

    It touches where its body is nearer than a millimetre to something. NaN if the robot was lost for
    more than half a second, or at the path's beginning or end.
    """
    bridged = _bridged(path)
    if bridged is None:
        return math.nan
    x, y, heading = bridged
    turn = np.diff(heading)
    mean = heading[:-1] + turn / 2.0
    along = np.diff(x) * np.cos(mean) + np.diff(y) * np.sin(mean)
    forward = along / (np.sinc(turn / (2.0 * np.pi)) * STEP_S)
    apart = turn * profile.wheels.track_cm / (2.0 * STEP_S)
    reach = profile.body.radius_cm + TOUCH_CM
    touches = [task.arena.obstacle_at(*place, reach) is not None for place in zip(x[1:], y[1:], strict=True)]
    ground = Ground(
        x=np.ascontiguousarray(x[1:]),
        y=np.ascontiguousarray(y[1:]),
        heading=np.ascontiguousarray(heading[1:]),
        left=forward - apart,
        right=forward + apart,
        contact=np.array(touches, np.float64),
    )
    return float(task.compiled_score()(ground, task.room(profile)))


def _bridged(path: Table) -> tuple[Floats, Floats, Floats] | None:
    """x, y and the unwrapped heading (rad) straight across short gaps; None where one is long."""
    known = ~np.isnan(path["x_cm"])
    rows = np.arange(len(known))
    there = rows[known]
    if not (len(there) and known[0] and known[-1]) or np.diff(there).max(initial=1) > BRIDGED_STEPS + 1:
        return None
    heading = np.unwrap(np.radians(path["heading_deg"][known]))
    x, y, turned = (np.interp(rows, there, c) for c in (path["x_cm"][known], path["y_cm"][known], heading))
    return x, y, turned


def write_path(file: Path, path: Table) -> None:
    """Write a path as CSV."""
    with whole.new(file) as spare, spare.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(COLUMNS)
        for t, *pose in zip(*(path[name].tolist() for name in COLUMNS), strict=True):
            rows.writerow((f"{t:.1f}", *("" if value != value else f"{value:.6f}" for value in pose)))


def read_path(file: Path) -> Table:
    """Read a path back.

    Raises:
        StudyError: it is not there, or no such table.
    """
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            head, *rows = csv.reader(stream)
        if tuple(head) != COLUMNS:
            raise ValueError
        filled = [[field or "nan" for field in row] for row in rows]
        columns = np.array(filled, np.float64).reshape(len(rows), len(COLUMNS)).T
    except (OSError, ValueError):
        cure = "Delete the trial's folder and make it again."
        raise StudyError(f"{file}: expected a path, columns {', '.join(COLUMNS)}. {cure}") from None
    return dict(zip(COLUMNS, columns, strict=True))


def _table(x: Any, y: Any, heading: Any) -> Table:
    degrees: Floats = 180.0 - (180.0 - np.degrees(heading)) % 360.0
    times: Floats = (np.arange(len(x), dtype=np.float64) * STEP_S).round(6)
    return {"t_s": times, "x_cm": x, "y_cm": y, "heading_deg": degrees}
