"""Model error for each sensor, and the noise that it is compared with."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.forward import Scene, proximity, table_at
from realitygap.calibration.noise import NoiseEstimate, Sample, dark_noise, lit_noise, sample_noise
from realitygap.calibration.recordings import CHANNELS, FIRST_NOISE, SensorRecording, count_unit
from realitygap.calibration.rows import Rows, at_places, places_of
from realitygap.calibration.solve import Values, value_of
from realitygap.values import Floats
from realitygap.world.robot import Profile

__all__ = [
    "LIMITS", "Misfit", "Yardstick", "contradiction", "displaced", "explained", "lit_ratio", "measure_noise",
    "misfits", "misplaced", "pooled_noise", "stated_noise", "uneven_noise", "within", "without",
    "yardstick",
]  # fmt: skip

PLACED_CM = 0.1
"""Accuracy of places set by hand."""
LIMITS = {"infrared": 2.0, "ambient": 1.0}
"""Model error over noise deviation above which model error exceeds noise."""
DARK_SHARE, DARK_PLACES, SPREAD = 0.25, 8, 4.0
"""The share and the number of a sensor's places that read no more than its dark offset; and the range of such
readings in deviations of the noise."""

UNEVEN = 4.0
"""Ratio of the loudest sensor's noise to the quietest's from which on one figure for all misleads."""


@dataclass(frozen=True, kw_only=True)
class Yardstick:
    """The noise that a model's error is compared with: of "infrared" or "ambient" sensors.

    `top` is the converter's highest count, `deviation` the noise's (counts). It is subtracted from the error
    only if it was `measured`: an assumed one may exceed the whole residual. Below `dead` counts there are no
    readings: at places whose mean is there, noise decides which readings are 0.
    """

    kind: str
    top: float
    deviation: float
    measured: bool = True
    dead: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """One sensor: model minus measured, counts.

    `error` is the RMSE of the places' means with the noise removed; `ratio` is that over the noise's
    deviation, `lit_ratio` the same where readings are neither dark nor saturated.
    """

    sensor: int
    rmse: float
    bias: float
    error: float
    ratio: float
    lit_ratio: float


def measure_noise(
    recordings: Sequence[SensorRecording], models: Sequence[Floats], top: float, dead: float = 0.0
) -> list[NoiseEstimate]:
    """Noise of recordings of one kind, pooled: lit and dark proximity, or ambient.

    Args:
        recordings: of one kind.
        models: [n, S] of each, without noise.
        top: their full scale, counts.
        dead: counts below which a sensor reads 0.
    """
    joined = pooled_noise(recordings, models, top)
    if recordings[0].kind == "ambient":
        found = [lit_noise(joined, "ambient", top)]
    else:
        counts = np.concatenate([r.counts for r in recordings])
        dark = dark_noise(counts, np.concatenate(models), places_of(recordings), top)
        found = [lit_noise(joined, "proximity", top, dead), dark]
    return [estimate for estimate in found if estimate is not None]


def yardstick(
    kind: str, found: Sequence[NoiseEstimate], stated: Mapping[str, float], profile: Profile
) -> Yardstick:
    """The noise to compare errors with: what was measured, else what is stated, else the paper's robot's.

    Args:
        kind: of the recordings.
        found: by `measure_noise`.
        stated: deviations by channel.
        profile: of the robot.
    """
    channel, part = CHANNELS[kind], profile.channel(kind)
    measured = next((estimate.deviation for estimate in found if estimate.channel == channel), 0.0)
    deviation = measured or stated[channel] or FIRST_NOISE[kind] * count_unit(part.top)
    dead = profile.infrared.dead if kind == "infrared" else 0.0
    return Yardstick(kind=kind, top=part.top, deviation=deviation, measured=measured > 0, dead=dead)


def pooled_noise(recordings: Sequence[SensorRecording], models: Sequence[Floats], top: float) -> Sample:
    """The noise of recordings of one kind about the models' readings; rows are numbered through them all."""
    samples = [sample_noise(r, model, top) for r, model in zip(recordings, models, strict=True)]
    first = np.cumsum([0, *(len(r.counts) for r in recordings[:-1])])
    return Sample(
        z=np.concatenate([s.z for s in samples]),
        level=np.concatenate([s.level for s in samples]),
        group=np.concatenate([s.group + by for s, by in zip(samples, first, strict=True)]),
        row=np.concatenate([s.row + by for s, by in zip(samples, first, strict=True)]),
        tails=float(np.average([s.tails for s in samples], weights=[len(s.z) + 1 for s in samples])),
    )


def stated_noise(recording: SensorRecording, model: Floats, profile: Profile) -> dict[str, float]:
    """Deviations that a profile states, by channel, for comparison with those that `measure_noise` finds in a
    recording: of sensors with noise by the reading at that recording's readings."""
    part, stated = profile.channel(recording.kind), profile.noise.to_dict()
    if not any(sensor.noise for sensor in part.sensors):
        return stated
    sample = pooled_noise([recording], [model], part.top)
    table = table_at(np.array([sensor.noise for sensor in part.sensors]), sample.level / part.top)
    if recording.speed_cm_s is not None:
        rise = np.array([sensor.noise_rise for sensor in part.sensors])
        table = table * (1.0 + rise * recording.speed_cm_s[sample.row, None])
    channel = CHANNELS[recording.kind]
    said = replace(sample, z=np.where(np.isfinite(sample.z), table, np.nan))
    there = lit_noise(said, channel, part.top, profile.infrared.dead)
    return {**stated, channel: there.deviation} if there else stated


def uneven_noise(
    recordings: Sequence[SensorRecording], models: Sequence[Floats], top: float, dead: float = 0.0
) -> list[str]:
    """What to warn of, if proximity sensors have very different noise: the model's error is compared with one
    figure. Arguments as of `measure_noise`."""
    joined, sizes = pooled_noise(recordings, models, top), []
    for k in range(joined.z.shape[1]):
        own = replace(joined, z=joined.z[:, [k]], level=joined.level[:, [k]])
        found = lit_noise(own, "proximity", top, dead)
        sizes += [(found.deviation, k)] if found else []
    (least, quiet), (most, loud) = min(sizes, default=(0.0, 0)), max(sizes, default=(0.0, 0))
    if most <= UNEVEN * least:
        return []
    return [
        f"infrared: noise differs from sensor to sensor, from {least:.3g} counts (sensor {quiet}) to "
        f"{most:.3g} (sensor {loud}): errors are compared with one figure for all, beside which those of "
        "quiet sensors look too small"
    ]


def misfits(counts: Floats, model: Floats, place: NDArray[np.int64], noise: Yardstick) -> tuple[Misfit, ...]:
    """Each sensor's misfit, with the noise of a place's mean removed from the model's error.

    Args:
        counts, model: [n, S] readings, and the model's without noise.
        place: [n] the number of each row's place.
        noise: to compare the error with.
    """
    off, lit, many = _at_places(counts, model, place, noise)
    size = max(noise.deviation, 1e-9)
    noisy = noise.measured * noise.deviation**2 / many[:, None] * np.where(lit, 1.0, 0.0)

    def left(k: int, use: NDArray[np.bool_]) -> float:
        """RMS over some places, noise removed."""
        return float(np.sqrt(max(0.0, float((off[use, k] ** 2 - noisy[use, k]).mean()))))

    out = []
    for k in range(counts.shape[1]):
        known = np.isfinite(off[:, k])
        if not known.any():
            continue
        error, some = left(k, known), lit[:, k] & known
        in_light = left(k, some) if some.any() else np.nan
        raw = (model - counts)[np.isfinite(counts[:, k]), k]
        out.append(
            Misfit(
                sensor=k, rmse=float(np.sqrt((raw**2).mean())), bias=float(raw.mean()), error=error,
                ratio=error / size, lit_ratio=in_light / size,
            )
        )  # fmt: skip
    return tuple(out)


def lit_ratio(judged: Sequence[Misfit]) -> float:
    """Model error over noise of all sensors where readings are neither dark nor saturated; NaN without such
    readings."""
    told = [m.lit_ratio for m in judged if np.isfinite(m.lit_ratio)]
    return float(np.sqrt(np.mean(np.square(told)))) if told else np.nan


def within(counts: Floats, model: Floats, place: NDArray[np.int64], noise: Yardstick) -> float:
    """Share of mean readings, neither dark nor saturated, on which the model errs by at most two deviations
    of the noise; NaN without any. Arguments as of `misfits`."""
    off, lit, _ = _at_places(counts, model, place, noise)
    known = lit & np.isfinite(off)
    return float((np.abs(off[known]) <= 2.0 * noise.deviation).mean()) if known.any() else np.nan


def _at_places(
    counts: Floats, model: Floats, place: NDArray[np.int64], noise: Yardstick
) -> tuple[Floats, NDArray[np.bool_], NDArray[np.int64]]:
    """[m, S] model minus measured at each place, and whether it is lit there; [m] number of its readings."""
    many = np.bincount(place)
    mean, said = (at_places(table, place) / many[:, None] for table in (counts, model))
    if noise.kind != "infrared":
        return said - mean, np.isfinite(mean), many
    edge = 3 * noise.deviation
    lit = (mean > np.maximum(_dark(mean, noise.deviation) + edge, noise.dead)) & (mean < noise.top - edge)
    return said - mean, lit, many


def _dark(mean: Floats, deviation: float) -> Floats:
    """[S] reading of each sensor with nothing near, counts, from its places' means [m, S]: 0, unless the
    lowest of many places nearly agree and lie above the noise."""
    known = np.where(np.isfinite(mean), mean, np.inf)
    low = known <= known.min(axis=0) + SPREAD * deviation
    fewest = np.maximum(DARK_PLACES, DARK_SHARE * np.isfinite(mean).sum(axis=0))
    level = np.array([np.median(known[low[:, k], k]) for k in range(mean.shape[1])])
    return np.where((low.sum(axis=0) >= fewest) & np.isfinite(level) & (level > deviation), level, 0.0)


def misplaced(rows: Rows, profile: Profile, values: Values, deviation: float) -> float:
    """Change of lit readings, in noise deviations, if places set by hand are a millimetre off.

    Args:
        rows: readings and their places.
        profile, values: the fitted robot, and all fitted values, by name.
        deviation: of the noise, counts.
    """
    change = [
        displaced(recording, profile, scene.tried(values), value_of(values, name))
        for recording, (name, scene) in zip(rows.recordings, rows.scenes, strict=True)
    ]
    return explained(np.concatenate(change), rows.live(), rows.place, rows.top, deviation)


def displaced(recording: SensorRecording, profile: Profile, scene: Scene, turn: float) -> Floats:
    """[n, S] RMS change of readings if their places are a millimetre off, counts; NaN unless set by hand.

    Args:
        recording, profile, scene: the places, the robot, and the room they are in.
        turn: of the rig, degrees.
    """
    if recording.by_program or not (scene.bare or recording.from_sensor is not None):
        return np.full(recording.counts.shape, np.nan)
    there, *moved = (proximity(profile, scene, turn, away) for away in (0.0, -PLACED_CM, PLACED_CM))
    return np.asarray(np.sqrt(np.mean(np.square(np.array(moved) - there), axis=0)))


def explained(
    change: Floats, counts: Floats, place: NDArray[np.int64], top: float, deviation: float
) -> float:
    """RMS of a change [n, S] where readings [n, S] are neither dark nor saturated, in noise deviations; NaN
    without any. Other arguments as of `misplaced` and `misfits`."""
    mean = at_places(counts, place) / np.bincount(place)[:, None]
    edge, dark = 3 * deviation, _dark(mean, deviation)
    lit = (counts > dark + edge) & (counts < top - edge) & np.isfinite(change)
    return float(np.sqrt(np.mean(change[lit] ** 2))) / max(deviation, 1e-9) if lit.any() else np.nan


def without(ratio: float, misplaced: float) -> float:
    """What is left of a ratio without the part that `misplaced` explains."""
    return float(np.sqrt(np.maximum(ratio**2 - misplaced**2, 0.0)))


def contradiction(rows: Rows, deviation: float) -> float:
    """RMS deviation of recordings of the same lit places from their mean, counts: a lower bound on any
    model's error. NaN where no place was recorded twice."""
    read: dict[tuple[object, ...], list[float]] = {}
    edge = 3 * deviation
    for recording, counts in zip(rows.recordings, rows.split(rows.live()), strict=True):
        if recording.pose is not None and recording.from_sensor is None:
            continue
        where = (recording.object, recording.reflectance, recording.from_sensor)
        polar = np.column_stack([recording.distance_cm, recording.bearing_deg])
        for at in np.unique(polar, axis=0):
            mean = counts[(polar == at).all(axis=1)].mean(axis=0)
            for k in np.flatnonzero(np.isfinite(mean)).tolist():
                read.setdefault((*where, *at.tolist(), k), []).append(float(mean[k]))
    off = [
        one - float(np.mean(twice)) for twice in read.values() if len(twice) > 1
        for one in twice if edge < max(twice) and min(twice) < rows.top - edge
    ]  # fmt: skip
    return float(np.sqrt(np.mean(np.square(off)))) if off else np.nan
