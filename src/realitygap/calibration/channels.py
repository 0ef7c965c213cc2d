"""Fits of one kind of sensor in all forms, each judged on held-out places."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from realitygap.calibration import misfit
from realitygap.calibration.channel_fit import LOOKUP, MEASURED, ChannelFit, doubts
from realitygap.calibration.checks import refuse_nonsense
from realitygap.calibration.descent import PLAIN
from realitygap.calibration.forms import Tick, by_a_law, fit_forms, mended, with_columns
from realitygap.calibration.forward import lit_readings
from realitygap.calibration.infrared import INFRARED_FORMS
from realitygap.calibration.light import LIGHT_FORMS, as_bright_as_the_paper, with_light
from realitygap.calibration.light_forms import LightCurves, light_problems
from realitygap.calibration.lookup import fit_lookup
from realitygap.calibration.noise import noise_tables
from realitygap.calibration.optics import backgrounds, in_mean
from realitygap.calibration.recordings import SensorRecording
from realitygap.calibration.rows import FOLDS, REFLECTANCE, Rows
from realitygap.calibration.searches import searched
from realitygap.calibration.solve import Fit, value_of
from realitygap.errors import CalibrationError, ConfigError
from realitygap.values import Floats
from realitygap.work.pool import Pool
from realitygap.world.robot import Profile
from realitygap.world.sensors import LookUp

__all__ = ["AUTO", "agreed", "contradicted", "fit_infrared", "fit_light", "rivals", "ticks"]

AUTO = "auto"
"""The form with the smallest error on held-out places, where readings are neither dark nor saturated."""
AS_GOOD = 1.1
"""Forms whose held-out error is up to this factor larger are still considered."""


def ticks(recordings: Sequence[SensorRecording], form: str, *, beside: bool = True) -> int:
    """How often a fit of one kind of sensor reports progress; 0 without recordings."""
    if not recordings:
        return 0
    if form == LOOKUP:
        return 1
    if recordings[0].kind == "infrared":
        return FOLDS + len(INFRARED_FORMS) + (1 + FOLDS) * (form not in INFRARED_FORMS)
    return FOLDS + (len(LIGHT_FORMS) if beside else 1)


def fit_infrared(
    recordings: Sequence[SensorRecording], base: Profile, form: str, pool: Pool, *, tick: Tick = lambda: None
) -> ChannelFit:
    """Fit the proximity sensors to all recordings together.

    Args:
        recordings: of infrared.
        base: the profile whose values stay where recordings say nothing.
        form: which constants are free.
        pool: of workers, for the searches of the measured form.
        tick: called after each fit.

    Raises:
        CalibrationError: the recordings cannot come from such a robot.
    """
    base = replace(base, infrared=replace(base.infrared, table=LookUp())) if base.infrared.table else base
    rows = Rows(recordings, base)
    if form == LOOKUP:
        profile, fit, held_out, said = fit_lookup(rows, base)
        found = _channel("infrared", LOOKUP, rows, {LOOKUP: fit}, {LOOKUP: held_out}, profile)
        tick()
        return replace(found, warnings=(*found.warnings, *said))
    printed = form if form in INFRARED_FORMS else "extended"
    base = _by_laws(base)
    made, fits, off, doubt = searched(rows, base, printed, pool, tick, measured=form != printed)
    errs = {name: rows.rmse_lit(model) for name, model in off.items()}
    best = min(errs, key=errs.__getitem__) if form == AUTO else form
    found = _channel("infrared", best, rows, fits, off, made[best])
    ratios = {name: _ratio(rows, model, found) for name, model in off.items()}
    fit, unsure = agreed(best, {name: fits[name] for name in rivals(best, errs, ratios)})
    said = [*unsure, *contradicted(rows, found.deviation)]
    said += lit_apart(rows, found) if best == MEASURED else []
    said += [doubt] if doubt and best == "extended" else []
    return replace(found, fit=fit, warnings=(*found.warnings, *said))


def _by_laws(base: Profile) -> Profile:
    """The base without curves of its sensors, with which a printed law would be none, nor what belongs to
    them; the measured form begins anew, too."""
    law = by_a_law(base.infrared)
    if law is base.infrared:
        return base
    return replace(base, infrared=replace(law, sensors=tuple(replace(s, offset_cm=0.0) for s in law.sensors)))


def contradicted(rows: Rows, deviation: float) -> list[str]:
    """Warnings about recordings of the same places that differ by more than their noise (counts)."""
    apart = misfit.contradiction(rows, deviation)
    if not apart > deviation:
        return []
    return [
        f"infrared: recordings of the same places lie {apart:.3g} counts ({apart / rows.top:.1%} of full "
        "scale) off their mean: no form can follow both, unless they were set down apart or lit differently"
    ]


def lit_apart(rows: Rows, found: ChannelFit) -> list[str]:
    """Warnings about room light that changes readings by more than their noise."""
    values, dead = found.fit.values, found.profile.infrared.dead
    lit = backgrounds(values, rows.scenes)
    mean, said = in_mean(np.repeat(lit, [len(r.counts) for r in rows.recordings]), rows.use), []
    for name, light, (rig, scene), read in zip(
        rows.names(), lit, rows.scenes, rows.split(rows.live()), strict=True
    ):
        turn = value_of(values, rig)
        there, here = (lit_readings(found.profile, scene, by, turn) for by in (light - mean, 0.0))
        by = float((there - here)[read > dead].mean())
        said += [f"{name} {by:+.0f}"] if abs(by) > found.deviation else []
    return [
        f"infrared: recordings were lit differently (mean of lit readings, counts: {', '.join(said)}): the "
        "profile is of a room whose infrared is the mean of theirs"
    ] if said else []  # fmt: skip


def rivals(best: str, errs: Mapping[str, float], ratios: Mapping[str, float]) -> list[str]:
    """The forms that must agree on a reflectance: those that err almost as little on places held out as the
    best, and those whose model error over noise (`ratios`) does not exceed the limit."""
    limit = misfit.LIMITS["infrared"]
    return [name for name in errs if errs[name] <= AS_GOOD * errs[best] or ratios[name] <= limit]


def _ratio(rows: Rows, model: Floats, found: ChannelFit) -> float:
    """As `ChannelFit.ratio`, of another form's readings of places held out, with the noise that was found."""
    usual = misfit.yardstick("infrared", found.noise, found.profile.noise.to_dict(), found.profile)
    judged = misfit.misfits(rows.live(), model, rows.place, usual)
    return misfit.lit_ratio([one for one in judged if one.sensor not in rows.dead])


def agreed(form: str, fits: Mapping[str, Fit]) -> tuple[Fit, tuple[str, ...]]:
    """A form's fit with reflectances marked as not identifiable where another good form disagrees; and a
    warning that names them.

    An interval is only valid if its form is right: two forms that the readings bear out and that have
    different values refute both.
    """
    fit, doubted, said = fits[form], set(), []
    others = [(name, c) for name, one in fits.items() if name != form for c in one.constants]
    for c in fit.constants:
        for name, other in others:
            apart = other.key == c.key and (other.low > c.high or other.high < c.low)
            if c.key.startswith(REFLECTANCE) and apart:
                doubted.add(c.key)
                said.append(
                    f"infrared: {c.key} hangs on the form: {c.value:.3f} by {form}, {other.value:.3f} by "
                    f"{name}; state it if you can"
                )
    constants = tuple(replace(c, told=c.told and c.key not in doubted) for c in fit.constants)
    return replace(fit, constants=constants), tuple(said)


def fit_light(
    recordings: Sequence[SensorRecording],
    base: Profile,
    form: str,
    *,
    beside: bool = True,
    tick: Tick = lambda: None,
) -> ChannelFit:
    """Fit the ambient sensors to all recordings together.

    Args:
        recordings: of ambient light.
        base, form, tick: as of `fit_infrared`.
        beside: whether the other forms are fitted too, for comparison.

    Raises:
        CalibrationError: the recordings cannot come from such a robot, or mix known and unknown lamps.
    """
    rows = Rows(recordings, base)
    room, *other = {r.pose is not None and r.arena is not None for r in recordings}
    if other:
        raise CalibrationError(
            "ambient recordings: some are in an arena, some before a lamp of unknown brightness: calibrate "
            "from one kind."
        )
    printed = form if form in LIGHT_FORMS else "extended"
    try:
        problems = light_problems(rows, base, printed, room=room, beside=beside)
        fits, held_out, parts = fit_forms(rows, problems, printed, tick)
    except ConfigError as error:  # the fit passed through an impossible robot
        named, why = ", ".join(r.source for r in recordings), str(error).rstrip(".")
        expected = f"these are no readings of ambient light: {why}. Is its kind right?"
        raise CalibrationError(f"{named}: {expected}") from None
    start = problems[printed].base
    fits[printed] = mended(fits[printed], problems[printed].frees, rows.dead)
    values = fits[printed].values
    profile, off = with_light(start, values, printed), {printed: held_out}
    if not room:
        profile = as_bright_as_the_paper(profile)
    if form != printed:
        curves = LightCurves(rows, start, values)
        fits[MEASURED] = replace(fits[printed], model=curves.model())
        off[MEASURED] = curves.held_out(parts)
        better = rows.rmse(off[MEASURED]) * PLAIN < rows.rmse(held_out)
        form = MEASURED if form == MEASURED or better else printed
        profile = curves.profile(profile) if form == MEASURED else profile
    return _channel("ambient", form, rows, fits, off, profile)


def _channel(
    kind: str, form: str, rows: Rows, fits: dict[str, Fit], held_out: dict[str, Floats], profile: Profile
) -> ChannelFit:
    """The chosen form with its judgement; `held_out` [n, S] by form."""
    fit = fits[form]
    source = ", ".join(r.source for r in rows.recordings)
    live = rows.live()
    refuse_nonsense(rows.recordings, live, fit.model, rows.dead)
    beside = np.zeros_like(fit.model) if form == LOOKUP else fit.model
    read = rows.live_recordings(), rows.split(beside), rows.top, profile.infrared.dead
    noise = misfit.measure_noise(*read)
    uneven = misfit.uneven_noise(*read) if kind == "infrared" else []
    usual = misfit.yardstick(kind, noise, profile.noise.to_dict(), profile)
    sensors, judged = (
        tuple(m for m in misfit.misfits(live, model, rows.place, usual) if m.sensor not in rows.dead)
        for model in (fit.model, held_out[form])
    )
    by_form = {name: rows.rmse(one.model) for name, one in fits.items()}
    modelled = kind == "infrared" and form != LOOKUP
    told = [column[np.isfinite(column)] for column in live.T]
    span = np.array(
        [np.percentile(column, (0.5, 99.5)) if len(column) else (np.nan, np.nan) for column in told]
    )
    made = ChannelFit(
        kind=kind, form=form, profile=profile, fit=fit, by_form=by_form,
        held_out={name: rows.rmse(model) for name, model in held_out.items()}, judged=judged,
        misplaced=misfit.misplaced(rows, profile, fit.values, usual.deviation) if modelled else np.nan,
        noise=tuple(noise), deviation=usual.deviation, measured=usual.measured, sensors=sensors,
        dead=rows.dead, source=source, warnings=rows.warnings,
        distance_cm=rows.distance, bearing_deg=rows.bearing, name=rows.name, counts=live,
        model=fit.model, span=span,
    )  # fmt: skip
    apart = form in (MEASURED, LOOKUP) or (form == "extended" and bool(uneven))
    if made.measured:
        profile = _with_noise(made, rows) if apart else _with_one_noise(profile, kind)
    alike = "" if apart else "; this form simulates that figure, too; extended and measured each one's own"
    uneven = [said + alike for said in uneven]
    return replace(made, profile=profile, warnings=(*made.warnings, *doubts(made), *uneven))


def _with_one_noise(profile: Profile, kind: str) -> Profile:
    """The profile with one figure for all sensors of a kind: a base's tables by the reading are older."""
    law: Any = profile.channel(kind)
    if not any(s.noise for s in law.sensors):
        return profile
    sensors = tuple(replace(s, noise=(), noise_rise=0.0) for s in law.sensors)
    return replace(profile, **{kind: replace(law, sensors=sensors)})


def _with_noise(made: ChannelFit, rows: Rows) -> Profile:
    """The profile with each sensor's noise as a function of its reading."""
    # With one reading a place the table leaves no residual: its noise is in the readings themselves.
    model = np.ones_like(made.model) if made.form == LOOKUP else made.model
    sample = misfit.pooled_noise(rows.live_recordings(), rows.split(model), rows.top)
    still = (np.zeros(len(r.counts)) if r.speed_cm_s is None else r.speed_cm_s for r in rows.recordings)
    speed = np.concatenate(list(still))[sample.row]
    dead = made.profile.infrared.dead if made.kind == "infrared" else 0.0
    table, rise = noise_tables(sample, rows.live(), model, speed, rows.top, kind=made.kind, dead=dead)
    columns = {"noise": [tuple(row) for row in table.round(3).tolist()], "noise_rise": rise.round(5).tolist()}
    law: Any = made.profile.channel(made.kind)
    law = replace(law, sensors=with_columns(law.sensors, columns))
    return replace(made.profile, **{made.kind: law})
