"""A robot's sensors (§3.2.3, §3.3): places in its frame and the constants of their laws."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from realitygap.kernels.params import CONE, RAYS
from realitygap.values import Floats
from realitygap.world.files import Value, require
from realitygap.world.look_up import LookUp
from realitygap.world.rays import (
    FAN,
    RAY_ANGLES_DEG,
    fan,
    fan_weights,
    ray_angles,
    ray_weights,
    side_by_side,
    unit,
)
from realitygap.world.sensor_checks import Sensor, check_both, kernel_both

__all__ = [
    "RAY_NUMBERS",
    "RESPONSES",
    "UNLIT",
    "Ambient",
    "AmbientSensor",
    "Infrared",
    "ProximitySensor",
    "looks",
]

RESPONSES = ("paper", "linear", "measured")
"""Laws from illumination to counts."""
TURN = "Turn them round: the first becomes input -10, the second +10."
"""The cure for an input range in the wrong order."""
RAY_NUMBERS = (10, 16, 18, 20, 24, 27, 30, 32, 36, 40, 45, 48, 50, 54, 60)
"""How many rays reflected light may come in by."""


@dataclass(frozen=True, kw_only=True)
class ProximitySensor(Sensor):
    """Place and direction in the robot's frame (x forward, y left), and the law's constants."""

    a: float
    b: float
    offset_cm: float = 0.0
    curve: tuple[float, ...] = ()
    noise: tuple[float, ...] = ()
    noise_rise: float = 0.0

    def _check(self) -> None:
        super()._check()
        require(self.a > 0, "a", "more than 0", self.a)
        rising = all(one <= two for one, two in pairwise(self.curve))
        require(rising, "curve", "counts that never fall", self.curve)

    def reach_cm(self) -> float:
        """Distance beyond which no ray adds to the sum: √(a/−b) − offset; none where b ≥ 0."""
        return math.inf if self.b >= 0 else max(0.0, math.sqrt(self.a / -self.b) - self.offset_cm)


def looks(
    place: Floats, facing: Floats, reach: Floats, a: Floats, b: Floats, offset: Floats
) -> dict[str, Any]:
    """What the kernels' `Robot` has of proximity sensors' constants: those that a reach follows from."""
    return {
        "proximity_reach": reach,
        "proximity_rows": side_by_side(*place.T, *facing.T, reach, a, b, offset),
        "proximity_span": float(np.max(np.hypot(*place.T) + reach, initial=0.0)),
    }


@dataclass(frozen=True, kw_only=True)
class Infrared(Value):
    """Proximity (§3.2.3): I = Σ cos^m β (a/(d + offset)² + b), clipped to 0 … top.

    Beyond the paper: with `matt` 1 surfaces throw a back by the cosine of the angle under which a ray
    meets them (Lambert). Sensors with a curve read as measured: x = Σ lobe a / ((d + offset)² + width²)
    over rays at 0, ¼, ½, ¾ and 1 of `aperture_deg` to either side, none of which sees beyond `range_cm`
    (0: no end), less `overlap` times what the outermost would see of a flat surface at the middle ray's d;
    d + offset counts from 0 on. A curve holds counts at equal steps of √x / (√x + 1/curve_cm) from 0 to 1;
    readings below `dead` are 0. A sensor's noise holds deviations at equal steps of the reading, 0 … top,
    and its rise with the wheels' speed (a share for each cm/s). Sensors with a look-up `table` read by that.
    """

    exponent: float
    top: float
    bands: tuple[float, float]
    sensors: tuple[ProximitySensor, ...]
    matt: float = 0.0
    lobe: tuple[float, ...] = ()
    overlap: float = 0.0
    aperture_deg: float = 0.0
    width_cm: float = 0.0
    range_cm: float = 0.0
    curve_cm: float = 0.0
    dead: float = 0.0
    table: LookUp = LookUp()  # noqa: RUF009 (a frozen value)

    @property
    def measured(self) -> bool:
        """Whether the sensors read by curves of their own."""
        return any(sensor.curve for sensor in self.sensors)

    def to_kernel(self) -> dict[str, Any]:
        """Its part of the kernels' `Robot`."""
        sensors, aperture = self.sensors, self.aperture_deg if self.measured else 0.0
        angles = [share * aperture for share in FAN] if aperture else RAY_ANGLES_DEG
        a, b, offset = (np.array([getattr(s, key) for s in sensors]) for key in ("a", "b", "offset_cm"))
        own = kernel_both("proximity", self)
        return {
            **own,
            "proximity_fan": fan(angles, fan_weights(self.lobe) if aperture else ray_weights(self.exponent)),
            "proximity_cone": unit(aperture)[0] if aperture else CONE,
            "proximity_a": a,
            "proximity_b": b,
            "proximity_offset": offset,
            **looks(
                own["proximity_place"],
                own["proximity_facing"],
                np.array([self.reach_cm(s) for s in sensors]),
                a,
                b,
                offset,
            ),
            "proximity_knee": 1.0 / self.curve_cm if self.curve_cm else 0.0,
            "proximity_width2": self.width_cm**2,
            "proximity_least": 1.0 / self.range_cm if self.range_cm else 0.0,
            "proximity_overlap": self.overlap,
            "proximity_dead": self.dead,
            "proximity_table": self.table.to_kernel(),
            "proximity_lambertian": self.matt,
        }

    def reach_cm(self, sensor: ProximitySensor) -> float:
        """Distance beyond which a sensor reads what it reads in the dark, whatever is there."""
        if not sensor.curve:
            return sensor.reach_cm()
        steps = len(sensor.curve) - 1
        flat = next((k for k, one in enumerate(sensor.curve) if one > sensor.curve[0]), steps + 1) - 1
        least = (flat / max(steps - flat, 1e-9) / self.curve_cm) ** 2
        most = sensor.a * sum(max(share, 0.0) for share in self.lobe)
        far = math.sqrt(max(most / least - self.width_cm**2, 0.0)) - sensor.offset_cm if least else math.inf
        return max(0.0, min(far, self.range_cm or math.inf))

    def _check(self) -> None:
        require(self.top > 0, "top", "more than 0", self.top)
        check_both(self)
        self.table.check(len(self.sensors), self.top)
        if self.measured:
            shares = f"{RAYS // 2} shares from the middle outwards, their sum above 0"
            require(len(self.lobe) == RAYS // 2 and sum(self.lobe) > 0, "lobe", shares, self.lobe)
            require(0 < self.aperture_deg <= 85, "aperture_deg", "degrees above 0 to 85", self.aperture_deg)
            require(1e-6 < self.curve_cm < 1e6, "curve_cm", "cm above 0, below a million", self.curve_cm)
        for key in ("exponent", "width_cm", "range_cm", "overlap"):
            require(0 <= getattr(self, key) < 1e6, key, "0 or more, below a million", getattr(self, key))
        require(0 <= self.dead < self.top, "dead", "counts from 0 to below top", self.dead)
        far, near = self.bands
        require(far < near, "bands", "the reading far away, then the reading close by", self.bands, TURN)
        require(near <= self.top, "bands", f"readings up to top ({self.top:g})", self.bands)


@dataclass(frozen=True, kw_only=True)
class AmbientSensor(Sensor):
    """Place and direction in the robot's frame; `gain` multiplies the total illumination.

    The shifts are added to the robot's floor and dark readings (counts), 0 in the paper.
    """

    gain: float = 1.0
    floor_shift: float = 0.0
    dark_shift: float = 0.0
    curve: tuple[float, ...] = ()
    noise: tuple[float, ...] = ()
    noise_rise: float = 0.0

    def _check(self) -> None:
        super()._check()
        require(self.gain > 0, "gain", "more than 0", self.gain)
        falling = all(one >= two for one, two in pairwise(self.curve))
        require(falling, "curve", "counts that never rise", self.curve)


@dataclass(frozen=True, kw_only=True)
class Ambient(Value):
    """Ambient light (§3.3): V = floor + 1/√A, A = D + Σ D_j · reflectance · cos^m β_j / d_j².

    Beyond the paper, all neutral by default: `response` "linear" reads V = dark − A, down to floor;
    direct light falls in by cos^facing of its angle; the lamp hangs `lamp_height_cm` above the
    sensors, its points drawn to its centre by the share `lamp_narrow`, and at least `lamp_proud_cm`
    off the walls. Reflected light falls off as 1/d² (falloff 2) or 1/√(d² + near_cm²) (falloff 1); with
    `matt` 1 surfaces are lit by the cosine of the angle under which light meets them (Lambert); it comes
    in by 10 rays or more (RAY_NUMBERS). `sensor_height_cm` is the sensors' height above the floor, and that
    of the points of walls that they see: with body.height_cm it says where light passes over the body.
    """

    floor: float
    dark: float
    top: float
    reflectance: float
    exponent: float
    bands: tuple[float, float]
    sensors: tuple[AmbientSensor, ...]
    response: str = "paper"
    facing: float = 0.0
    lamp_height_cm: float = 0.0
    lamp_narrow: float = 0.0
    lamp_proud_cm: float = 0.0
    falloff: float = 2.0
    near_cm: float = 0.0
    matt: float = 0.0
    rays: float = 10.0
    sensor_height_cm: float = 0.0
    curve_light: float = 0.0

    @property
    def measured(self) -> bool:
        """Whether the sensors read by curves of their own."""
        return self.response == "measured"

    def _check(self) -> None:
        for key in ("floor", "reflectance", "exponent", "near_cm", "sensor_height_cm"):
            require(getattr(self, key) >= 0, key, "0 or more", getattr(self, key))
        require(self.dark > self.floor, "dark", f"more than floor ({self.floor:g})", self.dark)
        require(self.top >= self.dark, "top", f"at least dark ({self.dark:g})", self.top)
        check_both(self)
        dark, bright = self.bands
        require(dark > bright, "bands", "the reading in the dark, then the reading near a lamp",
                self.bands, TURN)  # fmt: skip
        require(self.response in RESPONSES, "response", " or ".join(map(repr, RESPONSES)), self.response)
        require(0 <= self.facing <= 20, "facing", "an exponent from 0 to 20", self.facing)
        require(0 <= self.lamp_height_cm <= 1e6, "lamp_height_cm", "0 to 1e6", self.lamp_height_cm)
        require(0 <= self.lamp_narrow <= 1, "lamp_narrow", "a share from 0 to 1", self.lamp_narrow)
        require(0 <= self.lamp_proud_cm <= 5, "lamp_proud_cm", "0 to 5", self.lamp_proud_cm)
        require(self.falloff in (1.0, 2.0), "falloff", "2 (as in the paper) or 1", self.falloff)
        curves = [bool(sensor.curve) for sensor in self.sensors]
        alike = any(curves) == self.measured and (self.curve_light > 0) == self.measured
        require(alike, "response", '"measured" with, and only with, curve_light and curves', self.response)
        known = ", ".join(map(str, RAY_NUMBERS))
        require(self.rays in RAY_NUMBERS, "rays", f"10 (as in the paper) or one of {known}", self.rays)
        for i, (floor, dark) in enumerate(self.ranges()):
            key = f"sensors[{i}].floor_shift"
            require(0 <= floor < dark <= self.top, key, "0 ≤ floor < dark ≤ top", (floor, dark))

    def to_kernel(self, body_height_cm: float) -> dict[str, Any]:
        """Its part of the kernels' `Robot`, on a body of this height."""
        sensors, many, own = self.sensors, round(self.rays), kernel_both("ambient", self)
        weights = ray_weights(self.exponent, self.reflectance * RAYS / many, many)
        floor, dark = np.array(self.ranges()).reshape(-1, 2).T
        columns = *own["ambient_place"].T, *own["ambient_facing"].T, np.full(len(sensors), math.inf)
        return {
            **own,
            "ambient_fan": fan(ray_angles(many), weights),
            "ambient_rows": side_by_side(*columns),
            "ambient_gain": np.array([s.gain for s in sensors]),
            "ambient_floor": floor.copy(),
            "ambient_dark": dark.copy(),
            "ambient_knee": math.sqrt(self.curve_light),
            "light_linear": float(self.response == "linear"),
            "light_facing": self.facing,
            "light_height2": self.lamp_height_cm**2,
            "light_flat": float(self.falloff == 1.0),
            "light_near": self.near_cm,
            "light_lambertian": self.matt,
            "light_narrow": self.lamp_narrow,
            "light_wall_offset": self.lamp_proud_cm,
            "light_clear": self._clear_share(body_height_cm),
        }

    def _clear_share(self, body_height_cm: float) -> float:
        """The share of light's way from the lamp to a surface that is above the body's top."""
        top, rise = body_height_cm - self.sensor_height_cm, self.lamp_height_cm
        return 1.0 - top / rise if 0 < top < rise else 0.0

    def ranges(self) -> tuple[tuple[float, float], ...]:
        """Floor and dark reading of each sensor, counts."""
        return tuple((self.floor + s.floor_shift, self.dark + s.dark_shift) for s in self.sensors)


UNLIT = Ambient(floor=0, dark=1, top=1, reflectance=0, exponent=0, bands=(1, 0), sensors=())
"""Of a robot that sees no light."""
