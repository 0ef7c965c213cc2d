"""The ambient sensors' fit (§3.2.1, §3.3): the paper's chain, and forms linear in intensity.

Gains are fitted as logarithms: they are scales, and a lamp's brightness is unknown by orders of magnitude.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from realitygap.calibration.forms import columns_of, free_directions, free_turns, with_columns
from realitygap.calibration.forward import (
    Scene,
    illumination,
    light_readings,
    lit_places,
    rows_of,
    work_of,
)
from realitygap.calibration.recordings import count_unit
from realitygap.calibration.solve import Free, Values, value_of
from realitygap.kernels.trial import Scratch
from realitygap.kernels.types import Robot
from realitygap.values import Floats
from realitygap.world.robot import Profile

__all__ = ["LIGHT_FORMS", "as_bright_as_the_paper", "light_frees", "light_model", "with_light"]

Scenes = Sequence[tuple[str, Scene]]

GAIN = "log_gain"

LIGHT_FORMS = ("paper", "individual", "linear", "extended")
""""paper": the paper's chain with the lamp's brightness free; "individual": with a gain for each sensor;
"linear": linear between dark and floor with gains and an angular exponent; "extended": also directions, the
lamp's height and, in a known room, light reflected by walls."""

COMMON = ("floor", "dark", "facing", "lamp_height_cm", "lamp_proud_cm", "reflectance", "exponent", "near_cm")
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


def light_frees(form: str, profile: Profile, scenes: Scenes, counts: Floats, *, room: bool) -> list[Free]:
    """The constants that a form leaves free.

    Args:
        form: one of LIGHT_FORMS.
        profile: where they start.
        scenes: each recording's rig name and places.
        counts: [n, S] readings.
        room: whether the walls are known, so that reflected light is informative.
    """
    linear, unit = form in ("linear", "extended"), count_unit(profile.ambient.top)
    dark, floor = (np.array([np.median(end)]) for end in (counts.max(axis=0), counts.min(axis=0)))
    frees = [
        Free(key="floor", start=floor, low=0.0, high=400.0 * unit, step=0.05 * unit),
        Free(key="dark", start=dark, low=100.0 * unit, high=1000.0 * unit, step=0.05 * unit),
    ]
    if linear:
        frees += _linear(profile, walls=form == "extended" and room and profile.ambient.falloff == 1.0)
    if form == "extended":
        frees += _extended(profile, room)
    start = {**{f.key: f.start for f in frees}, **{name: np.zeros(1) for name, _ in scenes}}
    gain = _first_gains(form, with_light(profile, start, form), scenes, counts)
    each = gain if form != "paper" else np.array([np.median(gain)])
    frees.insert(0, Free(key="log_gain", start=np.log(each), low=-30.0, high=40.0, step=1e-3))
    return frees + ([] if room else free_turns([name for name, _ in scenes]))


def _linear(profile: Profile, *, walls: bool) -> list[Free]:
    """The free constants of each sensor's own range and lobe, and of reflections if `walls` are known."""
    unit = count_unit(profile.ambient.top)
    none, most = np.zeros(len(profile.ambient.sensors)), 60 * unit
    shifts = [
        Free(
            key=key, start=none, low=-most, high=most, prior=SHIFT_PRIOR * unit, tie=0.02 * unit,
            step=0.05 * unit,
        )
        for key in ("floor_shift", "dark_shift")
    ]  # fmt: skip
    key = "lobe" if walls else "facing"
    return [*shifts, Free(key=key, start=np.ones(1), low=0.0, high=10.0, step=1e-3, jump=0.01)]


def _extended(profile: Profile, room: bool) -> list[Free]:
    sensors, law = profile.ambient.sensors, profile.ambient
    frees = [
        free_directions(sensors, tie=None if room else 0.02, jump=0.5),
        Free(key="lamp_height_cm", start=np.array([3.0]), low=0.0, high=50.0, step=0.02, jump=LAMP_JUMP_CM),
    ]
    if room:
        reflectance = law.reflectance if law.falloff == 2.0 else 0.03
        frees.append(
            Free(key="reflectance", start=np.array([reflectance]), low=0, high=100, step=1e-4, jump=3e-3)
        )
        if law.falloff == 2.0:
            frees.append(Free(key="exponent", start=np.array([law.exponent]), low=0.0, high=10.0, step=1e-3))
        else:
            frees += [
                Free(
                    key=key, start=np.zeros(len(sensors)), low=-PLACE_CM, high=PLACE_CM,
                    prior=PLACE_PRIOR_CM, step=4e-3, jump=0.04,
                )
                for key in ("forward_cm", "left_cm")
            ]  # fmt: skip
            frees += [
                Free(key="near_cm", start=np.array([0.5]), low=0.0, high=10.0, step=1e-3, jump=0.05),
                Free(key="lamp_proud_cm", start=np.array([0.3]), low=0.0, high=3.0, step=2e-2, jump=0.03),
            ]
    return frees


def _first_gains(form: str, profile: Profile, scenes: Scenes, counts: Floats) -> Floats:
    """Gains [S] with which the model is right at the middle of each sensor's range."""
    light = np.concatenate([illumination(profile, scene) for _, scene in scenes])
    floor, dark = profile.ambient.floor, profile.ambient.dark
    out = np.ones(counts.shape[1])
    for k in range(len(out)):
        share = (dark - counts[:, k]) / max(dark - floor, 1.0)
        some = (share > 0.1) & (share < 0.9) & (light[:, k] > 0)
        if some.any():
            lit, read = light[some, k], counts[some, k]
            wanted = (
                dark - read if form in ("linear", "extended") else 1.0 / np.maximum(read - floor, 1.0) ** 2
            )
            out[k] = np.median(wanted / lit)
    return out


def with_light(profile: Profile, values: Values, form: str) -> Profile:
    law = profile.ambient
    n = len(law.sensors)
    columns = columns_of(values, ("direction_deg",), law.sensors)
    common = {key: float(values[key][0]) for key in COMMON if key in values}
    if "dark" in values:  # a profile's bounds, where few places are dark or bright enough
        common["dark"] = min(common["dark"], law.top)
        common["floor"] = min(common["floor"], common["dark"] - NARROWEST)
    if "floor_shift" in values:  # no sensor reads below 0
        dark = np.minimum(values["dark_shift"], law.top - common["dark"])
        highest = common["dark"] + dark - NARROWEST - common["floor"]
        lowest = np.minimum(np.maximum(values["floor_shift"], -common["floor"]), highest)
        columns["floor_shift"] = np.broadcast_to(lowest, (n,)).tolist()
        columns["dark_shift"] = np.broadcast_to(dark, (n,)).tolist()
    if "log_gain" in values:
        columns["gain"] = np.broadcast_to(np.exp(values["log_gain"]), (n,)).tolist()
    if "forward_cm" in values:
        columns |= _moved(profile, values)
    sensors = with_columns(law.sensors, columns)
    if "lobe" in values:  # a wall's light has the same lobe as the lamp's
        common |= dict.fromkeys(("facing", "exponent"), float(values["lobe"][0]))
    response = "linear" if form in ("linear", "extended") else "paper"
    law = replace(law, sensors=sensors, response=response, **common)  # type: ignore[arg-type]
    return replace(profile, ambient=law)


def _moved(profile: Profile, values: Values) -> dict[str, list[float]]:
    """Fitted positions of the sensors, kept within the body."""
    inside = profile.body.radius_cm - INSIDE_CM
    off = zip(profile.ambient.sensors, values["forward_cm"].tolist(), values["left_cm"].tolist(), strict=True)
    places = [(s.x_cm + forward, s.y_cm + left) for s, forward, left in off]
    shares = [min(1.0, inside / max(math.hypot(x, y), 1e-9)) for x, y in places]
    x_cm, y_cm = ([place[i] * s for place, s in zip(places, shares, strict=True)] for i in range(2))
    return {"x_cm": x_cm, "y_cm": y_cm}


def light_model(profile: Profile, values: Values, scenes: Scenes, form: str, memory: LightMemory) -> Floats:
    """Noise-free readings [n, A] of several recordings, one after another, with each rig's rotation.

    Args:
        form, profile, scenes: as of `light_frees`.
        values: of the free constants.
        memory: of the last illumination, of this profile's forms at these scenes.
    """
    gain = np.exp(values[GAIN])
    made = memory.profile(profile, {key: value for key, value in values.items() if key != GAIN}, form)
    return light_readings(made, memory.light(made, values), gain)[memory.rows]


class LightMemory:
    """The last illumination at the places of some scenes, which gains, floors and darks do not change; and
    the last profile, which gains alone do not change.

    All profiles are one robot's but for its light. `rows` [n]: the place of each row of the recordings.
    """

    def __init__(self, scenes: Scenes) -> None:
        self.rows = rows_of([scene for _, scene in scenes])
        self._scenes = scenes
        self._kept: dict[tuple[object, ...], Floats] = {}
        self._last: tuple[Values, Profile] | None = None
        self._robot: Robot | None = None
        self._work: Scratch | None = None

    def profile(self, base: Profile, values: Values, form: str) -> Profile:
        last = self._last
        if last is None or any(not np.array_equal(last[0][key], value) for key, value in values.items()):
            self._last = last = (
                {key: value.copy() for key, value in values.items()},
                with_light(base, values, form),
            )
        return last[1]

    def light(self, profile: Profile, values: Values) -> Floats:
        """[m, A] illumination of each place, recomputed only if something it depends on has changed."""
        law = profile.ambient
        turns = tuple(value_of(values, name) for name, _ in self._scenes)
        directions = tuple((s.direction_deg, s.x_cm, s.y_cm) for s in law.sensors)
        lamp = (law.lamp_height_cm, law.lamp_narrow, law.lamp_proud_cm)
        shape = (law.facing, law.reflectance, law.exponent, law.near_cm, lamp)
        key = (turns, directions, shape)
        if key not in self._kept:
            if len(self._kept) > 16:
                self._kept.clear()
            rigs = [(scene, turn) for (_, scene), turn in zip(self._scenes, turns, strict=True)]
            if self._robot is None:
                self._robot = profile.to_kernel()
            ambient, light = law.to_kernel(profile.body.height_cm)
            robot = self._robot._replace(ambient=ambient, light=light)
            self._work = self._work or work_of(robot)
            self._kept[key] = lit_places(robot, rigs, self._work)
        return self._kept[key]


def as_bright_as_the_paper(profile: Profile) -> Profile:
    """Gains as if the table's lamp had been the paper's, since an unknown lamp's brightness is not
    identifiable.

    Ratios between sensors are kept; a common factor makes this profile read half-way between floor and dark
    at the light where the paper's does.
    """
    law = profile.ambient
    half = (law.dark - law.floor) / 2.0
    wanted = half**3 if law.response == "linear" else 1.0  # half = gain·A, at A = 1/half²
    gains = np.array([s.gain for s in law.sensors])
    gains *= wanted / np.exp(np.log(gains).mean())
    sensors = tuple(replace(s, gain=float(g)) for s, g in zip(law.sensors, gains, strict=True))
    return replace(profile, ambient=replace(law, sensors=sensors))
