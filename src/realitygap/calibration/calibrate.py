"""From recordings to a profile (§3.2.1): fits, noise, input ranges and provenance."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Any, Self

import numpy as np

from realitygap import lazy
from realitygap.calibration.channel import UNLIT, ChannelFit, fit_channel, ticks
from realitygap.calibration.checks import refuse_mixed
from realitygap.calibration.light import LIGHT_FORMS
from realitygap.calibration.model import REFLECTANCE
from realitygap.calibration.noise import unmeasured
from realitygap.calibration.recordings import (
    FOLLOWED_STEPS,
    Recording,
    SensorRecording,
    WheelRecording,
    as_recorded,
    count_unit,
    tells_heights,
)
from realitygap.calibration.wheels.fit import WheelFit, doubts, fit_wheels
from realitygap.errors import CalibrationError
from realitygap.files import must_be
from realitygap.work.pool import Workers, one_thread, opened
from realitygap.world.robot import FittedChannel, Profile, Provenance, SourceFile, load_profile

__all__ = ["FORMS", "Calibration", "base_of", "calibrate", "joined"]

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
    _refuse(recordings, form, light)
    recordings = [r.of_robot(base) if isinstance(r, SensorRecording) else r for r in recordings]
    base = as_recorded(recordings, base)
    near, lit = (_of_kind(recordings, kind) for kind in ("infrared", "ambient"))
    driven = [r for r in recordings if isinstance(r, WheelRecording) and (r.counted or r.followed)]
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


def _refuse(recordings: Sequence[Recording], form: str, light: str | None) -> None:
    must_be(recordings, Sequence, "recordings", "Give a list of what load_recording(path) reads.")
    for one in recordings:
        must_be(one, SensorRecording | WheelRecording, "recordings", "load_recording(path) reads one.")
    if form not in FORMS:
        raise CalibrationError(f"form: expected {' or '.join(FORMS)}, got {form!r}.")
    if light is not None and light not in (known := (*LIGHT_FORMS, "measured", "auto")):
        raise CalibrationError(f"light: expected {' or '.join(known)}, got {light!r}.")
    if not recordings:
        raise CalibrationError("no recordings: give folders made by `realitygap record`, or .sam tables.")
    refuse_mixed(recordings)
    driven = sum(isinstance(r, WheelRecording) for r in recordings)
    if driven > 1:
        raise CalibrationError(f"expected one recording of wheels, got {driven}. Give the best one.")


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
        fits.append(FittedChannel(channel="wheels", form=wheels.form, rmse=wheels.rmse[wheels.form]))
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
