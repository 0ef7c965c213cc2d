"""Judges a profile by recordings: RMSE, bias, and model error over noise, for each sensor."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from realitygap.calibration import model
from realitygap.calibration import noise as misfit
from realitygap.calibration.between import between_at, covered
from realitygap.calibration.fit import Observed, Parameter, Values, costs, fit, value_of
from realitygap.calibration.measured import BY_HAND, LIGHT, SHIFT
from realitygap.calibration.model import Scene, unchecked
from realitygap.calibration.noise import LIMITS, Misfit, unmeasured
from realitygap.calibration.odometry import measure_odometry, measured_speeds
from realitygap.calibration.readings import (
    dead_sensors,
    places_of,
    recorded,
    refuse_silent,
    refuse_slips,
    refuse_swapped,
)
from realitygap.calibration.recordings import (
    FIRST_NOISE,
    FOLLOWED_STEPS,
    Recording,
    SensorRecording,
    WheelRecording,
    count_unit,
    reaching,
    sets_of,
)
from realitygap.calibration.sets import PAYS, in_words, own_constants
from realitygap.calibration.wheels import refuse_few_steps, refuse_lengths, refuse_odd
from realitygap.errors import CalibrationError
from realitygap.values import Floats
from realitygap.work.pool import one_thread
from realitygap.world.robot import Profile

__all__ = ["LIMITS", "Judgement", "judge", "judge_all"]

STEP = 0.01
"""Degrees, or the logarithm of a brightness, over which a difference is taken."""
FITS = 1.25
"""A measured noise deviation within this factor of the profile's agrees with it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Judgement:
    """A profile compared with one recording: counts, or cm/s for wheels.

    `per_sensor` and all sums leave out dead sensors; `warnings` name them and everything else that is
    doubtful. `within` is the share of lit places on which the model errs by at most two deviations of the
    noise: where it is near 1 and `ratio` is large, single places err. `covered` is the share of readings
    within 95 % of the profile's noise, within and `between` recordings (its deviation, counts; 0: unknown).
    `gain` and `start_cm` are another unit's, or start's, and `plain` the RMSE without them. For a series of
    one sensor facing a wall, `shift_cm` is its extra distance and `background` the room's infrared beyond the
    profile's (1/cm²); both are fitted out, as is the `reflectance` of an unknown surface (`painted`).
    `misplaced` is as of a calibration. `ends`: how far off (cm, degrees; medians) runs end that the profile's
    track and pulses predict from their first pose, the marker's place on the robot fitted out; None without
    poses.
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
    ends: tuple[float, float] | None = None
    within: float = math.nan
    misplaced: float = math.nan
    covered: float = math.nan
    between: float = 0.0
    gain: float = 1.0
    start_cm: float = 0.0
    plain: float = math.nan
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
        if words := in_words(self.gain, self.start_cm):
            said.append(f"{words} (RMSE {self.plain:.3g} without that)")
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
            "kind": self.kind, "source": self.source, "rmse": self.rmse, "bias": self.bias, "ends": self.ends,
            "error_over_noise_lit": self.ratio, "within_two_deviations": self.within,
            "explained_by_places_1_mm_off": self.misplaced,
            "model_error_over_noise_without_them": self.ratio_placed,
            "per_sensor": sensors, "noise": {**noise, "fits": self.noise_fits},
            "turn_deg": self.turn_deg, "shift_cm": self.shift_cm,
            "covered": self.covered, "between": self.between, "gain": self.gain, "start_cm": self.start_cm,
            "rmse_plain": self.plain,
            "background": self.background, "brightness": self.brightness, "reflectance": self.reflectance,
            "warnings": list(self.warnings),
        }  # fmt: skip


def judge(recording: Recording, profile: Profile) -> Judgement:
    """Judge a profile by a recording; a rig's rotation (and an unknown lamp's brightness) is fitted out.

    Raises:
        RecordingError: the profile has another number of sensors, or another full scale.
    """
    return judge_all([recording], profile)[0]


def judge_all(recordings: Sequence[Recording], profile: Profile) -> list[Judgement]:
    """Judge a profile by the recordings of a robot: what `judge` fits out, and for each set of them, where
    that pays on places left out, another unit's gain and start. Recordings with one bearing of each sensor
    have one rotation together, or none."""
    near = [r for r in recordings if isinstance(r, SensorRecording) and r.kind == "infrared"]
    with one_thread():
        common = _common_turn([r.of_robot(profile) for r in near], profile)
        found = {id(r): _judged(r, profile, common) for r in recordings}
        for first in dict.fromkeys(sets := sets_of(near)):
            some = [r for r, number in zip(near, sets, strict=True) if number == first]
            turns = [found[id(r)].turn_deg for r in some]
            gain, start = _own_constants([r.of_robot(profile) for r in some], profile, turns)
            if (gain, start) == (1.0, 0.0):
                continue
            others = [replace(r, gain=gain * r.gain, distance_cm=r.distance_cm + start) for r in some]
            again = [_judged(one, profile, common) for one in others]
            before, after = ([one.rmse for one in made] for made in ([found[id(r)] for r in some], again))
            # A room's light or a shift may do as well.
            if PAYS * np.linalg.norm(after) < np.linalg.norm(before):
                for r, one, plain in zip(some, again, before, strict=True):
                    found[id(r)] = replace(one, gain=gain, start_cm=start, plain=plain)
    return [found[id(r)] for r in recordings]


def _common_turn(near: Sequence[SensorRecording], profile: Profile) -> float:
    """The rotation (degrees) of the recordings that only together tell one."""
    some = [r for r, key in zip(near, model.rigs_of(near), strict=True) if key == model.TURN]
    if not some or profile.infrared.table:
        return 0.0
    scenes, counts = [model.scene_of(r) for r in some], np.concatenate([r.counts for r in some])
    data = Observed(
        counts=np.nan_to_num(counts), noise=FIRST_NOISE["infrared"] * count_unit(profile.infrared.top),
        use=np.isfinite(counts), clusters=places_of(some),
    )  # fmt: skip

    def readings(values: Values) -> Floats:
        turn = value_of(values, model.TURN)
        return np.concatenate([model.proximity(profile, scene, turn) for scene in scenes])

    return value_of(fit(model.turns([model.TURN]), readings, data, intervals=False).values, model.TURN)


def _own_constants(
    some: Sequence[SensorRecording], profile: Profile, turns: Sequence[float]
) -> tuple[float, float]:
    """Gain and start (cm) of a set of infrared recordings turned by `turns` (degrees); (1, 0) where they do
    not pay."""
    if profile.infrared.table or any(math.isnan(r.reflectance) for r in some):
        return 1.0, 0.0
    scenes, counts = [model.scene_of(r) for r in some], np.concatenate([r.counts for r in some])
    data = Observed(
        counts=np.nan_to_num(counts), noise=FIRST_NOISE["infrared"] * count_unit(profile.infrared.top),
        use=np.isfinite(counts), clusters=places_of(some),
    )  # fmt: skip

    def read(gain: float, start: float) -> Floats:
        pairs = zip(scenes, turns, strict=True)
        return np.concatenate([model.proximity(profile, s.brighter(gain), t, start) for s, t in pairs])

    return own_constants(read, data)


def _judged(recording: Recording, profile: Profile, common: float) -> Judgement:
    """The judgement of one recording; `common`: rotation (degrees) of a rig that it does not tell alone."""
    if isinstance(recording, WheelRecording):
        return _judge_wheels(recording, profile)
    recording = _of_a_tables_surface(recording.of_robot(profile), profile)
    profile = reaching([recording], profile)
    part = profile.channel(recording.kind)
    dead, warnings = _doubts(recording, profile)
    live = [k for k in recorded(recording) if k not in dead]
    paint = math.isnan(recording.reflectance)
    scene, (turn, scale, shift, light) = model.scene_of(recording), (0.0, 1.0, 0.0, 0.0)
    if recording.from_sensor is None:
        turn, scale, read = _fitted_out(recording, profile, scene, live, common)
    else:
        shift, light, read = _set_up(recording, profile, scene)
    at = [f"rig turned by {turn:+.0f} degrees"] * (abs(turn) > 0.999 * model.TURN_DEG)
    at += [f"set down {10 * shift:+.0f} mm away"] * (abs(shift) > 0.999 * SHIFT["high"])
    warnings += tuple(f"{recording.source}: {what}: at its bound; are the places right?" for what in at)
    known = np.where(np.isin(np.arange(recording.sensors), live), recording.counts, np.nan)
    lively = replace(recording, counts=known)
    estimates = misfit.measure_noise([lively], [read], part.top, profile.infrared.dead)
    stated = misfit.stated_noise(lively, read, profile)
    noise = {e.channel: (e.deviation, stated[e.channel]) for e in estimates}
    of_noise = misfit.yardstick(recording.kind, estimates, stated, profile)
    deviation = of_noise.deviation
    warnings += () if of_noise.measured else (f"{recording.source}: {unmeasured(deviation)}",)
    off = (read - recording.counts)[:, live]
    off = off[np.isfinite(off)]
    change = np.full(known.shape, np.nan)
    if recording.kind == "infrared" and not profile.infrared.table:
        change = misfit.displaced(recording, profile, scene.painted(scale) if paint else scene, turn)
    found = misfit.misfits(recording.counts, read, recording.place(), of_noise)
    return Judgement(
        kind=recording.kind, source=recording.source, rmse=float(np.sqrt((off**2).mean())),
        bias=float(off.mean()), per_sensor=tuple(m for m in found if m.sensor in live), noise=noise,
        turn_deg=turn, shift_cm=shift, background=light, brightness=1.0 if paint else scale,
        reflectance=scale if paint else recording.reflectance, painted=paint,
        within=misfit.within(known, read, recording.place(), of_noise),
        misplaced=misfit.explained(change, known, recording.place(), part.top, deviation),
        covered=covered(known, read, profile, recording.kind),
        between=float(np.sqrt(np.mean(between_at(read, profile, recording.kind)[np.isfinite(known)] ** 2))),
        counts=recording.counts, model=read, warnings=warnings,
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
        refuse_slips([recording], top)
        gone = dead_sensors(recording, top)
        said += [f"{recording.source}: {reason}" for reason in gone.values()]
        refuse_silent([recording], [gone], top)
        dead = gone
        refuse_swapped(recording, profile, dead)
    except CalibrationError as error:  # it may name reasons that have been given
        said = [one for one in said if one.removeprefix(f"{recording.source}: ") not in str(error)]
        said.append(str(error))
    return dead, tuple(dict.fromkeys(said))


def _fitted_out(
    recording: SensorRecording, profile: Profile, scene: Scene, live: list[int], common: float
) -> tuple[float, float, Floats]:
    """The rig's rotation (degrees), the brightness of an unknown lamp or reflectance of an unknown surface,
    and the model's readings with both."""
    known = recording.pose is not None and recording.arena is not None
    lamp, paint = recording.kind == "ambient" and not known, math.isnan(recording.reflectance)
    free, (rig,) = [], model.rigs_of([recording])
    if not (known or (recording.exact and profile.infrared.measured)):
        free += model.turns(["turn"]) if rig else []
    usual = 0.0 if rig or known or recording.exact else common
    if not known and (lamp or paint):
        free.append(Parameter(key="scale", start=np.zeros(1), low=-30.0, high=30.0, step=STEP))

    def readings(values: Values) -> Floats:
        turn, scale = value_of(values, "turn") or usual, math.exp(value_of(values, "scale"))
        if recording.kind == "infrared":
            return model.proximity(profile, scene.painted(scale) if paint else scene, turn)
        law = profile.ambient
        sensors = tuple(unchecked(s, gain=s.gain * scale) for s in law.sensors)
        made = unchecked(profile, ambient=unchecked(law, sensors=sensors))
        return model.light_readings(made, model.illumination(profile, scene, turn))

    if not free:
        return usual, 1.0, readings({})
    top = profile.channel(recording.kind).top
    use = np.isin(np.arange(recording.sensors), live) & np.isfinite(recording.counts)
    data = Observed(
        counts=np.nan_to_num(recording.counts), noise=FIRST_NOISE[recording.kind] * count_unit(top), use=use,
        clusters=recording.place(),
    )  # fmt: skip
    scales = np.linspace(-14, 14, 15) if lamp else np.linspace(-3, 2, 11) if paint else np.zeros(1)
    starts = [{"turn": np.zeros(1), "scale": np.array([scale])} for scale in scales]
    start = min(starts, key=lambda one: float(costs(readings(one), data).sum()))
    found = fit(free, readings, data, start=start, intervals=False)
    turn = value_of(found.values, "turn") or usual
    return turn, math.exp(value_of(found.values, "scale")), found.model


def _set_up(recording: SensorRecording, profile: Profile, scene: Scene) -> tuple[float, float, Floats]:
    """Most likely extra distance (cm) and background light beyond the profile's (1/cm²), with a calibration's
    priors; and the profile's readings [n, S] there."""
    law, use = profile.infrared, np.isfinite(recording.counts)
    if not law.measured:
        return 0.0, 0.0, model.proximity(profile, scene)
    silent = (recording.counts <= 0) & (law.dead > 0)

    def readings(values: Values) -> Floats:
        away, more = float(values["shift"][0]), float(values["light"][0])
        return model.lit_readings(profile, scene, more, away_cm=away)

    def told(values: Values) -> Floats:
        return np.where(silent, np.maximum(readings(values) - law.dead, 0.0), readings(values))

    # Like a calibration, it uses the places' means.
    noise = BY_HAND * law.top * np.sqrt(np.median(np.bincount(recording.place())))
    measured = Observed(
        counts=np.nan_to_num(recording.counts), noise=float(noise), use=use, clusters=recording.place()
    )
    lit = {**LIGHT, "low": -LIGHT["high"]}
    frees = [
        Parameter(key="shift", start=np.zeros(1), **SHIFT),
        Parameter(key="light", start=np.zeros(1), **lit),
    ]
    found = fit(frees, told, measured, intervals=False).values
    read = readings(found)
    return float(found["shift"][0]), float(found["light"][0]), np.where(read < law.dead, 0.0, read)


def _judge_wheels(recording: WheelRecording, profile: Profile) -> Judgement:
    if not (recording.counted or recording.followed):
        raise CalibrationError(
            f"{recording.source}: no counters, nor pictures of {FOLLOWED_STEPS} successive steps: nothing "
            "tells how far the wheels turned. Leave it out."
        )
    said = list(recording.warnings)
    recording = recording.of_robot(profile)
    try:
        odometry = measure_odometry(recording, profile)
    except CalibrationError as error:  # a calibration would refuse it
        if recording.from_commands:
            raise
        odometry = None
        said.append(str(error))
    per_pulse = profile.provenance.cm_per_pulse(recording.pulses_per_mm)
    if recording.in_units:
        per_pulse = profile.wheels.speed_per_unit_cm_s
    elif recording.from_speeds:
        per_pulse = (0.1 / recording.pulses_per_mm,) * 2
    measured = measured_speeds(recording, odometry, per_pulse)
    if recording.commanded:
        refuse_few_steps(recording, measured)
        read = model.wheel_speeds(profile, recording)
    else:
        read = np.full_like(measured, np.nan)
    if not (odometry or recording.pulses_said or profile.provenance.pulses_per_mm):
        said.append(
            f"{recording.source}: pulses_per_mm: neither it nor profile {profile.name!r} has them: "
            f"a Khepera's {recording.pulses_per_mm:g} are assumed"
        )
    try:
        if recording.commanded:
            refuse_odd(recording)
        if odometry is not None:
            refuse_lengths(recording, odometry, profile)
    except CalibrationError as error:  # a calibration would refuse it
        said.append(str(error))
    off = read - measured
    rmse = bias = np.full(2, np.nan)
    if recording.commanded:
        rmse, bias = np.sqrt(np.nanmean(off**2, axis=0)), np.nanmean(off, axis=0)
    ends = None
    if odometry is not None:
        theta = np.array([*per_pulse, profile.wheels.track_cm, *odometry.theta[3:]])
        ends = replace(odometry, theta=theta).ends(recording)
    sides = tuple(
        Misfit(sensor=w, rmse=r, bias=b, error=r, ratio=np.nan, lit_ratio=np.nan)
        for w, (r, b) in enumerate(zip(rmse.tolist(), bias.tolist(), strict=True))
        if recording.commanded
    )
    return Judgement(
        kind="wheels", source=recording.source, rmse=float(np.sqrt((rmse**2).mean())),
        bias=float(bias.mean()),
        per_sensor=sides, noise={"wheel": (odometry.slip, profile.noise.wheel)} if odometry else {},
        counts=measured, model=read, warnings=tuple(dict.fromkeys(said)),
        ends=None if ends is None else (float(np.median(ends[:, 0])), math.degrees(np.median(ends[:, 1]))),
    )  # fmt: skip
