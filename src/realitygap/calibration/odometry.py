"""Odometry: poses seen from outside, predicted from the counters over whole runs.

One start pose for each piece of a run, and for all of them the wheels' centimetres per pulse, the track, the
marker's place and turn on the body, and how much later poses are stamped than counters. Summed over a run, a
noisy heading costs nothing: it is not an error of a regressor. For wheels without counters, commands replace
pulses, whose length is then the speed per unit.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from realitygap.calibration.fit import SIGMAS
from realitygap.calibration.recordings import WheelRecording
from realitygap.errors import CalibrationError
from realitygap.values import Floats
from realitygap.world.robot import Constant

__all__ = ["Odometry", "enough_pictures", "measure_odometry", "measured_speeds"]

KEYS = ("cm_per_pulse_left", "cm_per_pulse_right", "track_cm", "marker_ahead_cm", "marker_left_cm",
        "marker_turn_deg", "poses_late_s")  # fmt: skip
PRIOR = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.3, 0.3])
"""Deviations of what is known in advance: shares of lengths and track; the marker, in tracks; rad; s."""
TOLD = np.array([0.05, 0.05, 0.05, 0.1, 0.1, 0.1, 0.2])
"""Largest deviation, in the same units, with which a constant counts as determined."""
LONGEST_ROWS, SHORT_ROWS = 800, 100
"""Rows of a piece at most: of a fit, and where the errors' sizes are estimated."""
ROBUST_AT = 2.0
"""Residuals beyond this many deviations count less than their square (soft L1)."""
ROUNDS = 6
FEWEST, FEWEST_PIECES = 12, 8
"""Least number of pictures after a movement; and of pieces for the spread that leaving one out gives."""
LEAP, SURE = 6.0, 4.0
"""Deviations from which a step's error is a leap; and those by which slip must differ from none."""
FOLDS = 4
DISAGREE, FAR = 5.0, 0.03
"""Deviations, and share of the track, from which the halves of a recording disagree."""
MIRRORED = 0.35
"""Errors of the heading (rad) from which it is tried whether the heading runs the other way."""
APART, STEADY_STEPS, FEWEST_STEPS = 5, 10, 100
"""Steps between two pictures that are drawn; steps of constant command, without counters, before one that
measures slip; and number of single steps from which on they do."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Odometry:
    """Lengths and slip.

    Attributes:
        cm_per_pulse: left and right; for wheels without counters their speeds per unit, cm/s.
        track_cm: between the wheels.
        slip: deviation of the distance of one step, relative.
        place_cm, heading_deg: the poses' own errors.
        drift_deg_per_m: drift of the heading under equal commands.
        constants: with intervals.
        halves: the track by the first and by the second half of the trials, cm, where they disagree.
        theta: [7] constants as in KEYS, rad.
        unseen: how far off (cm, degrees; medians) the ends of runs are that were not fitted, see `ends`.
        unfitted: the same by the base's constants.
        ways: [m, 2] distances by the encoders (cm), and the camera's excess over them, [m, 2].
    """

    cm_per_pulse: tuple[float, float]
    track_cm: float
    slip: float
    place_cm: float
    heading_deg: float
    drift_deg_per_m: float
    constants: tuple[Constant, ...]
    halves: tuple[float, float] | None
    theta: Floats = field(repr=False)
    unseen: tuple[float, float]
    unfitted: tuple[float, float]
    ways: Floats = field(repr=False)
    beyond: Floats = field(repr=False)

    def ends(self, recording: WheelRecording) -> Floats:
        """[runs, 2] how far (cm, rad) from its last pose each run of a recording ends, predicted from its
        first pose and the counters."""
        return _ends(_Runs(recording, sys.maxsize), self.theta)


class _Runs:
    """A recording's pictures, in pieces of at most so many rows, of some trials."""

    def __init__(
        self, recording: WheelRecording, longest: int = LONGEST_ROWS, trials: Collection[int] | None = None
    ) -> None:
        assert recording.pose is not None
        self.t, self.counters, self.trial = recording.t_s, recording.counters, recording.trial
        self.first = np.concatenate([[True], np.diff(self.trial) != 0])
        pulses = self.pulses(0.0)
        pose = recording.pose.copy()
        again = np.concatenate([[False], (np.diff(pose, axis=0) == 0).all(axis=1)])
        pose[again & (np.abs(pulses).sum(axis=1) > 0)] = np.nan  # an old picture once more
        if trials is not None:
            pose[~np.isin(self.trial, list(trials))] = np.nan
        self.pose = pose
        self.piece = np.zeros(len(self.t), np.int64)
        count = 0
        for rows in recording.trials():
            parts = max(1, round(len(rows) / longest))
            self.piece[rows] = count + np.arange(len(rows)) * parts // len(rows)
            count += parts
        seen = np.flatnonzero(np.isfinite(pose).all(axis=1))
        used, self.index = np.unique(self.piece[seen], return_inverse=True)
        self.seen, self.count = seen, len(used)
        self.starts = seen[np.searchsorted(self.index, np.arange(self.count))]
        self.of_row = np.searchsorted(used, self.piece).clip(max=max(self.count - 1, 0))

    def pulses(self, late_s: float) -> Floats:
        """[n, 2] pulses in the step before each row, as of poses stamped so much too late."""
        counters = self.counters
        if late_s:
            counters = counters.copy()
            for a, b in pairwise([*np.flatnonzero(self.first), len(self.t)]):
                for w in range(2):
                    counters[a:b, w] = np.interp(self.t[a:b] - late_s, self.t[a:b], self.counters[a:b, w])
        pulses = np.concatenate([np.zeros((1, 2)), np.diff(counters, axis=0)])
        pulses[self.first] = 0.0
        return pulses

    def start(self, theta: Floats) -> Floats:
        """[pieces, 3] poses of the axle's middle at each piece's first picture, as seen there."""
        start = self.pose[self.starts].copy()
        start[:, 2] -= theta[5]
        start[:, :2] -= _turned(theta[3:5], start[:, 2])
        return start

    def axle(self, theta: Floats, start: Floats) -> Floats:
        """[n, 3] poses of the axle's middle, predicted from those at each piece's first picture."""
        ways = self.pulses(theta[6]) * theta[:2]
        turn, way = (ways[:, 1] - ways[:, 0]) / theta[2], ways.mean(axis=1)
        heading = np.cumsum(turn)
        chord, mean = way * np.sinc(turn / math.tau), heading - turn / 2
        x, y = np.cumsum(chord * np.cos(mean)), np.cumsum(chord * np.sin(mean))
        begin, at = self.starts[self.of_row], start[self.of_row]
        rotated = at[:, 2] - heading[begin]
        c, s, dx, dy = np.cos(rotated), np.sin(rotated), x - x[begin], y - y[begin]
        return np.stack([at[:, 0] + c * dx - s * dy, at[:, 1] + s * dx + c * dy, heading + rotated], 1)

    def off(self, theta: Floats, start: Floats) -> Floats:
        """[m, 3] predicted minus seen, cm and rad."""
        pose = self.axle(theta, start)[self.seen]
        pose[:, :2] += _turned(theta[3:5], pose[:, 2])
        pose[:, 2] += theta[5]
        off = pose - self.pose[self.seen]
        off[:, 2] = _within_half(off[:, 2])
        return np.asarray(off)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Constants [7] as in KEYS (rad, s), start poses, errors of place and heading [3], and derivatives of the
    weighed residuals by both [3m, 7 + 3 pieces], with the residuals."""

    theta: Floats
    start: Floats
    error: Floats
    columns: Floats
    residuals: Floats


def _fitted(runs: _Runs, known: Floats, theta: Floats) -> _Fit:
    """The least squares of all pieces, errors of place and heading estimated from what is left."""
    from scipy.optimize import least_squares

    scale = _scale(known)
    start, error = runs.start(theta), np.array([known[2], known[2], 1.0])
    rows, pieces = np.arange(len(runs.seen)), 7 + 3 * runs.index
    prior = np.concatenate([np.diag(1.0 / PRIOR), np.zeros((7, 3 * runs.count))], 1)
    for _ in range(ROUNDS):
        theta0, start0 = theta, start

        def unpacked(u: Floats) -> tuple[Floats, Floats]:
            moved = theta0 + u[:7] * scale  # noqa: B023
            return moved, start0 + u[7:].reshape(-1, 3)  # noqa: B023

        def residuals(u: Floats) -> Floats:
            moved, begun = unpacked(u)
            told = (moved - known) / scale / PRIOR
            return np.concatenate([(runs.off(moved, begun) / error).ravel(), told])  # noqa: B023

        def columns(u: Floats) -> Floats:
            moved, begun = unpacked(u)
            off, out = runs.off(moved, begun), np.zeros((len(rows), 3, 7 + 3 * runs.count))
            for i in range(7):
                step = np.where(np.arange(7) == i, 1e-6 * scale, 0.0)
                out[:, :, i] = (runs.off(moved + step, begun) - off) / 1e-6
            seen, at = off + runs.pose[runs.seen], begun[runs.index]
            out[rows, 0, pieces] = out[rows, 1, pieces + 1] = out[rows, 2, pieces + 2] = 1.0
            out[rows, 0, pieces + 2], out[rows, 1, pieces + 2] = at[:, 1] - seen[:, 1], seen[:, 0] - at[:, 0]
            out /= error[None, :, None]  # noqa: B023
            return np.concatenate([out.reshape(-1, 7 + 3 * runs.count), prior])

        found = least_squares(
            residuals, np.zeros(7 + 3 * runs.count), columns, loss="soft_l1", f_scale=ROBUST_AT, x_scale="jac"
        )
        theta, start = unpacked(found.x)
        left = 1.4826 * np.median(np.abs(runs.off(theta, start)), axis=0)
        place = math.hypot(left[0], left[1]) / math.sqrt(2)
        new = np.maximum([place, place, left[2]], [1e-4, 1e-4, 1e-5])
        if np.allclose(new, error, rtol=0.01):
            break
        error = new
    return _Fit(theta, start, error, columns(found.x), residuals(found.x))


def measure_odometry(recording: WheelRecording, track_cm: float) -> Odometry | None:
    """Lengths and slip of a recording; None if a camera did not see enough of it.

    Raises:
        CalibrationError: the heading runs the other way round.
    """
    if not enough_pictures(recording):
        return None
    length = 0.1 / recording.pulses_per_mm
    known = np.array([length, length, track_cm, 0.0, 0.0, 0.0, 0.0])
    runs = _Runs(recording, LONGEST_ROWS)
    fit = _fitted(runs, known, _begun(runs, known))
    if fit.error[2] > MIRRORED:
        _refuse_mirrored(recording, fit, known)
    short = _Runs(recording, SHORT_ROWS)
    near = _fitted(short, known, fit.theta)
    place, heading, slip = _errors(short, near)
    left_out = _left_out(short, near) if runs.count < FEWEST_PIECES else _left_out(runs, fit)
    deviation = np.maximum(_deviations(runs, fit, (place, heading, slip)), left_out)
    sure = (deviation < TOLD * _scale(fit.theta)).tolist()
    constants = tuple(
        Constant(key=key, value=value, low=value - SIGMAS * size, high=value + SIGMAS * size, told=told)
        for key, value, size, told in zip(KEYS, _shown(fit.theta), _shown(deviation), sure, strict=True)
        if recording.counted or not key.startswith("cm_per")
    )
    pairs = _steps(recording, fit.theta, APART)
    of_one_step = _slip(
        *_steps(recording, fit.theta, 1, steady=STEADY_STEPS if recording.from_commands else 1)
    )
    few = 1.0 / math.sqrt(2.0 * short.count)
    if of_one_step is not None:  # over more of them it is another, where it is correlated
        slip, few = of_one_step
    low, high = slip * (1 - SIGMAS * few), slip * (1 + SIGMAS * few)
    share = Constant(key="noise.wheel", value=slip, low=low, high=high, told=of_one_step is not None)
    return Odometry(
        cm_per_pulse=(float(fit.theta[0]), float(fit.theta[1])), track_cm=float(fit.theta[2]), slip=slip,
        place_cm=place, heading_deg=math.degrees(heading), drift_deg_per_m=_drift(recording, fit.theta),
        constants=(*constants, share), halves=_halves(runs, fit), theta=fit.theta,
        unseen=_unseen(recording, known, fit.theta),
        unfitted=_median(_ends(_Runs(recording, sys.maxsize), known)),
        ways=pairs[0], beyond=pairs[1],
    )  # fmt: skip


def _ends(runs: _Runs, theta: Floats) -> Floats:
    """[pieces, 2] see `Odometry.ends`."""
    off = runs.off(theta, runs.start(theta))
    last = np.searchsorted(runs.index, np.arange(runs.count), side="right") - 1
    return np.stack([np.hypot(off[last, 0], off[last, 1]), np.abs(off[last, 2])], 1)


def _median(ends: Floats) -> tuple[float, float]:
    place, heading = np.median(ends, axis=0)
    return float(place), math.degrees(heading)


def _unseen(recording: WheelRecording, known: Floats, theta: Floats) -> tuple[float, float]:
    """Ends of runs by constants fitted to the others; NaN of a single run."""
    trials = np.unique(recording.trial).tolist()
    found = [np.full((1, 2), math.nan)]
    for k in range(min(FOLDS, len(trials))):
        out = trials[k::FOLDS]
        rest = _Runs(recording, LONGEST_ROWS, set(trials).difference(out))
        left = _Runs(recording, sys.maxsize, out)
        if rest.count and left.count:
            found.append(_ends(left, _fitted(rest, known, theta).theta))
    return _median(np.concatenate(found[1:] or found))


def enough_pictures(recording: WheelRecording) -> bool:
    """Whether enough pictures followed a movement."""
    if recording.pose is None:
        return False
    seen, moved = np.asarray(np.isfinite(recording.pose).all(axis=1)), 0
    for rows in recording.trials():
        places = recording.counters[rows[seen[rows]]]
        moved += int((np.abs(np.diff(places, axis=0)).max(axis=1) > 0).sum()) if len(places) > 1 else 0
    return moved >= FEWEST


def measured_speeds(
    recording: WheelRecording, odometry: Odometry | None, cm_per_pulse: tuple[float, float]
) -> Floats:
    """[n, 2] mean speed of the wheels in the step after each row, cm/s; NaN where unknown.

    Without counters speeds come from the camera's poses; `cm_per_pulse` is of counters without odometry.
    """
    step, way = np.diff(recording.t_s), np.diff(recording.counters, axis=0)
    lengths = odometry.cm_per_pulse if odometry else cm_per_pulse
    if recording.from_commands:
        way, lengths = np.full_like(way, np.nan), (1.0, 1.0)
        if odometry is not None and recording.pose is not None:
            way = _ways(recording.pose, odometry.theta)
    out = np.full(recording.commands.shape, np.nan)
    good = (np.diff(recording.trial) == 0) & (np.abs(step - recording.period_s) < 0.2 * recording.period_s)
    out[:-1][good] = way[good] / step[good, None] * np.array(lengths)
    return out


def _begun(runs: _Runs, known: Floats) -> Floats:
    """Where a fit begins: lengths by the way between pictures some steps apart, the rest as known.

    The heading's noise shortens the track so found: this is a beginning only.
    """
    ways, pulses = [], []
    for rows in np.split(runs.seen, np.flatnonzero(np.diff(runs.index)) + 1):
        some = rows[::APART]
        pulses.append(np.diff(runs.counters[some], axis=0))
        ways.append(_ways(runs.pose[some], known))
    way, pulse = np.concatenate(ways), np.concatenate(pulses)
    size = (pulse**2).sum(axis=0)
    found = (way * pulse).sum(axis=0) / np.maximum(size, 1e-12)
    good = (size > 0) & (found > known[:2] / 4) & (found < known[:2] * 4)
    return np.concatenate([np.where(good, found, known[:2]), known[2:]])


def _refuse_mirrored(recording: WheelRecording, fit: _Fit, known: Floats) -> None:
    assert recording.pose is not None
    runs = _Runs(replace(recording, pose=recording.pose * (1.0, 1.0, -1.0)), LONGEST_ROWS)
    if _fitted(runs, known, _begun(runs, known)).error[2] < fit.error[2] / 3:
        raise CalibrationError(
            f"{recording.source}: heading_deg runs the other way: counter-clockwise from the x axis is "
            "expected. Turn its sign round."
        )


def _shown(theta: Floats) -> list[float]:
    """As in KEYS, degrees for radians."""
    return [*theta[:5].tolist(), math.degrees(theta[5]), float(theta[6])]


def _parts(runs: _Runs, fit: _Fit) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Of each piece, without its start pose: weighed derivatives [3m, 7] and residuals [3m], and the basis
    [3m, 3] of what was taken away."""
    each = np.repeat(runs.index, 3)
    for j in range(runs.count):
        rows = np.flatnonzero(each == j)
        basis = np.linalg.qr(fit.columns[rows][:, 7 + 3 * j : 10 + 3 * j])[0]
        columns, off = fit.columns[rows, :7], fit.residuals[rows]
        yield columns - basis @ (basis.T @ columns), off - basis @ (basis.T @ off), basis


def _left_out(runs: _Runs, fit: _Fit) -> Floats:
    """[7] deviations of the constants by leaving out each piece (jackknife)."""
    weight = (1.0 + (fit.residuals / ROBUST_AT) ** 2) ** -0.5
    each = np.repeat(runs.index, 3)
    whole = np.diag(PRIOR**-2.0)
    squares, slopes = [], []
    for j, (columns, off, _) in enumerate(_parts(runs, fit)):
        w = weight[: len(each)][each == j, None]
        squares.append((columns * w).T @ columns)
        slopes.append((columns * w).T @ off)
    whole = whole + np.sum(squares, axis=0)
    moved = np.array([np.linalg.solve(whole - a, b) for a, b in zip(squares, slopes, strict=True)])
    n = len(moved)
    return np.asarray(
        np.sqrt((n - 1) / n * ((moved - moved.mean(axis=0)) ** 2).sum(axis=0)) * _scale(fit.theta)
    )


def _halves(runs: _Runs, fit: _Fit) -> tuple[float, float] | None:
    """The track by each half of the pieces alone, where they differ by more than chance explains: by the
    slope of each half's squares at the fit (one step of Gauss and Newton), each with its own spread."""
    if runs.count < FEWEST_PIECES:
        return None
    found, spread = [], []
    parts = list(_parts(runs, fit))
    for some in (parts[: len(parts) // 2], parts[len(parts) // 2 :]):
        whole = np.diag(PRIOR**-2.0) + sum(columns.T @ columns for columns, _, _ in some)
        bread = np.linalg.inv(whole)
        moved = bread @ sum(columns.T @ off for columns, off, _ in some)
        slopes = np.array([columns.T @ (off - columns @ moved) for columns, off, _ in some])
        found.append(fit.theta[2] * (1.0 - moved[2]))
        spread.append((bread @ slopes.T @ slopes @ bread)[2, 2])
    apart = abs(found[1] - found[0])
    sure = apart > DISAGREE * math.sqrt(sum(spread)) * fit.theta[2] and apart > FAR * fit.theta[2]
    return (float(found[0]), float(found[1])) if sure else None


def _scale(theta: Floats) -> Floats:
    return np.array([theta[0], theta[1], theta[2], theta[2], theta[2], 1.0, 1.0])


def _slips(runs: _Runs, fit: _Fit) -> Iterator[Floats]:
    """Of each piece how its weighed residuals [3m, 2 steps] move when a wheel goes one step's way too far."""
    axle, ways = runs.axle(fit.theta, fit.start), runs.pulses(fit.theta[6]) * fit.theta[:2]
    heading = axle[:, 2] - (ways[:, 1] - ways[:, 0]) / fit.theta[2] / 2
    marker = axle[:, :2] + _turned(fit.theta[3:5], axle[:, 2])
    for j in range(runs.count):
        seen = runs.seen[runs.index == j]
        rows = np.arange(seen[0] + 1, seen[-1] + 1)
        after, out = seen[:, None] >= rows, []
        for w, sign in ((0, -1.0), (1, 1.0)):
            way, turn = ways[rows, w] / 2, sign * ways[rows, w] / fit.theta[2]
            x = np.cos(heading[rows]) * way - (marker[seen, 1][:, None] - axle[rows, 1]) * turn
            y = np.sin(heading[rows]) * way + (marker[seen, 0][:, None] - axle[rows, 0]) * turn
            out.append(np.stack([x, y, np.broadcast_to(turn, x.shape)], 1) * after[:, None])
        moved = np.concatenate(out, axis=2) / fit.error[None, :, None]
        yield moved.reshape(3 * len(seen), -1)


def _errors(runs: _Runs, fit: _Fit) -> tuple[float, float, float]:
    """Errors of place (cm) and heading (rad), and slip, by the squares that are left in each piece."""
    from scipy.optimize import nnls

    rows, squares = [], []
    for (_, off, basis), moved in zip(_parts(runs, fit), _slips(runs, fit), strict=True):
        moved = moved - basis @ (basis.T @ moved)
        free, of_heading = 1.0 - (basis**2).sum(axis=1), np.arange(len(off)) % 3 == 2
        for some, unit in ((~of_heading, (1.0, 0.0)), (of_heading, (0.0, 1.0))):
            rows.append([*(np.array(unit) * free[some].sum()), (moved[some] ** 2).sum()])
            squares.append((off[some] ** 2).sum())
    known, left = np.array(rows), np.array(squares)
    found = np.ones(3)
    for _ in range(10):
        weight = 1.0 / np.maximum(known @ found, 1e-9)
        found = nnls(known * weight[:, None], left * weight)[0]
    place, heading, slip = np.sqrt(found)
    return float(place * fit.error[0]), float(heading * fit.error[2]), float(slip)


def _deviations(runs: _Runs, fit: _Fit, errors: tuple[float, float, float]) -> Floats:
    """[7] deviations of the constants if places, headings and steps err by so much."""
    place, heading, slip = np.array(errors) / (fit.error[0], fit.error[2], 1.0)
    size, whole, inner = np.array([place, place, heading]), np.diag(PRIOR**-2.0), np.zeros((7, 7))
    for (columns, _, _), moved in zip(_parts(runs, fit), _slips(runs, fit), strict=True):
        whole = whole + columns.T @ columns
        own, drift = columns * np.tile(size, len(columns) // 3)[:, None], slip * columns.T @ moved
        inner += own.T @ own + drift @ drift.T
    bread = np.linalg.inv(whole)
    return np.asarray(np.sqrt(np.diag(bread @ (inner + np.diag(PRIOR**-2.0)) @ bread)) * _scale(fit.theta))


def _turned(point: Floats, heading: Floats) -> Floats:
    """[n, 2] a point of the body as seen from outside."""
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([c * point[0] - s * point[1], s * point[0] + c * point[1]], 1)


def _within_half(angle: Floats) -> Floats:
    """From −π to π."""
    return np.asarray((angle + math.pi) % math.tau - math.pi)


def _ways(pose: Floats, theta: Floats) -> Floats:
    """[m, 2] ways of both wheels from each pose to the next, by an arc; NaN where one is unknown."""
    heading = pose[:, 2] - theta[5]
    x, y = (pose[:, :2] - _turned(theta[3:5], heading)).T
    turn = _within_half(np.diff(heading))
    mean = heading[:-1] + turn / 2
    ahead = (np.diff(x) * np.cos(mean) + np.diff(y) * np.sin(mean)) / np.sinc(turn / math.tau)
    aside = turn * theta[2] / 2
    return np.stack([ahead - aside, ahead + aside], 1)


def _steps(recording: WheelRecording, theta: Floats, apart: int, *, steady: int = 0) -> tuple[Floats, Floats]:
    """[m, 2] ways by the counters between pictures so many steps apart, and what they are seen to go further;
    where commands are to have been constant for some steps before, only those."""
    assert recording.pose is not None
    counted, beyond = [], []
    for rows in recording.trials():
        seen = rows[np.isfinite(recording.pose[rows]).all(axis=1)][:: 1 if steady else apart]
        way = np.diff(recording.counters[seen], axis=0) * theta[:2]
        use = np.abs(way).max(axis=1, initial=0.0) > 0
        for k in np.flatnonzero(use & (steady > 0)):
            a, b = seen[k], seen[k + 1]
            before = recording.commands[max(a - steady, rows[0]) : b]
            use[k] = b == a + 1 and a - rows[0] >= steady and (before == before[0]).all()
        counted.append(way[use])
        beyond.append((_ways(recording.pose[seen], theta) - way)[use])
    return np.concatenate(counted), np.concatenate(beyond)


def _slip(ways: Floats, beyond: Floats) -> tuple[float, float] | None:
    """Relative deviation of a step's way, beside the camera's own: error² = s²·way² + c²; and the relative
    deviation of that; leaps left out. None of few steps, or where the camera's errors hide it."""
    from scipy.optimize import nnls

    if len(ways) < FEWEST_STEPS:
        return None
    squares, found = np.stack([ways.ravel() ** 2, np.ones(ways.size)], 1), np.array([0.06**2, 0.1**2])
    left = beyond.ravel() ** 2
    for _ in range(20):
        likely = squares @ found
        use = left < LEAP**2 * likely
        rows = squares[use] / likely[use, None]
        found = np.maximum(nnls(rows, left[use] / likely[use])[0], (1e-8, 1e-6))
    deviation = math.sqrt(
        2.0 * np.linalg.inv(rows.T @ rows)[0, 0]
    )  # a square of a normal error has twice its own
    return (math.sqrt(found[0]), deviation / found[0] / 2) if found[0] > SURE * deviation else None


def _drift(recording: WheelRecording, theta: Floats) -> float:
    """Drift of the heading under equal commands, degrees a metre; NaN without any."""
    assert recording.pose is not None
    turned = metres = 0.0
    for rows in recording.trials():
        seen = rows[np.isfinite(recording.pose[rows]).all(axis=1)]
        way = _ways(recording.pose[seen], theta)
        for k, (a, b) in enumerate(pairwise(seen)):
            if (recording.commands[a:b, 0] == recording.commands[a:b, 1]).all():
                ahead = way[k].mean()
                metres += abs(ahead) / 100.0
                turned += math.copysign(1.0, ahead) * (way[k, 1] - way[k, 0]) / theta[2]
    return math.degrees(turned) / metres if metres > 0.2 else math.nan
