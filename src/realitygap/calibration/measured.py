"""The form "measured" of the proximity sensors: optics by rays, electronics by a curve for each sensor.

Only the optics is searched (directions, offset, width, aperture, lobe): for each of its values the best
curves follow by linear least squares (variable projection: Golub and Pereyra 1973). Where a ray just hits or
just misses something, or ends, readings jump, so directions and the range are scanned between descents.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration import model
from realitygap.calibration.curves import ALIKE, ALIKES, Curves, Seen, on_curves, smoothness
from realitygap.calibration.fit import (
    SIGMAS,
    Fit,
    Observed,
    Outcome,
    Parameter,
    Use,
    Values,
    fit,
    scan,
    value_of,
)
from realitygap.calibration.model import Scenes, unchecked
from realitygap.calibration.readings import Readings, dead_zone, means, repeated_noise, saturation
from realitygap.kernels.curves import STEPS
from realitygap.kernels.trial import Scratch
from realitygap.kernels.types import Robot
from realitygap.values import Floats
from realitygap.world.robot import Constant, Profile

SHARES = ("share_1", "share_2", "share_3", "share_4")
ONE_BEAM = {"aperture_deg": 60.0, "share_1": 0.28, "share_2": 0.22, "share_3": 0.14, "share_4": 0.06}
TWO_BEAMS = {"share_4": 0.67}
LOBES = (ONE_BEAM, *({**TWO_BEAMS, "aperture_deg": wide} for wide in (10.0, 15.0, 22.0)))
"""Starting values, and the free parts of the lobe: one beam; or two beside the middle ray, minus their
response to a flat surface in front, as in simulators that subtract."""
WIDTH_CM = 3.0
STAGES = {0.05: 10.0, 0.02: 2.0, 0.003: 0.4}
"""Assumed accuracies of readings, as shares of the full scale, since details mislead far from the truth; and
the range of the scan for directions then, degrees."""
FIRST = max(STAGES)
FINE_DEG = (3.0, 1.0, 0.3)
"""Ranges of the last scans."""
OPENED_DEG, OPENINGS = (0.3, 0.1, 0.03), 9
"""Ranges of the scans for the angle between two beams, and angles tried in each."""
BESIDE = (*(("aperture_deg", by) for by in (-4.0, -2.0, 2.0, 4.0)), ("offset_cm", -0.5), ("offset_cm", 0.5))
"""Changes of one beam's constants from which descents begin anew: at its edges rays come and go, and descents
end a few degrees from the best, or, with another width, some millimetres."""
ROUNDS, SETTLED = 6, 0.95
"""The last rounds, of smoothness, scans and descents, go on while the residual falls below this factor."""
FINEST = 0.004
"""No model is expected to be more accurate than this share of the full scale."""
POINTS = (STEPS // 4, STEPS // 2, 3 * STEPS // 4)
"""Points of a curve whose intervals are reported."""
ENOUGH = 60
"""Bearings, with which a search begins."""
MATT = Parameter(key="matt", start=np.array([0.9]), low=0.0, high=1.0, prior=0.5, step=1e-2)
"""How Lambertian surfaces are at first; after a stage they are or are not."""
PLAIN = 1.02
"""A more complex model must be this factor better; otherwise one beam without a range limit is kept."""
ENDS_CM = tuple(np.geomspace(5.0, 40.0, 18))
"""Where rays may end; then closer about the best, by these shares of it."""
NEARER, LIKE = (0.08, 0.015, 0.002), 1.0 + 1e-6
AT_END = 0.015
"""By this share of their range rays are doubtful: readings that hang on it are left out of a descent."""
TIE_DEG = 0.02
"""How well the directions' mean is known where rigs may be turned: turned sensors look like a turned rig."""
HAIR_DEG = 0.3
"""Readings that jump when a sensor turns by this angle are left out too: a ray only just hits or misses."""
SHIFT: dict[str, Any] = {"low": -1.0, "high": 1.0, "prior": 0.2, "step": 2e-3}
"""Offset of a straight series, cm, common to all its distances."""
LIGHT: dict[str, Any] = {"low": 0.0, "high": 0.05, "prior": 0.002, "step": 1e-5}
LIT = 1.1
"""Light that a room may add to what rays bring, 1/cm²; the prior is that of a white wall at 22 cm. And the
factor by which the residual under one light must exceed that under several before several are used: half a
deviation of the noise."""
BY_HAND = 0.01
"""Share of the full scale that a millimetre is worth where each place of a series was set by hand."""
GAIN = 0.3
"""How much the gains of the sensors of a series may easily differ."""


def fit_measured(data: Readings, base: Profile, *, intervals: bool = True) -> Outcome:
    """Fit the form to the readings in use, from the most promising start."""
    law, noise = base.infrared, repeated_noise(data)
    noise = max(noise, (BY_HAND if data.straight else FINEST) * data.top)
    flat = tuple(np.linspace(0.0, law.top, 2))
    sensors = tuple(replace(s, a=1.0, b=0.0, curve=flat, noise=()) for s in law.sensors)
    law = replace(
        law, sensors=sensors, lobe=(1.0, 0.0, 0.0, 0.0, 0.0), aperture_deg=45.0, curve_cm=3.0,
        dead=dead_zone(data), exponent=1.0,
    )  # fmt: skip
    every = Seen(
        counts=data.counts, use=data.use, top=data.top, most=saturation(data), noise=noise, dead=law.dead
    )
    mean = means(data.live(), data.place, every.most)
    seen = replace(every, counts=np.nan_to_num(mean), use=np.isfinite(mean), noise=FIRST * data.top)
    first = Optics(
        base=replace(base, infrared=law), scenes=model.scenes_of(data.recordings), seen=seen,
        place=np.arange(len(mean)),
    )  # fmt: skip
    search = _Search(data, base, noise)
    optics, values = search.best(first)
    made = search.solved(optics, values, intervals=intervals)
    values = search.nearer(optics, values, made.values)
    # The optics follows the places' means, the curves all readings.
    chosen = optics.seen
    whole = replace(every, smooth=chosen.smooth, linear=chosen.linear, alike=chosen.alike)
    optics = replace(optics, seen=whole, place=data.place)
    constants = tuple(_moved(c, values) for c in made.constants)
    if intervals:
        constants += optics.points(values, data)
    made = replace(made, values=values, constants=constants, model=optics.shown(values))
    return Outcome(profile=optics.fitted(values), fit=made)


def _moved(constant: Constant, values: Values) -> Constant:
    """A constant with its final value, and its interval shifted with it."""
    key, _, number = constant.key.rstrip("]").partition("[")
    value = float(values[key][int(number or 0)])
    by = value - constant.value
    return replace(constant, value=value, low=constant.low + by, high=constant.high + by)


@dataclass(frozen=True, kw_only=True, eq=False)
class Optics:
    """A robot with measured sensors before its curves are known: `seen` are the readings that these are
    fitted to, `place` [n] the place of each, `lobe` the free parts of the lobe."""

    base: Profile
    scenes: Scenes
    seen: Seen
    place: NDArray[np.int64]
    lobe: tuple[str, ...] = ()

    @cached_property
    def _robot(self) -> Robot:
        return self.base.to_kernel()

    @cached_property
    def _work(self) -> Scratch:
        return model.work_of(self._robot)

    def profile(self, values: Values) -> Profile:
        """The base with the optics in place and placeholder curves, unchecked."""
        law = self.base.infrared
        shares = [float(values[key][0]) for key in SHARES]
        columns = model.columns_of(values, ("direction_deg",), law.sensors)
        columns["offset_cm"] = [float(values["offset_cm"][0])] * len(law.sensors)
        gains = {k: float(values[key][0]) for k in range(len(law.sensors)) if (key := _gain_of(k)) in values}
        usual = float(np.mean([*gains.values()])) if gains else 1.0
        columns["a"] = [gains.get(k, usual) for k in range(len(law.sensors))]
        sensors = model.with_columns(law.sensors, columns)
        common = {key: float(values[key][0]) for key in ("aperture_deg", "width_cm", "range_cm", "matt")}
        law = unchecked(
            law, sensors=sensors, lobe=(1.0 - sum(shares), *shares),
            overlap=0.0 if "share_1" in self.lobe else shares[-1], **common,
        )  # fmt: skip
        return unchecked(self.base, infrared=law)

    def fitted(self, values: Values) -> Profile:
        """The profile with the curves that suit the optics, in the mean of the rooms that each sensor was
        recorded in: a profile has no background of its own."""
        made = self.profile(values).infrared
        curves, lit = self.curves(values)[0], self._lit(values)
        if lit.any():
            mean = in_mean(lit[self.place], self.seen.use)
            share = np.minimum(np.arange(STEPS + 1.0)[:, None] / STEPS, 1.0 - 1e-9)
            light = (share / (1.0 - share) / made.curve_cm) ** 2 + mean * [s.a for s in made.sensors]
            curves = on_curves(curves, model.up_curve(light, made.curve_cm)).T
        columns = {"curve": [tuple(row) for row in curves.round(3).tolist()]}
        made = unchecked(made, sensors=model.with_columns(made.sensors, columns))
        return replace(self.base, infrared=model.checked(made))

    def share(self, values: Values) -> Floats:
        """[n, S] position of each reading on its curve."""
        law = self.profile(values).infrared
        robot = self._robot._replace(proximity=law.to_kernel())
        rigs = [(scene.tried(values), 0.0, value_of(values, _shift_of(name))) for name, scene in self.scenes]
        light = model.received(robot, rigs, self._work) + np.outer(self._lit(values), robot.proximity.a)
        return model.up_curve(light, law.curve_cm)[self.place]

    def _lit(self, values: Values) -> Floats:
        """The room's added light at each place."""
        return np.repeat(backgrounds(values, self.scenes), [len(scene.poses) for _, scene in self.scenes])

    def at(self, few: Use) -> "Optics":
        """The same of some of its places [m] only."""
        of = np.split(few, np.cumsum([len(scene.poses) for _, scene in self.scenes])[:-1])
        scenes = [
            (name, replace(scene, poses=scene.poses[there], row=np.arange(int(there.sum()))))
            for (name, scene), there in zip(self.scenes, of, strict=True)
        ]
        seen = replace(self.seen, counts=self.seen.counts[few], use=self.seen.use[few])
        return replace(self, scenes=scenes, seen=seen, place=np.arange(len(seen.counts)))

    def curves(self, values: Values, *, beyond: bool = False) -> tuple[Floats, Floats]:
        """The curves [S, STEPS + 1] that suit the optics, on beyond where readings end or not, and all
        shares."""
        u = self.share(values)
        return Curves(self.seen, u).fitted(beyond=beyond), u

    def readings(self, values: Values) -> Floats:
        """Noise-free readings [n, S]; in the dead zone what exceeds it."""
        curves, u = self.curves(values, beyond=True)
        read, dead = np.minimum(on_curves(curves, u), self.seen.most), self.seen.dead
        return np.where((self.seen.counts <= 0) & (dead > 0), np.maximum(read - dead, 0.0), read)

    def shown(self, values: Values) -> Floats:
        """Noise-free readings [n, S] as the robot reports them."""
        read = on_curves(*self.curves(values))
        return np.where(read < self.seen.dead, 0.0, read)

    def centred(self, values: Values) -> "Optics":
        """A copy with the curves' middle where readings are neither dark nor saturated."""
        seen, u = self.seen, self.share(values)
        lit = seen.use & (seen.counts > 0.1 * seen.top) & (seen.counts < 0.9 * seen.top) & (u > 0) & (u < 1)
        if not lit.any():
            return self
        root = float(np.median(u[lit] / (1.0 - u[lit]))) / self.base.infrared.curve_cm
        law = replace(self.base.infrared, curve_cm=1.0 / root)
        return replace(self, base=replace(self.base, infrared=law))

    def points(self, values: Values, data: Readings) -> tuple[Constant, ...]:
        """Three points of each sensor's curve with their intervals, for fixed optics."""
        curves, u = self.curves(values)
        size = SIGMAS * Curves(self.seen, u).deviations(curves)
        return tuple(
            Constant(
                key=f"curve_{j}[{k}]", value=value, low=max(0.0, value - size[k, j]),
                high=min(data.top, value + size[k, j]), told=bool(np.isfinite(size[k, j])),
            )
            for j in POINTS for k, value in enumerate(curves[:, j].tolist()) if k not in data.dead
        )  # fmt: skip


class _Search:
    """From starts to the best values; `noise` of a reading, counts."""

    def __init__(self, data: Readings, base: Profile, noise: float) -> None:
        self._data, self._sensors, self._noise = data, base.infrared.sensors, noise
        first_of = np.unique(data.place, return_index=True)[1]
        bearings, rank = np.unique(np.nan_to_num(data.bearing), return_inverse=True)
        self._few = (rank % max(1, len(bearings) // ENOUGH) == 0)[first_of]
        self._blocks, self._folds = data.block[first_of], data.fold_of()[first_of]
        rigs = model.rigs_of(data.recordings)
        self._rigs = [key for key, r in zip(rigs, data.recordings, strict=True) if key and not r.exact]
        self._turned = bool(self._rigs) and not any(r.exact for r in data.recordings)

    def best(self, first: "Optics") -> tuple[Optics, dict[str, Floats]]:
        """The most promising start's end: all lobes for one stage by some of the bearings, the best with one
        beam and the best with two for the others, then by all bearings with smooth curves."""
        data, few = self._data, first.at(self._few)
        begun = []
        for lobe in LOBES[: 1 if data.straight else None]:
            values = {p.key: p.start for p in self._parameters(())} | {
                key: np.array([lobe.get(key, 0.0)]) for key in (*SHARES, "range_cm", "aperture_deg")
            }
            values["matt"] = np.ones(1) if data.straight else MATT.start
            optics = replace(few, lobe=tuple(lobe)).centred(values)
            begun.append(self._stage(optics, values, FIRST))
        kinds = [[one for one in begun if ("share_1" in one[1].lobe) == plain] for plain in (True, False)]
        ends = []
        for kind in kinds:
            for _, optics, values in sorted(kind, key=itemgetter(0))[:1]:
                for share in [*STAGES][1:]:
                    _, optics, values = self._stage(optics, values, share)
                if not data.straight:  # matt or not from here on; rounding can err where other constants do
                    values = min(
                        ({**values, "matt": np.full(1, side)} for side in (0.0, 1.0)),
                        key=lambda tried: self._stage(optics, tried, min(STAGES))[0],
                    )
                ends.append(self._finished(replace(first, base=optics.base, lobe=optics.lobe), values))
        _, optics, values = min(ends, key=itemgetter(0))
        return optics, self._lit(optics, values)

    def _stage(
        self, optics: Optics, values: dict[str, Floats], share: float
    ) -> tuple[float, Optics, dict[str, Floats]]:
        """One round of improvement: directions, then where rays end, then all other constants."""
        values = self._scanned(optics, values, STAGES[share], share * self._data.top)
        optics = optics.centred(values)
        values = self._ended(optics, values, ENDS_CM)
        values = self.solved(optics, values, share * self._data.top).values
        return self._left(optics, values), optics, values

    def _finished(self, optics: Optics, values: dict[str, Floats]) -> tuple[float, Optics, dict[str, Floats]]:
        """By all places, with curves as smooth as places held out have it."""
        seen = replace(optics.seen, noise=self._noise)
        alikes = ALIKES if self._data.straight else (ALIKE,)
        best = np.inf
        for _ in range(ROUNDS):  # smoothness shows only near the right optics, and that with smooth curves
            seen = smoothness(seen, optics.share(values), self._folds, alikes)[1]
            optics = replace(optics, seen=seen)
            for reach in FINE_DEG:
                values = self._scanned(optics, values, reach)
            values = self.nearer(optics, values, self.solved(optics, values).values)
            one_beam = "share_1" in optics.lobe
            for key, by in BESIDE if one_beam and not self._data.straight else ():
                begun = {**values, key: values[key] + by}
                values = self.nearer(optics, values, self.solved(optics, begun).values)
            for reach in () if one_beam else OPENED_DEG:
                values = self._opened(optics, values, reach)
            before, best = best, self._left(optics, values)
            if best > SETTLED * before:
                break
        plain = 1.0 if "share_1" in optics.lobe else PLAIN
        return self._left(optics, values) * plain, optics, values

    def _opened(self, optics: Optics, values: dict[str, Floats], reach: float) -> dict[str, Floats]:
        """The values with the angle between two beams, and each sensor's direction for it, where the residual
        is smallest within `reach` degrees: all edges of all sensors tell it, and no derivative."""
        wide = values["aperture_deg"] + np.linspace(-reach, reach, OPENINGS)[:, None]
        tried = [self._scanned(optics, {**values, "aperture_deg": one}, reach) for one in wide]
        left = [self._left(optics, one) for one in tried]
        return self._ended(optics, tried[int(np.argmin(left))])

    def nearer(self, optics: Optics, values: dict[str, Floats], solved: Values) -> dict[str, Floats]:
        """The least-squares values with directions and ray ends readjusted, or the values before: whichever
        have the smaller residual."""
        found = self._level(self._scanned(optics, solved, FINE_DEG[-1]))
        found = self._ended(optics, found)
        return found if self._left(optics, found) < self._left(optics, values) else values

    def _parameters(self, lobe: Sequence[str]) -> list[Parameter]:
        """The constants that are free with this lobe."""
        one, data, scenes = np.ones(1), self._data, model.scenes_of(self._data.recordings)
        lowest = -4.0 if "share_1" in lobe else 0.0
        size = [
            Parameter(key="offset_cm", start=0.3 * one, low=-1.0, high=6.0, prior=2.0, step=5e-3),
            Parameter(key="width_cm", start=WIDTH_CM * one, low=0.0, high=20.0, prior=10.0, step=1e-2),
        ]
        if data.straight:
            shifts = [Parameter(key=_shift_of(name), start=0 * one, **SHIFT) for name, _ in scenes]
            gains = [
                Parameter(key=_gain_of(int(k)), start=one, low=0.1, high=10.0, prior=GAIN, step=2e-3)
                for k in np.flatnonzero(data.use.any(axis=0))
            ]
            look = model.directions(self._sensors)
            unit = model.units(data.recordings)
            return [*size, *shifts, *gains, *unit, *self._lights()] if lobe else [*size, look]
        return [
            model.directions(self._sensors, tie=TIE_DEG if self._turned else None),
            *size,
            Parameter(key="aperture_deg", start=45.0 * one, low=5.0, high=85.0, prior=30.0, step=0.1),
            *(
                Parameter(key=key, start=0.2 * one, low=lowest, high=4.0, prior=1.0, step=5e-3)
                for key in lobe if key in SHARES
            ),
            *model.reflectances(scenes),
            *model.units(data.recordings),
            *model.turns(list(dict.fromkeys(self._rigs))),
        ]  # fmt: skip

    def _lights(self) -> list[Parameter]:
        """The background light of each recording's room."""
        keys = [_background_of(name) for name, _ in model.scenes_of(self._data.recordings)]
        return [Parameter(key=key, start=np.zeros(1), **LIGHT) for key in keys]

    def _lit(self, optics: Optics, values: dict[str, Floats]) -> dict[str, Floats]:
        """The values with a background for each recording, if that reduces the residual clearly."""
        if self._data.straight or len(self._data.recordings) < 2:
            return values
        tried = values | {p.key: np.full(1, p.prior) for p in self._lights()}
        found = self.solved(optics, tried).values
        return dict(found) if self._left(optics, found) * LIT < self._left(optics, values) else values

    def _left(self, optics: Optics, values: Values) -> float:
        """Residual of the values: mean of the places' misfits, counts."""
        seen = optics.seen
        return float(np.abs((optics.readings(values) - seen.counts)[seen.use]).mean())

    def _level(self, values: Values) -> dict[str, Floats]:
        """The values with the directions' mean where it was and the rigs turned instead, if none stood
        exactly."""
        if not self._turned:
            return dict(values)
        by = values["direction_deg"].mean() - np.mean([s.direction_deg for s in self._sensors])
        rigs = {key: value + by for key, value in values.items() if key.startswith("turn_")}
        return {**values, **rigs, "direction_deg": values["direction_deg"] - by}

    def _scanned(
        self, optics: Optics, values: Values, reach: float, noise: float | None = None
    ) -> dict[str, Floats]:
        """The values with each sensor's direction where it costs least within `reach` degrees."""
        if self._data.straight:
            return dict(values)
        return scan(optics.readings, values, self._observed(optics, noise), reach)

    def _ended(self, optics: Optics, values: Values, ends: Sequence[float] = ()) -> dict[str, Floats]:
        """The values with rays that end where the residual is smallest; without an end unless one is much
        better."""
        if self._data.straight:  # a dead zone has the same effect
            return dict(values)

        def left(end: float) -> float:
            return self._left(optics, {**values, "range_cm": np.array([end])})

        best = min([float(values["range_cm"][0]), *ends], key=left)
        for near in NEARER if best else ():
            tried = best * (1.0 + near * np.linspace(-1.0, 1.0, 11))
            found = np.array([left(end) for end in tried])
            best = float(tried[found <= found.min() * LIKE].mean())  # the middle of equally good ones
        return {**values, "range_cm": np.array([best if left(best) * PLAIN < left(0.0) else 0.0])}

    def solved(
        self, optics: Optics, start: Values, noise: float | None = None, *, intervals: bool = False
    ) -> Fit:
        """Least squares over all free constants, without readings near a jump, where a difference quotient is
        no derivative; `noise` is the assumed accuracy of the readings, counts."""
        data = self._observed(optics, noise)
        free = self._parameters(optics.lobe)
        if 0 < start["matt"] < 1:
            free.append(MATT)
        if not self._data.straight and _background_of(optics.scenes[0][0]) in start:
            free += self._lights()
        hang = np.zeros(data.use.shape, bool)
        if start["range_cm"] > 0:
            near, far = _beside(optics, start, "range_cm", AT_END * start["range_cm"])
            hang |= np.abs(near - far) > data.noise
        if not self._data.straight:
            right, left = _beside(optics, start, "direction_deg", HAIR_DEG)
            hang |= np.abs(right + left - 2.0 * optics.readings(start)) > data.noise
        data = replace(data, use=data.use & ~hang)
        found = fit(
            free, lambda values: optics.readings({**start, **values}), data, start=start, intervals=intervals
        )
        return replace(found, values={**start, **found.values})

    def _observed(self, optics: Optics, noise: float | None) -> Observed:
        seen, some = optics.seen, len(optics.seen.counts) != len(self._blocks)
        clusters = self._blocks[self._few] if some else self._blocks
        return Observed(counts=seen.counts, noise=noise or self._noise, use=seen.use, clusters=clusters)


def _beside(optics: Optics, values: Values, key: str, by: Floats | float) -> list[Floats]:
    """The readings with a constant on either side of where it is."""
    return [optics.readings({**values, key: values[key] + off}) for off in (-by, by)]


def backgrounds(values: Values, scenes: Scenes) -> list[float]:
    """The added light of each recording's room, 1/cm²."""
    return [value_of(values, _background_of(name)) for name, _ in scenes]


def in_mean(background: Floats, use: Use) -> Floats:
    """[S] mean background of each sensor's readings in use, from that of all rows [n]; a sensor without
    readings takes the others'."""
    mean = (use * background[:, None]).sum(axis=0) / np.maximum(use.sum(axis=0), 1)
    there = use.any(axis=0)
    return np.asarray(np.where(there, mean, mean[there].mean()))


def _gain_of(sensor: int) -> str:
    return f"a_{sensor}"


def _background_of(turn: str) -> str:
    """Key of the added light of a recording's room (1/cm²), from that of its rig's rotation."""
    return turn.replace("turn", "background").replace("_deg", "")


def _shift_of(turn: str) -> str:
    """Key of a rig's extra distance (cm), from that of its rotation."""
    return turn.replace("turn", "shift").replace("deg", "cm")
