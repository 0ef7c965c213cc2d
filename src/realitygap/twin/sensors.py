"""What the eight sensors read: one after another, with noise, as counts of their converter.

Infrared reflected to each, and the lamp's light, direct and off the walls. The laws are the twin's own, taken
from what the real tables show, not from the paper's equations. Everything stands upright, so light is
followed in the plane. Lamps hang higher than the robot is tall: what of their light passes over it, it does
not shade.
"""

import math
from collections.abc import Mapping
from contextlib import nullcontext
from functools import partial
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from realitygap.twin.compiled import jit, part
from realitygap.twin.noise import (
    AMBIENT_COUNTS,
    DARK_COUNTS,
    PROXIMITY_COUNTS,
    draws,
    noise_at,
    sensor_noise,
    white_at,
)
from realitygap.twin.rays import Scene, clearance, is_clear, meet, near, scene_of
from realitygap.twin.unit import BODY_RADIUS, BODY_TOP, SENSORS_MM_DEG, WALL_HEIGHT, Unit, faces_of

__all__ = [
    "CYCLE_MS", "FULL", "HISTORY_MS", "IR_OFFSET", "LAMP_PROUD", "PHASE_MS", "SENSORS", "Sensors",
    "illuminate", "look_back", "noisy_proximity", "reflect",
]  # fmt: skip

Array = NDArray[np.float64]

SENSORS = len(SENSORS_MM_DEG)

RAYS = 45
FAN = (np.arange(RAYS) + 0.5) * math.pi / RAYS - math.pi / 2

# Infrared: fitted to wall.sam with this very law (RMSE 28 counts over the eight sensors)
IR_EXPONENT = 2.6  # cos^2.6: lamp's and eye's own narrowness together
IR_DEPTH = 0.0016  # m: lamp and eye lie a little behind their window
IR_GAIN = 0.0550  # counts·m² a ray of the fan, as many as there are
IR_OFFSET = 500.0  # counts: what must be reflected before the converter shows anything
IR_REACH = 0.12  # m: further away nothing reaches the offset

# Ambient light
EYE_EXPONENT = 1.4  # light.sam at 25 cm: three quarters of the light at 33° off, a third at 65°
EYE_HEIGHT = 0.012  # m
WALL_REFLECTANCE = 0.3  # share of the light that walls and cylinders (grey paint) reflect, evenly
EYE_MIDDLE = 1.47  # rad: the eye's response over all elevations, summed
LAMP_COUNTS = 6000.0
"""How far a lamp 1 m away, straight ahead, would pull a reading down: a desk lamp, bright enough to
saturate a sensor that looks at it from the far end of the room (paper, 3.3: lit sensors say where the
lamp is, hardly how far)."""
LAMP_PROUD = 0.006  # m: the lamp hangs this far in front of a wall it is fixed to


class Eyes(NamedTuple):
    """What the sensors are: places on the robot (m), directions (rad) and gains, [8] each; cosines and sines
    of a fan's rays, and their weights, [RAYS] each; and what there is to be seen.

    `reach` is how far away (m) something may throw infrared back; `low` is the share of the way from a wall,
    at their height, up to a lamp that lies below the body's top; `square` the square of the lamps' height
    above them. There is room for poses [8, 3], signals [8] and rays [RAYS, 5].
    """

    x: Array
    y: Array
    direction: Array
    gain: Array
    across: Array
    along: Array
    infrared: Array
    light: Array
    scene: Scene
    reach: float
    lamps: Array
    square: float
    low: float
    poses: Array
    signal: Array
    rays: Array


def eyes_of(arena: Mapping[str, Any], unit: Unit) -> Eyes:
    """Of a unit in an arena, a room in plain numbers."""
    place = np.array(SENSORS_MM_DEG, dtype=np.float64)
    reflectance = np.array(arena["reflectance"]) if "reflectance" in arena else None
    scene = scene_of(faces_of(arena), np.array(arena["cylinders"]).reshape(-1, 3) / 100.0, reflectance)
    lamps, size = np.array(arena["lamps"]).reshape(-1, 2) / 100.0, np.array(arena["size_cm"]) / 100.0
    rise = unit.lamp_height - EYE_HEIGHT
    fan = np.cos(FAN), np.sin(FAN)
    seen = fan[0] ** EYE_EXPONENT
    return Eyes(
        x=place[:, 0] / 1000.0,
        y=place[:, 1] / 1000.0,
        direction=np.radians(place[:, 2]) + np.array(unit.direction),
        gain=np.array(unit.proximity_gain),
        across=fan[0],
        along=fan[1],
        infrared=fan[0] ** IR_EXPONENT * IR_GAIN,
        light=seen / math.fsum(seen),
        scene=scene,
        reach=IR_REACH * math.sqrt(max(1.0, *scene.reflectance)),
        lamps=np.clip(lamps, LAMP_PROUD, size - LAMP_PROUD),
        square=rise**2,
        low=(BODY_TOP - EYE_HEIGHT) / max(rise, BODY_TOP - EYE_HEIGHT),
        poses=np.empty((SENSORS, 3)),
        signal=np.empty(SENSORS),
        rays=np.empty((RAYS, 5)),
    )


@part
def _stand(eyes: Any, poses: Any, k: int) -> Any:
    """Where a sensor is, and cosine and sine of where it looks."""
    c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
    x = poses[k, 0] + c * eyes.x[k] - s * eyes.y[k]
    y = poses[k, 1] + s * eyes.x[k] + c * eyes.y[k]
    angle = poses[k, 2] + eyes.direction[k]
    c, s = math.cos(angle), math.sin(angle)
    return x, y, c, s


@jit
def reflect(eyes: Any, poses: Any, out: Any) -> None:
    """Infrared reflected to each sensor, counts less the offset, without noise, into [8].

    Each ray: emitted and taken in by cos^2.6 of its angle, reflected by Lambert's law (cosine of
    the incidence) and the surface's reflectance, weakened by the square of the distance. `poses` [8, 3]: x, y
    (m) and heading of the robot when each sensor was refreshed.
    """
    counts = near(eyes.scene, poses[0, 0], poses[0, 1], eyes.reach + BODY_RADIUS)
    for k in range(SENSORS):
        out[k] = -IR_OFFSET
        if counts[0] == 0 and counts[1] == 0:
            continue
        x, y, c, s = _stand(eyes, poses, k)
        total = 0.0
        for j in range(RAYS):
            dx, dy = c * eyes.across[j] - s * eyes.along[j], s * eyes.across[j] + c * eyes.along[j]
            distance, incidence, _, _, _, _, reflectance = meet(eyes.scene, counts, x, y, dx, dy)
            deep = distance + IR_DEPTH
            total += reflectance * incidence / (deep * deep) * eyes.infrared[j]
        out[k] = total * eyes.gain[k] - IR_OFFSET


@jit
def illuminate(eyes: Any, power: float, poses: Any, out: Any) -> None:
    """Light on each sensor, into [8]; 1 is a lamp 1 m away, straight ahead. `poses` as of `reflect`.

    Direct light, and what walls and cylinders reflect evenly after one bounce.
    """
    lamps, rays = eyes.lamps, eyes.rays
    counts = near(eyes.scene, poses[0, 0], poses[0, 1], np.inf)
    centre_x, centre_y = 0.0, 0.0
    for k in range(SENSORS):
        out[k] = 0.0
        centre_x, centre_y = centre_x + poses[k, 0], centre_y + poses[k, 1]
    centre = centre_x / SENSORS, centre_y / SENSORS
    for k in range(SENSORS if lamps.shape[0] else 0):
        x, y, c, s = _stand(eyes, poses, k)
        for j in range(RAYS):
            dx, dy = c * eyes.across[j] - s * eyes.along[j], s * eyes.across[j] + c * eyes.along[j]
            distance, _, px, py, nx, ny, reflectance = meet(eyes.scene, counts, x, y, dx, dy)
            tall = math.atan2(WALL_HEIGHT - EYE_HEIGHT, distance) + math.atan2(EYE_HEIGHT, distance)
            # share of a sensor's view, up and down, that a wall fills
            tall = tall / EYE_MIDDLE * reflectance
            rays[j, 0], rays[j, 1], rays[j, 2], rays[j, 3], rays[j, 4] = px, py, nx, ny, tall
        for n in range(lamps.shape[0]):
            lamp, thrown = (lamps[n, 0], lamps[n, 1]), 0.0
            for j in range(RAYS):
                lit = on_wall(eyes, lamp, (rays[j, 0], rays[j, 1]), (rays[j, 2], rays[j, 3]), centre)
                thrown += lit * rays[j, 4] * eyes.light[j]
            out[k] = out[k] + _direct(eyes, lamp, x, y, c, s) + WALL_REFLECTANCE * thrown
        out[k] *= power


@part
def _direct(eyes: Any, lamp: Any, x: float, y: float, c: float, s: float) -> Any:
    """Light of a lamp on a sensor at x, y that looks along c, s."""
    ax, ay = lamp[0] - x, lamp[1] - y
    square = ax * ax + ay * ay + eyes.square
    facing = (ax * c + ay * s) / math.sqrt(square)
    return facing**EYE_EXPONENT / square if facing > 0.0 and is_clear(eyes.scene, x, y, ax, ay) else 0.0


@part
def on_wall(eyes: Any, lamp: Any, point: Any, normal: Any, centre: Any) -> Any:
    """Light of a lamp on a point of a wall whose normal points to the robot: each x, y (m).

    The body, about its centre, shades it where light comes nearer than its radius before it has risen above
    its top.
    """
    (px, py), (nx, ny) = point, normal
    ax, ay = lamp[0] - px, lamp[1] - py
    flat = ax * ax + ay * ay
    square = flat + eyes.square
    # 1 µm off the surface, so that a wall does not shade itself
    if not is_clear(eyes.scene, px + 1e-6 * nx, py + 1e-6 * ny, ax, ay):
        return 0.0
    along = ((centre[0] - px) * ax + (centre[1] - py) * ay) / max(flat, 1e-12)
    along = min(max(along, 0.0), eyes.low)
    dx, dy = px + along * ax - centre[0], py + along * ay - centre[1]
    if math.sqrt(dx * dx + dy * dy) <= BODY_RADIUS:
        return 0.0
    return max(ax * nx + ay * ny, 0.0) / math.sqrt(square) / square


FULL = 1023  # 10 bits
PHASE_MS = np.array([0, 3, 5, 8, 10, 13, 15, 18])
"""One sensor after another, all eight in 20 ms."""
CYCLE_MS = 20
HISTORY_MS = CYCLE_MS + 1
"""A reading is at most 20 ms old: poses are kept for so long."""

_wrapping = partial(np.errstate, over="ignore") if numba.config.DISABLE_JIT else nullcontext
"""Random bits wrap on purpose, which NumPy warns of where nothing is compiled."""


class Sensors:
    """The eight sensors of one unit in one arena.

    Args:
        arena, noise, seed: as of `TwinBody`.
        unit: its sensors' own gains and places.
    """

    def __init__(self, arena: Mapping[str, Any], unit: Unit, *, noise: float, seed: int) -> None:
        self._unit, self._noise, self._seed = unit, noise, seed
        self.eyes = eyes_of(arena, unit)
        self._near = sensor_noise(seed=seed, purpose=1)
        self._light = sensor_noise(seed=seed, purpose=2)
        self._idle = sensor_noise(seed=seed, purpose=3)
        pull = LAMP_COUNTS * np.array(unit.ambient_gain)
        self._laws = np.array([pull, np.array(unit.dark), np.array(unit.floor)])

    def clearance(self, x: float, y: float) -> float:
        """How far it is from a point to the nearest thing (m)."""
        return float(clearance(self.eyes.scene, x, y))

    def proximity(self, time_ms: int, history: Array) -> list[int]:
        """[8] counts; `history` [HISTORY_MS, 7] has the poses of the last milliseconds, each at its own."""
        return self._counts(_proximity, (self._near, self._idle), self._noise, time_ms, history)

    def ambient(self, time_ms: int, history: Array) -> list[int]:
        """[8] counts: linear in the light, from the dark value down to the floor; `history` as above."""
        scales = self._unit.lamp_power, self._noise
        return self._counts(_ambient, self._light, self._laws, scales, time_ms, history)

    def _counts(self, law: Any, *known: Any) -> list[int]:
        """What a compiled law reads."""
        out = np.empty(SENSORS, np.int64)
        with _wrapping():
            law(self.eyes, *known, out)
        counts: list[int] = out.tolist()
        return counts

    def analog(self, n: int, time_ms: int) -> int:
        """[counts] of an input that nothing is connected to."""
        return int(draws(self._seed, 40 + n, time_ms // CYCLE_MS).integers(0, 5)) if self._noise else 0


@part
def refreshed_at(sensor: int, time_ms: int) -> Any:
    """When a sensor was read last, up to now (ms)."""
    return max(time_ms - (time_ms - PHASE_MS[sensor]) % CYCLE_MS, 0)


@jit
def look_back(time_ms: int, history: Any, poses: Any) -> None:
    """Where the robot was when each sensor was refreshed last, into [8, 3]."""
    for k in range(SENSORS):
        n = refreshed_at(k, time_ms) % HISTORY_MS
        poses[k, 0], poses[k, 1] = history[n, 0], history[n, 1]
        w, x, y, z = history[n, 3], history[n, 4], history[n, 5], history[n, 6]
        poses[k, 2] = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@jit
def _proximity(eyes: Any, noises: Any, noise: float, time_ms: int, history: Any, out: Any) -> None:
    look_back(time_ms, history, eyes.poses)
    reflect(eyes, eyes.poses, eyes.signal)
    for k in range(SENSORS):
        signal = noisy_proximity(noises, noise, k, time_ms, eyes.signal[k])
        out[k] = min(max(np.rint(signal), 0.0), FULL)


@part
def noisy_proximity(noises: Any, noise: float, k: int, time_ms: int, signal: float) -> Any:
    """What sensor k's converter takes for a signal (counts), with its noise of this moment.

    `noises` are of what is seen and of a sensor that sees nothing, `noise` the scale of both.
    """
    if noise:
        when = refreshed_at(k, time_ms)
        signal += noise * PROXIMITY_COUNTS * noise_at(noises[0], k, time_ms, when)
        signal = max(signal, noise * DARK_COUNTS * abs(white_at(noises[1], k, when)) * 1.5 - 0.5)
    return signal


@jit
def _ambient(eyes: Any, noises: Any, laws: Any, scales: Any, time_ms: int, history: Any, out: Any) -> None:
    power, noise = scales
    look_back(time_ms, history, eyes.poses)
    illuminate(eyes, power, eyes.poses, eyes.signal)
    for k in range(SENSORS):
        signal = max(laws[1, k] - laws[0, k] * eyes.signal[k], laws[2, k])
        if noise:
            signal += noise * AMBIENT_COUNTS * noise_at(noises, k, time_ms, refreshed_at(k, time_ms))
        out[k] = min(max(np.rint(signal), 0.0), FULL)
