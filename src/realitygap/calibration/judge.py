"""How far a model is from readings: RMSE, bias, and model error over noise, for each sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.forward import (
    Scene,
    illumination,
    light_readings,
    proximity,
    scene_of,
    wheel_speeds,
)
from realitygap.calibration.noise import NoiseEstimate, dark_noise, lit_noise, sample_noise
from realitygap.calibration.odometry import measure_odometry
from realitygap.calibration.recording import SensorRecording, WheelRecording
from realitygap.calibration.wheels import PULSES_PER_CM, measured_speeds
from realitygap.errors import CalibrationError

if TYPE_CHECKING:
    from realitygap.calibration.recording import Recording
    from realitygap.world.profile import Profile

__all__ = ["LIMITS", "Judgement", "Misfit", "judge", "measure_noise", "misfits"]

Array = NDArray[np.float64]

LIMITS = {"infrared": 2.0, "ambient": 1.0}
"""Model error over noise deviation, beyond which the level of noise can explain nothing."""
FITS = 1.25
"""A measured noise deviation within this factor of the profile's fits it."""


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """One sensor: model minus measured, counts.

    `error` is what is left of the RMSE of each place's mean without the noise; `ratio` is that over the
    noise's deviation, `lit_ratio` the same where readings are neither dark nor saturated.
    """

    sensor: int
    rmse: float
    bias: float
    error: float
    ratio: float
    lit_ratio: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Judgement:
    """A profile against one recording: counts, or cm/s for wheels."""

    kind: str
    source: str
    rmse: float
    bias: float
    per_sensor: tuple[Misfit, ...]
    noise: dict[str, tuple[float, float]]
    turn_deg: float
    brightness: float
    counts: Array = field(repr=False)
    model: Array = field(repr=False)

    @property
    def noise_fits(self) -> bool | None:
        """Whether every deviation that could be measured fits the profile's; None: none could."""
        pairs = [(m, p) for m, p in self.noise.values() if np.isfinite(m)]
        return all(p > 0 and 1 / FITS <= m / p <= FITS for m, p in pairs) if pairs else None

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
            "per_sensor": sensors, "noise": {**noise, "fits": self.noise_fits},
            "turn_deg": self.turn_deg, "brightness": self.brightness,
        }  # fmt: skip


def judge(recording: Recording, profile: Profile) -> Judgement:
    """Judge a profile by a recording; a rig's turn (and an unknown lamp's brightness) is fitted out.

    Raises:
        CalibrationError: the profile has another number of sensors.
    """
    if isinstance(recording, WheelRecording):
        return _judge_wheels(recording, profile)
    part = profile.infrared if recording.kind == "infrared" else profile.ambient
    if len(part.sensors) != recording.sensors:
        raise CalibrationError(
            f"{recording.source}: expected {len(part.sensors)} sensors, as profile {profile.name!r} has, "
            f"got {recording.sensors}."
        )
    scene = scene_of(recording)
    turn, brightness, model = _fitted_out(recording, profile, scene)
    estimates = measure_noise([recording], [model])
    stated = {
        "proximity": profile.noise.proximity,
        "proximity_dark": profile.noise.proximity_dark,
        "ambient": profile.noise.ambient,
    }
    noise = {e.channel: (e.deviation, stated[e.channel]) for e in estimates}
    main = "proximity" if recording.kind == "infrared" else "ambient"
    deviation = noise.get(main, (stated[main], 0.0))[0]
    off = model - recording.counts
    return Judgement(
        kind=recording.kind,
        source=recording.source,
        rmse=float(np.sqrt((off**2).mean())),
        bias=float(off.mean()),
        per_sensor=misfits(recording.counts, model, recording.place(), recording.kind, deviation),
        noise=noise,
        turn_deg=turn,
        brightness=brightness,
        counts=recording.counts,
        model=model,
    )


def _fitted_out(recording: SensorRecording, profile: Profile, scene: Scene) -> tuple[float, float, Array]:
    """The rig's turn (degrees), an unknown lamp's brightness, and the model's readings with both."""
    from dataclasses import replace

    from scipy.optimize import least_squares

    known = recording.pose is not None and recording.arena is not None
    lamp = recording.kind == "ambient" and not known

    def readings(theta: Array) -> Array:
        turn = 0.0 if known else float(theta[0])
        if recording.kind == "infrared":
            return proximity(profile, scene, turn)
        scale = float(np.exp(theta[1])) if lamp else 1.0
        law = profile.ambient
        sensors = tuple(replace(s, gain=s.gain * scale) for s in law.sensors)
        made = replace(profile, ambient=replace(law, sensors=sensors))
        return light_readings(made, illumination(profile, scene, turn))

    if known:
        return 0.0, 1.0, readings(np.zeros(2))
    size = 2 if lamp else 1
    starts = [np.array([0.0, s])[:size] for s in (np.linspace(-14, 14, 15) if lamp else (0.0,))]
    start = min(starts, key=lambda theta: float(((readings(theta) - recording.counts) ** 2).sum()))

    def residuals(theta: Array) -> Array:
        return np.asarray((readings(theta) - recording.counts).ravel())

    found = least_squares(
        residuals,
        start, bounds=([-10.0, -30.0][:size], [10.0, 30.0][:size]), diff_step=[1e-3, 1e-3][:size],
        x_scale=[1.0, 0.1][:size], max_nfev=12,
    )  # fmt: skip
    return float(found.x[0]), float(np.exp(found.x[1])) if lamp else 1.0, readings(found.x)


def measure_noise(recordings: Sequence[SensorRecording], models: Sequence[Array]) -> list[NoiseEstimate]:
    """Noise of recordings of one kind, pooled: lit and dark proximity, or ambient."""
    samples, first = [], 0
    for recording, model in zip(recordings, models, strict=True):
        sample = sample_noise(
            recording.counts,
            model,
            recording.place(),
            distance=recording.distance_cm,
            bearing=recording.bearing_deg,
        )
        samples.append((sample, first))
        first += len(recording.counts)
    joined = type(samples[0][0])(
        z=np.concatenate([s.z for s, _ in samples]),
        level=np.concatenate([s.level for s, _ in samples]),
        model=np.concatenate([s.model for s, _ in samples]),
        group=np.concatenate([s.group + shift for s, shift in samples]),
    )
    if recordings[0].kind == "ambient":
        found = [lit_noise(joined, "ambient")]
    else:
        counts = np.concatenate([r.counts for r in recordings])
        place = np.concatenate([r.place() + shift for r, (_, shift) in zip(recordings, samples, strict=True)])
        found = [lit_noise(joined, "proximity"), dark_noise(counts, np.concatenate(models), place)]
    return [estimate for estimate in found if estimate is not None]


def misfits(
    counts: Array, model: Array, place: NDArray[np.int64], kind: str, deviation: float
) -> tuple[Misfit, ...]:
    """Each sensor's misfit; the noise of a place's mean is taken out of the model's error."""
    many = np.bincount(place)
    mean = np.stack([np.bincount(place, column) for column in counts.T], 1) / many[:, None]
    said = np.stack([np.bincount(place, column) for column in model.T], 1) / many[:, None]
    off = said - mean
    low, high = (3 * deviation, 1023 - 3 * deviation) if kind == "infrared" else (-np.inf, np.inf)
    lit = (mean > low) & (mean < high)
    noisy = deviation**2 / many[:, None] * np.where(lit, 1.0, 0.0)
    out = []
    for k in range(counts.shape[1]):
        error = np.sqrt(max(0.0, float((off[:, k] ** 2 - noisy[:, k]).mean())))
        some = lit[:, k]
        in_light = (
            np.sqrt(max(0.0, float((off[some, k] ** 2 - noisy[some, k]).mean()))) if some.any() else np.nan
        )
        raw = model[:, k] - counts[:, k]
        out.append(
            Misfit(
                sensor=k, rmse=float(np.sqrt((raw**2).mean())), bias=float(raw.mean()), error=float(error),
                ratio=float(error / max(deviation, 1e-9)), lit_ratio=float(in_light / max(deviation, 1e-9)),
            )
        )  # fmt: skip
    return tuple(out)


def _judge_wheels(recording: WheelRecording, profile: Profile) -> Judgement:
    odometry = measure_odometry(recording, PULSES_PER_CM, profile.wheels.track_cm)
    stated = profile.provenance.pulses_per_mm
    per_pulse = (0.1 / stated[0], 0.1 / stated[1]) if len(stated) == 2 else (1 / PULSES_PER_CM,) * 2
    measured = measured_speeds(recording, odometry.cm_per_pulse if odometry else per_pulse)
    model = wheel_speeds(profile, recording)
    off = model - measured
    rmse, bias = np.sqrt(np.nanmean(off**2, axis=0)), np.nanmean(off, axis=0)
    sides = tuple(
        Misfit(
            sensor=w,
            rmse=float(rmse[w]),
            bias=float(bias[w]),
            error=float(rmse[w]),
            ratio=np.nan,
            lit_ratio=np.nan,
        )
        for w in range(2)
    )
    return Judgement(
        kind="wheels", source=recording.source, rmse=float(np.sqrt((rmse**2).mean())),
        bias=float(bias.mean()),
        per_sensor=sides, noise={"wheel": (odometry.slip, profile.noise.wheel)} if odometry else {},
        turn_deg=0.0, brightness=1.0, counts=measured, model=model,
    )  # fmt: skip
