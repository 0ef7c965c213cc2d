"""All readings of one kind of sensor: the rows of several recordings, one after another, and their folds."""

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.fit import Observed, Use
from realitygap.calibration.recordings import FIRST_NOISE, SensorRecording, count_unit
from realitygap.errors import CalibrationError
from realitygap.values import Floats
from realitygap.world.robot import Profile

FOLDS, BESIDE_DEG = 4, 10.0
"""Folds of held-out places; and nothing is fitted within this bearing of a held-out place at its distance."""
MEDIAN = 0.455
"""Median of the square of a normal variable."""
LIT_SHARE, GAP = 0.05, 0.05
"""Shares of the full scale: readings at least the first from either end are neither dark nor saturated; a gap
above 0 of at least the second is a dead zone."""
LIT = 63.0
"""Counts of the paper's robot from either end of the converter: three deviations of its noise."""
STILL, STILL_DARK = 30.0, 30.0
"""A sensor whose readings span less than the first counts as dead; in the dark, if it reads at most the
second more than its least elsewhere: counts of the paper's robot."""
SATURATED_SHARE, ASIDE_DEG, FEWEST_LIT = 0.8, 60.0, 40
PILED = 8
"""Equal readings, being most of those near them, from which on the highest is a sensor's end."""
DARKEST = 10.0
"""Ambient readings stay above this however bright the light (counts of the paper's robot): sensors end at
about 50."""
MOST_ODD = 3
"""Sensors that answer to another side than they face, from which on columns or bearings are wrong."""
FEWEST, EXPLAINED = 3, 0.5
"""Distances of straight series; and the share of the readings' variation that a fit must explain."""


class Readings:
    """Rows of several recordings of one kind, one after another.

    Attributes:
        recordings, kind: as given.
        top, unit: the converter's highest count, and its counts per count of the paper's robot.
        noise: a first guess to weigh residuals by, counts.
        straight: whether all recordings are series of one sensor facing a wall.
        counts, use: [n, S] readings, and which of them count.
        distance, bearing, name, place: [n] of each row; `place` numbers the places of all recordings.
        block: [n] patches of neighbouring places, whose errors are correlated: they are held out together.
        dead: sensors that gave no information, and why.
        gone: for each recording, the sensors that tell nothing in it.
        warnings: in words.

    Raises:
        CalibrationError: hardly any reading tells something.
    """

    def __init__(self, recordings: Sequence[SensorRecording], base: Profile) -> None:
        first, *others = recordings
        if not first.facts and all(np.isnan(r.reflectance) for r in recordings):  # tables say nothing of it
            recordings = [replace(first, reflectance=1.0), *others]
        self.recordings, self.kind = recordings, first.kind
        self.straight = all(recording.from_sensor is not None for recording in recordings)
        self.top = base.channel(self.kind).top
        self.unit = count_unit(self.top)
        self.noise = FIRST_NOISE[self.kind] * self.unit
        self.gone = [dead_sensors(recording, self.top) for recording in recordings]
        self.dead = refuse_silent(recordings, self.gone, self.top)
        dark = _in_the_dark(recordings, self.gone, base)
        said = []
        for recording, gone, unlit in zip(recordings, self.gone, dark, strict=True):
            said += [f"{recording.source}: {why}" for k, why in gone.items() if k in self.dead]
            for some, what in (
                (unlit, "see nothing there: read as their dark level"),
                (gone.keys() - self.dead.keys() - unlit, "tell nothing there: left out of it"),
            ):
                named = ", ".join(map(str, sorted(some)))
                said += [f"{recording.source}: sensors {named} {what}"] if some else []
        self.counts = np.nan_to_num(np.concatenate([r.counts for r in recordings]))
        self.distance = np.concatenate([r.distance_cm for r in recordings])
        self.bearing = np.concatenate([r.bearing_deg for r in recordings])
        self.name = np.repeat(self.names(), [len(r.counts) for r in recordings])
        self.place = places_of(recordings)
        self.use = np.isfinite(np.concatenate([r.counts for r in recordings]))
        for use, gone, unlit in zip(self.split(self.use), self.gone, dark, strict=True):
            use[:, list(gone.keys() - unlit)] = False
        missing = [k for k in np.flatnonzero(~self.use.any(axis=0)).tolist() if k not in self.dead]
        self.dead |= {k: f"sensor {k} was not recorded" for k in missing}
        if missing:
            named = ", ".join(map(str, missing))
            said.append(f"not recorded, and taken to be like the others: sensors {named}")
        self.warnings = tuple(said)
        self.block = self._blocks()

    def without(self, out: Use) -> "Readings":
        """The same without the readings of the rows `out` [n], and without those at their distances and
        nearly their bearings, which would give them away."""
        some = copy(self)
        if self.block is not self.place:  # else no patches: places of a room, or of a straight series
            parts = zip(self.recordings, self.split(out), strict=True)
            out = out | np.concatenate([_beside(recording, there) for recording, there in parts])
        some.use = self.use & ~out[:, None]
        return some

    def of(self, recordings: Sequence[SensorRecording]) -> "Readings":
        """The same with these recordings, which have the same readings."""
        some = copy(self)
        some.recordings = recordings
        return some

    def names(self) -> list[str]:
        """One a recording: its object, or its file where objects repeat, numbered where files repeat too."""
        names = [r.object for r in self.recordings]
        if len(set(names)) < len(names):
            names = [Path(r.source).stem for r in self.recordings]
        if len(set(names)) < len(names):
            names = [f"{name} ({i})" for i, name in enumerate(names, 1)]
        return names

    def live(self) -> Floats:
        """[n, S] readings; NaN where they do not count."""
        return np.where(self.use, self.counts, np.nan)

    def split(self, table: NDArray[Any]) -> list[NDArray[Any]]:
        """A table's rows [n, …] by recording."""
        return np.split(table, np.cumsum([len(r.counts) for r in self.recordings])[:-1])

    def live_recordings(self) -> list[SensorRecording]:
        """The recordings with NaN for readings that do not count."""
        pairs = zip(self.recordings, self.split(self.live()), strict=True)
        return [replace(recording, counts=part) for recording, part in pairs]

    def observed(self) -> Observed:
        """All readings in use, weighed by `noise`."""
        return Observed(counts=self.counts, noise=self.noise, use=self.use, clusters=self.block)

    def _blocks(self) -> NDArray[np.int64]:
        known = np.isfinite(self.distance) & np.isfinite(self.bearing)
        if not known.all() or self.recordings[0].pose is not None:
            return self.place
        _, rank = np.unique(self.distance, return_inverse=True)
        thick = max(1, (int(rank.max()) + 1) // 6)
        patch = (rank // thick) * 18 + ((self.bearing + 180.0) // 20.0).astype(np.int64)
        of = np.concatenate([np.full(len(r.counts), i) for i, r in enumerate(self.recordings)])
        return np.asarray(of * 10_000 + patch, np.int64)

    def fold_of(self) -> NDArray[np.int64]:
        """[n] number of each row's fold."""
        numbers = np.unique(self.block, return_inverse=True)[1]
        order = np.random.default_rng(0).permutation(int(numbers.max()) + 1)
        return np.asarray(order[numbers] % FOLDS)

    def folds(self) -> Iterator[Use]:
        """The rows [n] of each fold; none of them if it leaves no others to fit."""
        of = self.fold_of()
        for number in range(FOLDS):
            yield (of == number) & bool((of != number).any())

    def rmse(self, model: Floats) -> float:
        """RMSE of the readings in use, counts."""
        return float(np.sqrt(((model - self.counts)[self.use] ** 2).mean()))

    def rmse_lit(self, model: Floats) -> float:
        """RMSE where readings are neither dark nor saturated (light's never are), counts; of all readings if
        there are none: what forms are compared by."""
        edge = LIT * self.unit if self.kind == "infrared" else -1.0
        lit = self.use & (self.counts > edge) & (self.counts < self.top - edge)
        return float(np.sqrt(((model - self.counts)[lit if lit.any() else self.use] ** 2).mean()))


def dead_sensors(recording: SensorRecording, top: float) -> dict[int, str]:
    """Sensors of a recording that give no information, and why; `top` is the converter's highest count."""
    dead = {}
    looks = "it looks dead" if all_round(recording) else "it looks dead, or away from the object"
    for k in recorded(recording):
        values = recording.counts[np.isfinite(recording.counts[:, k]), k]
        low, high = np.percentile(values, [0.2, 99.8])
        if np.ptp(values) == 0:
            dead[k] = f"sensor {k} reads {values[0]:.4g} everywhere: {looks}"
        elif recording.kind == "infrared" and (values >= top).mean() > SATURATED_SHARE:
            dead[k] = f"sensor {k} is saturated in {(values >= top).mean():.0%} of its readings"
        elif high - low < STILL * count_unit(top):
            dead[k] = f"sensor {k} hardly changes ({values.min():.4g} to {values.max():.4g}): {looks}"
    return dead


def refuse_silent(
    recordings: Sequence[SensorRecording], dead: Sequence[dict[int, str]], top: float
) -> dict[int, str]:
    """Sensors that are `dead` in every one of the recordings of one kind that has them, and why; a refusal if
    these are most, or few readings lie between dark and saturated."""
    where = ", ".join(recording.source for recording in recordings)
    there = [set(recorded(recording)) for recording in recordings]
    lives = {k for has, gone in zip(there, dead, strict=True) for k in has - gone.keys()}
    silent = {k: why for gone in dead for k, why in gone.items() if k not in lives}
    if len(silent) > len(set().union(*there)) // 2:
        raise CalibrationError(
            f"{where}: most sensors tell nothing: {'; '.join(silent.values())}. Record again; "
            "of an object on one side, give the recordings of all sides at once."
        )
    middle = 0
    for recording, has, gone in zip(recordings, there, dead, strict=True):
        lit = signal(recording, top)[:, sorted(has - gone.keys())]
        middle += int(((lit > 0.06) & (lit < 0.94)).sum())
    if middle < FEWEST_LIT:
        raise CalibrationError(
            f"{where}: only {middle} readings lie between dark and saturated, expected {FEWEST_LIT} or "
            "more. Are the distances right, and the object near enough? If so, record more places."
        )
    return silent


def signal(recording: SensorRecording, top: float) -> Floats:
    """[n, S] readings scaled to 0 (dark) to 1 (saturated)."""
    if recording.kind == "infrared":
        return np.nan_to_num(recording.counts) / top
    low, high = np.nanpercentile(recording.counts, [0.5, 99.5])
    return np.asarray(np.nan_to_num((high - recording.counts) / max(high - low, 1.0)))


def recorded(recording: SensorRecording) -> list[int]:
    """Numbers of the sensors that a recording has readings of."""
    return [int(k) for k in np.flatnonzero(np.isfinite(recording.counts).any(axis=0))]


def all_round(recording: SensorRecording) -> bool:
    """Whether the object stood on every side, a quarter turn apart at most."""
    turned = np.unique(np.round(recording.bearing_deg % 360.0, 3))
    return len(turned) >= 4 and float(np.diff(np.append(turned, turned[0] + 360.0)).max()) <= 100.0


def _in_the_dark(
    recordings: Sequence[SensorRecording], dead: Sequence[dict[int, str]], base: Profile
) -> list[set[int]]:
    """The sensors that face away from a recording's object: of those that tell nothing there, the ones that
    look aside in every row and read hardly more than their least in other recordings."""
    if recordings[0].kind != "infrared":
        return [set() for _ in recordings]
    live = [r.counts.copy() for r in recordings]
    for counts, gone in zip(live, dead, strict=True):
        counts[:, list(gone)] = np.inf
    least = np.fmin.reduce(np.concatenate(live)) + STILL_DARK * count_unit(base.infrared.top)
    looks = np.array([s.direction_deg for s in base.infrared.sensors])

    def away(recording: SensorRecording, k: int) -> bool:
        apart = np.abs((recording.bearing_deg - looks[k] + 180.0) % 360.0 - 180.0)
        dark = (apart > ASIDE_DEG) & (recording.counts[:, k] <= least[k])
        return bool(dark.all() and np.isfinite(least[k]))

    return [{k for k in gone if away(r, k)} for r, gone in zip(recordings, dead, strict=True)]


def _beside(places: SensorRecording, out: Use) -> Use:
    """[n] which rows stand within BESIDE_DEG of the places `out` [n], at their distances."""
    near = np.zeros(len(out), bool)
    for distance in np.unique(places.distance_cm[out]).tolist():
        here = places.distance_cm == distance
        apart = (places.bearing_deg[here, None] - np.unique(places.bearing_deg[out & here]) + 180.0) % 360.0
        near[here] = np.abs(apart - 180.0).min(axis=1) < BESIDE_DEG
    return near


def places_of(recordings: Sequence[SensorRecording]) -> NDArray[np.int64]:
    """[n] number of each row's place, through all recordings."""
    places, first = [], 0
    for recording in recordings:
        places.append(recording.place() + first)
        first = int(places[-1].max()) + 1
    return np.concatenate(places)


def at_places(values: Floats | Use, place: NDArray[np.int64]) -> Floats:
    """[m, S] sums over the rows [n, S] of each place [n]."""
    return np.stack([np.bincount(place, column) for column in values.T], 1)


def means(counts: Floats, place: NDArray[np.int64], most: Floats | float) -> Floats:
    """[m, S] reading at each place [n] of `counts` [n, S]: the mean, or the sensor's end (0 or `most`) where
    half of its readings are there; NaN where none counts."""
    use = np.isfinite(counts)
    many = at_places(use, place)
    mean = at_places(np.where(use, counts, 0.0), place) / np.maximum(many, 1.0)
    for end, there in ((0.0, counts <= 0), (most, counts >= most)):
        mean = np.where(at_places(there, place) >= many / 2, end, mean)
    return np.where(many > 0, mean, np.nan)


def repeated_noise(data: Readings) -> float:
    """Deviation of repeated readings at their places, counts; without any the paper's robot's."""
    lit = data.use & (data.counts > LIT_SHARE * data.top) & (data.counts < (1.0 - LIT_SHARE) * data.top)
    many = at_places(data.use, data.place)
    mean = at_places(np.where(data.use, data.counts, 0.0), data.place) / np.maximum(many, 1.0)
    off = ((data.counts - mean[data.place]) ** 2)[lit & (many > 1)[data.place]]
    usual = float(np.median(many[many > 0])) if lit.any() else 1.0
    spread = 1.0 - 1.0 / usual if usual > 1 else 1.0
    return float(np.sqrt(np.median(off) / MEDIAN / spread)) if len(off) else data.noise


def saturation(data: Readings) -> Floats:
    """[S] counts that each sensor does not exceed: where its readings accumulate, else the full scale."""
    most, noise = np.full(data.counts.shape[1], data.top), repeated_noise(data)
    for k in np.flatnonzero(data.use.any(axis=0)).tolist():
        read = data.counts[data.use[:, k], k]
        there, near = read == read.max(), read >= read.max() - 2.0 * noise
        if there.sum() >= PILED and 2 * there.sum() > near.sum():
            most[k] = read.max()
    return most


def dead_zone(data: Readings) -> float:
    """The smallest reading above 0 if there is a gap below it; else 0."""
    lit = data.counts[data.use & (data.counts > 0)]
    dark = (data.counts[data.use] == 0).mean()
    least = float(lit.min()) if len(lit) else 0.0
    return least if dark > 0.02 and least > GAP * data.top else 0.0


def refuse_slips(recordings: Sequence[SensorRecording], top: float) -> None:
    """Refuse recordings of one kind with another kind's counts, or too few distances."""
    for recording in recordings if recordings[0].kind == "ambient" else ():
        counts = recording.counts[np.isfinite(recording.counts)]
        ends = ((counts >= top) | (counts < DARKEST * count_unit(top))).mean()
        if ends > 0.5:
            raise CalibrationError(
                f"{recording.source}: {ends:.0%} of the readings lie at the ends 0 and {top:g}, as "
                "proximity's do, and no ambient light's. Is its kind \"infrared\"?"
            )
    if all(recording.from_sensor is not None for recording in recordings):
        many = len(np.unique(np.concatenate([recording.distance_cm for recording in recordings])))
        if many < FEWEST:
            named = ", ".join(recording.source for recording in recordings)
            raise CalibrationError(
                f"{named}: expected readings at {FEWEST} distances or more, got {many}: how they fall with "
                "the distance cannot be told. Record more."
            )


def refuse_swapped(recording: SensorRecording, profile: Profile, dead: Mapping[int, str]) -> None:
    """Refuse a recording whose sensors answer to another side than they face: columns are swapped, or
    bearings run the other way round."""
    if recording.pose is not None or not all_round(recording):  # a room's walls reflect
        return
    part = profile.channel(recording.kind)
    looks = np.array([sensor.direction_deg for sensor in part.sensors])
    lit = np.clip(signal(recording, part.top), 0.0, 1.0)
    lit = np.where(lit > 0.1, lit, 0.0)
    total = lit.T @ np.exp(1j * np.radians(recording.bearing_deg))
    answers, live = np.degrees(np.angle(total)), np.abs(total) > 0.2 * np.maximum(lit.sum(axis=0), 1e-9)
    live[list(dead)] = False

    def aside(turned: Floats) -> Use:
        return np.asarray(live & (np.abs((turned - looks + 180.0) % 360.0 - 180.0) > ASIDE_DEG))

    odd = aside(answers)
    if odd.sum() >= MOST_ODD:
        which = ", ".join(f"{k} at {answers[k]:.0f}° (looks to {looks[k]:.0f}°)" for k in np.flatnonzero(odd))
        swapped = aside(-answers).any()
        cure = "Are columns swapped?" if swapped else "The bearings seem to run the other way round."
        raise CalibrationError(
            f"{recording.source}: sensors answer to another side than they look: {which}. {cure}"
        )


def refuse_nonsense(data: Readings, model: Floats) -> None:
    """Refuse a fit, with the model's readings [n, S], that explains less than half of the variation."""
    live = [k for k in range(data.counts.shape[1]) if k not in data.dead]
    counts = data.live()[:, live]
    errors = np.nan_to_num(counts - model[:, live]) ** 2
    explained = 1.0 - errors.sum() / np.nansum((counts - np.nanmean(counts, axis=0)) ** 2)
    if explained >= EXPLAINED:
        return
    row, sensor = np.unravel_index(errors.argmax(), errors.shape)
    places = [one.at(k) for one in data.recordings for k in range(len(one.counts))]
    where = ", ".join(one.source for one in data.recordings)
    raise CalibrationError(
        f"{where}: the fitted law explains only {max(0.0, explained):.0%} of how the readings change: "
        "this is no recording of such an object, or its distances (cm from the body's edge) and bearings "
        f"(degrees) are not those of its rows. The furthest off is {places[row]}: s{live[sensor]} is "
        f"{counts[row, sensor]:.0f}, by the law {model[row, live[sensor]]:.0f}."
    )
