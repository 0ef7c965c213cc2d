"""A trial prepared for comparison: the robot's poses at 10 Hz, from any source."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from realitygap.errors import TrackError
from realitygap.files import must_be
from realitygap.track import Track, Trajectory
from realitygap.values import Floats, shown

__all__ = [
    "RADIUS_CM", "SHORTEST_S", "SLOWEST_HZ", "STEP_S", "Trial", "require_trials", "resampled", "trial_of",
]  # fmt: skip

RADIUS_CM = 2.9
"""A Khepera's body (§3.1), as for the scale's exemplars."""
RATE_HZ = 10.0
"""Every track is resampled to the simulation's rate."""
STEP_S = 1.0 / RATE_HZ
SHORTEST_S = 2.0
"""Shorter tracks show too little behaviour to compare."""
LONGEST_GAP_S = 1.0
"""After a longer loss the robot may have done anything in between."""
FARTHEST_CM = 1e5
"""No robot is this far from its arena's corner: such a track is in other units."""
SLOWEST_HZ = 4.5
"""Tracks with fewer rows a second do not resolve turns."""
LARGEST_TURN = math.pi + 1e-6
"""From row to row, rad: an unwrapped heading's, but for rounding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """One trial at 10 Hz, arrays [n]; x and y in cm, heading in rad, unwrapped.

    Not a Track: it has neither times nor gaps, and a name to compare it with others row by row.

    Attributes:
        start: name of its start; trials of two sets with the same name and pose are a pair.
        unit: the robot unit, "" if unknown.
        radius_cm: of its body, a Khepera's if unknown.
        source: the file, for messages.
        bridged_s: time lost and interpolated.
        rate_hz: rows a second of its source, at most 10.
        doubt: a warning; "" for none.

    Raises:
        TrackError: arrays that are no trial: of several lengths, not finite, or a heading that is not in
            radians or not unwrapped; a radius that is not positive.
    """

    x: Floats
    y: Floats
    heading: Floats
    start: str = "1"
    unit: str = ""
    radius_cm: float = RADIUS_CM
    source: str = "track"
    bridged_s: float = 0.0
    rate_hz: float = RATE_HZ
    doubt: str = ""

    def __post_init__(self) -> None:
        try:
            rows = np.array((self.x, self.y, self.heading), np.float64)
        except (TypeError, ValueError):
            sizes = ", ".join(map(shown, (self.x, self.y, self.heading)))
            raise self._refused("x, y and heading as arrays [n] of one length", sizes) from None
        if rows.ndim != 2 or not rows.size:
            raise self._refused("x, y and heading as arrays [n], n at least 1", shown(self.x))
        if not np.isfinite(rows).all():
            cure = "resampled(track) bridges short losses."
            raise self._refused("finite numbers", "NaN or infinity", cure)
        turn = float(np.abs(rows[2, 1:] - rows[2, :-1]).max(initial=0.0))
        if turn > LARGEST_TURN:
            cure = "Unwrap it: np.unwrap(np.radians(degrees)), or np.unwrap(radians)."
            raise self._refused(
                "a heading in rad that turns by at most π from row to row", f"{turn:.3g}", cure
            )
        must_be(self.radius_cm, float | int, "radius_cm", "Give the body's, in cm.")
        if not 0 < self.radius_cm < math.inf:
            raise self._refused("a positive radius_cm", repr(self.radius_cm))
        for name, row in zip(("x", "y", "heading"), rows, strict=True):
            if not isinstance(getattr(self, name), np.ndarray):
                object.__setattr__(self, name, row)

    def _refused(self, expected: str, got: str, cure: str = "") -> TrackError:
        where = f"{self.source}, start {self.start}"
        return TrackError(f"{where}: expected {expected}, got {got}.{' ' + cure if cure else ''}")

    def __len__(self) -> int:
        return len(self.x)

    @property
    def seconds(self) -> float:
        """Time from the first row to the last."""
        return (len(self) - 1) * STEP_S

    def cut(self, seconds: float) -> Self:
        """Its first `seconds`."""
        n = round(seconds * RATE_HZ) + 1
        if n == len(self):
            return self
        return replace(self, x=self.x[:n], y=self.y[:n], heading=self.heading[:n])

    def pieces(self, count: int) -> list[Self]:
        """The trial cut into `count` pieces of one length."""
        n = len(self) // count
        return [
            replace(self, x=self.x[a : a + n], y=self.y[a : a + n], heading=self.heading[a : a + n],
                    start=f"{self.start}.{i + 1}")
            for i, a in enumerate(range(0, n * count, n))
        ]  # fmt: skip


def trial_of(
    trajectory: Trajectory, *, start: str = "1", unit: str = "", radius_cm: float = RADIUS_CM
) -> Trial:
    """A simulated trajectory as a trial, its last pose included; the other arguments as of `Trial`."""
    track = trajectory.track
    if len(track) > 1 and track.t[1] != STEP_S:
        return resampled(track, start=start, unit=unit, radius_cm=radius_cm)
    return Trial(
        x=track.x, y=track.y, heading=np.unwrap(track.heading), start=start, unit=unit,
        radius_cm=radius_cm, source=track.seen_by,
    )  # fmt: skip


def resampled(
    track: Track, *, start: str = "1", unit: str = "", source: str = "", radius_cm: float = RADIUS_CM
) -> Trial:
    """A track of any rate as a trial.

    Short losses are interpolated; rows before the robot was first and after it was last seen are dropped.

    Args:
        track: NaN where the robot was lost.
        start, unit, radius_cm: as of `Trial`.
        source: for messages, by default the track's source.

    Raises:
        TrackError: too short, too slow, lost for too long, or time that does not increase.
    """
    source = source or track.seen_by or "track"
    where = f"{source}, start {start}"
    rows = np.array([track.t, track.x, track.y, track.heading])
    if not np.isfinite(rows[0]).all() or np.isinf(rows).any():
        raise TrackError(f"{where}: expected finite numbers (empty or NaN where the robot was lost).")
    if (np.abs(rows[1:3]) > FARTHEST_CM).any():
        raise TrackError(f"{where}: expected x_cm and y_cm in cm, got {np.nanmax(np.abs(rows[1:3])):.3g}.")
    if (np.diff(rows[0]) <= 0).any():
        at = float(rows[0][int(np.argmax(np.diff(rows[0]) <= 0)) + 1])
        raise TrackError(
            f"{where}: expected t_s to grow from row to row, got {at:g} after a time as late. "
            "Separate trials by a column start."
        )
    rows = rows[:, np.isfinite(rows).all(axis=0)]
    t = rows[0]
    _require_seen(t, where)
    grid = t[0] + np.arange(math.floor((t[-1] - t[0]) * RATE_HZ + 1e-6) + 1) * STEP_S
    usual = float(np.median(np.diff(t)))
    gaps = np.diff(t)[np.diff(t) > 1.5 * usual]
    x, y, heading = (np.interp(grid, t, values) for values in (rows[1], rows[2], np.unwrap(rows[3])))
    return Trial(
        x=x, y=y, heading=np.unwrap(heading), start=start, unit=unit, radius_cm=radius_cm, source=source,
        bridged_s=float((gaps - usual).sum()), rate_hz=min(RATE_HZ, 1 / usual),
    )  # fmt: skip


def _require_seen(t: Floats, where: str) -> None:
    """Refuse tracks with too few rows."""
    seconds = float(t[-1] - t[0]) if len(t) > 1 else 0.0
    if seconds < SHORTEST_S - 1e-6:
        raise TrackError(
            f"{where}: expected at least {SHORTEST_S:g} s with the robot in sight, got {seconds:g} s. "
            "Leave this start out, or film longer."
        )
    steps = np.diff(t)
    usual = float(np.median(steps))
    if usual > 1 / SLOWEST_HZ:
        raise TrackError(
            f"{where}: expected at least 5 rows a second, got {1 / usual:.2g}. Turns would not show."
        )
    worst = int(np.argmax(steps))
    if steps[worst] > LONGEST_GAP_S + usual + 1e-6:
        raise TrackError(
            f"{where}: the robot is lost from {t[worst]:.2f} to {t[worst + 1]:.2f} s; at most "
            f"{LONGEST_GAP_S:g} s can be bridged. Leave this start out, or cut it there."
        )
    lost = float(steps[steps > 1.5 * usual].sum())
    if lost > seconds / 4:
        raise TrackError(
            f"{where}: the robot is lost for {lost:.1f} of {seconds:.1f} s; expected at most a quarter. "
            "Leave this start out."
        )


def require_trials(trials: object) -> None:
    """Refuse anything but a list of trials.

    Raises:
        UsageError: names what came.
    """
    must_be(trials, Sequence, "trials", "read_trials(path) reads them.")
    for one in trials:  # type: ignore[attr-defined]
        must_be(one, Trial, "trial", "read_trials(path) reads them.")
