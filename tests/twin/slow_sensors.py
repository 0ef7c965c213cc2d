"""The twin's sensors, rays and noise in NumPy, many rays at a time: the judge of the compiled ones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.noise import (
    AMBIENT_COUNTS,
    DARK_COUNTS,
    DRIFT,
    DRIFT_KNOT_MS,
    OUTLIER_SIZE,
    OUTLIERS,
    PROXIMITY_COUNTS,
    WHITE,
)  # fmt: skip
from realitygap.twin.rays import FAR
from realitygap.twin.sensors import (
    CYCLE_MS,
    EYE_EXPONENT,
    EYE_HEIGHT,
    EYE_MIDDLE,
    FAN,
    FULL,
    IR_DEPTH,
    IR_EXPONENT,
    IR_GAIN,
    IR_OFFSET,
    IR_REACH,
    LAMP_COUNTS,
    LAMP_PROUD,
    PHASE_MS,
    WALL_REFLECTANCE,
    Sensors,
    illuminate,
    reflect,
)
from realitygap.twin.unit import BODY_RADIUS, BODY_TOP, SENSORS_MM_DEG, WALL_HEIGHT, Unit, faces_of

__all__ = ["SlowNoise", "SlowSensors"]

Array = NDArray[np.float64]

_CORE = 1.0 / math.sqrt(1.0 - OUTLIERS + OUTLIERS * OUTLIER_SIZE**2)
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_A = np.uint64(0xBF58476D1CE4E5B9)
_MIX_B = np.uint64(0x94D049BB133111EB)
_MASK = (1 << 64) - 1


def normals(bits: NDArray[np.uint64]) -> Array:
    """A draw of deviation 1 from each word of 64 random bits (Box and Muller 1958)."""
    first = ((bits >> np.uint64(32)).astype(np.float64) + 0.5) * 2.0**-32
    second = (bits & np.uint64(0xFFFFFFFF)).astype(np.float64) * 2.0**-32
    return np.asarray(np.sqrt(-2.0 * np.log(first)) * np.cos(2.0 * np.pi * second))


def spread(numbers: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Mix the bits of whole numbers (splitmix64, Steele et al. 2014)."""
    z = (numbers + _GOLDEN).astype(np.uint64)
    z = (z ^ (z >> np.uint64(30))) * _MIX_A
    z = (z ^ (z >> np.uint64(27))) * _MIX_B
    return z ^ (z >> np.uint64(31))


def _heavy(keys: NDArray[np.uint64]) -> NDArray[np.float64]:
    """Draws of deviation 1 with heavier tails than normal (kurtosis about 5)."""
    other: NDArray[np.uint64] = np.bitwise_xor(keys, _MIX_A)
    outlier = spread(other).astype(np.float64) < OUTLIERS * 2.0**64
    return np.asarray(normals(spread(keys)) * np.where(outlier, _CORE * OUTLIER_SIZE, _CORE))


class SlowNoise:
    """Noise of deviation 1 for the eight sensors of one kind: a pure function of the time."""

    def __init__(self, *, seed: int, purpose: int) -> None:
        base = spread(np.array([seed & _MASK], np.uint64))
        base = spread(np.bitwise_xor(base, np.uint64(purpose)))
        self._white = spread(np.add(base, np.arange(8, dtype=np.uint64), dtype=np.uint64))
        self._drift = spread(self._white)

    def white(self, refreshed: NDArray[np.int64]) -> NDArray[np.float64]:
        """[8] draws for the given refreshing of each sensor, named by its time."""
        return _heavy(self._white ^ refreshed.astype(np.uint64))

    def drift(self, time_ms: int) -> NDArray[np.float64]:
        """[8] slowly changing values of deviation 1."""
        knot, rest = divmod(time_ms, DRIFT_KNOT_MS)
        knots = np.array([[knot + 1], [knot + 2]], np.uint64)
        here, there = normals(spread(self._drift ^ knots))
        share = rest / DRIFT_KNOT_MS
        share = share * share * (3.0 - 2.0 * share)
        size = math.sqrt(share * share + (1.0 - share) ** 2)
        return np.asarray((here * (1.0 - share) + there * share) / size)

    def at(self, time_ms: int, refreshed: NDArray[np.int64]) -> NDArray[np.float64]:
        """[8] the whole noise, deviation 1."""
        return WHITE * self.white(refreshed) + DRIFT * self.drift(time_ms)


def _weighted(rows: Array, weights: Array) -> Array:
    """[n] sums of [n, m] rows times [m] weights, in order."""
    total = np.zeros(len(rows))
    for k, weight in enumerate(weights):
        total = total + rows[:, k] * weight
    return total


class SlowScene:
    """Faces [n, 4] (x0, y0, x1, y1, in m) and circles [k, 3] (x, y, radius) that stop light, and how much
    more than usual they throw back [1 + k]."""

    def __init__(self, faces: Array, circles: Array, white: Array | None = None) -> None:
        self._p = faces[:, :2].T.copy()
        along = (faces[:, 2:] - faces[:, :2]).T
        self._length = np.hypot(*along)
        self._u = along / self._length
        self._circles = circles
        self._white = np.ones(1 + len(circles)) if white is None else white

    def _distances(self, x: float, y: float) -> tuple[Array, Array]:
        """From a point to each face and to each circle (m)."""
        rx, ry = x - self._p[0], y - self._p[1]
        along = np.minimum(np.maximum(rx * self._u[0] + ry * self._u[1], 0.0), self._length)
        cx, cy, r = self._circles.T
        return np.hypot(rx - along * self._u[0], ry - along * self._u[1]), np.hypot(x - cx, y - cy) - r

    def clearance(self, x: float, y: float) -> float:
        """How far it is from a point to the nearest thing (m)."""
        return float(np.concatenate(self._distances(x, y)).min())

    def near(self, x: float, y: float, reach: float) -> SlowScene | None:
        """Only what comes nearer than `reach` (m) to a point; None if nothing does."""
        faces, circles = self._distances(x, y)
        some, others = faces < reach, circles < reach
        if not (some.any() or others.any()):
            return None
        part = object.__new__(SlowScene)
        part._p, part._u, part._length = self._p[:, some], self._u[:, some], self._length[some]
        part._circles = self._circles[others]
        part._white = self._white[np.concatenate([[True], others])]
        return part

    def _cross(self, x: Array, y: Array, dx: Array, dy: Array) -> Array:
        """[faces, ...] distances to the faces' lines (inf if missed); ... are the rays' own axes."""
        wide = (slice(None),) + (None,) * dx.ndim
        ux, uy = self._u[0][wide], self._u[1][wide]
        rx, ry = self._p[0][wide] - x, self._p[1][wide] - y
        turn = dx * uy - dy * ux
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (rx * uy - ry * ux) / turn
            s = (rx * dy - ry * dx) / turn
        hit = (t > 0.0) & (s >= -1e-9) & (s <= self._length[wide] + 1e-9)
        return np.asarray(np.where(hit, t, np.inf))

    def _touch(self, x: Array, y: Array, dx: Array, dy: Array) -> Array:
        """[circles, ...] distances to the circles (inf if missed); directions of length 1."""
        wide = (slice(None),) + (None,) * dx.ndim
        cx, cy, r = (c[wide] for c in self._circles.T)
        rx, ry = cx - x, cy - y
        middle = rx * dx + ry * dy
        room = r * r - (rx * dy - ry * dx) ** 2
        t = middle - np.sqrt(np.maximum(room, 0.0))
        return np.asarray(np.where((room > 0.0) & (t > 0.0), t, np.inf))

    def meet(self, x: Array, y: Array, dx: Array, dy: Array) -> tuple[Array, ...]:
        """The first thing each ray meets.

        Args:
            x, y: [n] starts (m).
            dx, dy: [n, rays] directions of length 1.

        Returns:
            [n, rays] each: distance, cosine of the incidence, x, y of the point, its normal's x and y
            (towards the ray's side), how much more than usual is thrown back there.
        """
        x, y = x[:, None], y[:, None]
        distance, nx, ny = np.full(dx.shape, FAR), -dx, -dy
        white = np.full(dx.shape, self._white[0])
        if len(self._length):
            t = self._cross(x, y, dx, dy)
            distance = np.minimum(t.min(axis=0), FAR)
            which = t.argmin(axis=0)
            nx, ny = self._u[1][which], -self._u[0][which]
            flip = np.where(nx * dx + ny * dy > 0.0, -1.0, 1.0)
            nx, ny = nx * flip, ny * flip
        if len(self._circles):
            t = self._touch(x, y, dx, dy)
            near = t.min(axis=0)
            closer = near < distance
            which = t.argmin(axis=0)
            cx, cy, r = (c[which] for c in self._circles.T)
            white = np.where(closer, self._white[1 + which], white)
            distance = np.where(closer, near, distance)
            nx = np.where(closer, (x + distance * dx - cx) / r, nx)
            ny = np.where(closer, (y + distance * dy - cy) / r, ny)
        incidence = -(nx * dx + ny * dy)
        return distance, incidence, x + distance * dx, y + distance * dy, nx, ny, white

    def clear(self, x: Array, y: Array, ax: Array, ay: Array) -> NDArray[np.bool_]:
        """Whether nothing stands between a point and another, `ax`, `ay` further on.

        Args:
            x, y: from where, m.
            ax, ay: the way to the other point, m.
        """
        way = np.hypot(ax, ay) + 1e-12
        dx, dy = ax / way, ay / way
        free = np.ones(np.shape(dx), dtype=np.bool_)
        if len(self._length) > 4:  # the four sides of the floor never stand between two points inside
            t = self._cross(x, y, dx, dy)
            free &= (t[4:] > way - 1e-9).all(axis=0)
        if len(self._circles):
            free &= (self._touch(x, y, dx, dy) > way - 1e-9).all(axis=0)
        return free


class SlowSensors:
    """The eight sensors of one unit in one arena.

    Args:
        arena: the room, in plain numbers.
        unit: its sensors' own gains and places.
        noise: a scale.
        seed: of the noise.
    """

    def __init__(self, arena: Mapping[str, Any], unit: Unit, *, noise: float, seed: int) -> None:
        place = np.array(SENSORS_MM_DEG, dtype=np.float64)
        self._unit = unit
        self._noise = noise
        self._seed = seed
        self._x, self._y = place[:, 0] / 1000.0, place[:, 1] / 1000.0
        self._direction = np.radians(place[:, 2]) + np.array(unit.direction)
        circles = np.array(arena["cylinders"]).reshape(-1, 3) / 100.0
        self._white = np.array(arena.get("reflectance", np.ones(1 + len(circles))))
        self._scene = SlowScene(faces_of(arena), circles, self._white)
        lamps, size = np.array(arena["lamps"]).reshape(-1, 2) / 100.0, np.array(arena["size_cm"]) / 100.0
        self._lamps = np.clip(lamps, LAMP_PROUD, size - LAMP_PROUD)
        self._rise = unit.lamp_height - EYE_HEIGHT
        # Of the way from a wall, at the eyes' height, up to a lamp: the share below the body's top
        self._low = (BODY_TOP - EYE_HEIGHT) / max(self._rise, BODY_TOP - EYE_HEIGHT)
        self._near = SlowNoise(seed=seed, purpose=1)
        self._light = SlowNoise(seed=seed, purpose=2)
        self._idle = SlowNoise(seed=seed, purpose=3)
        self._fan_cos, self._fan_sin = np.cos(FAN), np.sin(FAN)
        self._ir_weight = self._fan_cos**IR_EXPONENT * IR_GAIN
        self._gain = np.array(unit.proximity_gain)
        fan = self._fan_cos**EYE_EXPONENT
        self._eye_weight = fan / math.fsum(fan)

    def refreshed(self, time_ms: int) -> NDArray[np.int64]:
        """[8] when each sensor was read last, up to now (ms)."""
        return np.asarray(np.maximum(time_ms - (time_ms - PHASE_MS) % CYCLE_MS, 0))

    def clearance(self, x: float, y: float) -> float:
        """How far it is from a point to the nearest thing (m)."""
        return self._scene.clearance(x, y)

    def _stand(self, poses: Array) -> tuple[Array, Array, Array]:
        """Where the sensors are and where they look, [8] each, from the poses of their refreshing."""
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x = poses[:, 0] + c * self._x - s * self._y
        y = poses[:, 1] + s * self._x + c * self._y
        return x, y, poses[:, 2] + self._direction

    def _fan(self, look: Array) -> tuple[Array, Array]:
        c, s = np.cos(look)[:, None], np.sin(look)[:, None]
        return c * self._fan_cos - s * self._fan_sin, s * self._fan_cos + c * self._fan_sin

    # infrared

    def reflected(self, poses: Array) -> Array:
        """[8] infrared thrown back, in counts, less the offset: without noise and before the converter.

        Each ray: emitted and taken in by cos^2.6 of its angle, thrown back by Lambert's law (cosine of
        the incidence), weakened by the square of the distance.
        """
        x, y, look = self._stand(poses)
        reach = IR_REACH * math.sqrt(max(1.0, *self._white))
        near = self._scene.near(float(poses[0, 0]), float(poses[0, 1]), reach + BODY_RADIUS)
        if near is None:
            return np.full(8, -IR_OFFSET)
        distance, incidence, *_, white = near.meet(x, y, *self._fan(look))
        thrown = white * incidence / (distance + IR_DEPTH) ** 2
        return np.asarray(_weighted(thrown, self._ir_weight) * self._gain - IR_OFFSET)

    def proximity(self, time_ms: int, refreshed: NDArray[np.int64], poses: Array) -> list[int]:
        """[8] counts."""
        signal = self.reflected(poses)
        if self._noise:
            signal = signal + self._noise * PROXIMITY_COUNTS * self._near.at(time_ms, refreshed)
            idle = self._noise * DARK_COUNTS * np.abs(self._idle.white(refreshed)) * 1.5
            signal = np.maximum(signal, idle - 0.5)
        return [int(v) for v in np.clip(np.rint(signal), 0, FULL)]

    # ambient light

    def illumination(self, poses: Array) -> Array:
        """[8] light on each sensor; 1 is a lamp 1 m away, straight ahead.

        Direct light, and what walls and cylinders throw back evenly after one bounce.
        """
        x, y, look = self._stand(poses)
        total = np.zeros(8)
        if not len(self._lamps):
            return total
        distance, _, px, py, nx, ny, white = self._scene.meet(x, y, *self._fan(look))
        up, down = np.full_like(distance, WALL_HEIGHT - EYE_HEIGHT), np.full_like(distance, EYE_HEIGHT)
        tall = np.arctan2(up, distance) + np.arctan2(down, distance)
        tall = tall / EYE_MIDDLE * white  # share of a sensor's view, up and down, that a wall fills
        centre = poses.mean(axis=0)
        for lamp in self._lamps:
            total += self._direct(x, y, look, lamp)
            lit = self._on_walls(px, py, nx, ny, lamp, centre)
            total += WALL_REFLECTANCE * _weighted(lit * tall, self._eye_weight)
        return total * self._unit.lamp_power

    def _direct(self, x: Array, y: Array, look: Array, lamp: Array) -> Array:
        ax, ay = lamp[0] - x, lamp[1] - y
        flat = ax * ax + ay * ay
        square = flat + self._rise**2
        c, s = np.cos(look), np.sin(look)
        facing = (ax * c + ay * s) / np.sqrt(square)
        free = self._scene.clear(x, y, ax, ay)
        return np.asarray(np.where(free, np.maximum(facing, 0.0) ** EYE_EXPONENT / square, 0.0))

    def _on_walls(self, px: Array, py: Array, nx: Array, ny: Array, lamp: Array, centre: Array) -> Array:
        """Light of the lamp on points of walls [8, RAYS] (normals point to the robot).

        The body shades them where light comes nearer than its radius before it has risen above its top.
        """
        ax, ay = lamp[0] - px, lamp[1] - py
        square = ax * ax + ay * ay + self._rise**2
        facing = np.maximum(ax * nx + ay * ny, 0.0) / np.sqrt(square)
        # a hair off the surface, so that a wall does not shade itself
        free = self._scene.clear(px + 1e-6 * nx, py + 1e-6 * ny, ax, ay)
        flat = np.maximum(ax * ax + ay * ay, 1e-12)
        along = np.clip(((centre[0] - px) * ax + (centre[1] - py) * ay) / flat, 0.0, self._low)
        off = np.hypot(px + along * ax - centre[0], py + along * ay - centre[1])
        return np.asarray(np.where(free & (off > BODY_RADIUS), facing / square, 0.0))

    def ambient(self, time_ms: int, refreshed: NDArray[np.int64], poses: Array) -> list[int]:
        """[8] counts: linear in the light, from the dark value down to the floor."""
        pull = LAMP_COUNTS * np.array(self._unit.ambient_gain) * self.illumination(poses)
        signal = np.maximum(np.array(self._unit.dark) - pull, np.array(self._unit.floor))
        if self._noise:
            signal = signal + self._noise * AMBIENT_COUNTS * self._light.at(time_ms, refreshed)
        return [int(v) for v in np.clip(np.rint(signal), 0, FULL)]


def reflected(fast: Sensors, poses: Array) -> Array:
    """[8] infrared thrown back, as `reflect` has it."""
    out = np.empty(len(poses))
    reflect(fast.eyes, poses, out)
    return out


def illumination(fast: Sensors, poses: Array) -> Array:
    """[8] light on each sensor, as `illuminate` has it."""
    out = np.empty(len(poses))
    illuminate(fast.eyes, fast._unit.lamp_power, poses, out)
    return out
