"""The proximity sensors' fit (§3.2.1, §3.2.3): the paper's form first, then its extensions."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from realitygap.calibration import forms
from realitygap.calibration.forms import Problem
from realitygap.calibration.forward import Scene, proximity
from realitygap.calibration.recordings import count_unit
from realitygap.calibration.rows import Rows
from realitygap.calibration.solve import ROBUST_AT, Fit, Free, Values, value_of
from realitygap.values import Floats
from realitygap.world.robot import Profile, load_profile

__all__ = ["INFRARED_FORMS", "infrared_problems", "with_infrared"]

INFRARED_FORMS = ("paper", "individual", "extended")
""""paper": common a and b; "individual": a and b for each sensor; "extended": also directions, distance
offset, exponent of the cosine, and Lambertian surfaces. There is also "measured": measured.py."""

NEAREST_CM = 1e-3
"""Smallest distance of a sensor's own where the body touches."""
AGAINST, DECIDED = -1.5, 2.0
"""Standard errors: surfaces are taken as Lambertian unless readings contradict it by this much; from DECIDED
on the choice counts as identified. Walls alone say little about it, a cylinder decides it."""


def infrared_problems(rows: Rows, base: Profile) -> tuple[dict[str, Problem], str]:
    """The forms to be fitted; and in words what is not identifiable about them, if anything.

    Lambertian or not is tried, not fitted, since an exponent fitted to walls is unstable.
    """
    problems = {form: _problem(form, rows, base) for form in INFRARED_FORMS}
    tried = [
        _problem("extended", rows, replace(base, infrared=replace(base.infrared, matt=matt)))
        for matt in (0.0, 1.0)
    ]
    glossy, matt = (forms.solve_form(rows, problem, intervals=False) for problem in tried)
    for_matt = preference(rows, matt, over=glossy)
    against = for_matt <= AGAINST
    problem, begin, chosen = (tried[0], glossy, "are not") if against else (tried[1], matt, "are")
    problems["extended"] = replace(problem, begin=begin.values)
    doubt = (
        "infrared: whether surfaces are Lambertian is not identifiable from these recordings; "
        f"it is assumed that they {chosen}"
    )
    return problems, "" if abs(for_matt) >= DECIDED else doubt + " (readings before a cylinder tell most)"


def preference(rows: Rows, one: Fit, *, over: Fit) -> float:
    """Evidence for one fit over another with as many constants, in standard errors.

    Vuong's statistic (1989) with a standard error robust against errors shared by neighbouring places.
    """
    z = [np.where(rows.use, fit.model - rows.counts, 0.0) / rows.noise for fit in (one, over)]
    left = [np.sqrt(1.0 + (off / ROBUST_AT) ** 2).sum(axis=1) for off in z]
    gain = np.bincount(np.unique(rows.block, return_inverse=True)[1], left[1] - left[0])
    return float(gain.sum() / max(np.sqrt((gain**2).sum()), 1e-12))


def _problem(form: str, rows: Rows, base: Profile) -> Problem:
    base = neutral_infrared(base) if form == "paper" else base
    rigs = [] if rows.straight else [name for name, _ in rows.scenes]
    return Problem(
        frees=infrared_frees(form, base, rigs) + forms.free_reflectances(rows.scenes),
        model=lambda values: infrared_model(base, values, rows.scenes),
        base=base,
    )


def infrared_frees(form: str, profile: Profile, rigs: Sequence[str]) -> list[Free]:
    """The free constants of a form, starting from a profile; each rig has its own rotation.

    Without rigs every sensor faced a wall straight on, so directions are not identifiable and not free.
    """
    sensors = profile.infrared.sensors
    each, unit = 1 if form == "paper" else len(sensors), count_unit(profile.infrared.top)
    a = np.full(each, 1200.0 if form != "extended" else 900.0) * unit
    b = np.full(each, -50.0) * unit
    frees = [
        Free(key="a", start=a, low=1.0 * unit, high=1e5 * unit, step=0.5 * unit),
        Free(key="b", start=b, low=-5e3 * unit, high=-0.01 * unit, step=0.02 * unit),
    ]
    if form == "extended":
        frees += [
            *([forms.free_directions(sensors)] if rigs else []),
            Free(key="offset_cm", start=np.array([0.3]), low=-0.2, high=2.0, step=1e-3),
            Free(key="exponent", start=np.array([2.0]), low=0.0, high=8.0, step=5e-3),
        ]
    return frees + forms.free_turns(rigs)


def with_infrared(profile: Profile, values: Values) -> Profile:
    sensors, law = profile.infrared.sensors, profile.infrared
    columns = forms.columns_of(values, ("a", "b", "direction_deg", "offset_cm"), sensors)
    if "offset_cm" in columns:  # within a profile's bounds: no distance reaches 0
        depth = [profile.body.radius_cm - math.hypot(s.x_cm, s.y_cm) - NEAREST_CM for s in sensors]
        columns["offset_cm"] = [max(off, -d) for off, d in zip(columns["offset_cm"], depth, strict=True)]
    exponent = float(values["exponent"][0]) if "exponent" in values else law.exponent
    fitted = forms.with_columns(sensors, columns)
    return replace(profile, infrared=replace(law, sensors=fitted, exponent=exponent))


def infrared_model(profile: Profile, values: Values, scenes: Sequence[tuple[str, Scene]]) -> Floats:
    """Noise-free readings [n, P] of several recordings, one after another, with each rig's rotation."""
    made = with_infrared(profile, values)
    return np.concatenate(
        [proximity(made, scene.tried(values), value_of(values, rig)) for rig, scene in scenes]
    )


def neutral_infrared(base: Profile) -> Profile:
    """The base with §3.2.3 as printed: cos β, distances unchanged, sensors at their nominal directions."""
    law, paper = base.infrared, load_profile("paper").infrared
    sensors = tuple(replace(s, offset_cm=0.0) for s in forms.nominal(law.sensors, paper.sensors))
    return replace(base, infrared=replace(law, exponent=paper.exponent, matt=0.0, sensors=sensors))
