"""From recordings to a profile (§3.2.1): forms and the choice between them, noise, input ranges, provenance.

Each form of a kind of sensor is fitted to all readings, and to all but each fold's, with every choice inside;
the form with the smallest error on held-out places is kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from realitygap import lazy
from realitygap.calibration import model, noise
from realitygap.calibration.between import with_between
from realitygap.calibration.fit import AUTO, Fit, Outcome, Tick, Values, choose
from realitygap.calibration.forms import (
    INFRARED_FORMS,
    LIGHT_FORMS,
    as_bright_as_the_paper,
    fit_curves,
    fit_infrared,
    fit_light,
)
from realitygap.calibration.lookup import beyond, fit_lookup
from realitygap.calibration.measured import fit_measured
from realitygap.calibration.model import REFLECTANCE
from realitygap.calibration.noise import LIMITS, Misfit, NoiseEstimate, unmeasured
from realitygap.calibration.readings import FOLDS, Readings, refuse_nonsense, refuse_slips, refuse_swapped
from realitygap.calibration.recordings import (
    FOLLOWED_STEPS,
    Recording,
    SensorRecording,
    WheelRecording,
    as_recorded,
    count_unit,
    tells_heights,
)
from realitygap.calibration.sets import own_sets, units_in_words
from realitygap.calibration.wheels import WheelFit, doubts, fit_wheels
from realitygap.errors import CalibrationError, ConfigError
from realitygap.values import Floats
from realitygap.work.pool import Pool, Setup, Tell, Workers, one_thread, opened
from realitygap.world.robot import FittedChannel, Profile, Provenance, SourceFile, load_profile
from realitygap.world.sensors import LookUp

__all__ = ["FORMS", "Calibration", "ChannelFit", "base_of", "calibrate", "joined"]

FORMS = {
    "paper": ("paper", "paper", "printed"),
    "individual": ("individual", "linear", "refitted"),
    "extended": ("extended", "extended", "refitted"),
    "measured": ("measured", "measured", "refitted"),
    "lookup": ("lookup", "extended", "refitted"),
    "auto": ("auto", "auto", "refitted"),
}
"""What --form means for infrared, ambient light and wheels."""

UNKNOWN_LAMP = (
    "ambient: the lamp's brightness is unknown; gains are scaled as if the light which the paper's law "
    "reads half-way between floor and dark were read half-way here"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """A profile, the fits behind it, and warnings."""

    profile: Profile
    infrared: ChannelFit | None
    ambient: ChannelFit | None
    wheels: WheelFit | None
    recordings: tuple[Recording, ...]
    warnings: tuple[str, ...] = ()

    @property
    def channels(self) -> tuple[ChannelFit, ...]:
        """The sensors' fits."""
        return tuple(fit for fit in (self.infrared, self.ambient) if fit is not None)

    @property
    def surfaces(self) -> list[str]:
        """The fitted reflectances of surfaces that the recordings left unknown, in words: an interval says
        what noise leaves open, not how far off a wrong form is."""
        if self.infrared is None:
            return []
        near = _of_kind(self.recordings, "infrared")
        return [
            f"infrared: {Path(near[number].source).name}: reflectance of {near[number].object}, fitted: "
            f"{c.value:.3f} ({c.low:.3f} to {c.high:.3f}, if the form {self.infrared.form} is right)"
            f"{'' if c.told else ', not identifiable'}"
            for c in self.infrared.fit.constants if c.key.startswith(REFLECTANCE)
            for number in [int(c.key.removeprefix(REFLECTANCE))]
        ]  # fmt: skip

    def show(self, height: int = 900) -> Any:
        """The calibration's page in a notebook frame `height` pixels high; `save` writes it to a file."""
        return lazy.notebook().shown_calibration(self, height)

    def figures(self) -> Mapping[str, Any]:
        """The page's figures by name, as Matplotlib figures, each drawn when it is first used."""
        figures: Mapping[str, Any] = lazy.notebook().of_calibration(self)
        return figures

    def named(self, name: str, *, date: str | None = None) -> Self:
        """A copy with a name for its profile and another date (None: today's; "": none)."""
        where = self.profile.provenance
        dated = where if date is None else replace(where, date=date)
        return replace(self, profile=replace(self.profile, name=name, provenance=dated))


def base_of(recordings: Sequence[Recording]) -> str:
    """Name of the shipped profile to start from for the recorded robot; the paper's if the recordings name
    none."""
    return str(next((r.facts["base"] for r in recordings if "base" in r.facts), "paper"))


def calibrate(
    recordings: Sequence[Recording],
    base: Profile,
    *,
    form: str = "auto",
    light: str | None = None,
    beside: bool = True,
    workers: Workers = 1,
    on_progress: Callable[[int, int], None] | None = None,
) -> Calibration:
    """Fit a profile to recordings; constants that no recording covers keep the base's values.

    Args:
        recordings: of any kinds; those of one kind are fitted together.
        base: a profile.
        form: one of FORMS; "auto": "extended" or "measured", whichever has the smaller error on held-out
            places, "measured" only if it is smaller by 2 %.
        light: another form for ambient light.
        beside: fit the sensors in the other forms with a law too, for comparison.
        workers: processes for the sensors' fits, one a core if None; or a pool. Never changes a bit.
        on_progress: called with the number of fits done and of all fits.

    Raises:
        CalibrationError: the recordings give no plausible profile.
        StudyError: a worker process died repeatedly.
    """
    base = load_profile(base)
    if form not in FORMS:
        raise CalibrationError(f"form: expected {' or '.join(FORMS)}, got {form!r}.")
    if light is not None and light not in (known := (*LIGHT_FORMS, "measured", "auto")):
        raise CalibrationError(f"light: expected {' or '.join(known)}, got {light!r}.")
    if not recordings:
        raise CalibrationError("no recordings: give folders made by `realitygap record`, or .sam tables.")
    refuse_twice(recordings)
    for key in ("unit", "port"):
        said = {str(r.facts[key]): r.source for r in recordings if key in r.facts}
        if len(said) > 1:
            (one, here), (two, there) = list(said.items())[:2]
            raise CalibrationError(
                f"recordings of several robots: {here} has {key} {one}, {there} has {key} {two}. Calibrate "
                f"each robot by itself, or correct {key} in recording.toml if it is the same."
            )
    recordings = [r.of_robot(base) if isinstance(r, SensorRecording) else r for r in recordings]
    base = as_recorded(recordings, base)
    near, lit = (_of_kind(recordings, kind) for kind in ("infrared", "ambient"))
    driven = [r for r in recordings if isinstance(r, WheelRecording) and (r.counted or r.followed)]
    if len(driven) > 1:
        raise CalibrationError(
            f"expected one recording of wheels, got {len(driven)}. Give the best one, or list several logs "
            "in one MAP.toml."
        )
    infrared_form, light_form, wheel_form = FORMS[form]
    light_form = light or light_form
    total = len(driven) + ticks(near, infrared_form, beside=beside) + ticks(lit, light_form, beside=beside)
    done, report = count(), on_progress or (lambda done, total: None)

    def tick() -> None:
        report(next(done), total)

    tick()
    with one_thread():
        wheels = fit_wheels(driven[0], base, wheel_form, tick=tick) if driven else None  # soonest refused
        with opened(workers) as pool:
            infrared, ambient = (
                fit_channel(some, base, asked, pool, beside=beside, tick=tick) if some else None
                for some, asked in ((near, infrared_form), (lit, light_form))
            )
    made = Calibration(
        profile=base, infrared=infrared, ambient=ambient, wheels=wheels, recordings=tuple(recordings)
    )
    return _told(made)


def joined(parts: Sequence[Calibration], base: Profile) -> Calibration:
    """Merge one robot's calibrations, each by all recordings of other kinds and made with the same base, as
    if all had been fitted at once."""
    recordings = tuple(one for part in parts for one in part.recordings)
    made = Calibration(
        profile=as_recorded(recordings, base), recordings=recordings,
        infrared=next((part.infrared for part in parts if part.infrared), None),
        ambient=next((part.ambient for part in parts if part.ambient), None),
        wheels=next((part.wheels for part in parts if part.wheels), None),
    )  # fmt: skip
    return _told(made)


def _told(made: Calibration) -> Calibration:
    """The calibration with its profile, provenance and warnings added; `made` holds the fits and the base."""
    base, source = made.profile, "calibrated; see provenance"
    profile = replace(_joined(made), name="calibrated", source=source, provenance=_provenance(made))
    return replace(made, profile=profile, warnings=tuple(dict.fromkeys(_warnings(made, base))))


def _of_kind(recordings: Sequence[Recording], kind: str) -> list[SensorRecording]:
    return [r for r in recordings if isinstance(r, SensorRecording) and r.kind == kind]


def _joined(made: Calibration) -> Profile:
    """The base with all fitted constants, noise and input ranges in place."""
    profile, infrared, ambient, wheels = made.profile, made.infrared, made.ambient, made.wheels
    deviations = {
        e.channel: round(e.deviation, 3)
        for fit in made.channels
        for e in fit.noise
        if fit.measured or e.channel == "proximity_dark"
    }
    noise = replace(profile.noise, **deviations)
    if infrared is not None:
        low, high = np.nanmedian(infrared.span, axis=0).round().tolist()
        told = high - low > 100 * count_unit(profile.infrared.top)
        bands = (low, high) if told else profile.infrared.bands
        profile = replace(profile, infrared=replace(infrared.profile.infrared, bands=bands))
    if ambient is not None:
        law = ambient.profile.ambient
        bands = (round(law.dark, 1), round(max(law.floor, float(np.nanmedian(ambient.span[:, 0]))), 1))
        profile = replace(profile, ambient=replace(law, bands=bands))
    if wheels is not None:
        profile = replace(profile, wheels=wheels.profile.wheels)
        if wheels.odometry is not None:
            noise = replace(noise, wheel=round(wheels.odometry.slip, 5))
    return replace(profile, noise=noise)


def _provenance(made: Calibration) -> Provenance:
    from importlib.metadata import version

    wheels, recordings = made.wheels, made.recordings
    fits = [_fitted(fit) for fit in made.channels]
    told = {fit.kind: fit.fit.constants for fit in made.channels}
    notes = [
        f"{fit.kind}: {unmeasured(fit.deviation)}" for fit in made.channels if not fit.measured
    ] + made.surfaces
    notes += [f"{fit.kind}: {UNLIT}" for fit in made.channels if not np.isfinite(fit.ratio)]
    if made.ambient is not None and not any(r.arena is not None for r in _of_kind(recordings, "ambient")):
        notes.append(UNKNOWN_LAMP)
    if any(map(tells_heights, recordings)):
        notes.append("body.height_cm, ambient.sensor_height_cm: as the recordings state them, not fitted")
    if wheels is not None:
        if wheels.rmse:
            held_out = wheels.law.chosen if wheels.law is not None and wheels.law.curves else 0.0
            rmse = wheels.rmse[wheels.form]
            fits.append(FittedChannel(channel="wheels", form=wheels.form, rmse=rmse, held_out_rmse=held_out))
        told["wheels"] = wheels.constants
    return Provenance(
        base=made.profile.name,
        date=datetime.now(UTC).date().isoformat(),
        version=version("realitygap"),
        notes=tuple(notes),
        pulses_per_mm=wheels.pulses_per_mm if wheels else made.profile.provenance.pulses_per_mm,
        files=tuple(_file(r) for r in recordings),
        fits=tuple(fits),
        constants=tuple(replace(c, key=f"{kind}.{c.key}") for kind, some in told.items() for c in some),
    )


def _fitted(fit: ChannelFit) -> FittedChannel:
    over_all = float(np.sqrt(np.mean(np.square([m.error for m in fit.sensors])))) / fit.deviation
    ratio = fit.ratio if np.isfinite(fit.ratio) else over_all
    return FittedChannel(
        channel=fit.kind, form=fit.form, rmse=fit.rmse, held_out_rmse=fit.held_out[fit.form],
        model_error=ratio * fit.deviation, noise=fit.deviation, ratio=ratio, ratio_over_all=over_all,
    )  # fmt: skip


def _file(recording: Recording) -> SourceFile:
    if isinstance(recording, SensorRecording):
        kind, seen, readings = recording.kind, recording.object, recording.counts.size
    else:
        kind, seen, readings = "wheels", "", recording.commands.size
    name = Path(recording.source).name
    return SourceFile(file=name, sha256=recording.hash, kind=kind, object=seen, readings=float(readings))


def _warnings(made: Calibration, base: Profile) -> list[str]:
    kept = f"as profile {base.name!r} has them"
    out = [w for part in (*made.recordings, *made.channels) for w in part.warnings]
    if made.infrared is not None and made.ambient is None and base.ambient.sensors:
        out.append(f"ambient: no recording: its constants stay {kept}")
    wheels = made.wheels
    if wheels is None:
        driven = any(isinstance(r, WheelRecording) for r in made.recordings)
        unseen = f"wheels: no counters recorded, nor pictures of {FOLLOWED_STEPS} successive steps"
        return [*out, f"{unseen}: their constants stay {kept}"] if driven else out
    return out + doubts(wheels, base)


def refuse_twice(recordings: Sequence[Recording]) -> None:
    """Refuse one recording given twice, under whatever names; the error says both."""
    by_hash: dict[str, str] = {}
    for recording in recordings:
        if recording.hash in by_hash:
            other = by_hash[recording.hash]
            raise CalibrationError(f"{recording.source}: the same recording as {other}. Give it once.")
        if recording.hash:
            by_hash[recording.hash] = recording.source


# One kind of sensor

MEASURED, LOOKUP = "measured", "lookup"
"""The form with curves (measured.py, forms.py), and that without a model (lookup.py)."""
JUDGED = {AUTO: ("extended", MEASURED)}
"""The forms between which `auto` chooses, those with fewer constants first."""
UNLIT = (
    "too little is lit to say how model error compares with the noise: fewer than half of the sensors have a "
    "reading held out that is neither dark nor saturated; the ratio of all readings is kept"
)
TURNED_DEG = 15.0
"""Fitted directions further from the base's than any sensor is mounted."""
FAINT = 2e-4
"""Light of a room that is none, 1/cm²: that of a white wall at 70 cm."""
OVERFITTED = 1.3
"""Held-out RMSE over fitted RMSE above which a form is reported as overfitted."""
AS_GOOD = 1.1
"""A form whose held-out error is up to this factor larger has a say in which constants hang on the form."""
HINTS = {
    "a": "the object 1 to 4 cm before that sensor", "b": "the object 1 to 4 cm before that sensor",
    "direction_deg": "the object on either side of that sensor",
    "offset_cm": "distances below 1 cm", "width_cm": "distances below 1 cm",
    "exponent": "bearings far from the sensors' directions", "matt": "a cylinder beside a wall",
    "aperture_deg": "bearings far from the sensors' directions",
    "share": "bearings far from the sensors' directions", "curve": "distances at which it reads that much",
    "reflectance": "a surface of known reflectance beside it", "turn": "bearings all round",
    "background": "the same places under each light", "shift": "more distances below 3 cm",
    "log_gain": "that sensor towards the lamp", "lobe": "the lamp at all bearings",
    "facing": "the lamp at all bearings", "lamp_height_cm": "places beside the lamp",
    "lamp_proud_cm": "places beside the lamp", "near_cm": "places beside a wall",
    "forward_cm": "the robot's own shadow's edge", "left_cm": "the robot's own shadow's edge",
    "floor": "places in bright light", "dark": "places in the dark",
    "kp": "steps between many speeds", "ki": "steps between many speeds", "kd": "steps between many speeds",
    "lag": "steps between many speeds", "play_cm": "turning round on the spot and back",
    "friction_cm_s2": "standing starts at low speeds", "speed": "straight drives under a camera",
    "cm": "straight drives under a camera", "track": "turns on the way under a camera",
    "marker": "turns on the way under a camera", "poses": "changes of speed under a camera",
    "noise.wheel": "a camera that sees each step sharply",
}  # fmt: skip
"""Which readings would determine a constant, by the beginning of its key."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ChannelFit:
    """Fit of one kind of sensor.

    Attributes:
        kind: "infrared" or "ambient".
        form: the chosen form.
        profile: the base with this form's constants in place.
        fit: constants, intervals, and which constants cannot be separated.
        by_form: RMSE of every form, counts; held_out: of those that were tried on held-out places.
        judged: each sensor's misfit on held-out places; limits apply to its lit_ratio.
        misplaced: change of the model's lit readings, in noise deviations, if places set by hand are a
            millimetre off; NaN where a program set them.
        noise: what could be measured of it.
        deviation, measured: the noise's deviation where sensors see something, counts; whether it was
            measured (else it is the base's).
        sensors: each sensor's misfit.
        between: deviation of readings at the same places from one recording to another, beyond the noise of
            one, counts; NaN where no two recordings share places.
        dead: sensors that gave no information, and why.
        warnings: in words.
        distance_cm, bearing_deg: [n] of all rows; NaN where only poses are known.
        name: [n] each row's recording: its object, or its file where two have the same object.
        counts, model: [n, S]; counts are NaN for dead sensors.
        span: [S, 2] lowest and highest reading of each sensor; NaN without readings.
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
    between: float
    dead: dict[int, str]
    warnings: tuple[str, ...]
    source: str
    distance_cm: Floats = field(repr=False)
    bearing_deg: Floats = field(repr=False)
    name: NDArray[np.str_] = field(repr=False)
    counts: Floats = field(repr=False)
    model: Floats = field(repr=False)
    span: Floats = field(repr=False)

    @property
    def rmse(self) -> float:
        """RMSE of the chosen form over all live sensors, counts."""
        return self.by_form[self.form]

    @property
    def ratio(self) -> float:
        """Model error over noise of all sensors on held-out places whose readings are neither dark nor
        saturated; reports and limits use this figure. NaN without such places."""
        return noise.lit_ratio(self.judged)

    @property
    def ratio_placed(self) -> float:
        """The ratio without the error that places a millimetre off would explain; NaN like `misplaced`."""
        return noise.without(self.ratio, self.misplaced)


class Fits:
    """Fits forms of one kind of sensor: jobs of a pool, which need nothing of each other."""

    def __init__(self, data: Readings, base: Profile, room: bool) -> None:
        self._data, self._base, self._room = data, base, room

    def carry_out(self, job: tuple[str, int | None], tell: Tell) -> None:
        """Fit a form to all readings (None), or to all but a fold's, and send what was found by form: the
        outcomes; or the readings [m, S] on the fold's places, by fits that make every choice without them."""
        one_thread()
        form, fold = job
        if fold is None:
            tell((job, self._fitted(self._data, form, intervals=True)))
            return
        out = list(self._data.folds())[fold]
        if not out.any():
            tell((job, {}))
            return
        made = self._fitted(self._data.without(out), form, intervals=False)
        tell((job, {name: outcome.fit.model[out] for name, outcome in made.items()}))

    def _fitted(self, data: Readings, form: str, *, intervals: bool) -> dict[str, Outcome]:
        """Its outcome, and that of the form that it rests on."""
        if data.kind == "infrared":
            make: Any = {MEASURED: fit_measured, LOOKUP: fit_lookup}.get(form)
            make = make or partial(fit_infrared, form=form)
            made = make(data, self._base, intervals=intervals)
            own = None if form == LOOKUP else own_sets(data, made)
            return {form: made if own is None else make(own, self._base, intervals=intervals)}
        law = "extended" if form == MEASURED else form
        outcome, lit = fit_light(data, self._base, law, room=self._room, intervals=intervals)
        return {law: outcome} | ({form: fit_curves(data, outcome, lit)} if form == MEASURED else {})

    def close(self) -> None:
        """No resources to release."""


def _jobs(kind: str, form: str, *, beside: bool) -> list[tuple[str, int | None]]:
    """What has to be fitted, the longest first; the chosen form is one of those with folds."""
    judged = JUDGED.get(form, (form,))
    done = {*judged}
    if kind == "ambient" and MEASURED in judged:
        judged = (MEASURED,)  # which rests on the extended form
        done.add("extended")
    jobs: list[tuple[str, int | None]] = [(one, k) for one in judged[::-1] for k in (None, *range(FOLDS))]
    forms = INFRARED_FORMS if kind == "infrared" else LIGHT_FORMS
    return jobs + [(one, None) for one in forms if beside and form != LOOKUP and one not in done]


def ticks(recordings: Sequence[SensorRecording], form: str, *, beside: bool = True) -> int:
    """How often a fit of one kind of sensor reports progress; 0 without recordings."""
    return len(_jobs(recordings[0].kind, form, beside=beside)) if recordings else 0


def fit_channel(
    recordings: Sequence[SensorRecording], base: Profile, form: str, pool: Pool, *, beside: bool, tick: Tick
) -> ChannelFit:
    """Fit one kind of sensor to all its recordings together.

    `auto` takes the form that errs less on held-out places; `beside`: the other forms with a law are fitted
    too, for comparison; `tick` is called after each fit.
    """
    kind = recordings[0].kind
    refuse_slips(recordings, base.channel(kind).top)
    data, base = Readings(recordings, base), _by_laws(base, kind)
    said = list(data.warnings)
    for recording, gone in zip(data.recordings, data.gone, strict=True):
        refuse_swapped(recording, base, gone)
    room, *mixed = {r.pose is not None and r.arena is not None for r in recordings}
    if mixed and kind == "ambient":
        raise CalibrationError(
            "ambient recordings: some are in an arena, some before a lamp of unknown brightness: calibrate "
            "from one kind."
        )
    if all(scene.paint for _, scene in model.scenes_of(data.recordings)):
        raise CalibrationError(
            f"{recordings[0].source}: reflectance: expected a number for at least one recording; all say "
            "that it is unknown: only how surfaces differ can be fitted. Set it to 1 for one of them."
        )
    made: dict[tuple[str, int | None], dict[str, Any]] = {}

    def heard(message: tuple[tuple[str, int | None], dict[str, Any]]) -> None:
        made.update([message])
        tick()

    try:
        pool.work(Setup(Fits, (data, base, room)), _jobs(kind, form, beside=beside), heard)
    except ConfigError as error:  # the fit passed through an impossible robot
        named, why = ", ".join(r.source for r in recordings), str(error).rstrip(".")
        raise CalibrationError(
            f"{named}: these are no readings of {kind} light: {why}. Is its kind right?"
        ) from None
    outcomes = {name: one for (_, fold), found in made.items() if fold is None for name, one in found.items()}
    order = [*INFRARED_FORMS[:2], *LIGHT_FORMS, MEASURED, LOOKUP]
    outcomes = {name: outcomes[name] for name in dict.fromkeys(order) if name in outcomes}
    held: dict[str, Floats] = {}
    for name in JUDGED.get(form, (form,)):
        held[name] = outcomes[name].fit.model.copy()
        for fold, out in enumerate(data.folds()):
            found = next((f for (_, k), f in made.items() if k == fold and name in f), {})
            held[name][out] = found.get(name, held[name][out])
    best = choose({name: data.rmse_lit(read) for name, read in held.items()})
    outcome = outcomes[best]
    pairs = zip(outcome.profile.channel(kind).sensors, base.channel(kind).sensors, strict=True)
    apart = [abs(math.remainder(a.direction_deg - b.direction_deg, 360.0)) for a, b in pairs]
    if turned := [str(k) for k, off in enumerate(apart) if off > TURNED_DEG and k not in data.dead]:
        said.append(
            f"{kind}: sensors {', '.join(turned)} look more than {TURNED_DEG:g}° elsewhere than in profile "
            f"{base.name!r}: are columns exchanged, or is it another robot's?"
        )
    if kind == "ambient" and not room:
        outcome = replace(outcome, profile=as_bright_as_the_paper(outcome.profile))
    fits = {name: one.fit for name, one in outcomes.items()}
    return _channel(best, data, outcome, fits, held, said)


def _by_laws(base: Profile, kind: str) -> Profile:
    """The base without a table or curves of its sensors, with which a printed law would be none."""
    if kind != "infrared":
        return base
    law = replace(base.infrared, table=LookUp()) if base.infrared.table else base.infrared
    if law.measured:
        law = model.without_curves(law)
        law = replace(law, sensors=tuple(replace(s, offset_cm=0.0) for s in law.sensors))
    return base if law is base.infrared else replace(base, infrared=law)


def _channel(
    form: str,
    data: Readings,
    outcome: Outcome,
    fits: dict[str, Fit],
    held: dict[str, Floats],
    said: list[str],
) -> ChannelFit:
    """The chosen form with its judgement; `held` [n, S] readings on held-out places by form."""
    kind, profile, fit = data.kind, outcome.profile, fits[form]
    live, dead = data.live(), profile.infrared.dead
    refuse_nonsense(data, fit.model)
    beside = np.zeros_like(fit.model) if form == LOOKUP else fit.model
    recordings, models = data.live_recordings(), data.split(beside)
    found = noise.measure_noise(recordings, models, data.top, dead)
    usual = noise.yardstick(kind, found, profile.noise.to_dict(), profile)
    sensors, judged = (
        tuple(m for m in noise.misfits(live, read, data.place, usual) if m.sensor not in data.dead)
        for read in (fit.model, held[form])
    )
    fit, hanging = _agreed(form, fits, {name: data.rmse_lit(read) for name, read in held.items()})
    ends = [np.nanpercentile(c, (0.5, 99.5)) if np.isfinite(c).any() else (np.nan, np.nan) for c in live.T]
    made = ChannelFit(
        kind=kind, form=form, profile=profile, fit=fit,
        by_form={name: data.rmse(one.model) for name, one in fits.items()},
        held_out={name: data.rmse(read) for name, read in held.items()}, judged=judged,
        misplaced=_misplaced(data, profile, fit.values, usual.deviation) if form != LOOKUP else np.nan,
        between=np.nan,
        noise=tuple(found), deviation=usual.deviation, measured=usual.measured, sensors=sensors,
        dead=data.dead, source=", ".join(r.source for r in data.recordings), warnings=(),
        distance_cm=data.distance, bearing_deg=data.bearing, name=data.name, counts=live,
        model=fit.model, span=np.array(ends),
    )  # fmt: skip
    sizes = noise.by_sensor(noise.pooled_noise(recordings, models, data.top), kind, data.top, dead)
    uneven = bool(sizes) and max(sizes.values()) > noise.UNEVEN * min(sizes.values())
    if made.measured:
        apart = form in (MEASURED, LOOKUP) or (form == "extended" and uneven)
        profile = _with_noise(made, data, constant=not apart)
    profile, between = with_between(profile, data, fit.values, measured=made.measured)
    said = [*said, *_doubts(made), *hanging]
    if uneven and kind == "infrared":
        said.append(
            f"infrared: noise differs from sensor to sensor, from {min(sizes.values()):.3g} to "
            f"{max(sizes.values()):.3g} counts: errors are compared with one figure for all, beside which "
            "those of quiet sensors look too small"
        )
    said += units_in_words(data, fit.values)
    said += beyond(data, profile) if form == LOOKUP else []
    return replace(made, profile=profile, between=between, warnings=tuple(dict.fromkeys(said)))


def _misplaced(data: Readings, profile: Profile, values: Values, deviation: float) -> float:
    """Change of lit readings, in noise deviations, if places set by hand are a millimetre off."""
    if data.kind != "infrared":
        return np.nan
    change = [
        noise.displaced(recording, profile, scene.tried(values), 0.0)
        for recording, (_, scene) in zip(data.recordings, model.scenes_of(data.recordings), strict=True)
    ]
    return noise.explained(np.concatenate(change), data.live(), data.place, data.top, deviation)


def _agreed(form: str, fits: dict[str, Fit], errors: dict[str, float]) -> tuple[Fit, list[str]]:
    """The form's fit with reflectances marked as not identifiable where another form that errs hardly more
    disagrees, and a warning that names them: two forms that the readings bear out refute both intervals."""
    fit, said, doubted = fits[form], [], set()
    for name in (one for one in errors if one != form and errors[one] <= AS_GOOD * errors[form]):
        others = {c.key: c for c in fits[name].constants}
        for c in fit.constants:
            other = others.get(c.key)
            if other and c.key.startswith(model.REFLECTANCE) and (other.low > c.high or other.high < c.low):
                doubted.add(c.key)
                said.append(
                    f"infrared: {c.key} hangs on the form: {c.value:.3f} by {form}, {other.value:.3f} by "
                    f"{name}; state it if you can"
                )
    constants = tuple(replace(c, told=c.told and c.key not in doubted) for c in fit.constants)
    return replace(fit, constants=constants), said


def _doubts(made: ChannelFit) -> list[str]:
    """Warnings about a fit."""
    kind, limit, out = made.kind, LIMITS[made.kind], []
    over = [m for m in made.judged if m.lit_ratio > limit]
    if over:
        which = ", ".join(f"{m.sensor} ({m.lit_ratio:.1f})" for m in over)
        out.append(
            f"{kind}: model error is more than {limit:g} noise deviation{'s' * (limit != 1)} "
            f"({made.deviation:.3g} counts) for sensor{'s' * (len(over) > 1)} {which}: model error exceeds "
            "noise there"
        )
    if not np.isfinite(made.ratio):
        out.append(f"{kind}: {UNLIT}")
    held_out = made.held_out[made.form]
    if held_out > OVERFITTED * made.rmse and made.form != LOOKUP:  # which holds its input
        out.append(
            f"{kind}: RMSE {held_out:.3g} on places held out, {made.rmse:.3g} on those fitted: the form "
            "overfits"
        )
    free = {c.key for c in made.fit.constants}
    blind = {MEASURED: "aperture_deg", "extended": "direction_deg[0]"}.get(made.form)
    if kind == "infrared" and blind and blind not in free:
        out.append(
            f"{kind}: directions and lobes are not identifiable with every sensor straight before a wall: "
            "directions are the base profile's, the lobe is an assumption, as are matt surfaces"
        )
    out += _undetermined(made)
    lit = [float(value[0]) for key, value in made.fit.values.items() if key.startswith("background_")]
    if lit and max(lit) - min(lit) > FAINT:
        out.append(
            "infrared: recordings were lit differently (room's infrared, 1/cm²: "
            f"{', '.join(f'{value:.5f}' for value in lit)}): the profile is of a room with the mean"
        )
    if not made.measured:
        out.append(
            f"{kind}: {noise.unmeasured(made.deviation)}. Several readings at each place, or bearings close "
            "together, measure it"
        )
    return out


def _undetermined(made: ChannelFit) -> list[str]:
    """Which constants ended at a bound, and which the recordings do not determine, with what would."""
    dead, ended = tuple(f"[{k}]" for k in made.dead), made.fit.at_bounds
    live = [c for c in made.fit.constants if not c.key.endswith(dead)] if dead else made.fit.constants
    vague = [c.key for c in live if not c.told and c.key not in ended]
    at = [f"{c.key} ({c.value:.4g})" for c in live if c.key in ended]
    said = [f"{made.kind}: ended at a bound: {', '.join(at)}"] if at else []
    told = f"{made.kind}: not identifiable from these recordings: {with_hints(vague)}"
    return [*said, told] if vague else said


def with_hints(keys: Sequence[str]) -> str:
    """Constants that the recordings do not determine, by name, with the readings that would."""
    hints: dict[str, list[str]] = {}
    for key in keys:
        start = key.partition("[")[0]
        kinds = (start, start.rstrip("0123456789_"), start.partition("_")[0])
        hint = next((HINTS[one] for one in kinds if one in HINTS), "more places")
        hints.setdefault(hint, []).append(key)
    return "; ".join(f"{', '.join(some)} ({hint} would tell)" for hint, some in hints.items())


def _with_one_noise(profile: Profile, kind: str) -> Profile:
    """The profile with one figure for all sensors of a kind: a base's tables by the reading are older."""
    law: Any = profile.channel(kind)
    if not any(s.noise for s in law.sensors):
        return profile
    sensors = tuple(replace(s, noise=(), noise_rise=0.0) for s in law.sensors)
    return replace(profile, **{kind: replace(law, sensors=sensors)})


def _with_noise(made: ChannelFit, data: Readings, *, constant: bool) -> Profile:
    """The profile with each sensor's noise as a function of its reading; with one figure for all if the
    readings do not tell such a function and it is allowed (`constant`)."""
    # With one reading a place the table leaves no residual: its noise is in the readings themselves.
    read = np.ones_like(made.model) if made.form == LOOKUP else made.model
    sample = noise.pooled_noise(data.live_recordings(), data.split(read), data.top)
    still = (np.zeros(len(r.counts)) if r.speed_cm_s is None else r.speed_cm_s for r in data.recordings)
    speed = np.concatenate(list(still))[sample.row]
    knots = noise.finest(sample, data.top, made.kind, constant=constant)
    if not knots:
        return _with_one_noise(made.profile, made.kind)
    dead = made.profile.infrared.dead if made.kind == "infrared" else 0.0
    table, rise = noise.noise_tables(sample, data.live(), read, speed, data.top, knots=knots, dead=dead)
    columns = {"noise": [tuple(row) for row in table.round(3).tolist()], "noise_rise": rise.round(5).tolist()}
    law: Any = made.profile.channel(made.kind)
    law = model.checked(model.unchecked(law, sensors=model.with_columns(law.sensors, columns)))
    return replace(made.profile, **{made.kind: law})
