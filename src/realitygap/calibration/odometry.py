"""Odometry: poses seen from outside, predicted from the counters over whole runs.

One start pose for each piece of a run, and for all of them the wheels' centimetres per pulse, the track, the
marker's place and turn on the body, and how much later poses are stamped than counters. Summed over a run, a
noisy heading costs nothing: it is not an error of a regressor. For wheels without counters, commands replace
pulses, whose length is then the speed per unit.
"""

import math
import sys
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from realitygap.calibration.fit import SIGMAS
from realitygap.calibration.recordings import WheelRecording
from realitygap.errors import CalibrationError
from realitygap.values import Floats
from realitygap.world.robot import Constant, Profile

__all__ = ["Odometry", "measure_odometry", "measured_speeds"]

Without = Callable[[Collection[int]], WheelRecording]
KEYS = ("cm_per_pulse_left", "cm_per_pulse_right", "track_cm", "marker_ahead_cm", "marker_left_cm",
        "marker_turn_deg", "poses_late_s")  # fmt: skip
PRIOR = np.diag(np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.3, 0.3]) ** -2)
"""Information of what is known in advance: shares of lengths and track; the marker, in tracks; rad; s."""
DETERMINED = np.array([0.05, 0.05, 0.05, 0.1, 0.1, 0.1, 0.2])
"""Largest deviation, in the same units, with which a constant counts as determined."""
LONG, SHORT = 800, 100
"""Rows of a piece at most: of the fit, and where a fit begins or pieces are few."""
ROBUST_AT = 3.0
"""Residuals beyond this many deviations count by their size (Huber): nearly all count as squares, so that
leaving pieces out gives honest intervals."""
STEPS, FURTHEST, ENOUGH = 50, 0.5, 1e-6
"""Steps of a fit at most, and the largest and smallest of them in the constants' scales."""
FEWEST, FEWEST_PIECES = 12, 8
"""Least number of pictures after a movement; and of pieces for the spread that leaving one out gives."""
FOLDS = 4
DISAGREE, FAR = 5.0, 0.03
"""Deviations, and share of the track, from which the halves of a recording disagree."""
APART, STEADY_STEPS, FEWEST_STEPS = 5, 10, 100
"""Steps between two pictures that are drawn; steps of constant command, without counters, before one that
measures slip; and number of single steps from which on they do."""
EVEN = 0.9
"""Share of steps that last a period from which on slip can be told from late time stamps."""
LEAP, SURE = 6.0, 2.0
"""Deviations from which a step's error is a leap; and those by which slip must differ from none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Odometry:
    """Lengths and slip.

    Attributes:
        cm_per_pulse: left and right; for wheels without counters their speeds per unit, cm/s.
        track_cm: between the wheels.
        slip: deviation of the distance of one step, relative; the base's where the poses do not determine it.
        place_cm, heading_deg: deviations of the poses from the fitted runs; NaN without headings.
        drift_deg_per_m: drift of the heading under equal commands.
        lengths: cm_per_pulse with its intervals.
        constants: all, with intervals.
        halves: the track by the first and by the second half of the trials, cm, where they disagree.
        theta: [7] constants as in KEYS, rad.
        held_out: how far off (cm, degrees; medians) the ends of runs are that were not fitted, see `ends`.
        by_base: the same by the base's constants.
        ways: [m, 2] distances by the encoders (cm), and the camera's excess over them, [m, 2].
    """

    cm_per_pulse: tuple[float, float]
    track_cm: float
    slip: float
    place_cm: float
    heading_deg: float
    drift_deg_per_m: float
    lengths: tuple[Constant, Constant]
    constants: tuple[Constant, ...]
    halves: tuple[float, float] | None
    theta: Floats = field(repr=False)
    held_out: tuple[float, float]
    by_base: tuple[float, float]
    ways: Floats = field(repr=False)
    beyond: Floats = field(repr=False)

    def ends(self, recording: WheelRecording) -> Floats:
        """[runs, 2] how far (cm, rad) from its last pose each run of a recording ends, predicted from its
        first pose and the counters."""
        return _ends(_Runs(recording, sys.maxsize), self.theta)


class _Runs:
    """The pictures of a recording, or of some of its trials, in pieces of at most so many rows."""

    def __init__(
        self, recording: WheelRecording, longest: int, trials: Collection[int] | None = None
    ) -> None:
        assert recording.pose is not None
        first = np.concatenate([[True], np.diff(recording.trial) != 0])
        pulses = np.diff(recording.counters, axis=0, prepend=recording.counters[:1])
        pulses[first] = 0.0
        between = np.where(first, 1000.0, np.diff(recording.t_s, prepend=0.0))
        self.t_s, self.rolled = np.cumsum(between), np.cumsum(pulses, axis=0)
        pose = recording.pose
        moved = np.diff(pose, axis=0)
        same = (moved[:, :2] == 0).all(axis=1) & ((moved[:, 2] == 0) | np.isnan(moved[:, 2]))
        same = np.concatenate([[False], same]) & ~first
        taken = np.maximum.accumulate(np.where(same, 0, np.arange(len(pose))))
        old = (self.rolled != self.rolled[taken]).any(axis=1)  # the picture from before the wheels turned
        good = np.isfinite(pose[:, :2]).all(axis=1) & ~old
        if trials is not None:
            good &= np.isin(recording.trial, list(trials))
        piece = np.zeros(len(pose), np.int64)
        for rows in recording.trials():
            parts = max(1, round(len(rows) / longest))
            piece[rows] = piece.max() + 1 + np.arange(len(rows)) * parts // len(rows)
        self.seen = np.flatnonzero(good)
        self.pose = pose[self.seen]
        _, self.first, self.piece = np.unique(piece[self.seen], return_index=True, return_inverse=True)
        self.count = len(self.first)

    def earlier(self, sums: Floats, by_s: float) -> Floats:
        """[n, 2] running sums so many seconds before each row."""
        return np.stack([np.interp(self.t_s - by_s, self.t_s, column) for column in sums.T], 1)

    def start(self, theta: Floats) -> Floats:
        """[pieces, 3] poses of the axle's middle at each piece's first picture, as seen there."""
        start = self.pose[self.first].copy()
        start[:, 2] -= theta[5]
        unseen = np.isnan(start[:, 2])
        start[unseen, 2] = 0.0
        if unseen.any():
            start[unseen, 2] = self._facing(theta, start)[unseen]
        start[:, :2] -= _turned(theta[3:5], start[:, 2])
        return start

    def _facing(self, theta: Floats, start: Floats) -> Floats:
        """[pieces] headings with which the first third of a piece's way goes where it is seen to go."""
        along = [np.zeros(0)] * self.count
        whole, ends = self.predicted(theta, start)[:, :2], np.append(self.first[1:], len(self.seen))
        for j, (a, b) in enumerate(zip(self.first, ends, strict=True)):
            way = np.cumsum(np.hypot(*np.diff(whole[a:b], axis=0, prepend=whole[a : a + 1]).T))
            part = slice(a, a + max(2, int(np.searchsorted(way, way[-1] / 3)) + 1))
            model, seen = (z - z.mean(axis=0) for z in (whole[part], self.pose[part, :2]))
            along[j] = np.arctan2(
                (model[:, 0] * seen[:, 1] - model[:, 1] * seen[:, 0]).sum(), (model * seen).sum()
            )
        return np.array(along)

    def predicted(self, theta: Floats, start: Floats) -> Floats:
        """[m, 3] poses of the marker at each picture, from the axle's at each piece's first."""
        rolled = self.earlier(self.rolled, theta[6]) * theta[:2]
        heading = (rolled[:, 1] - rolled[:, 0]) / theta[2]
        turn = np.diff(heading, prepend=heading[:1])
        chord = np.diff(rolled.mean(axis=1), prepend=rolled[:1].mean()) * np.sinc(turn / math.tau)
        mean = heading - turn / 2
        path = np.cumsum(np.stack([chord * np.cos(mean), chord * np.sin(mean), turn], 1), axis=0)[self.seen]
        at, path = start[self.piece], path - path[self.first][self.piece]
        ahead = at[:, 2] - heading[self.seen][self.first][self.piece]
        place = at[:, :2] + _turned(path[:, :2].T, ahead) + _turned(theta[3:5], at[:, 2] + path[:, 2])
        return np.column_stack([place, at[:, 2] + path[:, 2] + theta[5]])

    def off(self, theta: Floats, start: Floats) -> Floats:
        """[m, 3] predicted minus seen, cm and rad; 0 where no heading was seen."""
        off = self.predicted(theta, start) - self.pose
        off[:, 2] = np.nan_to_num(_within_half(off[:, 2]))
        return np.asarray(off)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Constants [7] as in KEYS (rad, s), deviations of place, place and heading [3], and each piece's weighed
    residuals and their derivatives by the constants [3m, 1 + 7], without what its start pose explains."""

    theta: Floats
    error: Floats
    pieces: Sequence[Floats]


def _fitted(runs: _Runs, known: Floats, theta: Floats) -> _Fit:
    """The robust least squares of all pieces (Gauss and Newton, start poses eliminated), the errors of place
    and heading estimated from what is left."""
    start, error = runs.start(theta), np.array([known[2], known[2], 1.0])
    scale = _scale(known)
    for _ in range(STEPS):
        pieces, back = _eliminated(runs, theta, start, error, scale)
        normal = np.sum([rows.T @ rows for rows in pieces], axis=0)
        slope = normal[1:, 0] + PRIOR @ ((theta - known) / scale)
        move = -np.linalg.solve(normal[1:, 1:] + PRIOR, slope)
        move *= min(1.0, FURTHEST / np.abs(move).max())
        theta, start = theta + move * scale, start - back @ [1.0, *move]
        left = np.abs(runs.off(theta, start))
        place = 1.4826 * np.median(np.hypot(*left[:, :2].T)) / 1.7456
        faced = left[np.isfinite(runs.pose[:, 2]), 2]
        heading = 1.4826 * np.median(faced) if len(faced) else 1.0
        error = np.maximum([place, place, heading], [1e-4, 1e-4, 1e-5])
        if np.abs(move).max() < ENOUGH:
            break
    return _Fit(theta, error, _eliminated(runs, theta, start, error, scale)[0])


def _eliminated(
    runs: _Runs, theta: Floats, start: Floats, error: Floats, scale: Floats
) -> tuple[list[Floats], Floats]:
    """A fit's pieces, and how far back each start pose moves [pieces, 3, 1 + 7] by the residuals and by the
    constants."""
    off = runs.off(theta, start)
    rows = [off / error]
    for i in range(7):
        moved = theta + np.where(np.arange(7) == i, 1e-6 * scale, 0.0)
        rows.append((runs.off(moved, start) - off) / 1e-6 / error)
    weight = np.sqrt(ROBUST_AT / np.maximum(np.abs(rows[0]), ROBUST_AT))
    columns = np.stack(rows, axis=2) * weight[:, :, None]
    from_start = runs.predicted(theta, start)[:, :2] - start[runs.piece, :2]
    own = np.broadcast_to(np.eye(3), (len(off), 3, 3)).copy()
    own[:, 0, 2], own[:, 1, 2] = -from_start[:, 1], from_start[:, 0]
    own *= (weight / error)[:, :, None]
    pieces, back = [], np.zeros((runs.count, 3, 8))
    for j, a in enumerate(runs.first):
        b = runs.first[j + 1] if j + 1 < runs.count else len(off)
        basis, part = own[a:b].reshape(-1, 3), columns[a:b].reshape(-1, 8)
        back[j] = np.linalg.lstsq(basis, part, rcond=None)[0]
        pieces.append(part - basis @ back[j])
    return pieces, back


def _left_out(pieces: Sequence[Floats]) -> tuple[Floats, Floats]:
    """[7] how far the constants move if only these pieces are fitted, and their deviations by leaving out
    each piece (jackknife), in the constants' scales; what no piece says is as uncertain as in advance."""
    squares = np.array([rows.T @ rows for rows in pieces])
    whole, n = squares.sum(axis=0), len(pieces)
    moved = [-np.linalg.solve((whole - one)[1:, 1:] + PRIOR, (whole - one)[1:, 0]) for one in squares]
    bread = np.linalg.inv(whole[1:, 1:] + PRIOR)
    spread = (n - 1) * np.var(moved, axis=0) + np.diag(bread @ PRIOR @ bread)
    return -bread @ whole[1:, 0], np.sqrt(spread)


def measure_odometry(
    recording: WheelRecording, base: Profile, without: Without | None = None
) -> Odometry | None:
    """Lengths and slip of a recording; None if a camera did not see enough of it. `without`: the recording as
    it was straightened without some trials, for the errors of runs held out.

    Raises:
        CalibrationError: the heading runs the other way round.
    """
    from scipy.stats import t

    if recording.pose is None or _pictures(recording) < FEWEST:
        return None
    length, track = 0.1 / recording.pulses_per_mm, base.wheels.track_cm
    known = np.array([length, length, track, 0.0, 0.0, 0.0, 0.0])
    short, runs = _Runs(recording, SHORT), _Runs(recording, LONG)
    near = _fitted(short, known, known)
    mirrored = _Runs(replace(recording, pose=recording.pose * (1.0, 1.0, -1.0)), SHORT)
    if _fitted(mirrored, known, known).error[1:].prod() < near.error[1:].prod() / 3:
        raise CalibrationError(
            f"{recording.source}: heading_deg runs the other way: counter-clockwise from the x axis is "
            "expected. Turn its sign round."
        )
    fit = _fitted(runs, known, near.theta)
    pieces = fit.pieces if runs.count >= FEWEST_PIECES else near.pieces
    deviation = (_left_out(pieces)[1] if len(pieces) > 1 else np.diag(PRIOR) ** -0.5) * _scale(known)
    size = float(t.ppf(0.975, max(len(pieces) - 1, 1))) * deviation
    sure = (deviation < DETERMINED * _scale(fit.theta)).tolist()
    left, right, between, *others = (
        Constant(key=key, value=value, low=value - half, high=value + half, told=told)
        for key, value, half, told in zip(KEYS, _shown(fit.theta), _shown(size), sure, strict=True)
    )
    lengths = left, right
    between = replace(between, low=max(between.low, 0.0))
    slip = _slip(recording, fit.theta, base.noise.wheel)
    _, ways, beyond = _segments(recording, fit.theta, APART)
    return Odometry(
        cm_per_pulse=(float(fit.theta[0]), float(fit.theta[1])), track_cm=float(fit.theta[2]),
        slip=slip.value, place_cm=float(fit.error[0]),
        heading_deg=math.degrees(fit.error[2]) if np.isfinite(recording.pose[:, 2]).any() else math.nan,
        drift_deg_per_m=_drift(recording, fit.theta), lengths=lengths,
        constants=(*(lengths if recording.counted else ()), between, *others, slip),
        halves=_halves(fit) if runs.count >= FEWEST_PIECES else None, theta=fit.theta,
        held_out=_held_out(recording, without or (lambda _: recording), known, fit.theta),
        by_base=_medians(_ends(_Runs(recording, sys.maxsize), known)), ways=ways, beyond=beyond,
    )  # fmt: skip


def _pictures(recording: WheelRecording) -> int:
    """How many pictures show another place of the counters than the one before."""
    runs = _Runs(recording, sys.maxsize)
    follows = np.diff(runs.piece) == 0
    return int((np.diff(runs.rolled[runs.seen], axis=0)[follows] != 0).any(axis=1).sum())


def _halves(fit: _Fit) -> tuple[float, float] | None:
    """The track by each half of the pieces alone, where they differ by more than chance explains."""
    middle = len(fit.pieces) // 2
    (one, a), (two, b) = (
        (moved[2], spread[2]) for moved, spread in map(_left_out, (fit.pieces[:middle], fit.pieces[middle:]))
    )
    if abs(one - two) < max(DISAGREE * math.hypot(a, b), FAR):
        return None
    return fit.theta[2] * (1 + one), fit.theta[2] * (1 + two)


def _ends(runs: _Runs, theta: Floats) -> Floats:
    """[pieces, 2] see `Odometry.ends`."""
    off = runs.off(theta, runs.start(theta))[np.append(runs.first[1:], len(runs.seen)) - 1]
    return np.stack([np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])], 1)


def _medians(ends: Floats) -> tuple[float, float]:
    place, heading = np.median(ends, axis=0)
    return float(place), math.degrees(heading)


def _held_out(
    recording: WheelRecording, without: Without, known: Floats, theta: Floats
) -> tuple[float, float]:
    """Ends of runs by constants fitted to the others; NaN of a single run."""
    trials, found = np.unique(recording.trial).tolist(), []
    for k in range(min(FOLDS, len(trials))):
        out = trials[k::FOLDS]
        seen = without(out)
        rest, left = _Runs(seen, LONG, set(trials).difference(out)), _Runs(seen, sys.maxsize, out)
        if rest.count and left.count:
            found.append(_ends(left, _fitted(rest, known, theta).theta))
    return _medians(np.concatenate(found)) if found else (math.nan, math.nan)


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
            way = _ways(recording.pose[:-1], recording.pose[1:], odometry.theta)
    out = np.full(recording.commands.shape, np.nan)
    whole = recording.periods()[:-1] * recording.period_s
    good = (np.diff(recording.trial) == 0) & (np.abs(step - whole) < 0.2 * recording.period_s)
    out[:-1][good] = way[good] / step[good, None] * np.array(lengths)
    return out


def _shown(theta: Floats) -> list[float]:
    """As in KEYS, degrees for radians."""
    return [*theta[:5].tolist(), math.degrees(theta[5]), float(theta[6])]


def _scale(theta: Floats) -> Floats:
    return np.array([theta[0], theta[1], theta[2], theta[2], theta[2], 1.0, 1.0])


def _turned(point: Floats, heading: Floats) -> Floats:
    """[n, 2] points of the body [2] or [2, n] as seen from outside."""
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([c * point[0] - s * point[1], s * point[0] + c * point[1]], 1)


def _within_half(angle: Floats) -> Floats:
    """From −π to π."""
    return np.asarray((angle + math.pi) % math.tau - math.pi)


def _ways(before: Floats, after: Floats, theta: Floats) -> Floats:
    """[m, 2] ways of both wheels from poses [m, 3] to later ones, by an arc; NaN where one is unknown."""
    begin, end = before[:, 2] - theta[5], after[:, 2] - theta[5]
    turn = _within_half(end - begin)
    mean = begin + turn / 2
    moved = after[:, :2] - _turned(theta[3:5], end) - before[:, :2] + _turned(theta[3:5], begin)
    ahead = (moved[:, 0] * np.cos(mean) + moved[:, 1] * np.sin(mean)) / np.sinc(turn / math.tau)
    aside = turn * theta[2] / 2
    return np.stack([ahead - aside, ahead + aside], 1)


def _segments(recording: WheelRecording, theta: Floats, apart: int) -> tuple[Floats, Floats, Floats]:
    """Of pictures so many steps apart, between which the wheels turned: their rows [m, 2], the ways by the
    counters [m, 2], and what they are seen to go further [m, 2]."""
    assert recording.pose is not None
    runs, pieces = _Runs(recording, sys.maxsize), []
    seen = runs.seen[np.isfinite(runs.pose[:, 2])]
    for rows in recording.trials():
        kept = rows[np.isin(rows, seen)]
        kept = kept[np.unique((kept - rows[0]) // apart, return_index=True)[1]]
        pieces.append(np.stack([kept[:-1], kept[1:]], 1))
    pairs = np.concatenate(pieces)
    a, b = pairs.T
    late_s = 0.0 if recording.from_commands else theta[6]
    rolled = runs.earlier(runs.rolled, late_s)
    ways = (rolled[b] - rolled[a]) * theta[:2]
    whole = runs.earlier(runs.rolled, _steps_late(recording, theta) * recording.period_s)
    moved = (np.abs(whole[b] - whole[a]) > 1e-6).any(axis=1)
    beyond = _ways(recording.pose[a], recording.pose[b], theta) - ways
    return pairs[moved], ways[moved], beyond[moved]


def _steps_late(recording: WheelRecording, theta: Floats) -> int:
    """By how many rows pictures are late; none without counters, where it is the wheels that follow late."""
    return 0 if recording.from_commands else round(theta[6] / recording.period_s)


def _slip(recording: WheelRecording, theta: Floats, known: float) -> Constant:
    """Relative deviation of a step's way, beside the camera's own error: error² = s²·way² + c². From single
    steady steps if they tell it, since slip over several is larger where it is correlated; over several where
    those tell less (a camera's errors that last or times that jitter are no slip); else as known."""
    within = np.diff(recording.trial) == 0
    off = np.abs(np.diff(recording.t_s)[within] - recording.period_s)
    even = bool((off < 0.2 * recording.period_s).mean() > EVEN)
    one, several = (_slip_over(recording, theta, apart) if even else None for apart in (1, APART))
    if one and several and one.low > several.high:
        one = None
    unknown = Constant(key="noise.wheel", value=known, low=0.0, high=max(known, 1.0), told=False)
    return one or several or unknown


def _slip_over(recording: WheelRecording, theta: Floats, apart: int) -> Constant | None:
    """From pictures so many steps apart, leaps left out; None where they do not tell it."""
    from scipy.optimize import nnls

    squares = np.cumsum(np.diff(recording.counters, axis=0, prepend=recording.counters[:1]) ** 2, axis=0)
    (a, b), _, beyond = (part.T for part in _segments(recording, theta, apart))
    use = b > a
    if apart == 1:
        steady = STEADY_STEPS if recording.from_commands else 1
        asked = np.maximum(b - 1 - _steps_late(recording, theta), 0)
        use = (b == a + 1) & (recording.since_change().min(axis=1)[asked] >= steady)
    if use.sum() < (FEWEST_STEPS if apart == 1 else FEWEST):
        return None
    terms = np.stack([((squares[b] - squares[a]) * theta[:2] ** 2)[use].ravel(), np.ones(2 * use.sum())], 1)
    left, found = beyond.T[use].ravel() ** 2, np.array([0.06**2, 0.1**2])
    for _ in range(20):
        likely = terms @ found
        near = left < LEAP**2 * likely
        rows = terms[near] / likely[near, None]
        found = np.maximum(nnls(rows, left[near] / likely[near])[0], (1e-8, 1e-6))
    deviation = math.sqrt(2.0 * np.linalg.inv(rows.T @ rows)[0, 0])  # a square's: √2 times itself
    if found[0] <= SURE * deviation:
        return None
    slip = math.sqrt(found[0])
    half = SIGMAS * deviation / slip / 2
    return Constant(key="noise.wheel", value=slip, low=slip - half, high=slip + half, told=apart == 1)


def _drift(recording: WheelRecording, theta: Floats) -> float:
    """Drift of the heading under equal commands, degrees a metre; NaN without any."""
    pairs, ways, beyond = _segments(recording, theta, 1)
    unequal = np.concatenate([[0], np.cumsum(recording.commands[:, 0] != recording.commands[:, 1])])
    begin, end = np.maximum(pairs - _steps_late(recording, theta), 0).T
    way = (ways + beyond)[unequal[end] == unequal[begin]]
    metres = np.abs(way.mean(axis=1)).sum() / 100.0
    turned = np.sign(way.mean(axis=1)) @ (way[:, 1] - way[:, 0]) / theta[2]
    return math.degrees(turned) / metres if metres > 0.2 else math.nan
