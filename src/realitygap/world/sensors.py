"""A robot's sensors as frozen values: infrared, light, rays, look-up tables (§3.2.3, §3.3)."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.kernels import types
from realitygap.kernels.types import CONE, EYES, F32, RAYS, Contribution, Light, Proximity, Table
from realitygap.values import Floats
from realitygap.world.toml import Value, require

__all__ = [
    "FAN", "RAY_ANGLES_DEG", "RAY_NUMBERS", "UNLIT", "Ambient", "AmbientSensor", "Infrared",
    "LookUp", "ProximitySensor", "Sensor", "fan",
    "ray_angles", "ray_weights", "side_by_side", "unit", "within_reach",
]  # fmt: skip


FAN = (-1.0, -0.75, -0.5, -0.25, 0.0, 0.0, 0.25, 0.5, 0.75, 1.0)
"""Where the rays of a measured sensor lie, in shares of its aperture: the middle is there twice."""


@cache
def ray_angles(number: int) -> tuple[float, ...]:
    """Middles of this many equal parts of 180°, degrees from the sensor's direction."""
    return tuple(180.0 / number * (i + 0.5) - 90.0 for i in range(number))


RAY_ANGLES_DEG = ray_angles(RAYS)
"""β of each ray, −81 … +81: the middles of ten equal parts of 180° (a reading of §3.2.3)."""


def unit(direction_deg: float) -> tuple[float, float]:
    """Unit vector (x, y) of a direction in degrees."""
    turned = math.radians(180.0 - (180.0 - direction_deg) % 360.0)
    return round(math.cos(turned), 15) + 0.0, round(math.sin(turned), 15) + 0.0


def fan(angles_deg: Sequence[float], weights: Sequence[float]) -> F32:
    """Rays [3, n] at angles off a sensor's direction, that one of each mirror-image pair which comes first:
    cosines, sines, weights; one that is its own image has half its weight."""
    pairs, odd = (len(angles_deg) + 1) // 2, len(angles_deg) % 2
    rows = np.array([*zip(*map(unit, angles_deg[:pairs]), strict=True), weights[:pairs]], np.float32)
    rows[2, -1] *= 0.5 if odd else 1.0
    return rows


def ray_weights(exponent: float, factor: float = 1.0, number: int = RAYS) -> list[float]:
    """factor · cos^m β of each of `number` rays, m being the exponent."""
    return [factor * round(math.cos(math.radians(beta)) ** exponent, 15) for beta in ray_angles(number)]


def fan_weights(lobe: Sequence[float]) -> list[float]:
    """The rays' weights in a FAN: each share of a lobe belongs to two rays."""
    halves = [share / 2 for share in lobe]
    return [*halves[::-1], *halves]


def side_by_side(*columns: Iterable[float]) -> F32:
    """Blocks [n, constants, 8] of constants of sensors; the last sensor is repeated to a whole block."""
    with np.errstate(over="ignore"):  # beyond all measure: a trial then says so
        rows = np.array([list(column) for column in columns], np.float32)
    rows = np.concatenate([rows, np.repeat(rows[:, -1:], -rows.shape[1] % EYES, axis=1)], axis=1)
    return np.ascontiguousarray(np.moveaxis(rows.reshape(len(rows), -1, EYES), 0, 1))


@dataclass(frozen=True, kw_only=True)
class Sensor(Value):
    """Its place and direction in the robot's frame; both kinds end with the same tables."""

    x_cm: float
    y_cm: float
    direction_deg: float

    def _check(self) -> None:
        turn = self.direction_deg
        require(-360 <= turn <= 360, "direction_deg", "degrees from -360 to 360", turn)
        own: Any = self
        for key, values in (("curve", own.curve), ("noise", own.noise)):
            require(len(values) != 1, key, "two values or more, or none", values)
            require(all(value >= 0 for value in values), key, "values of 0 or more", values)
        require(own.noise_rise >= 0, "noise_rise", "0 or more", own.noise_rise)


def kernel_both(own: Any) -> dict[str, Any]:
    """What the kernels' sensors of either kind have; `own` is the profile's part."""
    sensors = own.sensors
    return {
        "place": np.array([(s.x_cm, s.y_cm) for s in sensors]).reshape(-1, 2),
        "facing": np.array([unit(s.direction_deg) for s in sensors]).reshape(-1, 2),
        "curve": _table([s.curve for s in sensors]),
        "noise": _table([s.noise for s in sensors]),
        "rise": np.array([s.noise_rise for s in sensors]),
        "between": np.array(own.between),
        "top": own.top,
        "low": own.bands[0],
        "high": own.bands[1],
    }


def _table(rows: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """[sensors, n] one row a sensor."""
    return np.array(rows, float).reshape(len(rows), len(rows[0]) if rows else 0)


def check_both(own: Any) -> None:
    """Refuse of either part of a profile tables of several lengths, and values above the full scale."""
    require(own.matt in (0.0, 1.0), "matt", "0 (as in the paper) or 1", own.matt)
    for key in ("curve", "noise"):
        lengths = {len(getattr(sensor, key)) for sensor in own.sensors}
        require(len(lengths) <= 1, f"sensors.{key}", "as many values for every sensor", sorted(lengths))
        for i, sensor in enumerate(own.sensors):
            most = max(getattr(sensor, key), default=0.0)
            require(most <= own.top, f"sensors[{i}].{key}", f"at most top ({own.top:g})", most)
    require(len(own.between) != 1, "between", "two values or more, or none", own.between)
    fits = all(0 <= value <= own.top for value in own.between)
    require(fits, "between", f"values from 0 to top ({own.top:g})", own.between)


@dataclass(frozen=True, kw_only=True)
class LookUp(Value):
    """What proximity sensors read round objects, in the place of a law (the paper's reference [15]).

    `nothing` holds each sensor's counts where nothing is near; without any there is no table. `wall_cm` are
    distances from the body's edge, rising; `wall` a row a sensor, of counts: all bearings, at equal steps
    counter-clockwise from the robot's front, at the first distance, then at the next. So for cylinders, from
    edge to edge, whatever their radius. How readings follow: `kernels/infrared.py`.
    """

    nothing: tuple[float, ...] = ()
    wall_cm: tuple[float, ...] = ()
    wall: tuple[tuple[float, ...], ...] = ()
    cylinder_cm: tuple[float, ...] = ()
    cylinder: tuple[tuple[float, ...], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.nothing)

    def check(self, sensors: int, top: float) -> None:
        """Refuse a table that is not for these sensors and this full scale.

        Raises:
            ConfigError: names the key.
        """
        if self == LookUp():
            return
        require(len(self.nothing) == sensors, "nothing", f"one of each sensor ({sensors})", self.nothing)
        require(all(0 <= v <= top for v in self.nothing), "nothing", f"0 to top ({top:g})", self.nothing)
        for key in ("wall", "cylinder"):
            at, rows = getattr(self, f"{key}_cm"), getattr(self, key)
            rising = len(at) >= 2 and at[0] >= 0 and all(one < two for one, two in pairwise(at))
            require(rising, f"{key}_cm", "two distances or more, rising from 0 or more", at)
            require(len(rows) == sensors, key, f"a row for each sensor ({sensors})", len(rows))
            lengths = sorted({len(row) for row in rows})
            fits = len(lengths) == 1 and lengths[0] % len(at) == 0 and lengths[0] >= 2 * len(at)
            many = f"rows of one length, two bearings or more at each of {len(at)} distances"
            require(fits, key, many, lengths)
            counts = [count for row in rows for count in row]
            ends = min(counts), max(counts)
            require(ends[0] >= 0 and ends[1] <= top, key, f"counts from 0 to top ({top:g})", ends)

    def to_kernel(self) -> Table | tuple[()]:
        """The table as the kernels take it; (): none."""
        if not self:
            return ()
        nothing = np.array(self.nothing)

        def seen(at: tuple[float, ...], rows: tuple[tuple[float, ...], ...]) -> Contribution:
            counts = np.array(rows).T.reshape(len(at), -1, len(rows))
            return Contribution(at=np.array(at), added=np.ascontiguousarray(counts - nothing))

        return Table(nothing, seen(self.wall_cm, self.wall), seen(self.cylinder_cm, self.cylinder))


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


def within_reach(
    place: Floats, facing: Floats, reach: Floats, a: Floats, b: Floats, offset: Floats
) -> dict[str, Any]:
    """Those of the kernels' constants of proximity sensors that follow from a reach.

    Args:
        place, facing: [P, 2] in the robot's frame, cm; unit vectors.
        reach: [P] cm.
        a, b, offset: [P] constants of the law.
    """
    return {
        "reach": reach,
        "rows": side_by_side(*place.T, *facing.T, reach, a, b, offset),
        "span": float(np.max(np.hypot(*place.T) + reach, initial=0.0)),
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
    and its rise with the wheels' speed (a share for each cm/s). `between` holds at the same steps how much
    readings at one place differ between days or units. Sensors with a look-up `table` read by that.
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
    between: tuple[float, ...] = ()
    table: LookUp = LookUp()

    @property
    def measured(self) -> bool:
        """Whether the sensors read by curves of their own."""
        return any(sensor.curve for sensor in self.sensors)

    def to_kernel(self) -> Proximity:
        """The sensors as the kernels take them."""
        sensors, aperture = self.sensors, self.aperture_deg if self.measured else 0.0
        angles = [share * aperture for share in FAN] if aperture else RAY_ANGLES_DEG
        a, b, offset = (np.array([getattr(s, key) for s in sensors]) for key in ("a", "b", "offset_cm"))
        own = kernel_both(self)
        reach = np.array([self.reach_cm(s) for s in sensors])
        return Proximity(
            **own,
            **within_reach(own["place"], own["facing"], reach, a, b, offset),
            fan=fan(angles, fan_weights(self.lobe) if aperture else ray_weights(self.exponent)),
            cone=unit(aperture)[0] if aperture else CONE,
            a=a,
            b=b,
            offset=offset,
            knee=1.0 / self.curve_cm if self.curve_cm else 0.0,
            width2=self.width_cm**2,
            least=1.0 / self.range_cm if self.range_cm else 0.0,
            overlap=self.overlap,
            dead=self.dead,
            table=self.table.to_kernel(),
            lambertian=self.matt,
        )

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
    between: tuple[float, ...] = ()

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
        told = "the reading in the dark, then the reading near a lamp"
        require(dark > bright, "bands", told, self.bands, TURN)
        require(self.response in RESPONSES, "response", " or ".join(map(repr, RESPONSES)), self.response)
        for key, most in (("facing", 20), ("lamp_height_cm", 1e6), ("lamp_narrow", 1), ("lamp_proud_cm", 5)):
            require(0 <= getattr(self, key) <= most, key, f"0 to {most:g}", getattr(self, key))
        require(self.falloff in (1.0, 2.0), "falloff", "2 (as in the paper) or 1", self.falloff)
        curves = [bool(sensor.curve) for sensor in self.sensors]
        alike = any(curves) == self.measured and (self.curve_light > 0) == self.measured
        require(alike, "response", '"measured" with, and only with, curve_light and curves', self.response)
        known = ", ".join(map(str, RAY_NUMBERS))
        require(self.rays in RAY_NUMBERS, "rays", f"10 (as in the paper) or one of {known}", self.rays)
        for i, (floor, dark) in enumerate(self.ranges()):
            key = f"sensors[{i}].floor_shift"
            require(0 <= floor < dark <= self.top, key, "0 ≤ floor < dark ≤ top", (floor, dark))

    def to_kernel(self, body_height_cm: float) -> tuple[types.Ambient, Light]:
        """Sensors and law as the kernels take them, on a body of this height."""
        sensors, many, own = self.sensors, round(self.rays), kernel_both(self)
        weights = ray_weights(self.exponent, self.reflectance * RAYS / many, many)
        floor, dark = np.array(self.ranges()).reshape(-1, 2).T
        eyes = types.Ambient(
            **own,
            fan=fan(ray_angles(many), weights),
            rows=side_by_side(*own["place"].T, *own["facing"].T, np.full(len(sensors), math.inf)),
            gain=np.array([s.gain for s in sensors]),
            floor=floor.copy(),
            dark=dark.copy(),
            knee=math.sqrt(self.curve_light),
        )
        light = Light(
            linear=float(self.response == "linear"),
            facing=self.facing,
            height2=self.lamp_height_cm**2,
            flat=float(self.falloff == 1.0),
            near=self.near_cm,
            lambertian=self.matt,
            narrow=self.lamp_narrow,
            wall_offset=self.lamp_proud_cm,
            clear=self._clear_share(body_height_cm),
        )
        return eyes, light

    def _clear_share(self, body_height_cm: float) -> float:
        """The share of light's way from the lamp to a surface that is above the body's top."""
        top, rise = body_height_cm - self.sensor_height_cm, self.lamp_height_cm
        return 1.0 - top / rise if 0 < top < rise else 0.0

    def ranges(self) -> tuple[tuple[float, float], ...]:
        """Floor and dark reading of each sensor, counts."""
        return tuple((self.floor + s.floor_shift, self.dark + s.dark_shift) for s in self.sensors)


UNLIT = Ambient(floor=0, dark=1, top=1, reflectance=0, exponent=0, bands=(1, 0), sensors=())
"""Of a robot that sees no light."""
