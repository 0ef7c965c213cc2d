"""The forms of the ambient sensors' fit (§3.3), how reflected light is chosen, and the measured form."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.curves import Curves, Seen, on_curves, smoothness
from realitygap.calibration.forms import Problem, by_a_law, nominal, solve_form, with_columns
from realitygap.calibration.light import LIGHT_FORMS, LightMemory, light_frees, light_model, with_light
from realitygap.calibration.rows import Rows
from realitygap.calibration.solve import Values
from realitygap.values import Floats
from realitygap.world.robot import Profile, load_profile
from realitygap.world.sensors import RAY_NUMBERS, Ambient

__all__ = ["LightCurves", "light_problems"]

FIRST_RAYS = 30.0
"""Number of rays while the kind of reflection is chosen: ten see a shadow in steps of 18°."""
FEWEST_RAYS, PROMISING = 20, 3
"""Least number of rays that is tried in a room, and how many numbers are fitted."""

BEYOND = (
    "response", "facing", "lamp_height_cm", "lamp_narrow", "lamp_proud_cm", "falloff", "near_cm",
    "matt", "rays",
)  # fmt: skip
"""Keys of [ambient] that the paper does not have; their defaults change nothing."""


def light_problems(rows: Rows, base: Profile, form: str, *, room: bool, beside: bool) -> dict[str, Problem]:
    """The forms to be fitted.

    Args:
        form: the requested one.
        room: whether the walls are known, so that reflected light is informative.
        beside: whether to include all other forms.
    """
    base = replace(base, ambient=by_a_law(base.ambient))
    names = LIGHT_FORMS if beside else (form,)
    problems = {name: _problem(name, rows, base, room=room) for name in names}
    if room and "linear" in names:
        flat = _problem("linear", rows, base, room=True, falloff=1.0)
        problems["linear"] = _best(rows, [problems["linear"], flat])
    if room and "extended" in names:
        problems["extended"] = _best_light(rows, base, problems["extended"])
    return problems


def _problem(
    form: str, rows: Rows, base: Profile, *, room: bool, falloff: float = 2.0, **light: float
) -> Problem:
    """A form's fit with one kind of reflected light; `light` are keys of [ambient]."""
    base = neutral_light(base) if form == "paper" else base
    law = base.ambient
    reflectance = law.reflectance if falloff == law.falloff else law.reflectance / 30.0
    changes = {"falloff": falloff, "reflectance": reflectance, **light}
    start = replace(base, ambient=replace(law, **changes))  # type: ignore[arg-type]
    memory = LightMemory(rows.scenes)
    return Problem(
        frees=light_frees(form, start, rows.scenes, rows.counts, room=room),
        model=lambda values: light_model(start, values, rows.scenes, form, memory),
        base=start,
        steep=room and form == "extended",
    )


def _best(rows: Rows, problems: Sequence[Problem]) -> Problem:
    """The problem with the smallest residual, restarted from its result."""
    fits = [solve_form(rows, problem, intervals=False) for problem in problems]
    left = [rows.rmse(fit.model) for fit in fits]
    k = left.index(min(left))
    return replace(problems[k], begin=fits[k].values)


def _best_light(rows: Rows, base: Profile, paper: Problem) -> Problem:
    """The best combination of reflection (as in the paper, or from walls of some height) and lamp (as wide as
    the arena says, or narrow), and then the best number of rays.

    Occlusion of a lamp and what a ray hits change in jumps without a derivative, so these are tried, not
    fitted.
    """

    def walls(narrow: float, rays: float) -> Problem:
        return _problem(
            "extended", rows, base, room=True, falloff=1.0, matt=1.0, lamp_narrow=narrow, rays=rays
        )

    best = _best(rows, [paper, walls(0.0, FIRST_RAYS), walls(1.0, FIRST_RAYS)])
    if best.base.ambient.falloff == 2.0 or best.begin is None:
        return best
    many = [walls(best.base.ambient.lamp_narrow, n) for n in RAY_NUMBERS if n >= FEWEST_RAYS]
    many.sort(key=lambda problem: rows.rmse(problem.model(best.begin)))  # type: ignore[arg-type]
    return _best(rows, [replace(problem, begin=best.begin) for problem in many[:PROMISING]])


def neutral_light(base: Profile) -> Profile:
    """The base with §3.3 as printed: 1.5 · cos² β for reflected light, and no extensions."""
    law, paper = base.ambient, load_profile("paper").ambient
    sensors = tuple(replace(s, floor_shift=0.0, dark_shift=0.0) for s in nominal(law.sensors, paper.sensors))
    beyond = {key: Ambient.__dataclass_fields__[key].default for key in BEYOND}
    printed = {"reflectance": paper.reflectance, "exponent": paper.exponent}
    return replace(base, ambient=replace(law, sensors=sensors, **printed, **beyond))  # type: ignore[arg-type]


class LightCurves:
    """The form "measured" of the ambient sensors, on the optics of the extended form's fit.

    Lamp, walls and lobe stay as the extended form found them; a table for each sensor replaces the straight
    line between dark and floor.

    Args:
        rows: all readings.
        base: the profile that the extended form started from.
        values: the extended form's result.
    """

    def __init__(self, rows: Rows, base: Profile, values: Values) -> None:
        self._rows, self._base = rows, base
        light = self._light(values)
        bright = light[rows.use & (light > 0)]
        self._knee = float(np.median(bright)) if len(bright) else 1.0
        top = rows.top
        seen = Seen(counts=top - rows.counts, use=rows.use, top=top, most=top, noise=rows.noise)
        self._values, self._share = values, self._share_of(light)
        self._seen = smoothness(seen, self._share, rows.folds())[1]

    def model(self) -> Floats:
        """[n, A] model readings, counts."""
        return self._read(self._share, self._seen)

    def held_out(self, folds: Sequence[tuple[NDArray[np.bool_], Values]]) -> Floats:
        """[n, A] model readings on held-out places, by the extended form's fits without each fold: its rows
        [n], and the values fitted without them."""
        out = self.model()
        for without, values in folds:
            some = replace(self._seen, use=self._seen.use & ~without[:, None])
            out[without] = self._read(self._share_of(self._light(values)), some)[without]
        return out

    def profile(self, extended: Profile) -> Profile:
        """The extended form's profile with curves in place of its straight line; its gains may have been
        rescaled."""
        law = extended.ambient
        before = with_light(self._base, self._values, "extended").ambient.sensors
        scale = float(np.median([now.gain / s.gain for now, s in zip(law.sensors, before, strict=True)]))
        curves = Curves(self._seen, self._share).fitted()
        falling = np.maximum(self._seen.top - curves, 0.0).round(3).tolist()
        sensors = with_columns(law.sensors, {"curve": [tuple(row) for row in falling]})
        measured = replace(law, response="measured", curve_light=self._knee * scale, sensors=sensors)
        return replace(extended, ambient=measured)

    def _light(self, values: Values) -> Floats:
        """[n, A] the light that reaches each sensor, times its gain."""
        made = with_light(self._base, values, "extended")
        memory = LightMemory(self._rows.scenes)
        light = memory.light(made, values)[memory.rows]
        return np.asarray(light * np.array([sensor.gain for sensor in made.ambient.sensors]))

    def _share_of(self, light: Floats) -> Floats:
        """[n, A] position of each reading on its curve."""
        root = np.sqrt(light)
        return np.asarray(root / (root + np.sqrt(self._knee)))

    def _read(self, share: Floats, seen: Seen) -> Floats:
        return seen.top - on_curves(Curves(seen, share).fitted(), share)
