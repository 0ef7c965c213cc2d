"""A robot's sensors (§3.2.3, §3.3): places in its frame and the constants of their laws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import ConfigError
from realitygap.kernels.params import LANES, RAYS
from realitygap.world.files import Value, require
from realitygap.world.rays import ray_weights, rays, unit

__all__ = ["RAY_NUMBERS", "RESPONSES", "UNLIT", "Ambient", "AmbientSensor", "Infrared", "ProximitySensor"]

FEWEST_TURNED, OUTWARDS_DEG = 2, 35.0
"""So many sensors that look aside tell radians from degrees; and how nearly a sensor looks outwards."""
RESPONSES = ("paper", "linear")
"""Laws from illumination to counts."""
TURN = "Turn them round: the first becomes input -10, the second +10."
"""The cure for an input range in the wrong order."""
RAY_NUMBERS = (10, 16, 18, 20, 24, 27, 30, 32, 36, 40, 45, 48, 50, 54, 60)
"""How many rays reflected light may come in by: up to six fans of eight to ten each."""


@dataclass(frozen=True, kw_only=True)
class ProximitySensor(Value):
    """Place and direction in the robot's frame (x forward, y left), and the law's constants."""

    x_cm: float
    y_cm: float
    direction_deg: float
    a: float
    b: float
    offset_cm: float = 0.0

    def _check(self) -> None:
        _check_direction(self.direction_deg)
        require(self.a > 0, "a", "more than 0", self.a)

    def reach_cm(self) -> float:
        """Distance beyond which no ray adds to the sum: √(a/−b) − offset; none where b ≥ 0."""
        return math.inf if self.b >= 0 else max(0.0, math.sqrt(self.a / -self.b) - self.offset_cm)


@dataclass(frozen=True, kw_only=True)
class Infrared(Value):
    """Proximity (§3.2.3): I = Σ cos^m β (a/(d + offset)² + b), clipped to 0 … top.

    Beyond the paper: with matt 1 surfaces throw a back by the cosine of the angle under which a ray
    meets them (Lambert).
    """

    exponent: float
    top: float
    bands: tuple[float, float]
    sensors: tuple[ProximitySensor, ...]
    matt: float = 0.0

    def to_kernel(self) -> dict[str, Any]:
        """Its part of the kernels' `Robot`."""
        sensors = self.sensors
        return {
            "proximity_place": _places(sensors),
            "proximity_ray": rays([s.direction_deg for s in sensors]),
            "proximity_weight": ray_weights(len(sensors), self.exponent),
            "proximity_a": np.array([s.a for s in sensors]),
            "proximity_b": np.array([s.b for s in sensors]),
            "proximity_offset": np.array([s.offset_cm for s in sensors]),
            "proximity_reach": np.array([s.reach_cm() for s in sensors]),
            "proximity_top": self.top,
            "proximity_lambertian": self.matt,
            "proximity_low": self.bands[0],
            "proximity_high": self.bands[1],
        }

    def _check(self) -> None:
        require(self.exponent >= 0, "exponent", "0 or more", self.exponent)
        require(self.top > 0, "top", "more than 0", self.top)
        require(self.matt in (0.0, 1.0), "matt", "0 (as in the paper) or 1", self.matt)
        _check_bands(self.bands)
        far, near = self.bands
        require(far < near, "bands", "what is read far off, then what is read near by", self.bands, TURN)
        _check_radians(self.sensors)


@dataclass(frozen=True, kw_only=True)
class AmbientSensor(Value):
    """Place and direction in the robot's frame; `gain` multiplies the total illumination.

    The shifts are added to the robot's floor and dark readings (counts), 0 in the paper.
    """

    x_cm: float
    y_cm: float
    direction_deg: float
    gain: float = 1.0
    floor_shift: float = 0.0
    dark_shift: float = 0.0

    def _check(self) -> None:
        _check_direction(self.direction_deg)
        require(self.gain > 0, "gain", "more than 0", self.gain)


@dataclass(frozen=True, kw_only=True)
class Ambient(Value):
    """Ambient light (§3.3): V = floor + 1/√A, A = D + Σ D_j · reflectance · cos^m β_j / d_j².

    Beyond the paper, all neutral by default: `response` "linear" reads V = dark − A, down to floor;
    direct light falls in by cos^facing of its angle; the lamp hangs `lamp_height_cm` above the
    sensors, its points drawn to its centre by the share `lamp_narrow`, and at least `lamp_proud_cm`
    off the walls. Reflected light falls off as 1/d² (falloff 2) or 1/√(d² + near_cm²) (falloff 1); with
    matt 1 surfaces are lit by the cosine of the angle under which light meets them (Lambert); it comes
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

    def _check(self) -> None:
        require(self.floor >= 0, "floor", "0 or more", self.floor)
        require(self.dark > self.floor, "dark", f"more than floor ({self.floor:g})", self.dark)
        require(self.top >= self.dark, "top", f"at least dark ({self.dark:g})", self.top)
        require(self.reflectance >= 0, "reflectance", "0 or more", self.reflectance)
        require(self.exponent >= 0, "exponent", "0 or more", self.exponent)
        _check_bands(self.bands)
        dark, bright = self.bands
        require(dark > bright, "bands", "what is read in the dark, then what is read near a lamp",
                self.bands, TURN)  # fmt: skip
        _check_radians(self.sensors)
        require(self.response in RESPONSES, "response", " or ".join(map(repr, RESPONSES)), self.response)
        require(0 <= self.facing <= 20, "facing", "an exponent from 0 to 20", self.facing)
        require(0 <= self.lamp_height_cm <= 1e6, "lamp_height_cm", "0 to 1e6", self.lamp_height_cm)
        require(0 <= self.lamp_narrow <= 1, "lamp_narrow", "a share from 0 to 1", self.lamp_narrow)
        require(0 <= self.lamp_proud_cm <= 5, "lamp_proud_cm", "0 to 5", self.lamp_proud_cm)
        require(self.falloff in (1.0, 2.0), "falloff", "2 (as in the paper) or 1", self.falloff)
        require(self.near_cm >= 0, "near_cm", "0 or more", self.near_cm)
        require(self.matt in (0.0, 1.0), "matt", "0 (as in the paper) or 1", self.matt)
        require(self.sensor_height_cm >= 0, "sensor_height_cm", "0 or more", self.sensor_height_cm)
        known = ", ".join(map(str, RAY_NUMBERS))
        require(self.rays in RAY_NUMBERS, "rays", f"10 (as in the paper) or one of {known}", self.rays)
        for i, (floor, dark) in enumerate(self.ranges()):
            key = f"sensors[{i}].floor_shift"
            require(0 <= floor < dark <= self.top, key, "0 ≤ floor < dark ≤ top", (floor, dark))

    def to_kernel(self, body_height_cm: float) -> dict[str, Any]:
        """Its part of the kernels' `Robot`, on a body of this height."""
        sensors, shifts = self.sensors, self.shifts_deg()
        per_fan, thrown_back = round(self.rays) // len(shifts), self.reflectance * RAYS / self.rays
        fans = [ray_weights(1, self.exponent, thrown_back, shift, per_fan) for shift in shifts]
        floor, dark = np.array(self.ranges()).reshape(-1, 2).T
        return {
            "ambient_place": _places(sensors),
            "ambient_facing": np.array([unit(s.direction_deg) for s in sensors]).reshape(-1, 2),
            "ambient_ray": rays([s.direction_deg + shift for s in sensors for shift in shifts], per_fan),
            "ambient_weight": np.concatenate([np.zeros((0, LANES)), *fans * len(sensors)]),
            "ambient_gain": np.array([s.gain for s in sensors]),
            "ambient_floor": floor.copy(),
            "ambient_dark": dark.copy(),
            "ambient_top": self.top,
            "light_linear": float(self.response == "linear"),
            "light_facing": self.facing,
            "light_height2": self.lamp_height_cm**2,
            "light_flat": float(self.falloff == 1.0),
            "light_near": self.near_cm,
            "light_lambertian": self.matt,
            "light_narrow": self.lamp_narrow,
            "light_wall_offset": self.lamp_proud_cm,
            "light_clear": self._clear_share(body_height_cm),
            "ambient_low": self.bands[0],
            "ambient_high": self.bands[1],
        }

    def _clear_share(self, body_height_cm: float) -> float:
        """The share of light's way from the lamp to a surface that is above the body's top."""
        top, rise = body_height_cm - self.sensor_height_cm, self.lamp_height_cm
        return 1.0 - top / rise if 0 < top < rise else 0.0

    def shifts_deg(self) -> tuple[float, ...]:
        """By how much each fan of at most ten rays is turned off the sensor's direction."""
        fans = -(-round(self.rays) // RAYS)
        return tuple((i - (fans - 1) / 2) * 180.0 / self.rays for i in range(fans))

    def ranges(self) -> tuple[tuple[float, float], ...]:
        """Floor and dark reading of each sensor, counts."""
        return tuple((self.floor + s.floor_shift, self.dark + s.dark_shift) for s in self.sensors)


def _places(sensors: Sequence[ProximitySensor | AmbientSensor]) -> NDArray[np.float64]:
    return np.array([(s.x_cm, s.y_cm) for s in sensors]).reshape(-1, 2)


def _check_direction(direction_deg: float) -> None:
    require(-360 <= direction_deg <= 360, "direction_deg", "degrees from -360 to 360", direction_deg)


def _check_radians(sensors: Sequence[ProximitySensor | AmbientSensor]) -> None:
    """Refuse directions that are none in degrees, but look outwards in radians."""
    turned = [s for s in sensors if s.direction_deg and math.hypot(s.x_cm, s.y_cm) > 0]
    if len(turned) < FEWEST_TURNED or any(abs(s.direction_deg) > math.tau + 1e-3 for s in sensors):
        return
    places = [math.degrees(math.atan2(s.y_cm, s.x_cm)) for s in turned]
    here = [_apart(s.direction_deg, place) for s, place in zip(turned, places, strict=True)]
    there = [_apart(math.degrees(s.direction_deg), place) for s, place in zip(turned, places, strict=True)]
    if max(there) < OUTWARDS_DEG < min(here):
        key = f"sensors[{sensors.index(turned[0])}].direction_deg"
        cure = "These look like radians: sensors would look where they sit. Convert all of them."
        require(False, key, "degrees", turned[0].direction_deg, cure)


def _apart(a_deg: float, b_deg: float) -> float:
    return abs((a_deg - b_deg + 180.0) % 360.0 - 180.0)


def _check_bands(bands: tuple[float, float]) -> None:
    if bands[0] == bands[1]:
        raise ConfigError(
            f"bands: expected two different readings (they become inputs -10 and +10), got {list(bands)}."
        )


UNLIT = Ambient(floor=0, dark=1, top=1, reflectance=0, exponent=0, bands=(1, 0), sensors=())
"""Of a robot that sees no light."""
