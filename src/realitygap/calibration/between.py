"""Noise between recordings: how readings at the same places differ from one day, set-down or unit to another.

A recording's own noise is white from step to step; this one is drawn once a trial (`--noise-between`).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from realitygap.calibration import model
from realitygap.calibration.fit import SIGMAS, Values
from realitygap.calibration.model import table_at
from realitygap.calibration.noise import FEWEST, KNOTS, Sample, table_of
from realitygap.calibration.readings import Readings, at_places
from realitygap.calibration.recordings import CHANNELS, SensorRecording
from realitygap.values import Floats
from realitygap.world.robot import Profile


def with_between(
    profile: Profile, data: Readings, values: Values, *, measured: bool
) -> tuple[Profile, float]:
    """The profile with the noise between recordings of the same places, and its deviation (counts): what a
    new day or set-down adds; gains and starts of their own, among the fit's `values`, are taken out. NaN: too
    few places are shared.

    Where the noise of one recording was not `measured`, the spread holds both: half of its square at most is
    taken for one recording's.
    """
    kind, knots = data.kind, KNOTS["infrared"][0]
    own = {key: value for key, value in values.items() if key.startswith((model.GAIN, model.START))}
    scenes = [scene for _, scene in model.scenes_of(data.recordings)]
    law: Any = profile.channel(kind)
    if own:
        said = [model.proximity(profile, scene.tried(own)) for scene in scenes]
    else:
        said = [np.zeros_like(r.counts) for r in data.recordings]
    sample = between_recordings(data.live_recordings(), said)
    if len(sample.z) < FEWEST:
        return replace(profile, **{kind: replace(law, between=())}) if law.between else profile, np.nan
    repeats = float(np.median(np.bincount(data.place)))
    within = within_table(profile, kind, knots) / np.sqrt(repeats)
    table, whole = between_table(sample, within, data.top)
    law = replace(law, between=tuple(np.minimum(table, data.top).round(3).tolist()))
    if not measured:
        spread, _ = between_table(sample, 0.0 * within, data.top)
        own = np.minimum(within, spread / np.sqrt(2.0))
        table = np.sqrt(spread**2 - own**2)
        rows = tuple(own.round(3).tolist())
        sensors = tuple(replace(s, noise=rows, noise_rise=0.0) for s in law.sensors)
        law = replace(law, sensors=sensors, between=tuple(np.minimum(table, data.top).round(3).tolist()))
    return replace(profile, **{kind: law}), whole


def between_recordings(recordings: Sequence[SensorRecording], models: Sequence[Floats]) -> Sample:
    """How readings [m, 1] at the same places differ from one recording to another, beyond what the models
    [n, S] of each say; `group` numbers places and sensors."""
    at: dict[tuple[object, ...], list[tuple[float, float]]] = {}
    for recording, said in zip(recordings, models, strict=True):
        place = recording.place()
        first = np.unique(place, return_index=True)[1]
        use = np.isfinite(recording.counts)
        many = at_places(use, place)
        read, model = (
            at_places(np.where(use, t, 0.0), place) / np.maximum(many, 1) for t in (recording.counts, said)
        )
        where = np.stack([recording.distance_cm, recording.bearing_deg], 1)
        where = (where if recording.pose is None or recording.from_sensor is not None else recording.pose)[
            first
        ]
        for i, k in np.argwhere(many > 0).tolist():
            key = (recording.object, k, *np.round(where[i], 3).tolist())
            at.setdefault(key, []).append((read[i, k], read[i, k] - model[i, k]))
    z, level, group = [], [], []
    for number, pairs in enumerate(at.values()):
        (mean, centre), n = np.mean(pairs, axis=0), len(pairs)
        if n > 1:
            z += [(off - centre) * np.sqrt(n / (n - 1)) for _, off in pairs]
            level += [mean] * n
            group += [number] * n
    return Sample(z=np.reshape(z, (-1, 1)), level=np.reshape(level, (-1, 1)), group=np.array(group, np.int64))


def between_table(sample: Sample, within: Floats, top: float) -> tuple[Floats, float]:
    """The deviation between recordings at equal steps of the reading, and in all, of a `sample` of theirs;
    `within` [knots] is the part of it that a recording's own noise makes."""
    knots = len(within)
    spread = table_of(sample, np.isfinite(sample.z), top, knots)[0]
    own = np.interp(sample.level / top, np.linspace(0.0, 1.0, knots), within)
    whole = float(np.mean(sample.z**2) - np.mean(own**2))
    return np.sqrt(np.maximum(spread**2 - within**2, 0.0)), float(np.sqrt(max(whole, 0.0)))


def within_table(profile: Profile, kind: str, knots: int) -> Floats:
    """[knots] the stated noise of a recording at equal steps of the reading: RMS over the sensors."""
    part, share = profile.channel(kind), np.linspace(0.0, 1.0, knots)[:, None]
    if not any(sensor.noise for sensor in part.sensors):
        return np.full(knots, profile.noise.to_dict()[CHANNELS[kind]])
    rows = np.broadcast_to(share, (knots, len(part.sensors)))
    return np.asarray(np.sqrt(np.mean(table_at([s.noise for s in part.sensors], rows) ** 2, axis=1)))


def between_at(model: Floats, profile: Profile, kind: str) -> Floats:
    """[n, S] the stated deviation between recordings at a model's readings."""
    part = profile.channel(kind)
    steps = np.linspace(0.0, 1.0, len(part.between) or 1)
    return np.asarray(np.interp(model / part.top, steps, part.between or (0.0,)))


def covered(counts: Floats, model: Floats, profile: Profile, kind: str) -> float:
    """Share of readings [n, S] that lie within 95 % of the stated noise, within and between recordings, about
    the model's; those at an end of the scale, where the model is too, do not count. NaN without any."""
    part = profile.channel(kind)
    at = np.clip(model / part.top, 0.0, 1.0)
    if any(sensor.noise for sensor in part.sensors):
        size = table_at([s.noise for s in part.sensors], at)
    else:
        stated = profile.noise.to_dict()
        size = np.where(
            (model > 0) | (kind == "ambient"), stated[CHANNELS[kind]], profile.noise.proximity_dark
        )
    size = np.hypot(size, between_at(model, profile, kind))
    low, high = (counts <= 0) & (model <= 0), (counts >= part.top) & (model >= part.top)
    use = np.isfinite(counts) & ~(low | high)
    return (
        float((np.abs(model - counts) <= SIGMAS * np.maximum(size, 0.3))[use].mean()) if use.any() else np.nan
    )
