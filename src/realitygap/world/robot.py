"""A robot as frozen values: profile, body, wheels, noise, and where constants come from (§3.1, §3.2)."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from realitygap import lazy
from realitygap.errors import RealityGapWarning
from realitygap.files import to_toml
from realitygap.kernels import types
from realitygap.kernels.types import MAX_DELAY, STEP_S, UPDATES
from realitygap.values import as_count
from realitygap.world.sensors import RAY_ANGLES_DEG, UNLIT, Ambient, Infrared
from realitygap.world.toml import Value, load, require, shipped

__all__ = [
    "MEASURED", "NOISE_LEVELS", "Body", "Constant", "FittedChannel", "Noise", "Profile", "Provenance",
    "SourceFile", "Wheels", "largest_pole", "load_profile", "noise_level", "noise_name", "profile_names",
]  # fmt: skip


P = TypeVar("P", types.Proximity, types.Ambient)

NOISE_LEVELS = {"zero": 0.0, "observed": 1.0, "double": 2.0}
"""The paper's three levels."""
LARGEST = 10.0
"""Beyond it the wheels' noise, a share of their speed, drives the speed control itself unstable."""


def noise_level(value: str | float) -> float:
    """A noise level from its name or number.

    Args:
        value: "zero", "observed", "double", or a number from 0 to 10 (as a number or as text).

    Raises:
        ConfigError: anything else.
    """
    text = str(value).strip().lower()
    if text in NOISE_LEVELS:
        return NOISE_LEVELS[text]
    try:
        level = math.nan if isinstance(value, bool) else float(text)
    except ValueError:
        level = math.nan
    names = ", ".join(NOISE_LEVELS)
    told = f"{names} or a number from 0 to {LARGEST:g} (1 = observed)"
    require(0 <= level <= LARGEST, "noise", told, value)
    return level + 0.0


def noise_name(level: float) -> str:
    """The name of a noise level: the paper's, or the number itself."""
    return next((name for name, value in NOISE_LEVELS.items() if value == level), f"{level:g}")


@dataclass(frozen=True, kw_only=True)
class SourceFile(Value):
    """A recording that constants were fitted to."""

    file: str
    sha256: str
    kind: str
    object: str = ""
    readings: float = 0.0


@dataclass(frozen=True, kw_only=True)
class FittedChannel(Value):
    """How well a channel was fitted: counts, or cm/s for wheels; ratio is model error over noise."""

    channel: str
    form: str
    rmse: float
    held_out_rmse: float = 0.0
    model_error: float = 0.0
    noise: float = 0.0
    ratio: float = 0.0
    ratio_over_all: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Constant(Value):
    """A constant and its 95 % interval; `told` is false where it is not identifiable from the data."""

    key: str
    value: float
    low: float
    high: float
    told: bool = True


@dataclass(frozen=True, kw_only=True)
class Provenance(Value):
    """The history of a profile; empty for one that was written by hand."""

    base: str = ""
    date: str = ""
    version: str = ""
    notes: tuple[str, ...] = ()
    pulses_per_mm: tuple[float, ...] = ()
    files: tuple[SourceFile, ...] = ()
    fits: tuple[FittedChannel, ...] = ()
    constants: tuple[Constant, ...] = ()

    def cm_per_pulse(self, pulses_per_mm: float) -> tuple[float, float]:
        """Of the left and the right counter, as measured; by `pulses_per_mm` where nothing was."""
        left, right = self.pulses_per_mm if len(self.pulses_per_mm) == 2 else (pulses_per_mm,) * 2
        return 0.1 / left, 0.1 / right


LEAST_WIDTH = 0.25
"""Of an outline, over its radius: the kernels move it in pieces of a quarter of that."""
RADII_CM = (0.2, 100.0)
"""Of bodies: neither metres, nor millimetres of a large one."""


@dataclass(frozen=True, kw_only=True)
class Body(Value):
    """A disc, or a convex polygon, and how high its top is above the floor; 0: endlessly, as in the paper.

    `outline_cm` has the polygon's corners, counter-clockwise, from the axle's middle (x ahead, y left); then
    `radius_cm` is that of the circle about it, and need not be given.
    """

    radius_cm: float = 0.0
    outline_cm: tuple[tuple[float, float], ...] = ()
    height_cm: float = 0.0

    def _check(self) -> None:
        if self.outline_cm:
            self._check_outline()
        least, most = RADII_CM
        fits, cure = least <= self.radius_cm <= most, "Or give outline_cm."
        require(
            fits, "radius_cm", f"{least:g} to {most:g} cm", self.radius_cm, "" if self.radius_cm else cure
        )
        require(self.height_cm >= 0, "height_cm", "0 (no end) or more", self.height_cm)

    def _check_outline(self) -> None:
        """Refuse what is no convex polygon about the axle's middle; find its radius."""
        corners, outline = np.array(self.outline_cm), self.outline_cm
        require(len(corners) >= 3, "outline_cm", "three corners or more", outline)
        edges = np.roll(corners, -1, axis=0) - corners
        after = np.roll(edges, -1, axis=0)
        left = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
        once = abs(np.arctan2(left, (edges * after).sum(axis=1)).sum() - math.tau) < 1e-6
        told = "corners of a convex polygon, counter-clockwise"
        cure = "Turn their order round." if (left < 0).all() else "Leave out corners that lie within."
        require(bool((left > 1e-9).all() and once), "outline_cm", told, outline, cure)
        require(self.depth_cm(0, 0) >= 0, "outline_cm", "the axle's middle (0, 0) inside", outline)
        radius = float(np.hypot(*corners.T).max())
        width = float(np.ptp(corners @ self.edges()[:, 2:].T, axis=0).min())
        least = f"a body at least {radius * LEAST_WIDTH:.3g} cm wide, a quarter of its radius"
        require(width >= radius * LEAST_WIDTH, "outline_cm", least, width)
        given = self.radius_cm or radius
        told = f"{radius:.6g}, of the circle about the outline, or none"
        require(abs(given - radius) <= 1e-3 * radius, "radius_cm", told, given)
        object.__setattr__(self, "radius_cm", radius)

    def edges(self) -> NDArray[np.float64]:
        """The outline as the kernels take it, [corners, 4]: corner, outward normal of the edge after it."""
        corners = np.array(self.outline_cm).reshape(-1, 2)
        ahead = np.roll(corners, -1, axis=0) - corners
        normals = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1) / np.hypot(*ahead.T)[:, None]
        return np.hstack([corners, normals])

    def reach_cm(
        self, bearing: NDArray[np.float64], gap_cm: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """How far the edge stands out from the axle's middle, towards what lies in a direction.

        Args:
            bearing: [n] of the direction, rad from the robot's front.
            gap_cm: [n] from the edge to the middle of what lies there; None: a wall, square to the direction.

        Returns:
            [n] cm: the thing is this much, and the gap, from the axle's middle.
        """
        if not self.outline_cm:
            return np.full(len(bearing), self.radius_cm)
        corners, normals = np.hsplit(self.edges(), 2)
        ahead = np.stack([np.cos(bearing), np.sin(bearing)])
        out = corners @ ahead
        if gap_cm is None:
            return np.asarray(out.max(axis=0))
        # Whatever is within the gap of the edge: a disc about each corner, a strip before each edge.
        aside = corners @ np.stack([-ahead[1], ahead[0]])
        with np.errstate(invalid="ignore", divide="ignore"):
            discs = out + np.sqrt(gap_cm**2 - aside**2)
            strips = ((normals * corners).sum(axis=1)[:, None] + gap_cm) / (normals @ ahead)
            along = strips * (np.stack([-normals[:, 1], normals[:, 0]], axis=1) @ ahead)
        begin = (corners[:, 1] * normals[:, 0] - corners[:, 0] * normals[:, 1])[:, None]
        lengths = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)[:, None]
        before = (strips > 0) & (along >= begin) & (along <= begin + lengths)
        last = np.fmax(np.fmax.reduce(discs), np.where(before, strips, -np.inf).max(axis=0))
        return np.asarray(last - gap_cm)

    def grown(self, by_cm: float) -> Self:
        """The body with its edge farther out."""
        corners, normals = np.hsplit(self.edges(), 2)
        sums = normals + np.roll(normals, 1, axis=0)
        moved = corners + by_cm * 2 * sums / (sums**2).sum(axis=1, keepdims=True)
        radius = 0.0 if len(corners) else self.radius_cm + by_cm
        return replace(self, radius_cm=radius, outline_cm=moved.tolist())

    def depth_cm(self, x_cm: float, y_cm: float) -> float:
        """How far a place in the robot's frame is from the body's edge; below 0: it is outside."""
        if not self.outline_cm:
            return self.radius_cm - math.hypot(x_cm, y_cm)
        x, y, nx, ny = self.edges().T
        return float((nx * (x - x_cm) + ny * (y - y_cm)).min())


FEEDS = ("proximity", "ambient", "proximity+ambient")
"""What may be fed to a network; the index is `types.Trial.feed`."""
MEASURED = {
    "lobe", "overlap", "aperture_deg", "width_cm", "range_cm", "curve_cm", "dead", "curve_light",
    "curve", "table", "noise", "noise_rise", "between",
}  # fmt: skip
"""Keys that only sensors as measured have: left out of a file where they are 0 or empty."""
PERIODS_S = (0.02, 0.2)
"""Shortest and longest step of a robot's control."""
TRACK = (0.2, 15.0)
"""The track's least and most, in radii of the body."""
ON_EDGE = 1e-6
"""A sensor may lie on the outline, as rounded, cm."""
TOP_INPUT = 10
"""Inputs of a network are −10 … 10 (§5.3)."""


def largest_pole(kp: float, ki: float, kd: float, divisor: float) -> float:
    """Largest closed-loop pole of the printed law with P = (V − U)/0.1 and five terms in I (§3.2.2)."""
    p, i, d = (gain / divisor for gain in (kp, ki, kd))
    p, i = p / STEP_S, i / STEP_S
    # δ_t = −p·U_t − i·(U_t + … + U_{t−4}) + d·δ_{t−1}, U_{t+1} = U_t + δ_t
    law = np.array([1.0, p + i - 1 - d, i + d, i, i, i])
    return float(np.abs(np.roots(law)).max())


Curve = tuple[tuple[float, float], ...]
"""Commands, rising, and the speeds (cm/s) at which a wheel settles under them."""


@dataclass(frozen=True, kw_only=True)
class Wheels(Value):
    """Two wheels under the PID law of §3.2.2: δv = (Kp·P + Ki·I + Kd·D) / divisor.

    Beyond the paper, 0 by default: `lag` is the share of a command that acts one step late,
    `play_cm` the way that a wheel loses where it turns round. The law acts on the speed at which a wheel
    settles: command times `speed_per_unit_cm_s`, or by its curve of (command, cm/s), linear between and
    constant beyond; then `speed_per_unit_cm_s` is only the unit in which speeds are told.
    """

    track_cm: float
    speed_per_unit_cm_s: tuple[float, float]
    top_command: float
    kp: float
    ki: float
    kd: float
    divisor: float
    rest_speed_cm_s: float
    friction_cm_s2: float
    lag: float = 0.0
    play_cm: float = 0.0
    curve_left: Curve = ()
    curve_right: Curve = ()

    @property
    def curves(self) -> tuple[Curve, ...]:
        """Of the left and the right wheel; none where speeds are proportional to commands."""
        return (self.curve_left, self.curve_right) if self.curve_left else ()

    @property
    def top_speed_cm_s(self) -> float:
        """The faster wheel's at the top command, either way."""
        top = self.top_command
        if not self.curves:
            return top * max(self.speed_per_unit_cm_s)
        return float(max(np.abs(_settled(curve, np.array([-top, top]))).max() for curve in self.curves))

    def proportional(self, commands: NDArray[np.float64]) -> NDArray[np.float64]:
        """[n, 2] commands that without curves would make the same speeds."""
        if not self.curves:
            return commands
        pairs = zip(commands.T, self.curves, self.speed_per_unit_cm_s, strict=True)
        return np.stack([_settled(curve, column) / unit for column, curve, unit in pairs], 1)

    def command(self, output: int) -> int:
        """A network's output −10 … 10 in the robot's units, of which it takes whole ones.

        Raises:
            UsageError: another output.
        """
        return round(self.top_command / TOP_INPUT * as_count(output, "output", -TOP_INPUT, TOP_INPUT))

    def _check(self) -> None:
        for key in ("track_cm", "top_command", "divisor"):
            require(getattr(self, key) > 0, key, "more than 0", getattr(self, key))
        told = "1 or more, since a robot receives whole commands"
        require(self.command(TOP_INPUT) >= 1, "top_command", told, self.top_command)
        for key in ("kp", "ki", "kd", "rest_speed_cm_s", "friction_cm_s2"):
            require(getattr(self, key) >= 0, key, "0 or more", getattr(self, key))
        for i, speed in enumerate(self.speed_per_unit_cm_s):
            require(speed > 0, f"speed_per_unit_cm_s[{i}]", "more than 0", speed)
        require(0 <= self.lag <= 1, "lag", "a share from 0 to 1", self.lag)
        require(self.play_cm >= 0, "play_cm", "0 or more", self.play_cm)
        for key in ("curve_left", "curve_right"):
            self._check_curve(key)
        pole = largest_pole(self.kp, self.ki, self.kd, self.divisor)
        told = "gains with which a wheel settles at its speed (largest pole below 1)"
        require(pole < 1, "kp", told, float(f"{pole:.4g}"), "Lower kp, ki or kd, or raise the divisor.")

    def _check_curve(self, key: str) -> None:
        """Refuse what is no law of command to speed, or of one wheel alone."""
        curve = getattr(self, key)
        told = "[[command, cm_s], …] for both wheels, or for none"
        require(bool(self.curve_left) == bool(self.curve_right), key, told, curve)
        if not curve:
            return
        commands, speeds = np.array(curve).T
        require(len(curve) >= 2 and (np.diff(commands) > 0).all(), key, "rising commands, two or more", curve)
        require((np.diff(speeds) >= 0).all(), key, "speeds (cm/s) that never fall as commands rise", curve)
        rests = commands[0] <= 0 <= commands[-1] and np.interp(0, commands, speeds) == 0
        require(bool(rests), key, "[0, 0] on it: a wheel rests at command 0", curve)


@dataclass(frozen=True, kw_only=True)
class Noise(Value):
    """Observed deviations (§6): counts for the sensors, shares for wheel speed and friction.

    `between`: the share of the sensors' spread `between` recordings that each trial draws once.
    """

    proximity: float
    proximity_dark: float
    ambient: float = 0.0
    wheel: float
    friction: float
    between: float = 0.0

    def _check(self) -> None:
        for key, value in self.to_dict().items():
            require(value >= 0, key, "0 or more", value)
        require(self.wheel <= 1, "wheel", "a share of the speed, 0 to 1 (0.05 is 5 %)", self.wheel)
        require(self.friction <= 10, "friction", "a share of the threshold, 0 to 10", self.friction)


@dataclass(frozen=True, kw_only=True)
class Profile(Value):
    """All constants of one robot. Lengths cm, angles degrees, readings counts.

    A step of control lasts `period_s`. Each channel states its full scale (`top`) and its sensors, as many
    as there are; without `ambient` the robot sees no light.
    """

    name: str
    source: str = ""
    period_s: float = STEP_S
    body: Body
    wheels: Wheels
    infrared: Infrared
    ambient: Ambient = UNLIT
    noise: Noise
    provenance: Provenance = Provenance()

    def _check(self) -> None:
        require(bool(self.name.strip()), "name", "a name", self.name)
        inside = PERIODS_S[0] <= self.period_s <= PERIODS_S[1]
        require(inside, "period_s", "0.02 to 0.2 (s) of one step", self.period_s)
        radius, track = self.body.radius_cm, self.wheels.track_cm
        least, most = (round(share * radius, 6) for share in TRACK)
        told = f"{least:g} to {most:g} cm between the wheels of a body of radius {radius:g} cm"
        require(least <= track <= most, "wheels.track_cm", told, track)
        round_ = not (self.infrared.table and self.body.outline_cm)
        told = "none on a body with an outline: distances count from a disc"
        require(round_, "infrared.table", told, f"{len(self.body.outline_cm)} corners")
        top, eyes = self.body.height_cm, self.ambient.sensor_height_cm
        below = f"less than body.height_cm ({top:g})"
        require(top == 0 or eyes < top, "ambient.sensor_height_cm", below, eyes)
        way = self.wheels.top_speed_cm_s * self.period_s
        told = f"a top speed of at most one body radius ({radius:g} cm) a step of {self.period_s:g} s"
        cure = "Lower it, or lower wheels.top_command."
        key = "curve_left" if self.wheels.curves else "speed_per_unit_cm_s"
        require(way <= radius, f"wheels.{key}", told, way, cure)
        for part, keys in (("infrared", ("proximity", "proximity_dark")), ("ambient", ("ambient",))):
            top, there = getattr(self, part).top, getattr(self, part).sensors
            for key in keys if there else ():
                value = getattr(self.noise, key)
                require(value <= top, f"noise.{key}", f"at most the converter's range, {top:g} counts", value)
            for i, sensor in enumerate(there):
                place = (sensor.x_cm, sensor.y_cm)
                key, depth = f"{part}.sensors[{i}]", self.body.depth_cm(*place)
                require(depth >= -ON_EDGE, key, f"a place inside the body (radius {radius:g} cm)", place)
                offset = 0.0 if sensor.curve else getattr(sensor, "offset_cm", 0.0)
                cure = "The sensor's distance to what the body touches would be 0."
                fits = offset >= 0 or offset > -depth
                require(fits, f"{key}.offset_cm", f"more than {-depth:.3g}", offset, cure)

    def to_kernel(self) -> types.Robot:
        """The robot as the kernels' arrays."""
        wheels = self.wheels
        ambient, light = self.ambient.to_kernel(self.body.height_cm)
        return types.Robot(
            radius=self.body.radius_cm,
            outline=self.body.edges(),
            period=self.period_s,
            wheels=types.Wheels(
                track=wheels.track_cm,
                speed_per_unit=np.array(wheels.speed_per_unit_cm_s),
                rest_speed=wheels.rest_speed_cm_s,
                friction=wheels.friction_cm_s2,
                half_play=wheels.play_cm / 2 / self.period_s,
                curve=_joined(wheels),
                **{key: getattr(wheels, key) for key in ("kp", "ki", "kd", "divisor", "lag", "top_command")},
            ),
            proximity=self._drawing(self.infrared.to_kernel()),
            ambient=self._drawing(ambient),
            light=light,
            noise=types.Noise(**{key: getattr(self.noise, key) for key in types.Noise._fields}),
        )

    def _drawing(self, part: P) -> P:
        """Sensors with as much of their spread between recordings as a trial draws."""
        return part._replace(between=self.noise.between * part.between[: None if self.noise.between else 0])

    def with_between(self) -> Self:
        """A copy of which each simulated trial draws the spread between recordings, once for each sensor, as
        `--noise-between` does.

        Raises:
            ConfigError: no calibration by several recordings of the same places has measured it.
        """
        there = bool(self.infrared.between or self.ambient.between)
        cure = "Calibrate it by recordings of the same places on several days, or of several units."
        expected = "infrared.between or ambient.between of some counts"
        require(there, f"noise between recordings: profile {self.name!r}", expected, "none", cure)
        return replace(self, noise=replace(self.noise, between=1.0))

    def _repr_html_(self) -> str:
        return str(lazy.notebook().profile_html(self))

    @property
    def is_mirrored(self) -> bool:
        """Whether every sensor that is off the middle looks across the robot to its other side."""
        sensors = (*self.infrared.sensors, *self.ambient.sensors)
        sides = [one.y_cm * math.sin(math.radians(one.direction_deg)) for one in sensors]
        clear = [side for side in sides if abs(side) > 0.1 * self.body.radius_cm]
        return len(clear) > 1 and max(clear) < 0

    def channel(self, kind: str) -> Infrared | Ambient:
        """The sensors of a kind: "infrared" (or "proximity", as a task feeds them) or "ambient"."""
        return self.ambient if kind == "ambient" else self.infrared

    def bands(self, feeds: str) -> list[tuple[float, float]]:
        """The counts that become inputs −10 and +10, of each reading that `feeds` names, in their order.

        Raises:
            ConfigError: other feeds.
        """
        hint = "The infrared sensors feed as 'proximity'." if feeds == "infrared" else ""
        require(feeds in FEEDS, "feeds", " or ".join(map(repr, FEEDS)), feeds, hint)
        return [self.channel(kind).bands for kind in feeds.split("+") for _ in self.channel(kind).sensors]

    def inputs(self, readings: Sequence[float], feeds: str, sensors: Sequence[int]) -> list[int]:
        """A network's inputs −10 … 10, as the kernels make them of readings ("bands", §7.2).

        Args:
            readings: counts of all sensors that `feeds` names.
            feeds: "proximity", "ambient", or "proximity+ambient": those before these.
            sensors: which of the readings each input is made of.

        Raises:
            ConfigError: other feeds, or readings of another number of sensors.
        """
        bands = self.bands(feeds)
        fits = len(readings) == len(bands)
        require(fits, "readings", f"one of each {feeds} sensor ({len(bands)})", readings)
        scaled = []
        for sensor in sensors:
            low, high = bands[sensor]
            share = (float(readings[sensor]) - low) / (high - low)
            value = math.floor(share * (2.0 * TOP_INPUT) - TOP_INPUT + 0.5)
            scaled.append(max(-TOP_INPUT, min(TOP_INPUT, value)))
        return scaled

    def to_dict(self) -> dict[str, Any]:
        """Every constant the simulation uses: the file's, and under `fixed` what no file changes."""
        fixed = {
            "step_s": self.period_s, "updates_per_step": UPDATES, "longest_delay_updates": MAX_DELAY,
            "ray_angles_deg": list(RAY_ANGLES_DEG),
        }  # fmt: skip
        return {**self._table(), "fixed": fixed}

    def to_toml(self) -> str:
        """The profile as a TOML file, which reads back to an equal value."""
        return to_toml(self._table())

    def _table(self) -> dict[str, Any]:
        """Its keys; provenance, light sensors and what is measured only where there is any."""
        table = super().to_dict()
        if not self.infrared.table:
            del table["infrared"]["table"]
        for key, unsaid in (("provenance", Provenance()), ("ambient", UNLIT)):
            if getattr(self, key) == unsaid:
                del table[key]
        if self.period_s == STEP_S:
            del table["period_s"]
        if not self.wheels.curves:
            del table["wheels"]["curve_left"], table["wheels"]["curve_right"]
        if not self.noise.between:
            del table["noise"]["between"]
        if not self.body.outline_cm:
            del table["body"]["outline_cm"]
        for part in ("infrared", "ambient"):
            for one in (table[part], *table[part]["sensors"]) if part in table else ():
                for key in MEASURED & one.keys():
                    if not one[key]:
                        del one[key]
        return table


def _joined(wheels: Wheels) -> NDArray[np.float64]:
    """Its curves as the kernels take them (types.Wheels)."""
    knots = np.unique([command for curve in wheels.curves for command, _ in curve])
    units = zip(wheels.curves, wheels.speed_per_unit_cm_s, strict=False)  # none without curves
    return np.column_stack([knots, *(_settled(curve, knots) / unit for curve, unit in units)]).reshape(-1, 3)


def _settled(curve: Curve, commands: NDArray[np.float64]) -> NDArray[np.float64]:
    """Speeds at which a wheel settles by its curve, cm/s."""
    known, speeds = np.array(curve).T
    return np.asarray(np.interp(commands, known, speeds))


def load_profile(name_or_path: str | PathLike[str] | Profile) -> Profile:
    """A robot's profile: "paper", or the path of a TOML file (a Profile stays itself).

    Raises:
        ConfigError: names the file and the key, what was expected and what came.
    """
    made = load(Profile, name_or_path, folder="profiles")
    if made is not name_or_path and made.is_mirrored:
        warnings.warn(
            f"profile {made.name!r}: each sensor on the left looks to the right, across the robot, and the "
            "other way round: is the sign of y_cm or direction_deg exchanged? y is to the left, and angles "
            "are counter-clockwise.",
            RealityGapWarning,
            stacklevel=2,
        )
    return made


def profile_names() -> tuple[str, ...]:
    """Names of the profiles that come with the package."""
    return shipped("profiles")
