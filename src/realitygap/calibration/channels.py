"""Fits of a sensor channel in all its forms, side by side, each judged on places held out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.checks import refuse_nonsense
from realitygap.calibration.forms import Tick, fit_forms, mend_dead, mended, with_columns
from realitygap.calibration.infrared import INFRARED_FORMS, infrared_problems, with_infrared
from realitygap.calibration.light import LIGHT_FORMS, as_bright_as_the_paper, with_light
from realitygap.calibration.light_forms import AMBIENT_COUNTS, light_problems
from realitygap.calibration.light_measured import LightCurves
from realitygap.calibration.measured import MEASURED, PLAIN, fit_measured
from realitygap.calibration.misfit import LIMITS, Misfit, measure_noise, misfits, misplaced, pooled_noise
from realitygap.calibration.noise import NoiseEstimate, noise_tables
from realitygap.calibration.recordings.recording import SensorRecording
from realitygap.calibration.rows import FOLDS, PROXIMITY_COUNTS, REFLECTANCE, Rows
from realitygap.calibration.solve import Fit
from realitygap.errors import CalibrationError, ConfigError
from realitygap.world.profile import Profile

__all__ = ["AUTO", "UNLIT", "ChannelFit", "agreed", "fit_infrared", "fit_light", "ticks", "unmeasured"]

Array = NDArray[np.float64]

AUTO = "auto"
"""The form that errs least on places held out, where readings are neither dark nor saturated."""
UNLIT = "no reading held out is neither dark nor saturated: model error over noise is that of all readings"
OVERFITTED = 1.3
"""Held-out RMSE over the fitted one, from which on a form is said to fit more than the robot."""
FAR_OFF, NARROW = 10.0, 4.0
"""Model error over noise, and an angular exponent, from which on a light's distances are doubted."""
AS_GOOD = 1.1
"""A form that errs so many times as much on places held out is still heard."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ChannelFit:
    """One kind of sensor, fitted.

    Attributes:
        kind: "infrared" or "ambient".
        form: the form that was asked for.
        profile: the base with this form's constants in place.
        fit: constants, intervals, what cannot be told apart.
        by_form: RMSE of every form, counts; held_out: of those that were tried on places held out.
        judged: each sensor's misfit on places held out: limits go by its lit_ratio.
        misplaced: by how many deviations the model's lit readings change where places set by hand are a
            millimetre off; NaN where a program set them.
        noise: what could be measured of it.
        deviation, measured: the noise's where sensors see something, counts, and whether it was measured
            or is the base profile's.
        sensors: each sensor's misfit.
        dead: sensors that told nothing, and why.
        warnings: in words.
        distance_cm, bearing_deg: [n] of all rows; NaN where poses are all that is known.
        counts, model: [n, S].
        span: [S, 2] what each sensor's readings really span.
    """

    kind: str
    form: str
    profile: Profile
    fit: Fit
    by_form: dict[str, float]
    held_out: dict[str, float]
    noise: tuple[NoiseEstimate, ...]
    deviation: float
    measured: bool
    sensors: tuple[Misfit, ...]
    judged: tuple[Misfit, ...]
    misplaced: float
    dead: dict[int, str]
    warnings: tuple[str, ...]
    source: str
    distance_cm: Array = field(repr=False)
    bearing_deg: Array = field(repr=False)
    counts: Array = field(repr=False)
    model: Array = field(repr=False)
    span: Array = field(repr=False)

    @property
    def rmse(self) -> float:
        """Of the form that was asked for, all sensors that live, counts."""
        return self.by_form[self.form]

    @property
    def ratio(self) -> float:
        """Model error over noise of all sensors on places held out, where readings are neither dark nor
        saturated: the figure that reports and limits go by; NaN where there are none."""
        told = [m.lit_ratio for m in self.judged if np.isfinite(m.lit_ratio)]
        return float(np.sqrt(np.mean(np.square(told)))) if told else np.nan

    @property
    def ratio_placed(self) -> float:
        """The ratio without what places that are a millimetre off explain of it; NaN as `misplaced`."""
        return float(np.sqrt(max(0.0, self.ratio**2 - self.misplaced**2)))


def ticks(recordings: Sequence[SensorRecording], form: str, *, beside: bool = True) -> int:
    """How often the fit of one kind of sensor says that it goes on; 0 without recordings."""
    if not recordings:
        return 0
    if recordings[0].kind == "infrared":
        return FOLDS + len(INFRARED_FORMS) + (1 + FOLDS) * (form not in INFRARED_FORMS)
    return FOLDS + (len(LIGHT_FORMS) if beside else 1)


def fit_infrared(
    recordings: Sequence[SensorRecording], base: Profile, form: str, *, tick: Tick = lambda: None
) -> ChannelFit:
    """Fit the proximity sensors to all recordings at once.

    Args:
        recordings: of its kind.
        base: the profile that keeps what they do not cover.
        form: which constants are free.
        tick: called after each fit.

    Raises:
        CalibrationError: the recordings are no robot's.
    """
    rows = Rows(recordings, base)
    problems, doubt = infrared_problems(rows, base)
    printed = form if form in problems else "extended"
    fits, held_out, _ = fit_forms(rows, problems, printed, PROXIMITY_COUNTS * rows.unit, tick)
    values = mend_dead(fits[printed].values, problems[printed].frees, rows.dead)
    fits[printed] = mended(fits[printed], values, rows.dead)
    made = {printed: with_infrared(problems[printed].base, values)}
    off = {printed: held_out}
    if form != printed:
        profile, fits[MEASURED], off[MEASURED] = fit_measured(rows, base, tick)
        made[MEASURED] = profile
    best = min(off, key=lambda name: rows.rmse_lit(off[name])) if form == AUTO else form
    found = _channel("infrared", best, rows, fits, off, made[best])
    errs = {name: rows.rmse_lit(model) for name, model in off.items()}
    fit, unsure = agreed(best, {name: fits[name] for name in errs if errs[name] <= AS_GOOD * errs[best]})
    found = replace(found, fit=fit, warnings=(*found.warnings, *unsure))
    if best == MEASURED:
        found = replace(found, profile=_with_noise(found, rows))
    return replace(found, warnings=(*found.warnings, doubt)) if doubt and best == "extended" else found


def agreed(form: str, fits: Mapping[str, Fit]) -> tuple[Fit, tuple[str, ...]]:
    """A form's fit, in which reflectances that another form puts elsewhere count as not identifiable; and in
    words which those are. An interval holds if its form does: what two forms say that err as little is
    neither's doing.
    """
    fit, said = fits[form], []
    others = [(name, c) for name, one in fits.items() if name != form for c in one.constants]
    for c in fit.constants:
        for name, other in others:
            apart = other.key == c.key and (other.low > c.high or other.high < c.low)
            if c.key.startswith(REFLECTANCE) and apart:
                fit = replace(
                    fit, constants=tuple(replace(k, told=False) if k is c else k for k in fit.constants)
                )
                said.append(
                    f"infrared: {c.key} hangs on the form: {c.value:.3f} by {form}, {other.value:.3f} by "
                    f"{name}; state it if you can"
                )
    return fit, tuple(said)


def fit_light(
    recordings: Sequence[SensorRecording],
    base: Profile,
    form: str,
    *,
    beside: bool = True,
    tick: Tick = lambda: None,
) -> ChannelFit:
    """Fit the ambient sensors to all recordings at once; `beside` the form all others for comparison.

    Args:
        recordings: of its kind.
        base: the profile that keeps what they do not cover.
        form: which constants are free.
        beside: whether the other forms are fitted, too, to compare with.
        tick: called after each fit.

    Raises:
        CalibrationError: the recordings are no robot's, or of lamps both known and unknown.
    """
    rows = Rows(recordings, base)
    room, *other = {r.pose is not None and r.arena is not None for r in recordings}
    if other:
        raise CalibrationError(
            "ambient recordings: some are in an arena, some before a lamp of unknown brightness: calibrate "
            "from one kind."
        )
    printed, noise = form if form in LIGHT_FORMS else "extended", AMBIENT_COUNTS * rows.unit
    try:
        problems = light_problems(rows, base, printed, room=room, beside=beside)
        fits, held_out, parts = fit_forms(rows, problems, printed, noise, tick)
    except ConfigError as error:  # on its way the fit came to a robot that cannot be
        named, why = ", ".join(r.source for r in recordings), str(error).rstrip(".")
        expected = f"these are no readings of ambient light: {why}. Is its kind right?"
        raise CalibrationError(f"{named}: {expected}") from None
    values = mend_dead(fits[printed].values, problems[printed].frees, rows.dead)
    fits[printed] = mended(fits[printed], values, rows.dead)
    profile, off = with_light(problems[printed].base, values, printed), {printed: held_out}
    if not room:
        profile = as_bright_as_the_paper(profile)
    if form == printed:
        return _channel("ambient", form, rows, fits, off, profile)
    curves = LightCurves(rows, problems[printed].base, values, noise)
    fits[MEASURED] = replace(fits[printed], model=curves.model())
    off[MEASURED] = curves.held_out(parts)
    better = rows.rmse(off[MEASURED]) * PLAIN < rows.rmse(held_out)
    if form == MEASURED or better:
        return _channel("ambient", MEASURED, rows, fits, off, curves.profile(profile))
    return _channel("ambient", printed, rows, fits, off, profile)


def _channel(
    kind: str, form: str, rows: Rows, fits: dict[str, Fit], held_out: dict[str, Array], profile: Profile
) -> ChannelFit:
    """The form that was taken, with what is said of all: `held_out` [n, S] by form."""
    fit = fits[form]
    source = ", ".join(r.source for r in rows.recordings)
    live = rows.live()
    refuse_nonsense(source, live, fit.model, rows.dead)
    noise = measure_noise(rows.live_recordings(), rows.split(fit.model), rows.top, profile.infrared.dead)
    main = next((e.deviation for e in noise if e.channel in ("proximity", "ambient")), 0.0)
    deviation = main or (profile.noise.proximity if kind == "infrared" else profile.noise.ambient)
    deviation = deviation or rows.unit * (PROXIMITY_COUNTS if kind == "infrared" else AMBIENT_COUNTS)
    sensors, judged = (
        tuple(
            m
            for m in misfits(live, model, rows.place, kind=kind, top=rows.top, deviation=deviation)
            if m.sensor not in rows.dead
        )
        for model in (fit.model, held_out[form])
    )
    by_form = {name: rows.rmse(one.model) for name, one in fits.items()}
    span = np.stack([np.percentile(rows.counts, q, axis=0) for q in (0.5, 99.5)], 1)
    made = ChannelFit(
        kind=kind, form=form, profile=profile, fit=fit, by_form=by_form,
        held_out={name: rows.rmse(model) for name, model in held_out.items()}, judged=judged,
        misplaced=misplaced(rows, profile, fit.values, deviation) if kind == "infrared" else np.nan,
        noise=tuple(noise), deviation=deviation, measured=main > 0, sensors=sensors, dead=rows.dead,
        source=source, warnings=rows.warnings,
        distance_cm=rows.distance, bearing_deg=rows.bearing, counts=rows.counts, model=fit.model, span=span,
    )  # fmt: skip
    return replace(made, warnings=(*made.warnings, *_warnings(made)))


def _with_noise(made: ChannelFit, rows: Rows) -> Profile:
    """The profile with each sensor's own noise, where it was measured."""
    sample = pooled_noise(rows.live_recordings(), rows.split(made.model), rows.top)
    if not made.measured:
        return made.profile
    still = (np.zeros(len(r.counts)) if r.speed_cm_s is None else r.speed_cm_s for r in rows.recordings)
    speed = np.concatenate(list(still))[sample.row]
    table, rise = noise_tables(sample, rows.live(), made.model, speed, rows.top)
    law = made.profile.infrared
    columns = {"noise": [tuple(row) for row in table.round(3).tolist()], "noise_rise": rise.round(5).tolist()}
    return replace(made.profile, infrared=replace(law, sensors=with_columns(law.sensors, columns)))


def _warnings(made: ChannelFit) -> list[str]:
    kind, limit, out = made.kind, LIMITS[made.kind], []
    over = [m for m in made.judged if m.lit_ratio > limit]
    if over:
        which = ", ".join(f"{m.sensor} ({m.lit_ratio:.1f})" for m in over)
        out.append(
            f"{kind}: model error is more than {limit:g} noise deviations ({made.deviation:.3g} "
            f"counts) for sensors "
            f"{which}: model error exceeds noise there"
        )
    if not np.isfinite(made.ratio):
        out.append(f"{kind}: {UNLIT}")
    held_out = made.held_out[made.form]
    if held_out > OVERFITTED * made.rmse:
        out.append(
            f"{kind}: RMSE {held_out:.3g} on places held out, {made.rmse:.3g} on those fitted: the form "
            "overfits"
        )
    if made.form == MEASURED and not any(c.key == "aperture_deg" for c in made.fit.constants):
        out.append(
            f"{kind}: directions and lobes are not identifiable with every sensor straight before a wall: "
            "directions are the base profile's, the lobe is an assumption, as are matt surfaces"
        )
    dead = tuple(f"[{k}]" for k in made.dead)
    vague = [c.key for c in made.fit.constants if not c.told and not c.key.endswith(dead)]
    if vague:
        names = ", ".join(vague)
        out.append(f"{kind}: not identifiable from these recordings: {names} (bounds or a mild prior decide)")
    out += _doubtful_light(made)
    if not made.measured:
        out.append(
            f"{kind}: {unmeasured(made)}. Several readings at each place, or bearings close together, "
            "measure it"
        )
    return out


def _doubtful_light(made: ChannelFit) -> list[str]:
    """A warning where a linear law of light is far off, or its lobe odd: as with distances in another unit.

    The paper's law is far off on any sensor that reads light linearly: that says nothing of distances.
    """
    if made.kind != "ambient" or made.profile.ambient.response != "linear" or not made.sensors:
        return []
    error = float(np.sqrt(np.mean([m.ratio**2 for m in made.sensors])))
    facing = made.profile.ambient.facing
    if error < FAR_OFF and facing < NARROW:
        return []
    return [
        f"ambient: model error of {error:.1f} noise deviations, sensors with an angular exponent of "
        f"{facing:.1f} (a Khepera's is about 1.3): are distances in cm, from the body's edge to the lamp?"
    ]


def unmeasured(made: ChannelFit) -> str:
    """What a noise that was not measured means, in words."""
    return (
        f"too little to measure noise by where sensors see something: {made.deviation:.3g} counts are "
        "assumed, and model error over noise rests on them"
    )
