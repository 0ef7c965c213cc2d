"""The forms with a printed law (§3.2.1, §3.2.3, §3.3): the paper's first, then its extensions.

A form is a list of free constants and a model from their values to readings. Gains of light are fitted as
logarithms: they are scales, and a lamp's brightness is unknown by orders of magnitude.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from realitygap.calibration import model
from realitygap.calibration.curves import Curves, Seen, on_curves, smoothness
from realitygap.calibration.fit import (
    ROBUST_AT,
    Fit,
    Outcome,
    Parameter,
    Values,
    fit,
    mended,
    scan,
    search,
)
from realitygap.calibration.model import Scenes
from realitygap.calibration.readings import Readings
from realitygap.calibration.recordings import count_unit
from realitygap.values import Floats
from realitygap.world.robot import Constant, Profile, load_profile
from realitygap.world.sensors import RAY_NUMBERS, Ambient

# Proximity

INFRARED_FORMS = ("paper", "individual", "extended")
""""paper": common a and b; "individual": a and b for each sensor; "extended": also directions, distance
offset, exponent of the cosine, and how Lambertian surfaces are. There is also "measured": measured.py."""
NEAREST_CM = 1e-3
"""Smallest distance of a sensor's own where the body touches."""
NEUTRAL = {"offset_cm": np.zeros(1), "exponent": np.ones(1)}
TRIAL_STEPS = 8
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
        base = _printed_infrared(base) if form == "paper" else base
        return _from_starts(data, base, form, [{}], intervals=intervals)
    # A sensor whose readings become 0 on the way has no gradient back: a simpler form's end has all.
    starts: list[Values] = [
        {},
        {**NEUTRAL, **fit_infrared(data, base, "individual", intervals=False).fit.values},
    ]
    law, tried = base.infrared, []
    for share in (1.0, 0.0):
        lawful = replace(base, infrared=replace(law, matt=share))
        tried.append(_from_starts(data, lawful, form, starts, intervals=False))
        starts = [tried[0].fit.values]
    matt, glossy = tried
    for_matt = preference(data, matt.fit, over=glossy.fit)
    best = glossy if for_matt <= AGAINST else matt
    if not intervals:
        return best
    best = _from_starts(data, best.profile, form, [best.fit.values], intervals=True)
    share, told = best.profile.infrared.matt, abs(for_matt) >= DECIDED
    ends = (share, share) if told else (0.0, 1.0)
    surface = Constant(key="matt", value=share, low=ends[0], high=ends[1], told=told)
    return replace(best, fit=replace(best.fit, constants=(*best.fit.constants, surface)))


def _from_starts(
    data: Readings, base: Profile, form: str, starts: Sequence[Values], *, intervals: bool
) -> Outcome:
    """The fit from the most promising of some starts."""
    scenes = model.scenes_of(data.recordings)
    rigs = [] if data.straight else [scene.turn for _, scene in scenes if scene.turn]
    free = infrared_parameters(form, base, list(dict.fromkeys(rigs)), told=not data.straight)
    free += model.reflectances(scenes) + model.units(data.recordings)

    def readings(values: Values) -> Floats:
        made = with_infrared(base, values)
        return np.concatenate([model.proximity(made, scene.tried(values)) for _, scene in scenes])

    observed, start = data.observed(), starts[0]
    if len(starts) > 1:
        tried = [
            fit(free, readings, observed, start=one, intervals=False, steps=TRIAL_STEPS) for one in starts
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


def infrared_parameters(
    form: str, profile: Profile, rigs: Sequence[str], *, told: bool = True
) -> list[Parameter]:
    """What a form leaves free, starting from a profile; each rig has its own rotation. Where every sensor
    faced a wall straight on, directions are not identifiable and not free (not `told`)."""
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
            *([model.directions(sensors)] if told else []),
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


def _printed_infrared(base: Profile) -> Profile:
    """The base with §3.2.3 as printed: cos β, distances unchanged, sensors at their nominal directions."""
    law, paper = base.infrared, load_profile("paper").infrared
    sensors = tuple(replace(s, offset_cm=0.0) for s in model.nominal(law.sensors, paper.sensors))
    return replace(base, infrared=replace(law, exponent=paper.exponent, matt=0.0, sensors=sensors))


# Ambient light

LIGHT_FORMS = ("paper", "individual", "linear", "extended")
""""paper": the paper's chain with the lamp's brightness free; "individual": with a gain for each sensor;
"linear": linear between dark and floor with gains and an angular exponent; "extended": also directions, the
lamp's height and, in a known room, light reflected by walls. "measured": curves on the extended's optics."""
GAIN = "log_gain"
OF_RESPONSE = (GAIN, "floor", "dark", "floor_shift", "dark_shift")
"""What changes readings, but not the light that reaches a sensor."""
COMMON = (
    "floor", "dark", "facing", "lamp_height_cm", "lamp_narrow", "lamp_proud_cm", "reflectance", "exponent",
    "near_cm",
)  # fmt: skip
NARROWEST, INSIDE_CM = 1.0, 0.01
"""Least difference between floor and dark, counts, and least distance of a sensor from the body's edge."""
SHIFT_PRIOR = 10.0
"""Expected differences between a robot's sensors in the dark and when saturated, counts of the paper's robot.
"""
PLACE_CM, PLACE_PRIOR_CM = 0.15, 0.05
"""Bound and prior deviation of a sensor's position from the profile's."""
LAMP_JUMP_CM = 0.4
"""The lamp's height changes all rays that pass over the body at once: least squares may end more than a
centimetre off, and a search with steps of 0.1 cm stayed there."""
SCANS_DEG, FINE_DEG = (12.0, 3.0), (3.0, 1.0, 0.3)
"""Ranges to either side of successive scans of directions: from scratch, and from nearly correct values."""
DRAWS, DRAWS_HELD_OUT = 2000, 500
"""Evaluations of all places in the search for what jumps; fewer for held-out fits, of which there are four: a
poorer search errs on the safe side."""
STEPS = 12
"""Of a descent, while kinds of light are compared."""
FIRST_RAYS, FEWEST_RAYS, PROMISING = 30.0, 20, 3
"""Number of rays while the kind of reflection is chosen, since ten see a shadow in steps of 18°; the least
number that is tried in a room, and how many numbers are fitted."""
BEYOND = (
    "response", "facing", "lamp_height_cm", "lamp_narrow", "lamp_proud_cm", "falloff", "near_cm",
    "matt", "rays",
)  # fmt: skip
"""Keys of [ambient] that the paper does not have; their defaults change nothing."""


def fit_light(
    data: Readings, base: Profile, form: str, *, room: bool, intervals: bool = True
) -> tuple[Outcome, "LightModel"]:
    """Fit a form of light with a law to the readings in use; also the model at its reflected light. `room`:
    whether the walls are known, so that reflected light is informative."""
    base = replace(base, ambient=model.without_curves(base.ambient))
    base = _printed_light(base) if form == "paper" else base
    observed, scenes = data.observed(), model.scenes_of(data.recordings)
    lit = LightModel(base, scenes, form)
    free = light_parameters(form, base, scenes, data.live(), room=room)
    start: Values = {}
    steep = room and form == "extended"
    if steep:
        lit, free, start = _best_light(data, base, scenes)
    best = fit(free, lit, observed, start=start, intervals=intervals and not steep)
    if steep:
        # What a ray hits jumps, within a tenth of a millimetre, which no derivative sees.
        draws = DRAWS if intervals else DRAWS_HELD_OUT
        found = search(free, lit, observed, best.values, draws=draws)
        best = fit(free, lit, observed, start=found, intervals=intervals)
    best = mended(best, free, data.dead)
    made = with_light(lit.base, best.values, form)
    return Outcome(profile=replace(made, ambient=model.checked(made.ambient)), fit=best), lit


def _best_light(
    data: Readings, base: Profile, scenes: Scenes
) -> tuple["LightModel", list[Parameter], Values]:
    """The extended form's best light off walls: as in the paper, or off walls of some height with a lamp as
    wide as the arena says or narrow; then its number of rays. All of these change in jumps, so they are
    tried, not fitted."""
    observed = data.observed()

    def tried(
        start: Values, scans: Sequence[float], **keys: float
    ) -> tuple["LightModel", list[Parameter], Fit]:
        law = replace(base.ambient, **keys)  # type: ignore[arg-type]
        lit = LightModel(replace(base, ambient=law), scenes, "extended")
        free = light_parameters("extended", lit.base, scenes, data.live(), room=True)
        at: Values = {p.key: p.start for p in free} | dict(start)
        for reach in scans:
            near = scan(lit, at, observed, reach)
            made = fit(free, lit, observed, start=near, intervals=False, steps=STEPS)
            at = made.values
        return lit, free, made

    walls = {"falloff": 1.0, "matt": 1.0, "reflectance": base.ambient.reflectance / 30.0}
    printed = tried({}, SCANS_DEG, falloff=2.0)
    kinds = [printed, *(tried({}, SCANS_DEG, **walls, lamp_narrow=n, rays=FIRST_RAYS) for n in (0.0, 1.0))]
    lit, free, best = min(kinds, key=lambda one: one[2].cost)
    if best is not printed[2]:
        many = [n for n in RAY_NUMBERS if n >= FEWEST_RAYS]
        off = [data.rmse(lit.with_rays(n)(best.values)) for n in many]
        few = [float(many[k]) for k in np.argsort(off, kind="stable")[:PROMISING]]
        narrow = lit.base.ambient.lamp_narrow
        kinds = [tried(best.values, FINE_DEG[-1:], **walls, lamp_narrow=narrow, rays=n) for n in few]
        lit, free, best = min(kinds, key=lambda one: one[2].cost)
    at: Values = best.values
    for reach in FINE_DEG:
        at = fit(free, lit, observed, start=scan(lit, at, observed, reach), intervals=False).values
    return lit, free, at


def light_parameters(
    form: str, profile: Profile, scenes: Scenes, counts: Floats, *, room: bool
) -> list[Parameter]:
    """What a form leaves free; `counts` [n, S], NaN where not in use, give the first floor, dark
    and gains."""
    linear, unit, law = form in ("linear", "extended"), count_unit(profile.ambient.top), profile.ambient
    counts = np.where(
        np.isfinite(counts).any(axis=0), counts, np.nanmean(counts)
    )  # a sensor that is not used
    dark, floor = (
        np.array([np.median(end)]) for end in (np.nanmax(counts, axis=0), np.nanmin(counts, axis=0))
    )
    none, one = np.zeros(len(law.sensors)), np.ones(1)
    free = [
        Parameter(key="floor", start=floor, low=0.0, high=400.0 * unit, step=0.05 * unit),
        Parameter(key="dark", start=dark, low=100.0 * unit, high=1000.0 * unit, step=0.05 * unit),
    ]
    if linear:
        shift: dict[str, Any] = {
            "start": none, "low": -60 * unit, "high": 60 * unit, "prior": SHIFT_PRIOR * unit,
            "tie": 0.02 * unit, "step": 0.05 * unit,
        }  # fmt: skip
        lobe = "lobe" if form == "extended" and room and law.falloff == 1.0 else "facing"
        free += [
            Parameter(key="floor_shift", **shift), Parameter(key="dark_shift", **shift),
            Parameter(key=lobe, start=one, low=0.0, high=10.0, jump=0.01),
        ]  # fmt: skip
    if form == "extended":
        free += [
            model.directions(law.sensors, tie=None if room else 0.02, jump=0.5),
            Parameter(
                key="lamp_height_cm", start=3.0 * one, low=0.0, high=50.0, step=0.02, jump=LAMP_JUMP_CM
            ),
        ]
    if form == "extended" and room:
        begin = law.reflectance if law.falloff == 2.0 else 0.03
        free.append(Parameter(key="reflectance", start=begin * one, low=0, high=100, step=1e-4, jump=3e-3))
    if form == "extended" and room and law.falloff == 2.0:
        free.append(Parameter(key="exponent", start=law.exponent * one, low=0.0, high=10.0))
    elif form == "extended" and room:
        place: dict[str, Any] = {"start": none, "low": -PLACE_CM, "high": PLACE_CM, "prior": PLACE_PRIOR_CM}
        free += [
            *(Parameter(key=key, step=4e-3, jump=0.04, **place) for key in ("forward_cm", "left_cm")),
            Parameter(key="near_cm", start=0.5 * one, low=0.0, high=10.0, jump=0.05),
            Parameter(key="lamp_proud_cm", start=0.3 * one, low=0.0, high=3.0, step=2e-2, jump=0.03),
        ]
    start = {p.key: p.start for p in free}
    gain = _first_gains(form, with_light(profile, start, form), scenes, counts)
    each = gain if form != "paper" else np.array([np.median(gain)])
    free.insert(0, Parameter(key=GAIN, start=np.log(each), low=-30.0, high=40.0))
    rigs = dict.fromkeys(scene.turn for _, scene in scenes if scene.turn)
    return free + ([] if room else model.turns(list(rigs)))


def _first_gains(form: str, profile: Profile, scenes: Scenes, counts: Floats) -> Floats:
    """Gains [S] with which the model is right at the middle of each sensor's range."""
    light = np.concatenate([model.illumination(profile, scene) for _, scene in scenes])
    floor, dark = profile.ambient.floor, profile.ambient.dark
    out = np.ones(counts.shape[1])
    for k in range(len(out)):
        share = (dark - counts[:, k]) / max(dark - floor, 1.0)
        some = (share > 0.1) & (share < 0.9) & (light[:, k] > 0)
        if some.any():
            lit, read = light[some, k], counts[some, k]
            linear = form in ("linear", "extended")
            wanted = dark - read if linear else 1.0 / np.maximum(read - floor, 1.0) ** 2
            out[k] = np.median(wanted / lit)
    return out


def with_light(profile: Profile, values: Values, form: str) -> Profile:
    """The profile with fitted constants in place, within what a profile can hold, but unchecked."""
    law = profile.ambient
    n = len(law.sensors)
    columns = model.columns_of(values, ("direction_deg",), law.sensors)
    common = {key: float(values[key][0]) for key in COMMON if key in values}
    if "dark" in values:  # where few places are dark or bright enough
        common["dark"] = min(common["dark"], law.top)
        common["floor"] = min(common["floor"], common["dark"] - NARROWEST)
    if "floor_shift" in values:  # no sensor reads below 0
        dark = np.minimum(values["dark_shift"], law.top - common["dark"])
        highest = common["dark"] + dark - NARROWEST - common["floor"]
        lowest = np.minimum(np.maximum(values["floor_shift"], -common["floor"]), highest)
        columns["floor_shift"] = np.broadcast_to(lowest, (n,)).tolist()
        columns["dark_shift"] = np.broadcast_to(dark, (n,)).tolist()
    if GAIN in values:
        columns["gain"] = np.broadcast_to(np.exp(values[GAIN]), (n,)).tolist()
    if "forward_cm" in values:
        columns |= _moved(profile, values)
    if "lobe" in values:  # a wall's light has the same lobe as the lamp's
        common |= dict.fromkeys(("facing", "exponent"), float(values["lobe"][0]))
    response = "linear" if form in ("linear", "extended") else "paper"
    sensors = model.with_columns(law.sensors, columns)
    law = model.unchecked(law, sensors=sensors, response=response, **common)
    return model.unchecked(profile, ambient=law)


def _moved(profile: Profile, values: Values) -> dict[str, list[float]]:
    """Fitted positions of the sensors, kept within the body."""
    inside = profile.body.radius_cm - INSIDE_CM
    off = zip(profile.ambient.sensors, values["forward_cm"].tolist(), values["left_cm"].tolist(), strict=True)
    places = [(s.x_cm + forward, s.y_cm + left) for s, forward, left in off]
    shares = [min(1.0, inside / max(math.hypot(x, y), 1e-9)) for x, y in places]
    x_cm, y_cm = ([place[i] * s for place, s in zip(places, shares, strict=True)] for i in range(2))
    return {"x_cm": x_cm, "y_cm": y_cm}


class LightModel:
    """Noise-free readings [n, A] of several recordings, one after another.

    Rays are cast anew only if something changed that the light depends on: gains, floors and darks do not.
    """

    def __init__(self, base: Profile, scenes: Scenes, form: str) -> None:
        self.base, self._scenes, self._form = base, scenes, form
        self._rows, self._robot = model.rows_of([scene for _, scene in scenes]), base.to_kernel()
        self._work = model.work_of(self._robot)
        self._made = lru_cache(maxsize=4)(self._profile)
        self._lit = lru_cache(maxsize=8)(self._cast)

    def with_rays(self, number: int) -> "LightModel":
        """The same with another number of rays for reflected light."""
        law = replace(self.base.ambient, rays=float(number))
        return LightModel(replace(self.base, ambient=law), self._scenes, self._form)

    def __call__(self, values: Values) -> Floats:
        made = self._made(*_key({key: value for key, value in values.items() if key != GAIN}))
        return model.light_readings(made, self._places(values), np.exp(values[GAIN]))[self._rows]

    def light(self, values: Values) -> Floats:
        """[n, A] the light that reaches each sensor, times its gain."""
        return np.asarray(self._places(values)[self._rows] * np.exp(values[GAIN]))

    def _places(self, values: Values) -> Floats:
        optics = {key: value for key, value in values.items() if key not in OF_RESPONSE}
        return self._lit(*_key(optics))

    def _profile(self, keys: tuple[str, ...], *values: bytes) -> Profile:
        return with_light(self.base, _of_key(keys, values), self._form)

    def _cast(self, keys: tuple[str, ...], *values: bytes) -> Floats:
        """[m, A] illumination of each place."""
        at = _of_key(keys, values)
        law = with_light(self.base, at, self._form).ambient
        rigs = [(scene.tried(at), 0.0) for _, scene in self._scenes]
        ambient, light = law.to_kernel(self.base.body.height_cm)
        robot = self._robot._replace(ambient=ambient, light=light)
        return model.lit_places(robot, rigs, self._work)


def _key(values: Values) -> tuple[tuple[str, ...], *tuple[bytes, ...]]:
    """Values as a key of a cache."""
    return tuple(values), *(np.asarray(value, float).tobytes() for value in values.values())


def _of_key(keys: tuple[str, ...], values: Sequence[bytes]) -> dict[str, Floats]:
    return {key: np.frombuffer(value) for key, value in zip(keys, values, strict=True)}


def _printed_light(base: Profile) -> Profile:
    """The base with §3.3 as printed: 1.5 · cos² β for reflected light, and no extensions."""
    law, paper = base.ambient, load_profile("paper").ambient
    sensors = tuple(
        replace(s, floor_shift=0.0, dark_shift=0.0) for s in model.nominal(law.sensors, paper.sensors)
    )
    beyond = {key: Ambient.__dataclass_fields__[key].default for key in BEYOND}
    printed = {"reflectance": paper.reflectance, "exponent": paper.exponent}
    return replace(base, ambient=replace(law, sensors=sensors, **printed, **beyond))  # type: ignore[arg-type]


def fit_curves(data: Readings, extended: Outcome, lit: LightModel) -> Outcome:
    """The form "measured": a curve for each sensor in place of the straight line between dark and floor.

    Lamp, walls and lobe stay as the extended form has found them.
    """
    light = lit.light(extended.fit.values)
    bright = light[data.use & (light > 0)]
    knee = float(np.median(bright)) if len(bright) else 1.0
    share = np.sqrt(light) / (np.sqrt(light) + np.sqrt(knee))
    seen = Seen(counts=data.top - data.counts, use=data.use, top=data.top, most=data.top, noise=data.noise)
    curves = Curves(smoothness(seen, share, data.fold_of())[1], share).fitted()
    falling = np.maximum(data.top - curves, 0.0).round(3).tolist()
    law = extended.profile.ambient
    sensors = model.with_columns(law.sensors, {"curve": [tuple(row) for row in falling]})
    law = model.checked(model.unchecked(law, response="measured", curve_light=knee, sensors=sensors))
    fitted = replace(extended.fit, model=data.top - on_curves(curves, share))
    return Outcome(profile=replace(extended.profile, ambient=law), fit=fitted)


def as_bright_as_the_paper(profile: Profile) -> Profile:
    """Gains as if the recordings' lamp had been the paper's, since an unknown lamp's brightness is not
    identifiable: this profile reads half-way between floor and dark at the light where the paper's does."""
    law = profile.ambient
    half = (law.dark - law.floor) / 2.0
    wanted = 1.0 if law.response == "paper" else half**3  # half = gain·A, at A = 1/half²
    gains = np.array([s.gain for s in law.sensors])
    scale = wanted / np.exp(np.log(gains).mean())
    sensors = tuple(replace(s, gain=float(s.gain * scale)) for s in law.sensors)
    return replace(profile, ambient=replace(law, sensors=sensors, curve_light=law.curve_light * scale))
