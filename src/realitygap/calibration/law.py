"""The law of command to speed: one constant, or a monotone curve for each wheel and direction (dead zone,
saturation), whichever errs less on runs that it was not fitted to.

Fitted to settled speeds: the mean over the second half of each hold of a wheel's command.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.fit import MARGIN
from realitygap.calibration.recordings import WheelRecording
from realitygap.values import Floats

__all__ = ["Law", "fit_law"]

SETTLED, FEWEST_ROWS = 5, 3
"""Steps after which a wheel has its speed; known speeds that a settled one is the mean of, at least."""
MOST_KNOTS = 40
"""In one direction; of more levels a curve has knots at quantiles."""
FOLDS = 4
FEWEST_TRIALS, ROWS = 10, 20
"""With fewer trials the rows are grouped by this many (2 s)."""
NEGLIGIBLE = 0.01
"""Share of the fastest settled speed by which a constant may err before a curve is thought of."""
REST, TOP, WELL_BELOW = 0.02, 0.98, 0.9
"""Shares of a wheel's top speed below which it rests, and above which it drives no faster; and of the largest
command, below which that is said."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Law:
    """What a recording says of commands and settled speeds.

    Attributes:
        curves: [K, 2] command, cm/s of the left and of the right wheel; none where one constant errs no more.
        constant, curve, chosen: RMS errors (cm/s) on runs not fitted; `chosen` chooses within each fold.
        holds: [h, 4] wheel, command, settled speed (cm/s), and the group of rows that stays together.
    """

    curves: tuple[Floats, ...]
    constant: float
    curve: float
    chosen: float
    holds: Floats = field(repr=False)

    def unit(self, top: float) -> Floats:
        """[2] cm/s a unit at the top command, the mean of both directions."""
        ends = [np.interp([-top, top], *curve.T) for curve in self.curves]
        return np.array([(ahead - back) / 2 / top for back, ahead in ends])

    def straight(self, commands: Floats, top: float) -> Floats:
        """[n, 2] commands of proportional wheels that settle at the same speeds."""
        settled = [np.interp(commands[:, w], *curve.T) for w, curve in enumerate(self.curves)]
        return np.stack(settled, axis=1) / self.unit(top)

    def told(self) -> str:
        """Its dead zone and its saturation in words."""
        rest, full = [], []
        for curve in self.curves:
            for side in (-1, 1):
                command, speed = np.abs(curve[side * curve[:, 0] >= 0].T)
                rest.append(command[speed <= REST * speed.max()].max())
                full.append(command[speed >= TOP * speed.max()].min())
        parts = [f"nothing up to {_span(rest)}"] if max(rest) > 0 else []
        ends = max(full) < WELL_BELOW * np.abs(self.holds[:, 1]).max()
        parts += [f"none more from {_span(full)} on"] if ends else []
        return " and ".join(parts) or "steeper here than there"


def _span(values: list[float]) -> str:
    low, high = f"{min(values):g}", f"{max(values):g}"
    return low if low == high else f"{low} to {high}"


def fit_law(recording: WheelRecording, measured: Floats, top: float) -> Law:
    """The law of a recording's commands and speeds [n, 2] (cm/s); curves reach the top command at least."""
    holds = _holds(recording, measured)
    reach = max(top, float(np.abs(recording.commands).max()))
    errors = _held_out(holds, reach)
    inside = []
    for out in _folds(holds):
        rest = holds[~out]
        fitted = _curves(rest, reach) if _better(_held_out(rest, reach), rest) else None
        inside.append(_off(holds[out], rest, fitted))
    better = _better(errors, holds)
    constant, curve, chosen = (
        float(np.sqrt(np.mean(off**2))) if len(off) else np.nan
        for off in (*errors.T, np.concatenate([*inside, np.zeros(0)]))
    )
    curves = _curves(holds, reach) if better else ()
    return Law(curves=curves, constant=constant, curve=curve, chosen=chosen, holds=holds)


def groups(trial: NDArray[np.int64]) -> NDArray[np.int64]:
    """[n] numbers of rows with correlated errors: a trial's, or a piece's where trials are few."""
    numbers = np.unique(trial, return_inverse=True)[1]
    if int(numbers.max(initial=0)) + 1 < FEWEST_TRIALS:
        numbers = np.unique(numbers * len(trial) + np.arange(len(trial)) // ROWS, return_inverse=True)[1]
    return np.asarray(numbers)


def _holds(recording: WheelRecording, measured: Floats) -> Floats:
    """As `Law.holds`."""
    out, group, since = [], groups(recording.trial), recording.since_change()
    for w in range(2):
        starts = np.flatnonzero(since[:, w] == 0)
        for a, b in zip(starts, np.append(starts[1:], len(since)), strict=True):
            rows = measured[a + max(SETTLED, (b - a) // 2) : b, w]
            known = rows[np.isfinite(rows)]
            if len(known) >= FEWEST_ROWS and recording.commands[a, w] != 0:
                out.append((w, recording.commands[a, w], known.mean(), group[a]))
    return np.array(out).reshape(-1, 4)


def _folds(holds: Floats) -> list[NDArray[np.bool_]]:
    """Which holds are left out together, as long as the others say something of both wheels."""
    number = np.unique(holds[:, 3], return_inverse=True)[1]
    folds = [number % FOLDS == k for k in range(FOLDS)]
    return [out for out in folds if out.any() and len(np.unique(holds[~out, 0])) == 2]


def _off(holds: Floats, fitted_to: Floats, curves: tuple[Floats, ...] | None) -> Floats:
    """[h] errors on holds of curves, or of a constant for each wheel fitted to other holds, cm/s."""
    off = np.zeros(len(holds))
    for w in range(2):
        here, (_, command, speed, _) = holds[:, 0] == w, fitted_to[fitted_to[:, 0] == w].T
        asked = holds[here, 1]
        by = np.interp(asked, *curves[w].T) if curves else asked * (speed @ command) / (command @ command)
        off[here] = by - holds[here, 2]
    return off


def _held_out(holds: Floats, reach: float) -> Floats:
    """[h, 2] errors of a constant and of a curve, fitted to the other folds; none without others."""
    off = np.full((len(holds), 2), np.nan)
    for out in _folds(holds):
        rest = holds[~out]
        off[out] = np.stack([_off(holds[out], rest, one) for one in (None, _curves(rest, reach))], 1)
    return off if np.isfinite(off).all() else off[:0]


def _better(errors: Floats, holds: Floats) -> bool:
    """Whether a curve errs less, by MARGIN and by a standard error over groups, and a constant noticeably."""
    if not len(errors):
        return False
    constant, curve = errors.T**2
    gain = np.bincount(np.unique(holds[:, 3], return_inverse=True)[1], constant - curve)
    sure = gain.sum() > np.sqrt(len(gain)) * gain.std()
    matters = np.sqrt(constant.mean()) > NEGLIGIBLE * np.abs(holds[:, 2]).max()
    return bool(sure and matters and np.sqrt(constant.sum()) > MARGIN * np.sqrt(curve.sum()))


def _curves(holds: Floats, reach: float) -> tuple[Floats, ...]:
    """Of each wheel, [K, 2], from −reach or below to reach or above. At commands that one direction was never
    told, it does as all of them do together, in its proportion to them."""
    wheel, command, speed, _ = holds.T
    way = np.sign(command)
    level, speed = np.abs(command), way * speed
    every = _rising(level, speed, reach)
    made = []
    for w in range(2):
        knots = [(0.0, 0.0)]
        for side in (-1, 1):
            own = (wheel == w) & (way == side)
            common = np.interp(level[own], *every)
            share = speed[own] @ common / (common @ common) if common.any() else 1.0
            more = np.setdiff1d(level, level[own])
            told = np.append(speed[own], share * np.interp(more, *every))
            knot, settled = _rising(np.append(level[own], more), told, reach)
            knots += zip(side * knot[1:], side * settled[1:] + 0.0, strict=True)
        made.append(np.array(sorted(knots)))
    return tuple(made)


def _rising(level: Floats, speed: Floats, reach: float) -> tuple[Floats, Floats]:
    """Knots from 0 to reach or above and speeds there, by non-negative least squares of the rises between."""
    from scipy.optimize import nnls

    knot = np.unique(level)
    if len(knot) > MOST_KNOTS:
        knot = np.unique(np.quantile(level, np.linspace(0, 1, MOST_KNOTS)))
    below = np.append(0.0, knot[:-1])
    rises = nnls(np.clip((level[:, None] - below) / (knot - below), 0.0, 1.0), speed)[0]
    if knot[-1] < reach:  # goes on as it ends
        rises = np.append(rises, rises[-1] * (reach - knot[-1]) / (knot[-1] - below[-1]))
        knot = np.append(knot, reach)
    return np.append(0.0, knot), np.append(0.0, np.cumsum(rises))
