"""What the eight sensors see: infrared thrown back, and the lamp's light, direct and off the walls.

The laws are the twin's own, taken from what the real tables show, not from the paper's equations.
Everything stands upright, so light is followed in the plane. Lamps hang higher than the robot is tall:
what of their light passes over it, it does not shade.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.arena import edges
from realitygap.twin.arithmetic import arctan2, cos_sin, hypot, power, weighted
from realitygap.twin.model import BODY_RADIUS, BODY_TOP, WALL_HEIGHT
from realitygap.twin.noise import (
    AMBIENT_COUNTS,
    DARK_COUNTS,
    PROXIMITY_COUNTS,
    SensorNoise,
    draws,
)
from realitygap.twin.rays import Scene
from realitygap.twin.unit import SENSORS_MM_DEG, Unit

__all__ = ["CYCLE_MS", "PHASE_MS", "Sensors"]

Array = NDArray[np.float64]

FULL = 1023  # 10 bits
PHASE_MS = np.array([0, 3, 5, 8, 10, 13, 15, 18])
"""One sensor after another, all eight in 20 ms."""
CYCLE_MS = 20

RAYS = 45
FAN = (np.arange(RAYS) + 0.5) * math.pi / RAYS - math.pi / 2

# Infrared: fitted to wall.sam with this very law (RMSE 28 counts over the eight sensors)
IR_EXPONENT = 2.6  # cos^2.6: lamp's and eye's own narrowness together
IR_DEPTH = 0.0016  # m: lamp and eye lie a little behind their window
IR_GAIN = 0.0550  # counts·m² a ray of the fan, as many as there are
IR_OFFSET = 500.0  # counts: what must be thrown back before the converter shows anything
IR_REACH = 0.12  # m: further away nothing reaches the offset

# Ambient light
EYE_EXPONENT = 1.4  # light.sam at 25 cm: three quarters of the light at 33° off, a third at 65°
EYE_HEIGHT = 0.012  # m
WALL_WHITE = 0.3  # share of the light that walls and cylinders (grey paint) throw back, evenly
EYE_MIDDLE = 1.47  # rad: the eye's response over all elevations, summed
LAMP_COUNTS = 6000.0
"""How far a lamp 1 m away, straight ahead, would pull a reading down: a desk lamp, bright enough to
saturate a sensor that looks at it from the far end of the room (paper, 3.3: lit sensors say where the
lamp is, hardly how far)."""
LAMP_PROUD = 0.006  # m: the lamp hangs this far in front of a wall it is fixed to


class Sensors:
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
        self._scene = Scene(edges(arena), np.array(arena["cylinders"]).reshape(-1, 3) / 100.0)
        lamps, size = np.array(arena["lamps"]).reshape(-1, 2) / 100.0, np.array(arena["size_cm"]) / 100.0
        self._lamps = np.clip(lamps, LAMP_PROUD, size - LAMP_PROUD)
        self._rise = unit.lamp_height - EYE_HEIGHT
        # Of the way from a wall, at the eyes' height, up to a lamp: the share below the body's top
        self._low = (BODY_TOP - EYE_HEIGHT) / max(self._rise, BODY_TOP - EYE_HEIGHT)
        self._near = SensorNoise(seed=seed, purpose=1)
        self._light = SensorNoise(seed=seed, purpose=2)
        self._idle = SensorNoise(seed=seed, purpose=3)
        self._fan_cos, self._fan_sin = cos_sin(FAN)
        self._ir_weight = power(self._fan_cos, IR_EXPONENT) * IR_GAIN
        self._gain = np.array(unit.proximity_gain)
        fan = power(self._fan_cos, EYE_EXPONENT)
        self._eye_weight = fan / math.fsum(fan)

    def refreshed(self, time_ms: int) -> NDArray[np.int64]:
        """[8] when each sensor was read last, up to now (ms)."""
        return np.asarray(np.maximum(time_ms - (time_ms - PHASE_MS) % CYCLE_MS, 0))

    def clearance(self, x: float, y: float) -> float:
        """How far it is from a point to the nearest thing (m)."""
        return self._scene.clearance(x, y)

    def _stand(self, poses: Array) -> tuple[Array, Array, Array]:
        """Where the sensors are and where they look, [8] each, from the poses of their refreshing."""
        c, s = cos_sin(poses[:, 2])
        x = poses[:, 0] + c * self._x - s * self._y
        y = poses[:, 1] + s * self._x + c * self._y
        return x, y, poses[:, 2] + self._direction

    def _fan(self, look: Array) -> tuple[Array, Array]:
        c, s = (part[:, None] for part in cos_sin(look))
        return c * self._fan_cos - s * self._fan_sin, s * self._fan_cos + c * self._fan_sin

    # infrared

    def reflected(self, poses: Array) -> Array:
        """[8] infrared thrown back, in counts, less the offset: without noise and before the converter.

        Each ray: emitted and taken in by cos^2.6 of its angle, thrown back by Lambert's law (cosine of
        the incidence), weakened by the square of the distance.
        """
        x, y, look = self._stand(poses)
        near = self._scene.near(float(poses[0, 0]), float(poses[0, 1]), IR_REACH + BODY_RADIUS)
        if near is None:
            return np.full(8, -IR_OFFSET)
        distance, incidence, *_ = near.meet(x, y, *self._fan(look))
        thrown = incidence / (distance + IR_DEPTH) ** 2
        return np.asarray(weighted(thrown, self._ir_weight) * self._gain - IR_OFFSET)

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
        distance, _, px, py, nx, ny = self._scene.meet(x, y, *self._fan(look))
        up, down = np.full_like(distance, WALL_HEIGHT - EYE_HEIGHT), np.full_like(distance, EYE_HEIGHT)
        tall = arctan2(up, distance) + arctan2(down, distance)
        tall /= EYE_MIDDLE  # share of a sensor's view, up and down, that a wall fills
        centre = poses.mean(axis=0)
        for lamp in self._lamps:
            total += self._direct(x, y, look, lamp)
            lit = self._on_walls(px, py, nx, ny, lamp, centre)
            total += WALL_WHITE * weighted(lit * tall, self._eye_weight)
        return total * self._unit.lamp_power

    def _direct(self, x: Array, y: Array, look: Array, lamp: Array) -> Array:
        ax, ay = lamp[0] - x, lamp[1] - y
        flat = ax * ax + ay * ay
        square = flat + self._rise**2
        c, s = cos_sin(look)
        facing = (ax * c + ay * s) / np.sqrt(square)
        free = self._scene.clear(x, y, ax, ay)
        return np.asarray(np.where(free, power(facing, EYE_EXPONENT) / square, 0.0))

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
        off = hypot(px + along * ax - centre[0], py + along * ay - centre[1])
        return np.asarray(np.where(free & (off > BODY_RADIUS), facing / square, 0.0))

    def ambient(self, time_ms: int, refreshed: NDArray[np.int64], poses: Array) -> list[int]:
        """[8] counts: linear in the light, from the dark value down to the floor."""
        pull = LAMP_COUNTS * np.array(self._unit.ambient_gain) * self.illumination(poses)
        signal = np.maximum(np.array(self._unit.dark) - pull, np.array(self._unit.floor))
        if self._noise:
            signal = signal + self._noise * AMBIENT_COUNTS * self._light.at(time_ms, refreshed)
        return [int(v) for v in np.clip(np.rint(signal), 0, FULL)]

    def analog(self, n: int, time_ms: int) -> int:
        """[counts] of an input that nothing is connected to."""
        return int(draws(self._seed, 40 + n, time_ms // CYCLE_MS).integers(0, 5)) if self._noise else 0
