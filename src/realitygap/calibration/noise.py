"""Noise of the sensors: its deviation, whether it depends on the reading, and its tails.

Repeated readings at a place measure it directly. A table with one reading for each place shows it only as
disagreement of neighbouring bearings: in fourth differences of the model's residuals (lower ones still
contain some of the curve).
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.forward import table_at
from realitygap.calibration.recordings import FIRST_NOISE, SensorRecording, count_unit
from realitygap.values import Floats

__all__ = ["NoiseEstimate", "Sample", "dark_noise", "lit_noise", "noise_tables", "sample_noise"]

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
KNOTS = {"infrared": 9, "ambient": 33}
"""Knots of a table of noise over the reading; more for light, whose readings span less than half of the
scale."""
RESAMPLES = 200
BINS = 4
STEADY = 1.35
"""Ratio of the largest to the smallest deviation over the readings' range up to which noise counts as
independent of the reading."""
HEAVY = 1.0
"""Excess kurtosis from which tails are reported as heavier than normal."""


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
        sums = np.add.reduceat(counts[order], np.searchsorted(at, np.arange(len(many))))
        mean = (sums / many[:, None])[at]
        spread = np.sqrt(many / np.maximum(many - 1, 1))[at, None]
        z = np.where(many[at, None] > 1, (counts[order] - mean) * spread, np.nan)
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
) -> list[tuple[NDArray[np.int64], NDArray[np.bool_]]]:
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


def noise_tables(
    sample: Sample, counts: Floats, model: Floats, speed: Floats, top: float, *, kind: str, dead: float = 0.0
) -> tuple[Floats, Floats]:
    """Each sensor's deviation at equal steps of the reading [S, KNOTS of the kind], and its rise with
    speed [S], s/cm.

    A sensor with few values follows the pooled table; there is no rise with speed where the wheels always
    stood, or never did.

    Args:
        sample: of noise.
        counts, model: [n, S] readings, and the model's without noise; in the dark noise is cut off at 0.
        speed: [m] speed of the wheels, cm/s, at each of the sample's values.
        top: the converter's highest count.
        kind: "infrared" or "ambient".
        dead: counts below which a sensor reads 0; readings above it, at a place that is at its edge, are none
            of the dark.
    """
    known, knots = np.isfinite(sample.z), KNOTS[kind]
    moving = known & (speed > 0)[:, None]
    rise = np.zeros(sample.z.shape[1])
    if moving.any() and (known & ~moving).any():
        still = _table_of(sample, known & ~moving, top, knots)
        size = np.abs(sample.z) / np.maximum(table_at(still, sample.level / top), 1e-9)
        for k in np.flatnonzero(moving.sum(axis=0) >= FEWEST).tolist():
            ratio = np.sqrt(np.mean(size[moving[:, k], k] ** 2))
            rise[k] = max(0.0, ratio - 1.0) / speed[moving[:, k]].mean()
    bare = replace(sample, z=sample.z / (1.0 + rise * speed[:, None]))
    table = _table_of(bare, known, top, knots)
    for k in range(len(table)):
        dark = (model[:, k] <= 0.5) & (counts[:, k] < (dead or np.inf))
        if dark.sum() >= FEWEST:
            table[k, 0] = np.sqrt(2.0 * np.mean(counts[dark, k] ** 2))
    return np.minimum(table, top), rise


def _table_of(sample: Sample, use: NDArray[np.bool_], top: float, knots: int) -> Floats:
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
    """Noise where readings are neither dark, dead nor saturated; for light, everywhere. None: too few.

    Args:
        sample: noise and readings.
        channel: "proximity" or "ambient".
        top: full scale, counts.
        dead: counts below which a sensor reads 0.
    """
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
    """Noise of proximity sensors with nothing in range: the spread of their readings there.

    Args:
        counts, model: [n, S].
        place: [n] number of each row's place.
        top: full scale, counts.
    """
    use = (model <= 0) & (counts < 2 * DARK_COUNTS * count_unit(top))
    many = np.maximum(use.sum(axis=0), 1)
    mean = np.where(use, counts, 0.0).sum(axis=0) / many
    sample = Sample(z=counts - mean, level=counts, group=place)
    return _estimate(sample, use, "proximity_dark")


def _estimate(sample: Sample, use: NDArray[np.bool_], channel: str) -> NoiseEstimate | None:
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
