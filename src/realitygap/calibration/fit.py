"""Bounded robust least squares over named parameters; held-out errors; and the choice between forms.

A form is a list of parameters, some of them one value per sensor, and a model from their values to
readings. Derivatives are differences, all sensors of a parameter at once, since a sensor's constant changes
only its own readings; steps are wide enough for readings in single precision. Intervals are cluster-robust
(White 1980; Liang and Zeger 1986), since neighbouring places share the model's error and rows are not
independent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.values import Floats
from realitygap.world.robot import Constant, Profile

Values = Mapping[str, Floats]
"""The values of parameters by name: [1], or [S] one per sensor."""
Model = Callable[[Values], Floats]
"""Noise-free readings [n, S] of values; infinite for values that no robot can have."""
Use = NDArray[np.bool_]
Tick = Callable[[], None]

AUTO = "auto"
MARGIN = 1.02
"""A form with more constants is taken only if its held-out error is smaller by this factor."""
ROBUST_AT = 5.0
"""Residuals beyond this many noise deviations count less than their square (soft L1)."""
SIGMAS = 1.96
"""Intervals hold 95 %."""
ALIKE, BLIND = 0.95, 1e-5
"""Correlation from which two constants count as inseparable."""
FORBIDDEN = 1e4
"""Residual, in noise deviations, of values that no robot can have."""
FEW = 3
SCAN = 17
"""Steps of a scan of directions."""
COMMON_EVERY, AFAR = 3, 0.5
"""Of the draws of a search every third changes what all sensors share; half of the others use the first step
size, to leave the neighbourhood of the best."""
WIDER, NARROWER, NARROWEST, WIDEST = 1.8, 0.94, 0.01, 4.0
"""A search's steps grow when a draw is better and shrink when it is not; the limits of their factor."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A free constant.

    Attributes:
        key: its name.
        start: [1], or [S] one per sensor.
        low, high: bounds.
        prior: deviation of a prior about `start`; None: no prior.
        tie: deviation of a prior on the mean over sensors, about its start; None: no prior.
        step: of the difference.
        jump: the first step of a random search, where readings jump; 0 where they do not.
    """

    key: str
    start: Floats
    low: float
    high: float
    prior: float | None = None
    tie: float | None = None
    step: float = 1e-3
    jump: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Observed:
    """The readings that a model is fitted to.

    Attributes:
        counts: [n, S] readings.
        noise: deviation to weigh residuals by, counts.
        use: [n, S] readings to use.
        clusters: [n] equal numbers for places with correlated errors.
    """

    counts: Floats
    noise: float
    use: Use
    clusters: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A fit.

    Attributes:
        values: by name.
        model: [n, S] the model's readings with them, also of rows that were not used.
        cost: half the robust sum of squares that was minimised.
        constants: values with their intervals; `told` is False where a bound or a prior decides.
        at_bounds: names of those that ended at a bound.
        alike: pairs that the data cannot separate, with their correlation.
    """

    values: dict[str, Floats]
    model: Floats
    cost: float = 0.0
    constants: tuple[Constant, ...] = ()
    at_bounds: tuple[str, ...] = ()
    alike: tuple[tuple[str, str, float], ...] = ()


def value_of(values: Values, key: str) -> float:
    """The value of a constant that all sensors share; 0 where it is none of these."""
    return float(values[key][0]) if key in values else 0.0


def fit(
    parameters: Sequence[Parameter],
    model: Model,
    data: Observed,
    *,
    start: Values | None = None,
    intervals: bool = True,
    steps: int = 60,
) -> Fit:
    """Fit `parameters` so that model(values) is near the readings in use.

    Args:
        parameters: the free constants.
        model: of all rows.
        data: readings, and which of them to use.
        start: values to begin at instead of each parameter's own; others than the parameters' are left out.
        intervals: whether to estimate intervals; without, the descent ends earlier.
        steps: at most.
    """
    from scipy.optimize import least_squares

    packed = _Packed(parameters, model, data)
    low, high = packed.bounds
    theta = packed.pack({**{p.key: p.start for p in parameters}, **(start or {})})
    inside = np.clip(theta, low + 1e-9 * (1 + np.abs(low)), high - 1e-9 * (1 + np.abs(high)))
    found = least_squares(
        packed.residuals, inside, jac=packed.jacobian, bounds=packed.bounds, x_scale="jac",
        loss="soft_l1", f_scale=ROBUST_AT, xtol=1e-5 if intervals else 1e-4, ftol=1e-6, gtol=1e-8,
        max_nfev=steps if intervals else min(steps, 25), **packed.solver,
    )  # fmt: skip
    values = packed.unpack(found.x)
    made = Fit(values=values, model=packed.readings(found.x), cost=float(found.cost))
    return packed.told(made, found.x) if intervals else made


class _Packed:
    """The parameters as one vector [p], its residuals and what its curvature tells."""

    def __init__(self, parameters: Sequence[Parameter], model: Model, data: Observed) -> None:
        self._model, self._data = model, data
        sizes = [len(p.start) for p in parameters]
        ends = np.cumsum(sizes).tolist()
        self._parts = [
            (p, slice(end - size, end)) for p, size, end in zip(parameters, sizes, ends, strict=True)
        ]
        self.bounds = (
            np.repeat([p.low for p in parameters], sizes),
            np.repeat([p.high for p in parameters], sizes),
        )
        self._prior_rows = [row for p, where in self._parts for row in _prior_rows(p, where, sum(sizes))]
        self._starts = self.pack({p.key: p.start for p in parameters})
        self._last: tuple[Floats, Floats] | None = None
        lsmr = {"maxiter": 4 * sum(sizes), "atol": 1e-7, "btol": 1e-7}
        few = sum(sizes) < FEW  # with which SciPy's iterative solver fails
        self.solver: dict[str, Any] = {} if few else {"tr_solver": "lsmr", "tr_options": lsmr}

    def pack(self, values: Values) -> Floats:
        whole = [np.broadcast_to(values[p.key], p.start.shape) for p, _ in self._parts]
        return np.concatenate(whole).astype(float)

    def unpack(self, theta: Floats) -> dict[str, Floats]:
        return {p.key: theta[where] for p, where in self._parts}

    def readings(self, theta: Floats) -> Floats:
        if self._last is None or not np.array_equal(self._last[0], theta):
            self._last = theta.copy(), self._model(self.unpack(theta))
        return self._last[1]

    def residuals(self, theta: Floats) -> Floats:
        off = (self.readings(theta) - self._data.counts)[self._data.use] / self._data.noise
        off[np.isinf(off)] = FORBIDDEN
        return np.concatenate([off, [float(row @ (theta - self._starts)) for row, _ in self._prior_rows]])

    def _columns(self, theta: Floats) -> Floats:
        """[n, S, p] derivatives of the readings over the noise."""
        base = self.readings(theta)
        out = np.zeros((*base.shape, len(theta)))
        for p, where in self._parts:
            ahead = np.where(theta[where] + p.step > p.high, -p.step, p.step)
            for steps in (ahead, -ahead):  # the side that a robot can have
                moved = theta.copy()
                moved[where] += steps
                read = self._model(self.unpack(moved))
                if not np.isinf(read).any():
                    break
            real = ~(np.isinf(read) | np.isinf(base))
            change = np.subtract(read, base, where=real, out=np.zeros(base.shape)) / self._data.noise
            for k, step in enumerate(steps):
                own = slice(None) if len(steps) == 1 else k
                out[:, own, where.start + k] = change[:, own] / step
        return out

    def jacobian(self, theta: Floats) -> Any:
        from scipy.sparse import csr_matrix

        held = np.array([row for row, _ in self._prior_rows]).reshape(-1, len(theta))
        rows = np.concatenate([self._columns(theta)[self._data.use], held])
        return csr_matrix(rows) if self.solver else rows

    def told(self, made: Fit, theta: Floats) -> Fit:
        """The fit with its constants' intervals: a sandwich, bread from the Jacobian and the priors, filled
        with the clusters' scores."""
        columns, use, n = self._columns(theta), self._data.use, len(theta)
        used = columns[use]
        curvature = used.T @ used
        held = np.array([row for row, _ in self._prior_rows]).reshape(-1, n)
        ties = np.array([row for row, tie in self._prior_rows if tie]).reshape(-1, n)
        off = np.where(use, (made.model - self._data.counts) / self._data.noise, 0.0)
        scores = np.einsum("ns,nsp->np", off, columns)
        bread = np.linalg.pinv(curvature + held.T @ held)
        meat = filling(scores, self._data.clusters) + held.T @ held
        deviation = np.sqrt(np.maximum(np.diag(bread @ meat @ bread), 0.0))
        # What the readings alone say of each, beside its prior.
        alone = curvature + ties.T @ ties
        size = np.sqrt(np.maximum(np.diag(alone), 1e-12))
        alone = np.sqrt(np.maximum(np.diag(np.linalg.pinv(alone / np.outer(size, size))), 0.0)) / size
        limits = np.concatenate([np.full(len(p.start), p.prior or np.inf) for p, _ in self._parts])
        moves = (
            np.diag(curvature) > 0
        )  # a constant that changes no reading (of a dead sensor, say) is unknown
        deviation = np.where(moves | np.isfinite(limits), deviation, np.inf)
        low, high = self.bounds
        at_bound = (theta <= low + 1e-6 * (high - low)) | (theta >= high - 1e-6 * (high - low))
        names = [
            p.key if len(p.start) == 1 else f"{p.key}[{i}]"
            for p, _ in self._parts for i in range(len(p.start))
        ]  # fmt: skip
        known = ~at_bound & (alone < limits) & moves
        return replace(
            made, constants=bounded(names, theta, deviation, low, high, known),
            at_bounds=tuple(name for name, at in zip(names, at_bound & moves, strict=True) if at),
            alike=blind_pairs(names, curvature),
        )  # fmt: skip


def _prior_rows(p: Parameter, where: slice, n: int) -> list[tuple[Floats, bool]]:
    """Rows [n] of a parameter's priors, and whether each ties the mean over sensors."""
    rows: list[tuple[Floats, bool]] = []
    if p.prior is not None:
        rows += [(row, False) for row in np.eye(n)[where] / p.prior]
    if p.tie is not None:
        row = np.zeros(n)
        row[where] = 1.0 / (len(p.start) * p.tie)
        rows.append((row, True))
    return rows


def bounded(
    names: Sequence[str], values: Floats, size: Floats, low: Floats, high: Floats, told: Use
) -> tuple[Constant, ...]:
    """Constants with 95 % intervals from standard errors `size` [p], cut off at their bounds; `told`: whether
    each is identifiable."""
    least, most = np.fmax(low, values - SIGMAS * size), np.fmin(high, values + SIGMAS * size)
    columns = (column.tolist() for column in (values, least, most, told))
    return tuple(
        Constant(key=name, value=value, low=a, high=b, told=sure)
        for name, value, a, b, sure in zip(names, *columns, strict=True)
    )


def filling(scores: Floats, clusters: NDArray[np.int64]) -> Floats:
    """[p, p] the middle ("meat") of a sandwich covariance from scores [n, p]; rows of one cluster [n] have
    correlated errors (Liang and Zeger, Biometrika 73, 1986)."""
    groups = np.unique(clusters, return_inverse=True)[1]
    sums = np.zeros((int(groups.max()) + 1, scores.shape[1]))
    np.add.at(sums, groups, scores)
    return np.asarray(sums.T @ sums * (len(sums) / max(len(sums) - 1, 1)))


def blind_pairs(names: Sequence[str], curvature: Floats) -> tuple[tuple[str, str, float], ...]:
    """Pairs of constants whose estimates correlate with `|ρ| ≥ 0.95`; of two kinds of constant only the
    closest pair."""
    size = np.sqrt(np.diag(curvature))
    moves = np.flatnonzero(size > 1e-9 * size.max(initial=1e-300))
    names, size = [names[int(i)] for i in moves], size[moves]
    values, vectors = np.linalg.eigh(curvature[np.ix_(moves, moves)] / np.outer(size, size))
    inverse = (vectors / np.maximum(values, BLIND)) @ vectors.T
    scale = np.sqrt(np.maximum(np.diag(inverse), 1e-12))
    rho = np.clip(inverse / np.outer(scale, scale), -1.0, 1.0)
    closest: dict[tuple[str, str], tuple[str, str, float]] = {}
    for i, j in np.argwhere(np.tril(np.abs(rho) >= ALIKE, -1)).tolist():
        first, second = sorted(names[k].partition("[")[0] for k in (i, j))
        kinds = (first, second)
        # A shift's mean is fixed at 0 by definition.
        shifted = kinds[1] == f"{kinds[0]}_shift" or (kinds[0] == kinds[1] and kinds[0].endswith("_shift"))
        pair = (names[i], names[j], float(rho[i, j]))
        if not shifted and abs(pair[2]) > abs(closest.get(kinds, ("", "", 0.0))[2]):
            closest[kinds] = pair
    return tuple(sorted(closest.values(), key=lambda pair: -abs(pair[2])))


def mended(made: Fit, parameters: Sequence[Parameter], dead: Mapping[int, str]) -> Fit:
    """The fit with the median of the others' values, and the nominal direction, for dead sensors."""
    start = {p.key: p.start for p in parameters}
    values = {key: value.copy() for key, value in made.values.items()}
    at = {}
    for key, value in values.items():
        for k in dead if len(value) > 1 else ():
            live = [i for i in range(len(value)) if i not in dead]
            value[k] = start[key][k] if key == "direction_deg" else np.median(value[live])
            at[f"{key}[{k}]"] = float(value[k])
    constants = tuple(
        replace(c, value=at[c.key], low=min(c.low, at[c.key]), high=max(c.high, at[c.key]), told=False)
        if c.key in at
        else c
        for c in made.constants
    )
    return replace(made, values=values, constants=constants)


def costs(model: Floats, data: Observed) -> Floats:
    """[S] robust misfit (soft L1) of each sensor's readings in use, in squared deviations."""
    off = np.where(data.use, (model - data.counts) / data.noise, 0.0)
    return np.asarray(2.0 * ROBUST_AT**2 * (np.sqrt(1.0 + (off / ROBUST_AT) ** 2) - 1.0).sum(axis=0))


def scan(model: Model, values: Values, data: Observed, reach: float) -> dict[str, Floats]:
    """The values with each sensor's direction where it costs least within `reach` degrees: where a ray ends,
    or direct light is bright, a reading jumps within a degree, and no derivative sees it come."""
    tried = values["direction_deg"] + np.linspace(-reach, reach, SCAN)[:, None]
    cost = np.array([costs(model({**values, "direction_deg": one}), data) for one in tried])
    return {**values, "direction_deg": tried[cost.argmin(axis=0), np.arange(tried.shape[1])]}


def search(
    parameters: Sequence[Parameter], model: Model, data: Observed, values: Values, *, draws: int
) -> dict[str, Floats]:
    """Better values of the parameters with a `jump`, by draws about the best; never worse ones.

    At the edge of the robot's own shadow a tenth of a millimetre switches a ray on or off, and least squares
    stop at the first such edge. One draw evaluates all places for all sensors at once, and keeps each
    sensor's where it suits that sensor better. A "log_gain" follows each draw by one step of Newton's.
    """
    random, sensors = np.random.default_rng(0), data.counts.shape[1]
    own = [p for p in parameters if p.jump and len(p.start) == sensors]
    common = [p for p in parameters if p.jump and len(p.start) == 1]
    gain = next((p for p in parameters if p.key == "log_gain"), None)

    def gained(values: dict[str, Floats]) -> tuple[dict[str, Floats], Floats]:
        here = model(values)
        if gain is not None:
            off = np.where(data.use, (here - data.counts) / data.noise, 0.0)
            more = values["log_gain"] + gain.step
            slope = np.where(data.use, (model({**values, "log_gain": more}) - here) / data.noise, 0.0)
            weight = 1.0 / np.sqrt(1.0 + (off / ROBUST_AT) ** 2)
            curvature = np.maximum((weight * slope * slope).sum(axis=0), 1e-12)
            by = -gain.step * (weight * slope * off).sum(axis=0) / curvature
            values = {**values, "log_gain": values["log_gain"] + by}
            here = model(values)
        cost = costs(here, data)
        for p in own:
            cost += ((values[p.key] - p.start) / p.prior) ** 2 if p.prior else 0.0
        return values, cost

    def near(p: Parameter, step: Floats) -> Floats:
        return np.clip(best[p.key] + random.standard_normal(len(p.start)) * p.jump * step, p.low, p.high)

    best, cost = gained({key: np.array(value) for key, value in values.items()})
    step, common_step, first = np.ones(sensors), np.ones(1), np.ones(sensors)
    for k in range(draws):
        shared = k % COMMON_EVERY == 0
        afar = not shared and random.random() < AFAR
        moved = {p.key: near(p, common_step) for p in common} if shared else {
            p.key: near(p, first if afar else step) for p in own
        }  # fmt: skip
        tried, new = gained({**best, **moved})
        won = np.array([new.sum() < cost.sum()]) if shared else new < cost
        keys = [*moved, *(["log_gain"] if gain is not None else [])]
        best = best | {key: np.where(won, tried[key], best[key]) for key in keys}
        cost = np.where(won, new, cost)
        if shared:
            common_step = _stepped(common_step, won)
        elif not afar:
            step = _stepped(step, won)
    return best


def _stepped(step: Floats, better: Use) -> Floats:
    return np.asarray(np.clip(np.where(better, step * WIDER, step * NARROWER), NARROWEST, WIDEST))


def choose(errors: Mapping[str, float]) -> str:
    """The form with the smallest error on held-out places; `errors` by form, those with fewer constants
    first: one with more must be better by MARGIN."""
    best, *others = errors
    for name in others:
        best = name if errors[name] * MARGIN < errors[best] else best
    return best


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """A form fitted: the base's profile with its constants in place, and the fit."""

    profile: Profile
    fit: Fit
