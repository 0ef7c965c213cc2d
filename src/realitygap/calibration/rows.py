"""All readings of one kind of sensor: the rows of several recordings, one after another."""

from collections.abc import Callable, Collection, Iterator, Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration import checks
from realitygap.calibration.forward import scene_of
from realitygap.calibration.recordings import FIRST_NOISE, SensorRecording, count_unit
from realitygap.calibration.solve import Measured
from realitygap.errors import CalibrationError
from realitygap.values import Floats
from realitygap.world.robot import Profile

__all__ = [
    "FOLDS", "REFLECTANCE", "Rows", "at_places", "dead_zone", "means", "places_of", "repeated_noise",
    "saturation",
]  # fmt: skip

FOLDS, BESIDE_DEG = 4, 10.0
"""Folds of held-out places; and nothing is fitted within this bearing of a held-out place at its distance."""
ENOUGH = 60
"""Bearings."""
REFLECTANCE = "reflectance_"
"""Prefix of the key of a recording's reflectance; its number follows."""
MEDIAN = 0.455
"""Median of the square of a normal variable."""
LIT_SHARE, GAP = 0.05, 0.05
"""Shares of the full scale: readings at least the first from either end are neither dark nor saturated; a gap
above 0 of at least the second is a dead zone."""
STILL_DARK = 30.0
"""A sensor that hardly changes is in the dark if it reads at most this much more than its least elsewhere:
counts of the paper's robot."""
PILED = 8
"""Equal readings, being most of those near them, from which on the highest is a sensor's end."""
LIT = 63.0
"""Counts of the paper's robot from either end of the converter: three deviations of its noise."""


class Rows:
    """Rows of several recordings of one kind, one after another.

    `top` is the converter's highest count, `unit` its counts per count of the paper's robot, `noise` a first
    guess to weigh residuals by (counts); `straight` says whether all recordings are series of one sensor
    facing a wall; `edges` has the places between those of each recording, if any, with NaN for readings that
    are not to be used.
    """

    def __init__(self, recordings: Sequence[SensorRecording], base: Profile) -> None:
        first, *others = recordings
        if not first.facts and all(np.isnan(r.reflectance) for r in recordings):  # tables say nothing of it
            recordings = [replace(first, reflectance=1.0), *others]
        self.recordings = recordings
        self.straight = all(recording.from_sensor is not None for recording in recordings)
        warned: list[str] = []
        self.top = base.channel(recordings[0].kind).top
        self.unit = count_unit(self.top)
        self.noise = FIRST_NOISE[recordings[0].kind] * self.unit
        for recording in recordings:
            checks.refuse_other_kind(recording, self.top)
            checks.refuse_units(recording, self.top)
        checks.refuse_few(recordings)
        dead = [checks.dead_sensors(recording, self.top) for recording in recordings]
        self.dead = checks.refuse_silent(recordings, dead, self.top)
        in_dark = _in_the_dark(recordings, dead, base)
        for recording, gone, dark in zip(recordings, dead, in_dark, strict=True):
            warned += [f"{recording.source}: {why}" for k, why in gone.items() if k in self.dead]
            for some, said in (
                (dark, "see nothing there: read as their dark level"),
                (gone.keys() - self.dead.keys() - dark, "tell nothing there: left out of it"),
            ):
                warned += [f"{recording.source}: sensors {named} {said}" for named in _listed(some)]
            warned += checks.refuse_swapped(recording, base, gone)
        dead = [{k: gone[k] for k in gone.keys() - dark} for gone, dark in zip(dead, in_dark, strict=True)]
        self.warnings = tuple(warned)
        self.counts = np.nan_to_num(np.concatenate([r.counts for r in recordings]))
        self.distance = np.concatenate([r.distance_cm for r in recordings])
        self.bearing = np.concatenate([r.bearing_deg for r in recordings])
        self.name = np.repeat(self.names(), [len(r.counts) for r in recordings])
        self.scenes = [(f"turn_{i}_deg", scene_of(r, f"{REFLECTANCE}{i}")) for i, r in enumerate(recordings)]
        if all(scene.paint for _, scene in self.scenes):
            raise CalibrationError(
                f"{recordings[0].source}: reflectance: expected a number for at least one recording; all say "
                "that it is unknown: only how surfaces differ can be fitted. Set it to 1 for one of them."
            )
        self.place = places_of(recordings)
        self.use = np.isfinite(np.concatenate([r.counts for r in recordings]))
        for use, gone in zip(self.split(self.use), dead, strict=True):
            use[:, list(gone)] = False
        missing = [k for k in np.flatnonzero(~self.use.any(axis=0)).tolist() if k not in self.dead]
        self.dead |= {k: f"sensor {k} was not recorded" for k in missing}
        if missing:
            named = ", ".join(map(str, missing))
            self.warnings += (f"not recorded, and taken to be like the others: sensors {named}",)
        self.block = self._blocks()
        self.edges = tuple(_without(r.edges, list(gone)) for r, gone in zip(recordings, dead, strict=True))

    def without(self, out: NDArray[np.bool_]) -> "Rows":
        """The same without the readings of the rows `out` [n], and without those at their distances and
        nearly their bearings, which would give them away."""
        some = copy(self)
        parts = list(zip(self.recordings, self.split(out), self.edges, strict=True))
        if self.block is not self.place:  # else no patches: places of a room, or of a straight series
            out = out | np.concatenate([_beside(places, there, places) for places, there, _ in parts])
        some.use = self.use & ~out[:, None]
        some.edges = tuple(
            edges and _without(edges, slice(None), _beside(places, there, edges))
            for places, there, edges in parts
        )
        return some

    def sparse(self) -> NDArray[np.bool_]:
        """[n] rows at some of the bearings, where there are many: enough to begin a search with."""
        bearings, rank = np.unique(np.nan_to_num(self.bearing), return_inverse=True)
        return np.asarray(rank % max(1, len(bearings) // ENOUGH) == 0)

    def names(self) -> list[str]:
        """One a recording: its object, or its file where objects repeat, numbered where files repeat too."""
        names = [r.object for r in self.recordings]
        if len(set(names)) < len(names):
            names = [Path(r.source).stem for r in self.recordings]
        if len(set(names)) < len(names):
            names = [f"{name} ({i})" for i, name in enumerate(names, 1)]
        return names

    def live(self) -> Floats:
        """[n, S] readings; NaN for dead sensors."""
        return np.where(self.use, self.counts, np.nan)

    def split(self, table: NDArray[Any]) -> list[NDArray[Any]]:
        """A table's rows [n, …] by recording."""
        return np.split(table, np.cumsum([len(r.counts) for r in self.recordings])[:-1])

    def live_recordings(self) -> list[SensorRecording]:
        """The recordings with NaN for dead sensors."""
        pairs = zip(self.recordings, self.split(self.live()), strict=True)
        return [replace(recording, counts=part) for recording, part in pairs]

    def measured(self) -> Measured:
        """All readings of live sensors, weighed by `noise`."""
        return Measured(counts=self.counts, noise=self.noise, use=self.use, clusters=self.block)

    def _blocks(self) -> NDArray[np.int64]:
        """[n] patches of neighbouring distances and bearings: their errors are correlated, and they are held
        out together."""
        known = np.isfinite(self.distance) & np.isfinite(self.bearing)
        if not known.all() or self.recordings[0].pose is not None:
            return self.place
        _, rank = np.unique(self.distance, return_inverse=True)
        thick = max(1, (int(rank.max()) + 1) // 6)
        patch = (rank // thick) * 18 + ((self.bearing + 180.0) // 20.0).astype(np.int64)
        of = np.concatenate([np.full(len(r.counts), i) for i, r in enumerate(self.recordings)])
        return np.asarray(of * 10_000 + patch, np.int64)

    def folds(self) -> NDArray[np.int64]:
        """[n] number of each row's fold."""
        numbers = np.unique(self.block, return_inverse=True)[1]
        order = np.random.default_rng(0).permutation(int(numbers.max()) + 1)
        return np.asarray(order[numbers] % FOLDS)

    def held_out(self, tick: Callable[[], None]) -> Iterator[NDArray[np.bool_]]:
        """The rows [n] of each fold that leaves others to fit; `tick` is called after each."""
        for fold in range(FOLDS):
            out = self.fold(fold)
            if out.any():
                yield out
            tick()

    def fold(self, number: int) -> NDArray[np.bool_]:
        """[n] rows of a fold; none of them if it leaves no others to fit."""
        out = self.folds() == number
        return np.asarray(out & (not out.all()))

    def rmse(self, model: Floats) -> float:
        """RMSE of the readings in use, counts."""
        return float(np.sqrt(((model - self.counts)[self.use] ** 2).mean()))

    def rmse_lit(self, model: Floats) -> float:
        """RMSE where readings are neither dark nor saturated, counts; of all readings if there are none."""
        edge = LIT * self.unit
        lit = self.use & (self.counts > edge) & (self.counts < self.top - edge)
        return float(np.sqrt(((model - self.counts)[lit if lit.any() else self.use] ** 2).mean()))


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
        dark = (apart > checks.ASIDE_DEG) & (recording.counts[:, k] <= least[k])
        return bool(dark.all() and np.isfinite(least[k]))

    return [{k for k in gone if away(r, k)} for r, gone in zip(recordings, dead, strict=True)]


def _listed(sensors: Collection[int]) -> list[str]:
    """Their numbers in words; nothing of none."""
    return [", ".join(map(str, sorted(sensors)))] if sensors else []


def _beside(places: SensorRecording, out: NDArray[np.bool_], others: SensorRecording) -> NDArray[np.bool_]:
    """[m] which of the others stand within BESIDE_DEG of the places `out` [n], at their distances."""
    near = np.zeros(len(others.counts), bool)
    for distance in np.unique(places.distance_cm[out]).tolist():
        here = others.distance_cm == distance
        of = np.unique(places.bearing_deg[out & (places.distance_cm == distance)])
        apart = (others.bearing_deg[here, None] - of + 180.0) % 360.0 - 180.0
        near[here] = np.abs(apart).min(axis=1) < BESIDE_DEG
    return near


def _without(
    edges: SensorRecording | None, sensors: list[int] | slice, rows: NDArray[np.bool_] | slice = slice(None)
) -> SensorRecording | None:
    """A copy with NaN for these readings."""
    if edges is None:
        return None
    counts = edges.counts.copy()
    counts[rows, sensors] = np.nan
    return replace(edges, counts=counts)


def places_of(recordings: Sequence[SensorRecording]) -> NDArray[np.int64]:
    """[n] number of each row's place, through all recordings."""
    places, first = [], 0
    for recording in recordings:
        places.append(recording.place() + first)
        first = int(places[-1].max()) + 1
    return np.concatenate(places)


def at_places(values: Floats | NDArray[np.bool_], place: NDArray[np.int64]) -> Floats:
    """[m, S] sums over the rows [n, S] of each place [n]."""
    return np.stack([np.bincount(place, column) for column in values.T], 1)


def means(counts: Floats, place: NDArray[np.int64], most: Floats | float) -> Floats:
    """[m, S] reading at each place [n] of `counts` [n, S]: the mean, or the sensor's end where half of its
    readings are there; NaN where none counts.

    `most`: counts that a sensor does not exceed, [S] or one for all.
    """
    use = np.isfinite(counts)
    many = at_places(use, place)
    mean = at_places(np.where(use, counts, 0.0), place) / np.maximum(many, 1.0)
    for end, there in ((0.0, counts <= 0), (most, counts >= most)):
        mean = np.where(at_places(there, place) >= many / 2, end, mean)
    return np.where(many > 0, mean, np.nan)


def repeated_noise(rows: Rows) -> float:
    """Deviation of repeated readings at their places, counts; without any the paper's robot's."""
    lit = rows.use & (rows.counts > LIT_SHARE * rows.top) & (rows.counts < (1.0 - LIT_SHARE) * rows.top)
    many = np.maximum(np.bincount(rows.place), 1)
    mean = at_places(rows.counts, rows.place) / many[:, None]
    off = ((rows.counts - mean[rows.place]) ** 2)[lit & (many > 1)[rows.place][:, None]]
    spread = 1.0 - 1.0 / np.median(many) if np.median(many) > 1 else 1.0
    return float(np.sqrt(np.median(off) / MEDIAN / spread)) if len(off) else rows.noise


def saturation(rows: Rows) -> Floats:
    """[S] counts that each sensor does not exceed: where its readings accumulate, else the full scale."""
    most, noise = np.full(rows.counts.shape[1], rows.top), repeated_noise(rows)
    for k in np.flatnonzero(rows.use.any(axis=0)).tolist():
        read = rows.counts[rows.use[:, k], k]
        there, near = read == read.max(), read >= read.max() - 2.0 * noise
        if there.sum() >= PILED and 2 * there.sum() > near.sum():
            most[k] = read.max()
    return most


def dead_zone(rows: Rows) -> float:
    """The smallest reading above 0 if there is a gap below it; else 0."""
    lit = rows.counts[rows.use & (rows.counts > 0)]
    dark = (rows.counts[rows.use] == 0).mean()
    least = float(lit.min()) if len(lit) else 0.0
    return least if dark > 0.02 and least > GAP * rows.top else 0.0
