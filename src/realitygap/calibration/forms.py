"""The fit of a form: its free constants, where the search begins, and its error on held-out places."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.forward import Scene
from realitygap.calibration.rows import Rows
from realitygap.calibration.search import DRAWS, search
from realitygap.calibration.solve import Fit, Free, Measured, Model, Values, solve
from realitygap.values import Floats
from realitygap.world.arena import WHITEST
from realitygap.world.robot import MEASURED, Profile
from realitygap.world.sensors import Ambient, Infrared, Sensor

__all__ = [
    "FINE_DEG", "Problem", "Tick", "by_a_law", "columns_of", "fit_forms", "free_directions",
    "free_reflectances", "free_turns", "mended", "nominal", "scan", "solve_form", "with_columns",
]  # fmt: skip

Tick = Callable[[], None]
S = TypeVar("S", bound=Sensor)
L = TypeVar("L", Ambient, Infrared)

OF_CURVES = (MEASURED - {"dead", "table"}) | {"response"}
"""Keys that stand for curves, or with them."""
NEUTRAL = {"offset_cm": np.zeros(1), "exponent": np.ones(1)}
DRAWS_HELD_OUT = 500
"""Fewer draws for held-out fits, of which there are four: a poorer search errs on the safe side."""
SCANS_DEG, FINE_DEG, SCAN = (12.0, 3.0), (3.0, 1.0, 0.3), 17
"""Ranges to either side and number of steps of successive searches for directions: from scratch, and from
nearly correct values."""


SAME_CM = 0.2
"""Sensors within this distance of the paper's are taken to be the paper's: a fit moves them by less."""
DIRECTION_PRIOR_DEG = 5.0
"""How accurately sensors are mounted: separates a turned rig from sensors that are all turned."""
TURN_DEG, TURN_PRIOR_DEG = 10.0, 2.0
"""Bound and prior deviation of a rig's rotation."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """One form's fit: free constants, model, starting profile, whether a stepwise search is needed, and
    initial values."""

    frees: list[Free]
    model: Model
    base: Profile
    steep: bool = False
    begin: Values | None = None


def nominal(sensors: Sequence[S], paper: Sequence[S]) -> Sequence[S]:
    """Sensors before any fit: the paper's if they sit in the same places, else the given ones."""
    here, there = ([(s.x_cm, s.y_cm) for s in some] for some in (sensors, paper))
    same = len(here) == len(there) and np.allclose(here, there, rtol=0, atol=SAME_CM)
    return paper if same else sensors


def by_a_law(law: L) -> L:
    """Sensors without curves of their own and what goes with them, if they have any: laws begin anew."""

    def unsaid(one: L | Sensor) -> dict[str, Any]:
        own = one.__dataclass_fields__
        return {key: own[key].default for key in OF_CURVES & own.keys()}

    if not law.measured:
        return law
    return replace(law, sensors=tuple(replace(s, **unsaid(s)) for s in law.sensors), **unsaid(law))


def free_turns(rigs: Sequence[str]) -> list[Free]:
    """The rotation of each rig."""
    bounds = {"low": -TURN_DEG, "high": TURN_DEG}
    return [
        Free(key=rig, start=np.zeros(1), prior=TURN_PRIOR_DEG, step=0.05, jump=0.2, **bounds) for rig in rigs
    ]


def free_reflectances(scenes: Sequence[tuple[str, Scene]]) -> list[Free]:
    """The unknown reflectances of surfaces."""
    paints = [scene.paint for _, scene in scenes if scene.paint]
    return [Free(key=key, start=np.ones(1), low=0.01, high=WHITEST, step=1e-3) for key in paints]


def free_directions(sensors: Sequence[Sensor], *, tie: float | None = 0.02, jump: float = 0.0) -> Free:
    """The direction of each sensor."""
    start = np.array([s.direction_deg for s in sensors])
    return Free(
        key="direction_deg", start=start, low=-360, high=360, prior=DIRECTION_PRIOR_DEG, tie=tie, step=0.05,
        jump=jump,
    )  # fmt: skip


def columns_of(values: Values, keys: Sequence[str], sensors: Sequence[Sensor]) -> dict[str, list[float]]:
    """Fitted per-sensor constants by key; directions are kept within what a profile can hold."""
    n = len(sensors)
    columns = {key: np.broadcast_to(values[key], (n,)).tolist() for key in keys if key in values}
    if "direction_deg" in columns:
        columns["direction_deg"] = [min(360.0, max(-360.0, turned)) for turned in columns["direction_deg"]]
    return columns


def with_columns(sensors: Sequence[S], columns: Mapping[str, Sequence[Any]]) -> tuple[S, ...]:
    """Sensors with fitted constants in place."""
    return tuple(
        replace(sensor, **{key: column[k] for key, column in columns.items()})
        for k, sensor in enumerate(sensors)
    )


def fit_forms(
    rows: Rows, problems: Mapping[str, Problem], form: str, tick: Tick
) -> tuple[dict[str, Fit], Floats, list[tuple[NDArray[np.bool_], Values]]]:
    """Every form's fit; the requested form's readings [n, S] on held-out places; and for each fold its rows
    [n] with the values fitted without them.

    Args:
        rows: all readings.
        problems: by form, the simplest first.
        form: the requested one.
        tick: called after each fit.
    """
    fits: dict[str, Fit] = {}
    for name, problem in problems.items():
        fits[name] = solve_form(rows, problem, intervals=name == form)
        simpler = list(fits.values())[:-1]
        if simpler and _lost(rows, fits[name], simpler[-1]):
            # A sensor's readings became 0, with no gradient back: restart from the simpler form's result.
            start = {f.key: NEUTRAL.get(f.key, f.start) for f in problem.frees} | simpler[-1].values
            again = solve_form(rows, problem, start=start, intervals=name == form)
            if rows.rmse(again.model) < rows.rmse(fits[name].model):
                fits[name] = again
        tick()
    problem, begin = problems[form], fits[form].values
    if problem.steep:
        fits[form] = _searched(problem, rows.measured(), begin, draws=DRAWS, last=True)
    held_out = fits[form].model.copy()
    parts: list[tuple[NDArray[np.bool_], Values]] = []
    for out in rows.held_out(tick):
        seen = rows.without(out).measured()
        some = solve(problem.frees, problem.model, seen, start=begin, intervals=False)
        if problem.steep:  # not from a search that used these places
            some = _searched(problem, seen, some.values, draws=DRAWS_HELD_OUT, last=False)
        held_out[out] = some.model[out]
        parts.append((out, some.values))
    return fits, held_out, parts


def _lost(rows: Rows, fit: Fit, simpler: Fit) -> bool:
    """Whether any sensor is fitted much worse than by the previous form."""
    live = rows.use.any(axis=0)
    now, before = (np.sqrt(((one.model - rows.counts) ** 2).mean(axis=0))[live] for one in (fit, simpler))
    return bool((now > 1.3 * before).any())


def solve_form(rows: Rows, problem: Problem, *, start: Values | None = None, intervals: bool) -> Fit:
    """Fit a form by least squares.

    Args:
        rows: all readings.
        problem: the form.
        start: where to begin; None: as the problem has it.
        intervals: whether to estimate 95 % intervals.
    """
    measured, begin = rows.measured(), start or problem.begin
    values: Values = begin or {f.key: f.start for f in problem.frees}
    for reach in (FINE_DEG if begin else SCANS_DEG) if problem.steep else ():
        nearer = scan(problem.model, values, measured, reach)
        values = solve(problem.frees, problem.model, measured, start=nearer, intervals=False).values
    return solve(problem.frees, problem.model, measured, start=values, intervals=intervals)


def _searched(problem: Problem, measured: Measured, start: Values, *, draws: int, last: bool) -> Fit:
    """The fit of a form with jumps, from the end of least squares: random search, then least squares."""
    values = search(problem.frees, problem.model, measured, start, draws=draws)
    return solve(problem.frees, problem.model, measured, start=values, intervals=last)


def scan(model: Model, values: Values, measured: Measured, reach: float) -> dict[str, Floats]:
    """The values with each sensor's direction at its smallest residual within `reach` degrees.

    Where direct light is bright, or a ray ends, a sensor's reading drops within a degree, and no derivative
    sees it come.

    Args:
        model: readings [n, sensors] of values.
        values: of all that is free, by name.
        measured: readings to come near.
        reach: degrees to either side.
    """
    best, chosen = np.full(measured.counts.shape[1], np.inf), values["direction_deg"].copy()
    for off in np.linspace(-reach, reach, SCAN):
        turned = {**values, "direction_deg": values["direction_deg"] + off}
        off = (model(turned) - measured.counts) / measured.noise
        z = np.where(measured.use, off, 0.0)
        cost = np.sqrt(1.0 + (z / 5.0) ** 2).sum(axis=0)
        chosen = np.where(cost < best, turned["direction_deg"], chosen)
        best = np.minimum(cost, best)
    return {**values, "direction_deg": chosen}


def mended(fit: Fit, frees: Sequence[Free], dead: Collection[int]) -> Fit:
    """The fit with the median of the others' values, and the nominal direction, for dead sensors."""
    start = {f.key: f.start for f in frees}
    values = {key: value.copy() for key, value in fit.values.items()}
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
        for c in fit.constants
    )
    return replace(fit, values=values, constants=constants)
