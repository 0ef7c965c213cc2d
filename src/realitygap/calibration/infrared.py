"""The proximity sensors' printed forms (§3.2.1, §3.2.3): the paper's first, then its extensions."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from realitygap.calibration import model
from realitygap.calibration.fit import ROBUST_AT, Fit, Outcome, Parameter, Values, fit, mended, value_of
from realitygap.calibration.readings import Readings
from realitygap.calibration.recordings import count_unit
from realitygap.values import Floats
from realitygap.world.robot import Constant, Profile, load_profile

__all__ = ["INFRARED_FORMS", "fit_infrared", "parameters", "with_infrared"]

INFRARED_FORMS = ("paper", "individual", "extended")
""""paper": common a and b; "individual": a and b for each sensor; "extended": also directions, distance
offset, exponent of the cosine, and how Lambertian surfaces are. There is also "measured": measured.py."""
NEAREST_CM = 1e-3
"""Smallest distance of a sensor's own where the body touches."""
NEUTRAL = {"offset_cm": np.zeros(1), "exponent": np.ones(1)}
FIRST_STEPS = 8
"""Of a descent from each start; the best goes on."""
AGAINST, DECIDED = -1.5, 2.0
"""Standard errors: surfaces are taken as Lambertian unless readings contradict it by this much; from DECIDED
on the choice counts as identified. Walls alone say little about it, a cylinder decides it."""


def fit_infrared(data: Readings, base: Profile, form: str, *, intervals: bool = True) -> Outcome:
    """Fit a printed form to the readings in use.

    The extended form is fitted to Lambertian surfaces and to others, since an exponent of that cosine, fitted
    to walls, is unstable; "matt" is among its constants.
    """
    if form != "extended":
        base = _neutral(base) if form == "paper" else base
        return _fitted(data, base, form, [{}], intervals=intervals)
    # A sensor whose readings become 0 on the way has no gradient back: a simpler form's end has all.
    starts: list[Values] = [
        {},
        {**NEUTRAL, **fit_infrared(data, base, "individual", intervals=False).fit.values},
    ]
    law, tried = base.infrared, []
    for share in (1.0, 0.0):
        lawful = replace(base, infrared=replace(law, matt=share))
        tried.append(_fitted(data, lawful, form, starts, intervals=False))
        starts = [tried[0].fit.values]
    matt, glossy = tried
    for_matt = preference(data, matt.fit, over=glossy.fit)
    best = glossy if for_matt <= AGAINST else matt
    if not intervals:
        return best
    best = _fitted(data, best.profile, form, [best.fit.values], intervals=True)
    share, told = best.profile.infrared.matt, abs(for_matt) >= DECIDED
    ends = (share, share) if told else (0.0, 1.0)
    surface = Constant(key="matt", value=share, low=ends[0], high=ends[1], told=told)
    return replace(best, fit=replace(best.fit, constants=(*best.fit.constants, surface)))


def _fitted(
    data: Readings, base: Profile, form: str, starts: Sequence[Values], *, intervals: bool
) -> Outcome:
    """The fit from the most promising of some starts."""
    scenes = model.scenes_of(data.recordings)
    free = parameters(form, base, [] if data.straight else [name for name, _ in scenes])
    free += model.reflectances(scenes)

    def readings(values: Values) -> Floats:
        made = with_infrared(base, values)
        return np.concatenate(
            [model.proximity(made, scene.tried(values), value_of(values, rig)) for rig, scene in scenes]
        )

    observed, start = data.observed(), starts[0]
    if len(starts) > 1:
        tried = [
            fit(free, readings, observed, start=one, intervals=False, steps=FIRST_STEPS) for one in starts
        ]
        start = min(tried, key=lambda one: one.cost).values
    best = mended(fit(free, readings, observed, start=start, intervals=intervals), free, data.dead)
    made = with_infrared(base, best.values)
    return Outcome(profile=replace(made, infrared=model.checked(made.infrared)), fit=best)


def preference(data: Readings, one: Fit, *, over: Fit) -> float:
    """Evidence for one fit over another with as many constants, in standard errors.

    Vuong's statistic (1989) with a standard error robust against errors shared by neighbouring places.
    """
    left = [
        np.sqrt(1.0 + (np.where(data.use, made.model - data.counts, 0.0) / data.noise / ROBUST_AT) ** 2)
        for made in (one, over)
    ]
    gain = np.bincount(np.unique(data.block, return_inverse=True)[1], (left[1] - left[0]).sum(axis=1))
    return float(gain.sum() / max(np.sqrt((gain**2).sum()), 1e-12))


def parameters(form: str, profile: Profile, rigs: Sequence[str]) -> list[Parameter]:
    """What a form leaves free, starting from a profile; each rig has its own rotation.

    Without rigs every sensor faced a wall straight on, so directions are not identifiable and not free.
    """
    sensors = profile.infrared.sensors
    each, unit = 1 if form == "paper" else len(sensors), count_unit(profile.infrared.top)
    a = np.full(each, 1200.0 if form != "extended" else 900.0) * unit
    b = np.full(each, -50.0) * unit
    free = [
        Parameter(key="a", start=a, low=1.0 * unit, high=1e5 * unit, step=2.0 * unit),
        Parameter(key="b", start=b, low=-5e3 * unit, high=-0.01 * unit, step=0.1 * unit),
    ]
    if form == "extended":
        free += [
            *([model.directions(sensors)] if rigs else []),
            Parameter(key="offset_cm", start=np.array([0.3]), low=-0.2, high=2.0, step=2e-3),
            Parameter(key="exponent", start=np.array([2.0]), low=0.0, high=8.0, step=1e-2),
        ]
    return free + model.turns(rigs)


def with_infrared(profile: Profile, values: Values) -> Profile:
    """The profile with fitted constants in place, within what a profile can hold, but unchecked."""
    law = profile.infrared
    columns = model.columns_of(values, ("a", "b", "direction_deg", "offset_cm"), law.sensors)
    if "offset_cm" in columns:  # no distance reaches 0
        depth = [profile.body.radius_cm - math.hypot(s.x_cm, s.y_cm) - NEAREST_CM for s in law.sensors]
        columns["offset_cm"] = [max(off, -d) for off, d in zip(columns["offset_cm"], depth, strict=True)]
    common = {key: float(values[key][0]) for key in ("exponent",) if key in values}
    sensors = model.with_columns(law.sensors, columns)
    return model.unchecked(profile, infrared=model.unchecked(law, sensors=sensors, **common))


def _neutral(base: Profile) -> Profile:
    """The base with §3.2.3 as printed: cos β, distances unchanged, sensors at their nominal directions."""
    law, paper = base.infrared, load_profile("paper").infrared
    sensors = tuple(replace(s, offset_cm=0.0) for s in model.nominal(law.sensors, paper.sensors))
    return replace(base, infrared=replace(law, exponent=paper.exponent, matt=0.0, sensors=sensors))
