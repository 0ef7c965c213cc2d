"""Judges a profile by recordings: RMSE, bias, and model error over noise, for each sensor."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from realitygap.calibration import checks, forward, misfit
from realitygap.calibration.channel_fit import unmeasured
from realitygap.calibration.descent import BY_HAND, LIGHT, SHIFT
from realitygap.calibration.forward import Scene
from realitygap.calibration.misfit import LIMITS, Misfit
from realitygap.calibration.recordings import FOLLOWED_STEPS, Recording, SensorRecording, WheelRecording
from realitygap.calibration.solve import Free, Measured, Values, solve
from realitygap.calibration.wheels.checks import refuse_few_steps, refuse_odd
from realitygap.calibration.wheels.odometry import measure_odometry, measured_speeds
from realitygap.errors import CalibrationError
from realitygap.values import Floats
from realitygap.work.pool import one_thread
from realitygap.world.robot import Profile

__all__ = ["LIMITS", "Judgement", "judge"]

STEP = 0.01
"""Degrees, or the logarithm of a brightness, over which a difference is taken."""
FITS = 1.25
"""A measured noise deviation within this factor of the profile's agrees with it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Judgement:
    """A profile compared with one recording: counts, or cm/s for wheels.

    `per_sensor` and all sums leave out dead sensors; `warnings` name them and everything else that is
    doubtful. `within` is the share of lit places on which the model errs by at most two deviations of the
    noise: where it is near 1 and `ratio` is large, single places err. For a series of one sensor facing a
    wall, `shift_cm` is its extra distance and `background` the room's infrared beyond the profile's (1/cm²);
    both are fitted out, as is the `reflectance` of an unknown surface (`painted`). `misplaced` is as of a
    calibration.
    """

    kind: str
    source: str
    rmse: float
    bias: float
    per_sensor: tuple[Misfit, ...]
    noise: dict[str, tuple[float, float]]
    turn_deg: float = 0.0
    shift_cm: float = 0.0
    background: float = 0.0
    brightness: float = 1.0
    reflectance: float = 1.0
    painted: bool = False
    within: float = math.nan
    misplaced: float = math.nan
    counts: Floats = field(repr=False)
    model: Floats = field(repr=False)
    warnings: tuple[str, ...] = ()

    @property
    def fitted_out(self) -> list[str]:
        """How the recording's set-up differs from its description or from the profile's room, in words."""
        said = [f"rig turned by {self.turn_deg:+.1f} degrees"] if round(self.turn_deg, 1) else []
        if self.shift_cm or self.background:
            where = "farther away" if self.shift_cm > 0 else "nearer"
            said.append(f"set down {abs(10 * self.shift_cm):.1f} mm {where}")
            said.append(f"the room's infrared adds {self.background:+.5f}/cm² to that of the profile's room")
        if self.painted:
            said.append(f"a surface that reflects {self.reflectance:.2f} times as much as the profile's")
        return said

    @property
    def noise_fits(self) -> bool | None:
        """Whether every measured noise deviation agrees with the profile's; None: none could be measured."""
        pairs = [(m, p) for m, p in self.noise.values() if np.isfinite(m)]
        return all(p <= FITS * m and m <= FITS * p for m, p in pairs) if pairs else None

    @property
    def ratio(self) -> float:
        """Model error over noise of all sensors where readings are neither dark nor saturated, the same
        figure as a calibration's for held-out places; NaN without such readings."""
        return misfit.lit_ratio(self.per_sensor)

    @property
    def ratio_placed(self) -> float:
        """The ratio without the error that places a millimetre off would explain; NaN like `misplaced`."""
        return misfit.without(self.ratio, self.misplaced)

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        sensors = [
            {
                "sensor": m.sensor, "rmse": m.rmse, "bias": m.bias, "model_error": m.error,
                "error_over_noise": m.ratio, "error_over_noise_lit": m.lit_ratio,
            }
            for m in self.per_sensor
        ]  # fmt: skip
        noise = {key: {"measured": m, "profile": p} for key, (m, p) in self.noise.items()}
        return {
            "kind": self.kind, "source": self.source, "rmse": self.rmse, "bias": self.bias,
            "error_over_noise_lit": self.ratio, "within_two_deviations": self.within,
            "explained_by_places_1_mm_off": self.misplaced,
            "model_error_over_noise_without_them": self.ratio_placed,
            "per_sensor": sensors, "noise": {**noise, "fits": self.noise_fits},
            "turn_deg": self.turn_deg, "shift_cm": self.shift_cm,
            "background": self.background, "brightness": self.brightness, "reflectance": self.reflectance,
            "warnings": list(self.warnings),
        }  # fmt: skip


def judge(recording: Recording, profile: Profile) -> Judgement:
    """Judge a profile by a recording; a rig's rotation (and an unknown lamp's brightness) is fitted out.

    Raises:
        RecordingError: the profile has another number of sensors, or another full scale.
    """
    if isinstance(recording, WheelRecording):
        return _judge_wheels(recording, profile)
    recording = _of_a_tables_surface(recording.of_robot(profile), profile)
    part = profile.channel(recording.kind)
    dead, warnings = _doubts(recording, profile)
    live = [k for k in checks.recorded(recording) if k not in dead]
    paint = math.isnan(recording.reflectance)
    scene, (turn, scale, shift, light) = forward.scene_of(recording), (0.0, 1.0, 0.0, 0.0)
    with one_thread():
        if recording.from_sensor is None:
            turn, scale, model = _fitted_out(recording, profile, scene, live)
        else:
            shift, light, model = _set_up(recording, profile, scene)
    known = np.where(np.isin(np.arange(recording.sensors), live), recording.counts, np.nan)
    lively = replace(recording, counts=known)
    estimates = misfit.measure_noise([lively], [model], part.top, profile.infrared.dead)
    stated = misfit.stated_noise(lively, model, profile)
    noise = {e.channel: (e.deviation, stated[e.channel]) for e in estimates}
    of_noise = misfit.yardstick(recording.kind, estimates, stated, profile)
    deviation = of_noise.deviation
    warnings += () if of_noise.measured else (f"{recording.source}: {unmeasured(deviation)}",)
    off = (model - recording.counts)[:, live]
    change = np.full(known.shape, np.nan)
    if recording.kind == "infrared" and not profile.infrared.table:
        change = misfit.displaced(recording, profile, scene.painted(scale) if paint else scene, turn)
    found = misfit.misfits(recording.counts, model, recording.place(), of_noise)
    return Judgement(
        kind=recording.kind, source=recording.source, rmse=float(np.sqrt((off**2).mean())),
        bias=float(off.mean()), per_sensor=tuple(m for m in found if m.sensor in live), noise=noise,
        turn_deg=turn, shift_cm=shift, background=light, brightness=1.0 if paint else scale,
        reflectance=scale if paint else recording.reflectance, painted=paint,
        within=misfit.within(known, model, recording.place(), of_noise),
        misplaced=misfit.explained(change, known, recording.place(), part.top, deviation),
        counts=recording.counts, model=model, warnings=warnings,
    )  # fmt: skip


def _of_a_tables_surface(recording: SensorRecording, profile: Profile) -> SensorRecording:
    """A copy whose object is as white as those of a look-up table, which knows no other, and a warning."""
    if recording.kind != "infrared" or not profile.infrared.table or recording.reflectance == 1.0:
        return recording
    told = f"{recording.source}: reflectance: a look-up table has no data on other surfaces than its own"
    said = f"{told}; the {recording.object} is taken to be like those"
    return replace(recording, reflectance=1.0, warnings=(*recording.warnings, said))


def _doubts(recording: SensorRecording, profile: Profile) -> tuple[dict[int, str], tuple[str, ...]]:
    """Dead sensors, and the warnings or refusals of a calibration in words."""
    dead: dict[int, str] = {}
    top = profile.channel(recording.kind).top
    said = list(recording.warnings)
    try:
        checks.refuse_other_kind(recording, top)
        checks.refuse_units(recording, top)
        gone = checks.dead_sensors(recording, top)
        said += [f"{recording.source}: {reason}" for reason in gone.values()]
        checks.refuse_silent([recording], [gone], top)
        dead = gone
        said += checks.refuse_swapped(recording, profile, dead)
    except CalibrationError as error:  # it may name reasons that have been given
        said = [one for one in said if one.removeprefix(f"{recording.source}: ") not in str(error)]
        said.append(str(error))
    return dead, tuple(dict.fromkeys(said))


def _fitted_out(
    recording: SensorRecording, profile: Profile, scene: Scene, live: list[int]
) -> tuple[float, float, Floats]:
    """The rig's rotation (degrees), the brightness of an unknown lamp or reflectance of an unknown surface,
    and the model's readings with both."""
    from scipy.optimize import least_squares

    known = recording.pose is not None and recording.arena is not None
    straight = known or (recording.exact and profile.infrared.measured)
    lamp = recording.kind == "ambient" and not known
    paint = math.isnan(recording.reflectance)

    def readings(theta: Floats) -> Floats:
        turn = 0.0 if straight else float(theta[0])
        if recording.kind == "infrared":
            return forward.proximity(profile, scene.painted(math.exp(theta[1])) if paint else scene, turn)
        scale = float(np.exp(theta[1])) if lamp else 1.0
        law = profile.ambient
        sensors = tuple(replace(s, gain=s.gain * scale) for s in law.sensors)
        made = replace(profile, ambient=replace(law, sensors=sensors))
        return forward.light_readings(made, forward.illumination(profile, scene, turn))

    if known or (straight and not (lamp or paint)):
        return 0.0, 1.0, readings(np.zeros(2))
    size = 2 if lamp or paint else 1
    scales = np.linspace(-14, 14, 15) if lamp else np.linspace(-3, 2, 11) if paint else (0.0,)
    starts = [np.array([0.0, s])[:size] for s in scales]

    def residuals(theta: Floats) -> Floats:
        return np.asarray((readings(theta) - recording.counts)[:, live].ravel())

    start = min(starts, key=lambda theta: float((residuals(theta) ** 2).sum()))

    def slopes(theta: Floats) -> Floats:
        """By differences; readings are in single precision."""
        here = residuals(theta)
        moved = [residuals(theta + step) - here for step in STEP * np.eye(size)]
        return np.stack(moved, axis=1) / STEP

    found = least_squares(
        residuals,
        start, jac=slopes, bounds=([-10.0, -30.0][:size], [10.0, 30.0][:size]),
        x_scale=[1.0, 0.1][:size], max_nfev=12,
    )  # fmt: skip
    return float(found.x[0]), float(np.exp(found.x[1])) if size > 1 else 1.0, readings(found.x)


def _set_up(recording: SensorRecording, profile: Profile, scene: Scene) -> tuple[float, float, Floats]:
    """Most likely extra distance (cm) and background light beyond the profile's (1/cm²), with a calibration's
    priors; and the profile's readings [n, S] there."""
    law, use = profile.infrared, np.isfinite(recording.counts)
    if not law.measured:
        return 0.0, 0.0, forward.proximity(profile, scene)
    silent = (recording.counts <= 0) & (law.dead > 0)

    def readings(values: Values) -> Floats:
        away, more = float(values["shift"][0]), float(values["light"][0])
        return forward.lit_readings(profile, scene, more, away_cm=away)

    def told(values: Values) -> Floats:
        return np.where(silent, np.maximum(readings(values) - law.dead, 0.0), readings(values))

    # Like a calibration, it uses the places' means.
    noise = BY_HAND * law.top * np.sqrt(np.median(np.bincount(recording.place())))
    measured = Measured(
        counts=np.nan_to_num(recording.counts), noise=float(noise), use=use, clusters=recording.place()
    )
    lit = {**LIGHT, "low": -LIGHT["high"]}
    frees = [Free(key="shift", start=np.zeros(1), **SHIFT), Free(key="light", start=np.zeros(1), **lit)]
    found = solve(frees, told, measured, intervals=False).values
    model = readings(found)
    return float(found["shift"][0]), float(found["light"][0]), np.where(model < law.dead, 0.0, model)


def _judge_wheels(recording: WheelRecording, profile: Profile) -> Judgement:
    if not (recording.counted or recording.followed):
        raise CalibrationError(
            f"{recording.source}: no counters, nor pictures of {FOLLOWED_STEPS} successive steps: nothing "
            "tells how far the wheels turned. Leave it out."
        )
    said = list(recording.warnings)
    recording = recording.of_robot(profile)
    odometry = measure_odometry(recording, profile.wheels.track_cm)
    per_pulse = profile.provenance.cm_per_pulse(recording.pulses_per_mm)
    measured = measured_speeds(recording, odometry, per_pulse)
    refuse_few_steps(recording, measured)
    model = forward.wheel_speeds(profile, recording)
    if not (odometry or recording.pulses_said or profile.provenance.pulses_per_mm):
        said.append(
            f"{recording.source}: pulses_per_mm: neither it nor profile {profile.name!r} has them: "
            f"a Khepera's {recording.pulses_per_mm:g} are assumed"
        )
    try:
        refuse_odd(recording, odometry, profile)
    except CalibrationError as error:  # a calibration would refuse it
        said.append(str(error))
    off = model - measured
    rmse, bias = np.sqrt(np.nanmean(off**2, axis=0)), np.nanmean(off, axis=0)
    sides = tuple(
        Misfit(sensor=w, rmse=r, bias=b, error=r, ratio=np.nan, lit_ratio=np.nan)
        for w, (r, b) in enumerate(zip(rmse.tolist(), bias.tolist(), strict=True))
    )
    return Judgement(
        kind="wheels", source=recording.source, rmse=float(np.sqrt((rmse**2).mean())),
        bias=float(bias.mean()),
        per_sensor=sides, noise={"wheel": (odometry.slip, profile.noise.wheel)} if odometry else {},
        counts=measured, model=model, warnings=tuple(dict.fromkeys(said)),
    )  # fmt: skip
