"""The proximity sensors' printed forms (§3.2.1, §3.2.3): the paper's first, then its extensions."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from realitygap.calibration import model
from realitygap.calibration.fit import Outcome, Parameter, Values, fit, mended, value_of
from realitygap.calibration.readings import Readings
from realitygap.calibration.recordings.recording import count_unit
from realitygap.values import Floats
from realitygap.world.robot import Profile, load_profile

__all__ = ["INFRARED_FORMS", "fit_infrared", "parameters", "with_infrared"]

INFRARED_FORMS = ("paper", "individual", "extended")
""""paper": common a and b; "individual": a and b for each sensor; "extended": also directions, distance
offset, exponent of the cosine, and how Lambertian surfaces are. There is also "measured": measured.py."""
NEAREST_CM = 1e-3
"""Smallest distance of a sensor's own where the body touches."""
NEUTRAL = {"offset_cm": np.zeros(1), "exponent": np.ones(1)}
FIRST_STEPS = 8
"""Of a descent from each start; the best goes on."""
MATT_PRIOR = 0.5
"""Deviation of a prior that surfaces are Lambertian: walls alone say little about it, a cylinder decides."""


def fit_infrared(data: Readings, base: Profile, form: str, *, intervals: bool = True) -> Outcome:
    """Fit a printed form to the readings in use."""
    base = _neutral(base) if form == "paper" else base
    scenes = model.scenes_of(data.recordings)
    free = parameters(form, base, [] if data.straight else [name for name, _ in scenes])
    free += model.reflectances(scenes)

    def readings(values: Values) -> Floats:
        made = with_infrared(base, values)
        return np.concatenate(
            [model.proximity(made, scene.tried(values), value_of(values, rig)) for rig, scene in scenes]
        )

    starts: list[Values] = [{}]
    if form == "extended":
        # A sensor whose readings become 0 on the way has no gradient back: a simpler form's end has all.
        starts.append({**NEUTRAL, **fit_infrared(data, base, "individual", intervals=False).fit.values})
    observed = data.observed()
    tried = [fit(free, readings, observed, start=one, intervals=False, steps=FIRST_STEPS) for one in starts]
    start = min(tried, key=lambda one: one.cost).values
    best = mended(fit(free, readings, observed, start=start, intervals=intervals), free, data.dead)
    made = with_infrared(base, best.values)
    return Outcome(profile=replace(made, infrared=model.checked(made.infrared)), fit=best)


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
            Parameter(
                key="matt", start=np.ones(1), low=0.0, high=1.0, prior=MATT_PRIOR, step=1e-2, whole=True
            ),
        ]
    return free + model.turns(rigs)


def with_infrared(profile: Profile, values: Values) -> Profile:
    """The profile with fitted constants in place, within what a profile can hold, but unchecked."""
    law = profile.infrared
    columns = model.columns_of(values, ("a", "b", "direction_deg", "offset_cm"), law.sensors)
    if "offset_cm" in columns:  # no distance reaches 0
        depth = [profile.body.radius_cm - math.hypot(s.x_cm, s.y_cm) - NEAREST_CM for s in law.sensors]
        columns["offset_cm"] = [max(off, -d) for off, d in zip(columns["offset_cm"], depth, strict=True)]
    common = {key: float(values[key][0]) for key in ("exponent", "matt") if key in values}
    sensors = model.with_columns(law.sensors, columns)
    return model.unchecked(profile, infrared=model.unchecked(law, sensors=sensors, **common))


def _neutral(base: Profile) -> Profile:
    """The base with §3.2.3 as printed: cos β, distances unchanged, sensors at their nominal directions."""
    law, paper = base.infrared, load_profile("paper").infrared
    sensors = tuple(replace(s, offset_cm=0.0) for s in model.nominal(law.sensors, paper.sensors))
    return replace(base, infrared=replace(law, exponent=paper.exponent, matt=0.0, sensors=sensors))
