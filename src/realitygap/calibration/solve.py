"""Least squares with named constants, some of them one per sensor.

The Jacobian uses finite differences, all sensors of a constant at once, since a sensor's constant changes
only its own readings. Intervals are cluster-robust (White 1980; Liang and Zeger 1986), since neighbouring
places share the model's error and rows are not independent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.constants import blind_pairs, bounded, filling
from realitygap.values import Floats
from realitygap.world.robot import Constant

__all__ = ["ROBUST_AT", "Fit", "Free", "Measured", "Values", "solve", "value_of"]

Values = Mapping[str, Floats]
Model = Callable[[Values], Floats]

ROUNDS = 4
ROBUST_AT = 5.0
"""Residuals beyond this many noise deviations count less than their square (soft L1)."""


def value_of(values: Values, key: str) -> float:
    """The value of a constant that all sensors share; 0 where it is none of these."""
    return float(values[key][0]) if key in values else 0.0


@dataclass(frozen=True, kw_only=True)
class Free:
    """A free constant.

    Attributes:
        key: its name.
        start: [1], or [S] one per sensor.
        low, high: bounds.
        prior: deviation of a prior about `start`; None: no prior.
        tie: deviation of a prior on the mean over sensors, about its start; None: no prior.
        step: of the finite difference.
        jump: the first step of a random search (search.py), where readings jump; 0 where they do not.
    """

    key: str
    start: Floats
    low: float
    high: float
    prior: float | None = None
    tie: float | None = None
    step: float = 1e-4
    jump: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Fitted values by name, their intervals, and which constants cannot be separated."""

    values: dict[str, Floats]
    constants: tuple[Constant, ...]
    alike: tuple[tuple[str, str, float], ...]
    model: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """The readings that a model is fitted to.

    Attributes:
        counts: [n, S] readings.
        noise: deviation to weigh residuals by, counts.
        use: [n, S] readings to use.
        clusters: [n] equal numbers for places with correlated errors.
    """

    counts: Floats
    noise: float
    use: NDArray[np.bool_]
    clusters: NDArray[np.int64]


def solve(
    frees: Sequence[Free],
    model: Model,
    measured: Measured,
    *,
    start: Values | None = None,
    intervals: bool = True,
) -> Fit:
    """Fit `frees` so that model(values) [n, S] is near what was measured.

    Args:
        frees: the constants.
        model: their noise-free readings.
        measured: readings, and which of them to use.
        start: values to begin at instead of each constant's own.
        intervals: whether to estimate intervals.
    """
    packed = _Packed(frees, model, measured)
    theta = packed.pack({**{f.key: f.start for f in frees}, **(start or {})})
    low, high = packed.bounds
    inside = np.clip(theta, low + 1e-9 * (1 + np.abs(low)), high - 1e-9 * (1 + np.abs(high)))
    theta = _descend(packed, inside, measured.use, careful=intervals)
    values = packed.unpack(theta)
    constants: tuple[Constant, ...] = ()
    alike: tuple[tuple[str, str, float], ...] = ()
    if intervals:
        constants = packed.constants(theta, packed.covariance(theta, measured.clusters))
        alike = blind_pairs(packed.names(), packed.curvature(theta))
    return Fit(values=values, constants=constants, alike=alike, model=model(values))


def _descend(packed: _Packed, inside: Floats, use: NDArray[np.bool_], *, careful: bool) -> Floats:
    """The vector at which least squares end.

    Most rows depend on few constants or on none (0, saturated): readings that do not change are left out
    until they do. Soft L1 limits the weight of outliers.
    """
    from scipy.optimize import least_squares

    packed.use = packed.moving(inside)
    for _ in range(ROUNDS):
        found = least_squares(
            packed.residuals, inside, jac=packed.jacobian, bounds=packed.bounds, x_scale="jac",
            loss="soft_l1", f_scale=ROBUST_AT, xtol=1e-5 if careful else 1e-4, ftol=1e-6, gtol=1e-8,
            max_nfev=60 if careful else 25, tr_solver="lsmr",
            tr_options={"maxiter": 4 * len(inside), "atol": 1e-7, "btol": 1e-7},
        )  # fmt: skip
        inside, before = found.x, int(packed.use.sum())
        active, packed.use = packed.use, use
        packed.use = active | packed.moving(inside)
        if packed.use.sum() <= 1.005 * before:
            break
    packed.use = use
    return inside


class _Packed:
    """The constants as one vector, and its residuals."""

    def __init__(self, frees: Sequence[Free], model: Model, measured: Measured) -> None:
        self.model = model
        self.counts, self.noise, self.use = measured.counts, measured.noise, measured.use
        sizes = [len(f.start) for f in frees]
        ends = np.cumsum(sizes).tolist()
        self.parts = [(f, slice(end - size, end)) for f, size, end in zip(frees, sizes, ends, strict=True)]
        self.bounds = np.repeat([f.low for f in frees], sizes), np.repeat([f.high for f in frees], sizes)
        self._last: tuple[Floats, Floats] | None = None
        self._slopes: tuple[Floats, Floats] | None = None

    def pack(self, values: Values) -> Floats:
        whole = [np.broadcast_to(values[f.key], f.start.shape) for f, _ in self.parts]
        return np.concatenate(whole).astype(float)

    def unpack(self, theta: Floats) -> dict[str, Floats]:
        return {f.key: theta[where] for f, where in self.parts}

    def names(self) -> list[str]:
        sizes = [(f.key, len(f.start)) for f, _ in self.parts]
        return [key if size == 1 else f"{key}[{i}]" for key, size in sizes for i in range(size)]

    def readings(self, theta: Floats) -> Floats:
        if self._last is None or not np.array_equal(self._last[0], theta):
            self._last = theta.copy(), self.model(self.unpack(theta))
        return self._last[1]

    def residuals(self, theta: Floats) -> Floats:
        off = (self.readings(theta) - self.counts)[self.use] / self.noise
        return np.concatenate([off, *self._priors(theta)])

    def _priors(self, theta: Floats) -> list[Floats]:
        out = []
        for f, where in self.parts:
            off = theta[where] - f.start
            if f.prior is not None:
                out.append(off / f.prior)
            if f.tie is not None:
                out.append(np.array([off.mean() / f.tie]))
        return out

    def _columns(self, theta: Floats) -> Floats:
        """[n, S, constants] derivatives of the readings over the noise; the last ones are cached."""
        if self._slopes is None or not np.array_equal(self._slopes[0], theta):
            self._slopes = theta.copy(), self._differences(theta)
        return self._slopes[1]

    def _differences(self, theta: Floats) -> Floats:
        base = self.readings(theta)
        out = np.zeros((*base.shape, len(theta)))
        for f, where in self.parts:
            steps = np.where(theta[where] + f.step > f.high, -f.step, f.step)
            moved = theta.copy()
            moved[where] += steps
            change = (self.model(self.unpack(moved)) - base) / self.noise
            for k, step in enumerate(steps):
                own = slice(None) if len(steps) == 1 else k
                out[:, own, where.start + k] = change[:, own] / step
        return out

    def moving(self, theta: Floats) -> NDArray[np.bool_]:
        """[n, S] readings in use that any constant changes here."""
        return np.asarray(self.use & (self._columns(theta) != 0).any(axis=2)) | (
            self.use & (np.abs(self.readings(theta) - self.counts) > ROBUST_AT * self.noise)
        )

    def jacobian(self, theta: Floats) -> Any:
        from scipy.sparse import csr_matrix

        return csr_matrix(np.concatenate([self._columns(theta)[self.use], *self._prior_rows(len(theta))]))

    def _prior_rows(self, n: int, *, ties_only: bool = False) -> list[Floats]:
        rows = []
        for f, where in self.parts:
            if f.prior is not None and not ties_only:
                rows.append(np.eye(n)[where] / f.prior)
            if f.tie is not None:
                row = np.zeros((1, n))
                row[0, where] = 1.0 / (len(f.start) * f.tie)
                rows.append(row)
        return rows

    def curvature(self, theta: Floats) -> Floats:
        """JᵀJ of the data alone."""
        from scipy.sparse import csr_matrix

        rows = csr_matrix(self._columns(theta)[self.use])
        return np.asarray((rows.T @ rows).toarray())

    def covariance(self, theta: Floats, clusters: NDArray[np.int64]) -> Floats:
        """Sandwich covariance: bread from the Jacobian and the priors, meat from the clusters."""
        columns, off = self._columns(theta), (self.readings(theta) - self.counts) / self.noise
        scores = np.einsum("ns,nsp->np", np.where(self.use, off, 0.0), columns)
        held = np.concatenate([np.zeros((1, len(theta))), *self._prior_rows(len(theta))])
        bread = np.linalg.pinv(self.curvature(theta) + held.T @ held)
        return np.asarray(bread @ (filling(scores, clusters) + held.T @ held) @ bread)

    def constants(self, theta: Floats, covariance: Floats) -> tuple[Constant, ...]:
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        ties = np.concatenate([np.zeros((1, len(theta))), *self._prior_rows(len(theta), ties_only=True)])
        curvature = self.curvature(theta) + ties.T @ ties
        size = np.sqrt(np.maximum(np.diag(curvature), 1e-12))
        alone = np.sqrt(np.maximum(np.diag(np.linalg.pinv(curvature / np.outer(size, size))), 0.0)) / size
        low, high = self.bounds
        limits = np.concatenate([np.full(len(f.start), f.prior or np.inf) for f, _ in self.parts])
        span = 1e-6 * (high - low)
        # A constant that changes no reading (of a dead sensor, say) is unknown.
        moves = np.diag(self.curvature(theta)) > 0
        deviation = np.where(moves | np.isfinite(limits), deviation, np.inf)
        told = (theta > low + span) & (theta < high - span) & (alone < limits) & moves
        return bounded(self.names(), theta, deviation, low, high, told)
