"""Noise of the sensors, and the model error that is left beside it.

Repeated readings at a place measure noise directly. A table with one reading for each place shows it only as
disagreement of neighbouring bearings: in fourth differences of the model's residuals (lower ones still
contain some of the curve). A model's error is that of the places' means, with their noise taken out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.fit import Use
from realitygap.calibration.model import Scene, proximity, table_at
from realitygap.calibration.readings import at_places, places_of
from realitygap.calibration.recordings import CHANNELS, FIRST_NOISE, SensorRecording, count_unit
from realitygap.values import Floats
from realitygap.world.robot import Profile

CLEAR = 3.0
"""Only readings this many deviations away from the converter's ends are used."""
DARK_COUNTS = 15.0
"""The limit of dark readings: counts of the paper's robot."""
FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
STEEP = 40.0
"""Counts (of the paper's robot) from one bearing to the next beyond which an error of the bearing would look
like noise."""
CLOSE_DEG, CLOSE_CM = 8.0, 0.5
"""Largest separation of neighbours: further apart, the model's residual changes like noise."""
FEWEST, SCALINGS, LOUDEST = 30, 5, 1e4
"""Values from which on a sensor has a figure of its own; rounds in which sizes and the pooled table are
found; and the largest ratio of a sensor's squares to the pooled ones."""
KNOTS = {"infrared": (9, 33, 129), "ambient": (33, 129)}
"""Knots that a table of noise over the reading may have, the usual number first; more for light, whose
readings span less than half of the scale."""
CLEARLY, TELLING, OUTLYING = 3.0, 0.02, 5.0
"""A finer table must make readings left out likelier: by so many standard errors, and by so much a reading in
the mean (natural logarithms); deviations beyond the last count as that."""
FOLDS = 4
RESAMPLES = 200
BINS = 4
STEADY = 1.35
"""Ratio of the largest to the smallest deviation over the readings' range up to which noise counts as
independent of the reading."""
HEAVY = 1.0
"""Excess kurtosis from which tails are reported as heavier than normal."""
PLACED_CM = 0.1
"""Accuracy of places set by hand."""
LIMITS = {"infrared": 2.0, "ambient": 1.0}
"""Model error over noise deviation above which model error exceeds noise."""
DARK_SHARE, DARK_PLACES, SPREAD = 0.25, 8, 4.0
"""The share and the number of a sensor's places that read no more than its dark offset; and the range of such
readings in deviations of the noise."""
LIT_SENSORS = 0.5
"""Share of the sensors that must be lit somewhere for one figure to stand for all."""
UNEVEN = 4.0
"""Ratio of the loudest sensor's noise to the quietest's from which on one figure for all misleads."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample:
    """Noise at places: `z` [m, S] deviations, scaled to the noise's own; `level` [m, S] the readings there.

    `group` [m]: values of one group come from common readings. NaN where nothing was measured. `row` [m]: the
    reading's row. `tails`: share of the noise's excess kurtosis that remains in sums of several readings.
    """

    z: Floats
    level: Floats
    group: NDArray[np.int64]
    tails: float = 1.0
    row: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseEstimate:
    """Noise of one channel.

    Attributes:
        channel: "proximity", "proximity_dark" or "ambient".
        deviation, low, high: counts, with a 95 % interval.
        bins: (mean reading, deviation) over the range, in equal shares of the data.
        kurtosis: excess over the normal's, of one reading's noise.
        values: noise in deviations, for a picture.
    """

    channel: str
    deviation: float
    low: float
    high: float
    bins: tuple[tuple[float, float], ...]
    kurtosis: float
    values: Floats = field(repr=False)

    @property
    def depends(self) -> bool:
        """Whether the noise depends on the reading."""
        if self.channel == "proximity_dark":
            return False  # all its readings are equal: dark
        sizes = [size for _, size in self.bins if size > 0]
        return len(sizes) > 1 and max(sizes) > STEADY * min(sizes)

    @property
    def heavy(self) -> bool:
        """Whether its tails are heavier than normal."""
        return self.kurtosis > HEAVY


def sample_noise(recording: SensorRecording, model: Floats, top: float) -> Sample:
    """Noise [m, S] of a recording about the model's readings [n, S], from repeats or neighbouring bearings;
    `top` is the converter's highest count."""
    counts, place = recording.counts, recording.place()
    order = np.argsort(place, kind="stable")
    at, many = place[order], np.bincount(place)
    if np.median(many) >= 2:
        read, first = np.isfinite(counts[order]), np.searchsorted(at, np.arange(len(many)))
        sums = np.add.reduceat(np.where(read, counts[order], 0.0), first)
        each = np.add.reduceat(read.astype(float), first)
        mean = np.where(each > 0, sums / np.maximum(each, 1.0), np.nan)[at]
        spread = np.sqrt(each / np.maximum(each - 1, 1))[at]
        z = np.where(each[at] > 1, (counts[order] - mean) * spread, np.nan)
        return Sample(z=z, level=mean, group=at, row=order)
    return _from_neighbours(recording, model, top)


def _from_neighbours(recording: SensorRecording, model: Floats, top: float) -> Sample:
    """Fourth differences over bearings of the model's residuals, where readings are not steep.

    With too few bearings at a distance: over the distances of each bearing.
    """
    z, level, own = [], [], []
    counts, distance, bearing = recording.counts, recording.distance_cm, recording.bearing_deg
    reach = len(FOURTH) // 2
    rings = _rings(distance, bearing, close=CLOSE_DEG, turn=360.0)
    for rows, apart in rings or _rings(bearing, distance, close=CLOSE_CM):
        near = np.stack([np.roll(counts[rows], -k, 0) for k in range(-reach, reach + 1)])
        off = near - np.stack([np.roll(model[rows], -k, 0) for k in range(-reach, reach + 1)])
        steep = np.abs(near[-1] - near[0]) / (2 * reach) > STEEP * count_unit(top)
        z.append(
            np.where(steep | apart[:, None], np.nan, np.tensordot(FOURTH, off, 1) / np.linalg.norm(FOURTH))
        )
        # Any of them may be clipped: the one nearest to an end decides.
        level.append(np.where(near.mean(0) < top / 2, near.min(0), near.max(0)))
        own.append(rows)
    if not z:
        nothing = np.zeros((0, counts.shape[1]))
        return Sample(z=nothing, level=nothing, group=np.zeros(0, np.int64))
    return Sample(
        z=np.concatenate(z), level=np.concatenate(level), group=np.arange(sum(map(len, z))) // 4,
        row=np.concatenate(own), tails=float((FOURTH**4).sum() / (FOURTH**2).sum() ** 2),
    )  # fmt: skip


def _rings(
    same: Floats, by: Floats, *, close: float, turn: float = np.inf
) -> list[tuple[NDArray[np.int64], Use]]:
    """The rows of each value of one column, sorted by another, where there are enough of them; and whether
    each is further than `close` from its neighbours. With `turn` the last is followed by the first."""
    reach, found = len(FOURTH) // 2, []
    for one in np.unique(same[np.isfinite(same)]):
        rows = np.flatnonzero(same == one)
        if len(rows) < 4 * reach:
            continue
        rows = rows[np.argsort(by[rows], kind="stable")]
        ahead = np.diff(by[rows], append=by[rows[0]] + turn)
        apart = np.max([np.roll(ahead, k) for k in range(1 - reach, 1 + reach)], axis=0) > close
        if not apart.all():
            found.append((rows, apart))
    return found


def finest(sample: Sample, top: float, kind: str, *, constant: bool) -> int:
    """Knots of the table of noise that the readings bear out: the usual number or more; 0 where one figure
    does and is allowed (`constant`). Whole groups are left out in turn; a sensor's groups with a reading at
    either end of the scale, which cuts noise off, throughout."""
    groups, number = np.unique(sample.group, return_inverse=True)
    reading = sample.level + sample.z
    cut = ((sample.level <= 0) | (sample.level >= top) | (reading <= 0) | (reading >= top)) & np.isfinite(
        reading
    )
    known = np.isfinite(sample.z) & (at_places(cut, number) == 0)[number]
    if kind == "infrared":  # the dark has a figure of its own
        known &= sample.level > DARK_COUNTS * count_unit(top)
    fold = np.random.default_rng(0).permutation(len(groups))[number] % FOLDS

    def likelihood(knots: int) -> Floats:
        """[m] of each group under tables made without its fold."""
        out = np.zeros(sample.z.shape)
        for k in range(FOLDS):
            fits, judged = known & (fold != k)[:, None], known & (fold == k)[:, None]
            table = table_of(sample, fits, top, knots or 1)  # one figure a sensor
            size = table_at(table, np.nan_to_num(sample.level / top))
            size = np.maximum(size, 0.3)  # of rounding
            off = np.minimum(np.abs(sample.z) / size, OUTLYING)
            out = np.where(judged, -np.log(size) - off**2 / 2, out)
        return np.asarray(np.bincount(number, out.sum(axis=1)), float)

    best, *finer = ([0] if constant else []) + [*KNOTS[kind]]
    if known.sum() < 2 * FEWEST:
        return best
    least, many = likelihood(best), int(known.sum())
    for knots in finer:
        gain = likelihood(knots) - least
        if gain.sum() > CLEARLY * np.sqrt((gain**2).sum()) and gain.sum() > TELLING * many:
            best, least = knots, least + gain
    return best


def noise_tables(
    sample: Sample, counts: Floats, model: Floats, speed: Floats, top: float, *, knots: int, dead: float = 0.0
) -> tuple[Floats, Floats]:
    """Each sensor's deviation at equal steps of the reading [S, knots], and its rise with speed [S], s/cm;
    none where the wheels always stood, or never did.

    `counts`, `model` [n, S]: in the dark noise is cut off at 0, and readings above the dead zone are none of
    it; `speed` [m] of the wheels at each of the sample's values, cm/s.
    """
    known = np.isfinite(sample.z)
    moving = known & (speed > 0)[:, None]
    rise = np.zeros(sample.z.shape[1])
    if moving.any() and (known & ~moving).any():
        still = table_of(sample, known & ~moving, top, knots)
        size = np.abs(sample.z) / np.maximum(table_at(still, sample.level / top), 1e-9)
        for k in np.flatnonzero(moving.sum(axis=0) >= FEWEST).tolist():
            ratio = np.sqrt(np.mean(size[moving[:, k], k] ** 2))
            rise[k] = max(0.0, ratio - 1.0) / speed[moving[:, k]].mean()
    bare = replace(sample, z=sample.z / (1.0 + rise * speed[:, None]))
    table = table_of(bare, known, top, knots)
    for k in range(len(table)):
        dark = (model[:, k] <= 0.5) & (counts[:, k] < (dead or np.inf))
        if dark.sum() >= FEWEST:
            table[k, 0] = np.sqrt(2.0 * np.mean(counts[dark, k] ** 2))
    return np.minimum(table, top), rise


def table_of(sample: Sample, use: Use, top: float, knots: int) -> Floats:
    """[S, knots] deviations: squares averaged with triangular weights about each knot.

    Where a sensor has few values it follows the pooled table, scaled to its own noise elsewhere: some sensors
    of a robot are twenty times noisier than others.
    """
    at = np.where(use, np.clip(sample.level / top, 0.0, 1.0), 0.0) * (knots - 1)
    near = np.maximum(0.0, 1.0 - np.abs(at[..., None] - np.arange(knots))) * use[..., None]
    square = np.where(use, sample.z, 0.0)[..., None] ** 2
    sums, many = (near * square).sum(axis=0), near.sum(axis=0)
    all_many, each, loud = many.sum(axis=0), many.sum(axis=1), np.ones(len(sums))
    overall = sums.sum() / max(all_many.sum(), 1e-9)
    for _ in range(SCALINGS):
        all_sums = (sums / loud[:, None]).sum(axis=0)
        pooled = np.maximum((all_sums + FEWEST * overall / 10) / (all_many + FEWEST / 10), 1e-9)
        beside = np.clip((sums / pooled).sum(axis=1) / np.maximum(each, 1e-9), 1 / LOUDEST, LOUDEST)
        loud = beside ** (each / (each + FEWEST / 10))
        if each.any():  # a sensor without values is as all together
            loud *= each.sum() / (each * loud).sum()
    return np.asarray(np.sqrt((sums + FEWEST * loud[:, None] * pooled) / (many + FEWEST)))


def lit_noise(sample: Sample, channel: str, top: float, dead: float = 0.0) -> NoiseEstimate | None:
    """Noise of "proximity" where readings are neither dark, dead (below `dead`) nor saturated, of "ambient"
    everywhere. None: too few."""
    deviation = FIRST_NOISE["infrared"] * count_unit(top)
    use = np.isfinite(sample.z)
    if channel == "proximity":
        for _ in range(4):
            edge = CLEAR * deviation
            use = np.isfinite(sample.z) & (sample.level > max(edge, dead)) & (sample.level < top - edge)
            if use.sum() < FEWEST:
                return None
            deviation = float(np.sqrt(np.mean(sample.z[use] ** 2)))
    return _estimate(sample, use, channel)


def dark_noise(counts: Floats, model: Floats, place: NDArray[np.int64], top: float) -> NoiseEstimate | None:
    """Noise of proximity sensors with nothing in range, [n, S] readings and the model's: their spread."""
    use = (model <= 0) & (counts < 2 * DARK_COUNTS * count_unit(top))
    many = np.maximum(use.sum(axis=0), 1)
    mean = np.where(use, counts, 0.0).sum(axis=0) / many
    sample = Sample(z=counts - mean, level=counts, group=place)
    return _estimate(sample, use, "proximity_dark")


def _estimate(sample: Sample, use: Use, channel: str) -> NoiseEstimate | None:
    if use.sum() < FEWEST:
        return None
    z = np.where(use, sample.z, 0.0)
    square, many = (z**2).sum(axis=1), use.sum(axis=1)
    groups = np.unique(sample.group, return_inverse=True)[1]
    squares, counts = np.bincount(groups, square), np.bincount(groups, many)
    random = np.random.default_rng(0)
    drawn = random.integers(0, len(squares), (RESAMPLES, len(squares)))
    size = counts[drawn].sum(1)
    spread = np.sqrt(squares[drawn].sum(1)[size > 0] / size[size > 0])
    deviation = float(np.sqrt(square.sum() / many.sum()))
    unit = sample.z[use] / max(deviation, 1e-12)
    kurtosis = float(np.mean(unit**4) / max(float(np.mean(unit**2)) ** 2, 1e-12) - 3.0)
    return NoiseEstimate(
        channel=channel,
        deviation=deviation,
        low=float(np.quantile(spread, 0.025)),
        high=float(np.quantile(spread, 0.975)),
        bins=_bins(sample.level[use], sample.z[use]),
        kurtosis=kurtosis / sample.tails,
        values=unit,
    )


def _bins(level: Floats, z: Floats) -> tuple[tuple[float, float], ...]:
    order = np.argsort(level, kind="stable")
    parts = [part for part in np.array_split(order, BINS) if len(part) >= FEWEST]
    return tuple((float(level[part].mean()), float(np.sqrt(np.mean(z[part] ** 2)))) for part in parts)


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
    """Noise of recordings of one kind about the models' readings [n, S] of each, pooled: lit and dark
    proximity, or ambient."""
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
    """The noise to compare errors with: what was measured (`found`), else what is `stated`, else the paper's
    robot's."""
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


def by_sensor(sample: Sample, kind: str, top: float, dead: float = 0.0) -> dict[int, float]:
    """Each sensor's deviation where that could be measured; arguments as of `lit_noise`."""
    sizes: dict[int, float] = {}
    for k in range(sample.z.shape[1]):
        own = replace(sample, z=sample.z[:, [k]], level=sample.level[:, [k]])
        found = lit_noise(own, CHANNELS[kind], top, dead)
        sizes |= {k: found.deviation} if found else {}
    return sizes


def misfits(counts: Floats, model: Floats, place: NDArray[np.int64], noise: Yardstick) -> tuple[Misfit, ...]:
    """Each sensor's misfit of model and readings [n, S], with the noise of a place's mean removed."""
    off, lit, many = _at_places(counts, model, place, noise)
    size = max(noise.deviation, 1e-9)
    noisy = noise.measured * noise.deviation**2 / many * np.where(lit, 1.0, 0.0)

    def left(k: int, use: Use) -> float:
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
    """Model error over noise of all sensors where readings are neither dark nor saturated; NaN where fewer
    than half of the sensors have such readings."""
    told = [m.lit_ratio for m in judged if np.isfinite(m.lit_ratio)]
    few = len(told) < LIT_SENSORS * len(judged) or not told
    return np.nan if few else float(np.sqrt(np.mean(np.square(told))))


def within(counts: Floats, model: Floats, place: NDArray[np.int64], noise: Yardstick) -> float:
    """Share of mean readings, neither dark nor saturated, on which the model errs by at most two deviations
    of the noise; NaN without any. Arguments as of `misfits`."""
    off, lit, _ = _at_places(counts, model, place, noise)
    known = lit & np.isfinite(off)
    return float((np.abs(off[known]) <= 2.0 * noise.deviation).mean()) if known.any() else np.nan


def _at_places(
    counts: Floats, model: Floats, place: NDArray[np.int64], noise: Yardstick
) -> tuple[Floats, Use, Floats]:
    """[m, S] model minus measured at each place, whether it is lit there, and the number of its readings."""
    use = np.isfinite(counts)
    there = at_places(use, place)
    many = np.maximum(there, 1.0)
    said = at_places(np.where(use, model, 0.0), place) / many
    mean = np.where(there > 0, at_places(np.where(use, counts, 0.0), place) / many, np.nan)
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


def displaced(recording: SensorRecording, profile: Profile, scene: Scene, turn: float) -> Floats:
    """[n, S] RMS change of readings if their places are a millimetre off, counts; NaN unless set by hand."""
    if recording.by_program or not (scene.bare or recording.from_sensor is not None):
        return np.full(recording.counts.shape, np.nan)
    there, *moved = (proximity(profile, scene, turn, away) for away in (0.0, -PLACED_CM, PLACED_CM))
    return np.asarray(np.sqrt(np.mean(np.square(np.array(moved) - there), axis=0)))


def explained(
    change: Floats, counts: Floats, place: NDArray[np.int64], top: float, deviation: float
) -> float:
    """RMS of a change [n, S] where readings [n, S] are neither dark nor saturated, in noise deviations; NaN
    without any. Other arguments as of `misfits`."""
    use = np.isfinite(counts)
    with np.errstate(invalid="ignore"):
        mean = at_places(np.where(use, counts, 0.0), place) / at_places(use, place)
    edge, dark = 3 * deviation, _dark(mean, deviation)
    lit = (counts > dark + edge) & (counts < top - edge) & np.isfinite(change)
    return float(np.sqrt(np.mean(change[lit] ** 2))) / max(deviation, 1e-9) if lit.any() else np.nan


def without(ratio: float, misplaced: float) -> float:
    """What is left of a ratio without the part that `misplaced` explains."""
    return float(np.sqrt(np.maximum(ratio**2 - misplaced**2, 0.0)))


def unmeasured(deviation: float) -> str:
    """What it means that the noise was not measured, in words."""
    return (
        f"too little to measure noise by where sensors see something: {deviation:.3g} counts are assumed, "
        "and model error over noise, out of which none is taken, rests on them"
    )
