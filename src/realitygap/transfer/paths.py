"""Comparable tracks for scoring: from a camera or the wheels' counters, a row a step.

The first row is the start. Rows where the robot was not seen have no pose.
"""

import math
from collections.abc import Sequence

import numpy as np

from realitygap.kernels import trial as loop
from realitygap.kernels.types import STEP_S
from realitygap.kernels.types import Path as Ground
from realitygap.tasks.task import Task
from realitygap.track import Track, settled
from realitygap.values import Floats, Pose
from realitygap.world.robot import Profile

__all__ = ["of_counters", "of_poses", "of_track", "score"]

TOUCH_CM = 0.1
"""A body nearer than this to something touches it: the accuracy of a film."""

SAME_S = 0.001
APART_S = 0.25
"""A frame nearer than the first to a step shows that step; frames farther apart than the second show none."""

BRIDGED_STEPS = 5
"""A score interpolates a gap of this many steps at most."""


def of_track(track: Track, steps: int, begin_s: float = 0.0, *, period_s: float = STEP_S) -> Track:
    """A camera's track at the times of the steps, from `begin_s` on: interpolated between frames.

    A step next to which the robot was lost, or nothing was filmed, is a gap.

    Args:
        track: the camera's.
        steps: their number.
        begin_s: beginning of the first, in the track's time.
        period_s: of a step.
    """
    found, t = track.found, track.t
    times = begin_s + np.arange(steps + 1) * period_s
    after = np.searchsorted(t, times - SAME_S)
    last = np.minimum(after, len(t) - 1)
    before = np.where(np.abs(t[last] - times) <= SAME_S, last, after - 1)
    known = (after < len(t)) & (before >= 0) & found[last] & found[before] & (t[last] - t[before] <= APART_S)
    x, y, heading = np.full((3, steps + 1), np.nan)
    if known.any():
        seen = track.only(found)
        columns = (seen.x, seen.y, np.unwrap(settled(seen.heading)))
        x, y, heading = (np.where(known, np.interp(times, seen.t, column), np.nan) for column in columns)
    return Track(t=_times(steps + 1, period_s), x=x, y=y, heading=settled(heading), seen_by=track.seen_by)


def of_counters(
    counters: Floats,
    start: Pose,
    *,
    cm_per_pulse: tuple[float, float],
    axle_cm: float,
    period_s: float = STEP_S,
    t: Floats | None = None,
) -> Track:
    """The track from the wheels' counters [steps + 1, 2] and a known start (odometry).

    A step's arc is driven at its mean heading; a row of NaN (nothing read) keeps the counters before.

    Args:
        counters: pulses, NaN where nothing was read.
        start: where it began.
        cm_per_pulse: of the left and the right wheel.
        axle_cm: from wheel to wheel.
        period_s: of a step.
        t: [steps + 1] s, the time of each row; on time if None.
    """
    pulses = counters.copy()
    for k in range(len(pulses)):
        if np.isnan(pulses[k]).any():
            pulses[k] = pulses[k - 1] if k else 0.0
    if t is not None and _is_late(t, period_s):
        pulses = _on_time(pulses, t, period_s)
    left, right = np.diff(pulses, axis=0).T * np.array(cm_per_pulse)[:, None]
    turn = (right - left) / axle_cm
    heading = start.heading + np.concatenate([[0.0], np.cumsum(turn)])
    mean = heading[:-1] + turn / 2.0
    chord = (left + right) / 2.0 * np.sinc(turn / (2.0 * np.pi))
    x = start.x + np.concatenate([[0.0], np.cumsum(chord * np.cos(mean))])
    y = start.y + np.concatenate([[0.0], np.cumsum(chord * np.sin(mean))])
    return Track(t=_times(len(x), period_s), x=x, y=y, heading=settled(heading), seen_by="counters")


def of_poses(poses: Sequence[Pose], period_s: float = STEP_S, t: Floats | None = None) -> Track:
    """The track from poses reported by a robot, one a step, at `t` (s; on time if None)."""
    told = np.array([(one.x, one.y, one.heading) for one in poses], np.float64)
    if t is not None and _is_late(t, period_s):
        told = _on_time(np.column_stack([told[:, :2], np.unwrap(told[:, 2])]), t, period_s)
    x, y, heading = told.T
    return Track(t=_times(len(x), period_s), x=x, y=y, heading=settled(heading), seen_by="robot")


def _is_late(t: Floats, period_s: float) -> bool:
    """Whether rows read at `t` are of other moments than the steps'."""
    return bool(np.abs(t - t[0] - _times(len(t), period_s)).max() > SAME_S)


def _on_time(columns: Floats, t: Floats, period_s: float) -> Floats:
    """Columns [rows, n] read at `t`, interpolated to the times when the steps were due."""
    due = _times(len(t), period_s)
    return np.stack([np.interp(due, t - t[0], column) for column in columns.T], axis=1)


def score(path: Track, task: Task, profile: Profile) -> float:
    """The task's own score of a track: ground speeds from successive poses.

    It touches where its body is within a millimetre of something. NaN if the robot was lost for more than
    half a second, or at the beginning or end.
    """
    bridged = _bridged(path)
    if bridged is None:
        return math.nan
    x, y, heading = bridged
    turn = np.diff(heading)
    mean = heading[:-1] + turn / 2.0
    along = np.diff(x) * np.cos(mean) + np.diff(y) * np.sin(mean)
    forward = along / (np.sinc(turn / (2.0 * np.pi)) * profile.period_s)
    apart = turn * profile.wheels.track_cm / (2.0 * profile.period_s)
    grown, arena = profile.body.grown(TOUCH_CM), task.arena.to_kernel()
    robot = profile.to_kernel()._replace(radius=grown.radius_cm, outline=grown.edges())
    places = zip(x[1:], y[1:], heading[1:], strict=True)
    touches = [not loop.is_clear(robot, arena, *place) for place in places]
    ground = Ground(
        x=np.ascontiguousarray(x[1:]),
        y=np.ascontiguousarray(y[1:]),
        heading=np.ascontiguousarray(heading[1:]),
        left=forward - apart,
        right=forward + apart,
        contact=np.array(touches, np.float64),
    )
    return float(task.compiled_score()(ground, task.room(profile)))


def _bridged(path: Track) -> tuple[Floats, Floats, Floats] | None:
    """x, y and the unwrapped heading (rad), interpolated across short gaps; None if one is long."""
    known = path.found
    rows = np.arange(len(known))
    there = rows[known]
    if not (len(there) and known[0] and known[-1]) or np.diff(there).max(initial=1) > BRIDGED_STEPS + 1:
        return None
    columns = (path.x[known], path.y[known], np.unwrap(path.heading[known]))
    x, y, turned = (np.interp(rows, there, column) for column in columns)
    return x, y, turned


def _times(rows: int, period_s: float) -> Floats:
    return (np.arange(rows, dtype=np.float64) * period_s).round(6)
