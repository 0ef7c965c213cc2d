"""The readings of measured sensors for one set of values: rays, and a curve for each sensor."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.curves import STEPS, Curves, Seen, on_curves
from realitygap.calibration.forms import columns_of
from realitygap.calibration.forward import Scene, received, up_curve, work_of
from realitygap.calibration.solve import Values, value_of
from realitygap.kernels.trial import Scratch
from realitygap.kernels.types import Robot
from realitygap.values import Floats
from realitygap.world.robot import Profile

__all__ = ["SHARES", "Optics", "about_rig", "background_of", "backgrounds", "gain_of", "in_mean", "shift_of"]

Use = NDArray[np.bool_]

V = TypeVar("V")
SHARES = ("share_1", "share_2", "share_3", "share_4")


@dataclass(frozen=True, kw_only=True, eq=False)
class Optics:
    """A fit in progress: the base profile, the curves' middle, the readings (`seen`) and their places
    (`place` [n]); and the free parts of the lobe."""

    base: Profile
    scenes: Sequence[tuple[str, Scene]]
    seen: Seen
    place: NDArray[np.int64]
    lobe: tuple[str, ...] = ()

    @cached_property
    def _robot(self) -> Robot:
        return self.base.to_kernel()

    @cached_property
    def _work(self) -> Scratch:
        return work_of(self._robot)

    def profile(self, values: Values) -> Profile:
        """The base with the optics in place and placeholder curves; unchecked, since checks would take a
        fifth of a search. The result is checked at the end."""
        law = self.base.infrared
        shares = [float(values[key][0]) for key in SHARES]
        wide, width, end = (float(values[key][0]) for key in ("aperture_deg", "width_cm", "range_cm"))
        columns = columns_of(values, ("direction_deg",), law.sensors)
        columns["offset_cm"] = [float(values["offset_cm"][0])] * len(law.sensors)
        gains = {k: float(values[key][0]) for k in range(len(law.sensors)) if (key := gain_of(k)) in values}
        usual = float(np.mean([*gains.values()])) if gains else 1.0
        columns["a"] = [gains.get(k, usual) for k in range(len(law.sensors))]
        sensors = tuple(
            unchecked(sensor, **{key: column[k] for key, column in columns.items()})
            for k, sensor in enumerate(law.sensors)
        )
        law = unchecked(
            law, sensors=sensors, lobe=(1.0 - sum(shares), *shares),
            overlap=0.0 if "share_1" in self.lobe else shares[-1], aperture_deg=wide, width_cm=width,
            range_cm=end,
        )  # fmt: skip
        return unchecked(self.base, infrared=law)

    def share(self, profile: Profile, values: Values) -> Floats:
        """[n, S] position of each reading on its curve."""
        robot = self._robot._replace(proximity=profile.infrared.to_kernel())
        rigs = []
        for name, scene in self.scenes:
            rigs.append((scene.tried(values), value_of(values, name), value_of(values, shift_of(name))))
        light = received(robot, rigs, self._work) + np.outer(self._lit(values), robot.proximity.a)
        return up_curve(light, profile.infrared.curve_cm)[self.place]

    def _lit(self, values: Values) -> Floats:
        """The room's added light at each place."""
        return np.repeat(backgrounds(values, self.scenes), [len(scene.poses) for _, scene in self.scenes])

    def in_room(self, values: Values, curves: Floats, use: Use) -> Floats:
        """Curves [S, n] in the mean of the rooms that each sensor was recorded in: with its background, for a
        profile that has none."""
        law = self.profile(values).infrared
        lit = self._lit(values)
        if not lit.any():
            return curves
        mean = in_mean(lit[self.place], use)
        share = np.minimum(np.arange(STEPS + 1.0)[:, None] / STEPS, 1.0 - 1e-9)
        light = (share / (1.0 - share) / law.curve_cm) ** 2 + mean * [s.a for s in law.sensors]
        return np.asarray(on_curves(curves, up_curve(light, law.curve_cm)).T)

    def at(self, few: NDArray[np.bool_]) -> Optics:
        """The same of some of its places [m] only."""
        of = np.split(few, np.cumsum([len(scene.poses) for _, scene in self.scenes])[:-1])
        scenes = [
            (name, replace(scene, poses=scene.poses[there], row=np.arange(int(there.sum()))))
            for (name, scene), there in zip(self.scenes, of, strict=True)
        ]
        seen = replace(self.seen, counts=self.seen.counts[few], use=self.seen.use[few])
        return replace(self, scenes=scenes, seen=seen, place=np.arange(len(seen.counts)))

    def curves(self, values: Values, use: Use, *, beyond: bool = False) -> tuple[Floats, Floats]:
        """The curves [S, n] that suit the optics, on beyond where readings end or not, and all shares."""
        u = self.share(self.profile(values), values)
        return Curves(replace(self.seen, use=use), u).fitted(beyond=beyond), u

    def readings(self, values: Values, use: Use) -> Floats:
        """Noise-free readings [n, S] by curves fitted to those in `use`; in the dead zone what exceeds it."""
        return self.read(*self.curves(values, use, beyond=True))

    def read(self, curves: Floats, u: Floats) -> Floats:
        """The same by curves [S, n] at shares [n, S]."""
        model, dead = np.minimum(on_curves(curves, u), self.seen.most), self.seen.dead
        return np.where((self.seen.counts <= 0) & (dead > 0), np.maximum(model - dead, 0.0), model)

    def shown(self, values: Values, use: Use) -> Floats:
        """Noise-free readings [n, S] as the robot reports them."""
        model = on_curves(*self.curves(values, use))
        return np.where(model < self.seen.dead, 0.0, model)

    def centred(self, values: Values) -> Optics:
        """A copy with the curves' middle where readings are neither dark nor saturated."""
        seen = self.seen
        u = self.share(self.profile(values), values)
        lit = seen.use & (seen.counts > 0.1 * seen.top) & (seen.counts < 0.9 * seen.top) & (u > 0) & (u < 1)
        if not lit.any():
            return self
        root = float(np.median(u[lit] / (1.0 - u[lit]))) / self.base.infrared.curve_cm
        law = replace(self.base.infrared, curve_cm=1.0 / root)
        return replace(self, base=replace(self.base, infrared=law))


def backgrounds(values: Values, scenes: Sequence[tuple[str, Scene]]) -> list[float]:
    """The added light of each recording's room, 1/cm²."""
    return [value_of(values, background_of(name)) for name, _ in scenes]


def in_mean(background: Floats, use: Use) -> Floats:
    """[S] mean background of each sensor's readings in use, from that of all rows [n]; a sensor without
    readings takes the others'."""
    mean = (use * background[:, None]).sum(axis=0) / np.maximum(use.sum(axis=0), 1)
    there = use.any(axis=0)
    return np.asarray(np.where(there, mean, mean[there].mean()))


def unchecked(value: V, **changes: Any) -> V:
    """A copy of a value with changes, without its checks."""
    made = copy(value)
    vars(made).update(changes)
    return made


def gain_of(sensor: int) -> str:
    return f"a_{sensor}"


def background_of(turn: str) -> str:
    """Key of the added light of a recording's room (1/cm²), from that of its rig's rotation."""
    return turn.replace("turn", "background").replace("_deg", "")


def shift_of(turn: str) -> str:
    """Key of a rig's extra distance (cm), from that of its rotation."""
    return turn.replace("turn", "shift").replace("deg", "cm")


def about_rig(values: Values, sign: float) -> dict[str, Floats]:
    """The values with directions and other rigs' rotations relative to the first rig; with -1 the inverse.

    Turning robot and rig together is what readings constrain least.
    """
    turns = [key for key in values if key.startswith("turn_")]
    if not turns:
        return dict(values)
    by = sign * values[turns[0]]
    other = {"direction_deg": values["direction_deg"] + by, **{key: values[key] - by for key in turns[1:]}}
    return {**values, **other}
