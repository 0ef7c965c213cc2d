"""Paths that can be laid side by side: of the simulation, of a film's track, of the wheels' counters.

A path is a table of columns t_s, x_cm, y_cm, heading_deg (−180 < h ≤ 180): a row a step of 0.1 s, the
first one the start.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import StudyError
from realitygap.kernels.params import STEP_S
from realitygap.kernels.params import Path as Ground
from realitygap.values import Pose, Trajectory

if TYPE_CHECKING:
    from realitygap.film.track import Track
    from realitygap.tasks.task import Task
    from realitygap.world.profile import Profile

__all__ = ["COLUMNS", "Table", "of_counters", "of_track", "of_trajectory", "read_path", "score", "write_path"]

Floats = NDArray[np.float64]
Table = dict[str, Floats]

COLUMNS = ("t_s", "x_cm", "y_cm", "heading_deg")
TOUCH_CM = 0.1
"""A body nearer than this to something touches it: as exactly as a film shows."""


def of_trajectory(trajectory: Trajectory) -> Table:
    """The path of a simulated trial."""
    one, end = trajectory, trajectory.end
    return _table(np.append(one.x, end.x), np.append(one.y, end.y), np.append(one.heading, end.heading))


def of_track(track: Track, steps: int) -> Table:
    """A film's track at the times of the steps; frames where the robot was lost are bridged."""
    found = track.found
    times = np.arange(steps + 1) * STEP_S
    heading = np.unwrap(np.radians(track.heading_deg[found]))
    columns = (track.x_cm[found], track.y_cm[found], heading)
    x, y, heading = (np.interp(times, track.t_s[found], column) for column in columns)
    return _table(x, y, heading)


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

    It touches where its body is nearer than a millimetre to something.
    """
    x, y = path["x_cm"], path["y_cm"]
    heading = np.unwrap(np.radians(path["heading_deg"]))
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


def write_path(file: Path, path: Table) -> None:
    """Write a path as CSV."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(COLUMNS)
        for t, *pose in zip(*(path[name].tolist() for name in COLUMNS), strict=True):
            rows.writerow((f"{t:.1f}", *(f"{value:.6f}" for value in pose)))


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
        columns = np.array(rows, np.float64).reshape(len(rows), len(COLUMNS)).T
    except (OSError, ValueError):
        cure = "Delete the trial's folder and make it again."
        raise StudyError(f"{file}: expected a path, columns {', '.join(COLUMNS)}. {cure}") from None
    return dict(zip(COLUMNS, columns, strict=True))


def _table(x: Any, y: Any, heading: Any) -> Table:
    degrees: Floats = 180.0 - (180.0 - np.degrees(heading)) % 360.0
    times: Floats = (np.arange(len(x), dtype=np.float64) * STEP_S).round(6)
    return {"t_s": times, "x_cm": x, "y_cm": y, "heading_deg": degrees}
