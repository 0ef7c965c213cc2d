"""Odometry from a camera: centimetres per pulse, the track, and slip.

For wheels without counters, settled commands replace pulses, whose length is then the speed per unit. With
the track, pictures of each step give the wheels' speeds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.fit import SIGMAS
from realitygap.calibration.recordings import WheelRecording
from realitygap.values import Floats
from realitygap.world.robot import Constant

SLIP, CAMERA_CM, WILD = 0.06, 0.1, 6.0
"""Initial values of slip and of the camera's error; deviations beyond which a segment is an outlier."""
APART = 5
"""Steps between two pictures used for lengths: far enough for the camera's error to matter little."""
FEWEST_STEPS = 100
"""Number of single steps of steady driving from which on slip is estimated from them."""
SETTLED_STEPS, STEADY_STEPS = 4, 10
"""Steps of constant command before two pictures after which wheels without counters have turned as commanded
between them, driving or standing; a single step measures slip after the second number."""
FEWEST = 12
"""Least number of segments between two pictures."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Odometry:
    """Lengths and slip.

    Attributes:
        cm_per_pulse: left and right; for wheels without counters their speeds per unit, cm/s.
        track_cm: between the wheels.
        slip: deviation of the distance of one step, relative (of several steps' sum where no camera saw each
            step).
        drift_deg_per_m: drift of the heading under equal commands.
        constants: with intervals.
        ways: [m, 2] distances by the encoders (cm), and the camera's excess over them, [m, 2].
    """

    cm_per_pulse: tuple[float, float]
    track_cm: float
    slip: float
    drift_deg_per_m: float
    constants: tuple[Constant, ...]
    ways: Floats = field(repr=False)
    beyond: Floats = field(repr=False)


class _Ways(NamedTuple):
    """Segments between two pictures: pulses [m, 2], sums of the steps' squares [m, 2], distance and turn by
    camera [m], whether both commands were equal [m], and whether it is one step of steady driving [m]."""

    pulses: Floats
    squares: Floats
    way: Floats
    turn: Floats
    straight: NDArray[np.bool_]
    steady: NDArray[np.bool_]

    def only(self, some: NDArray[np.bool_]) -> _Ways:
        return _Ways._make(part[some] for part in self)


def measured_speeds(
    recording: WheelRecording, odometry: Odometry | None, cm_per_pulse: tuple[float, float]
) -> Floats:
    """[n, 2] mean speed of the wheels in the step after each row, cm/s; NaN where unknown.

    Without counters speeds come from the camera's poses; `cm_per_pulse` is of counters without odometry.
    """
    step, way = np.diff(recording.t_s), np.diff(recording.counters, axis=0)
    lengths = odometry.cm_per_pulse if odometry else cm_per_pulse
    if recording.from_commands:
        way = np.full_like(way, np.nan)
        if odometry is not None and recording.pose is not None:
            turn, ahead = np.array([_moved(a, b, 0.0) for a, b in pairwise(recording.pose)]).T
            aside = turn * odometry.track_cm / 2
            way, lengths = np.stack([ahead - aside, ahead + aside], 1), (1.0, 1.0)
    out = np.full(recording.commands.shape, np.nan)
    good = (np.diff(recording.trial) == 0) & (np.abs(step - recording.period_s) < 0.2 * recording.period_s)
    out[:-1][good] = way[good] / step[good, None] * np.array(lengths)
    return out


def measure_odometry(recording: WheelRecording, track_cm: float) -> Odometry | None:
    """Lengths and slip of a recording; None if a camera did not see enough of it."""
    ways = _between_pictures(recording, track_cm, apart=APART)
    if ways is None:
        return None
    pulses_per_cm = 10.0 * recording.pulses_per_mm
    theta, spread = np.array([1.0, 1.0, pulses_per_cm * track_cm]) / pulses_per_cm, np.zeros((3, 3))
    beyond, slip, camera = _beyond(ways, theta), SLIP, CAMERA_CM
    for _ in range(5):
        squares = ways.squares * theta[:2] ** 2
        likely = slip**2 * squares + camera**2
        # A picture in which the disk was misdetected is not used.
        seen = np.asarray((np.abs(beyond) < WILD * np.sqrt(likely)).all(axis=1))
        if seen.sum() < FEWEST:
            return None
        theta, spread = _lengths(ways, np.where(seen[:, None], 1.0 / likely, 0.0))
        beyond = _beyond(ways, theta)
        slip, camera = _slip(beyond[seen], squares[seen])
    ways, beyond = ways.only(seen), beyond[seen]
    deviation = np.sqrt(np.diag(spread))
    few = 1.0 / math.sqrt(2.0 * beyond.size)
    told = _of_one_step(recording, theta)
    if told is not None:
        slip, few = told
    names = ("cm_per_pulse_left", "cm_per_pulse_right", "track_cm")
    constants = tuple(
        Constant(key=k, value=float(v), low=float(v - SIGMAS * d), high=float(v + SIGMAS * d))
        for k, v, d in zip(names, theta, deviation, strict=True)
        if recording.counted or k == names[2]
    )
    share = Constant(
        key="noise.wheel", value=slip, low=slip * (1 - SIGMAS * few), high=slip * (1 + SIGMAS * few),
        told=told is not None,
    )  # fmt: skip
    return Odometry(
        cm_per_pulse=(float(theta[0]), float(theta[1])), track_cm=float(theta[2]), slip=slip,
        drift_deg_per_m=_drift(ways), constants=(*constants, share), ways=ways.pulses * theta[:2],
        beyond=beyond,
    )  # fmt: skip


def enough_pictures(recording: WheelRecording, track_cm: float) -> bool:
    """Whether there are enough pictures for lengths."""
    return _between_pictures(recording, track_cm, apart=APART) is not None


def _of_one_step(recording: WheelRecording, theta: Floats) -> tuple[float, float] | None:
    """Slip over one step, and its relative deviation, from pictures of steady driving at every step; None
    without enough of them. Slip is correlated over some steps, so sums over many say little about one."""
    ways = _between_pictures(recording, float(theta[2]), apart=1)
    if ways is None or ways.steady.sum() < FEWEST_STEPS:
        return None
    ways = ways.only(ways.steady)
    beyond, squares = _beyond(ways, theta), ways.squares * theta[:2] ** 2
    slip, camera = SLIP, CAMERA_CM
    for _ in range(5):
        likely = slip**2 * squares + camera**2
        seen = np.asarray((np.abs(beyond) < WILD * np.sqrt(likely)).all(axis=1))
        slip, camera = _slip(beyond[seen], squares[seen])
    return slip, 1.0 / math.sqrt(2.0 * beyond[seen].size)


def _between_pictures(recording: WheelRecording, track_cm: float, *, apart: int) -> _Ways | None:
    """Segments between pictures at least `apart` steps apart; None if there are too few."""
    if recording.pose is None:
        return None
    found: list[tuple[Floats, Floats, float, float, bool, bool]] = []
    for rows in recording.trials():
        seen = _thinned(rows[np.isfinite(recording.pose[rows]).all(axis=1)], apart)
        for a, b in pairwise(seen):
            if recording.from_commands and not _alike(recording.commands[rows[0] : b], a - rows[0]):
                continue
            steps = np.diff(recording.counters[a : b + 1], axis=0)
            pulses = steps.sum(axis=0)
            if not np.abs(pulses).max() > 0:
                continue
            guess = (pulses[1] - pulses[0]) / (10.0 * recording.pulses_per_mm) / track_cm
            turn, way = _moved(recording.pose[a], recording.pose[b], guess)
            told = recording.commands[a:b]
            since = STEADY_STEPS if recording.from_commands else 1
            before = recording.commands[max(a - since, rows[0]) : b]
            steady = b == a + 1 and a - rows[0] >= since and bool((before == before[0]).all())
            same = bool((told[:, 0] == told[:, 1]).all())
            found.append((pulses, (steps**2).sum(axis=0), way, turn, same, steady))
    if len(found) < FEWEST:
        return None
    return _Ways._make(np.array(column) for column in zip(*found, strict=True))


def _moved(a: Floats, b: Floats, guess: float) -> tuple[float, float]:
    """Turn (rad), nearest to a guess, and signed length (cm) of the arc from one pose to another."""
    (x0, y0, h0), (x1, y1, h1) = a, b
    turn = guess + math.remainder(h1 - h0 - guess, math.tau)
    half = turn / 2
    mean = h0 + half
    chord = (x1 - x0) * math.cos(mean) + (y1 - y0) * math.sin(mean)
    return turn, chord * (half / math.sin(half) if abs(half) > 1e-6 else 1.0)


def _alike(commands: Floats, a: int) -> bool:
    """Whether commands were constant before row `a` of a trial (0: at rest) and the same at the end."""
    before, last = commands[max(a - SETTLED_STEPS, 0) : a], commands[-SETTLED_STEPS:]
    stood = a == 0 or (a >= SETTLED_STEPS and bool((before == before[0]).all()))
    return stood and len(last) == SETTLED_STEPS and bool((last == (before[0] if a else 0.0)).all())


def _thinned(rows: NDArray[np.int64], apart: int) -> list[int]:
    """Of rows with pictures the first, each that is far enough from the previous one, and the last."""
    kept: list[int] = []
    for row in rows.tolist():
        if not kept or row - kept[-1] >= apart:
            kept.append(row)
    if len(kept) > 1 and kept[-1] != rows[-1]:
        kept[-1] = int(rows[-1])
    return kept


def _lengths(ways: _Ways, weight: Floats) -> tuple[Floats, Floats]:
    """(cm per pulse left, right, track) by weighted least squares, and their covariance.

    A wheel's distance is way ∓ turn·track/2, and equals its pulses' length.
    """
    m = len(ways.way)
    rows = np.zeros((2 * m, 3))
    rows[:m, 0], rows[m:, 1] = ways.pulses[:, 0], ways.pulses[:, 1]
    rows[:m, 2], rows[m:, 2] = ways.turn / 2, -ways.turn / 2
    wanted = np.concatenate([ways.way, ways.way])
    root = np.sqrt(weight.T.ravel())
    theta = np.linalg.lstsq(rows * root[:, None], wanted * root, rcond=None)[0]
    off = (rows @ theta - wanted) * root
    inverse = np.linalg.pinv((rows * root[:, None]).T @ (rows * root[:, None]))
    return np.asarray(theta), np.asarray(inverse * float((off**2).sum() / max(2 * m - 3, 1)))


def _beyond(ways: _Ways, theta: Floats) -> Floats:
    """[m, 2] distance of each wheel beyond that of its pulses, cm."""
    seen = np.stack([ways.way - ways.turn * theta[2] / 2, ways.way + ways.turn * theta[2] / 2], 1)
    return np.asarray(seen - ways.pulses * theta[:2])


def _slip(beyond: Floats, squares: Floats) -> tuple[float, float]:
    """Relative deviation of a step's distance, and the camera's own (cm): error² = s²·Σd² + c²."""
    x, y = squares.ravel(), beyond.ravel() ** 2
    slip2, camera2 = 0.06**2, 0.05**2
    for _ in range(20):
        root = 1.0 / (slip2 * x + camera2)
        rows = np.stack([x, np.ones_like(x)], 1) * root[:, None]
        solved = np.linalg.lstsq(rows, y * root, rcond=None)[0]
        slip2, camera2 = max(float(solved[0]), 1e-8), max(float(solved[1]), 1e-6)
    return math.sqrt(slip2), math.sqrt(camera2)


def _drift(ways: _Ways) -> float:
    """Drift of the heading under equal commands, degrees a metre; NaN without any."""
    metres = np.abs(ways.way[ways.straight]).sum() / 100.0
    turned = (np.sign(ways.way) * ways.turn)[ways.straight].sum()
    return float(math.degrees(turned) / metres) if metres > 0.2 else math.nan
