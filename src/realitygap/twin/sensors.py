"""What the eight sensors read: one after another, with noise, as counts of their converter."""

from collections.abc import Mapping
from contextlib import nullcontext
from functools import partial
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from realitygap.twin.arithmetic import jit, one_arctan2, step
from realitygap.twin.eyes import LAMP_COUNTS, SENSORS, eyes_of, illuminate, reflect
from realitygap.twin.noise import (
    AMBIENT_COUNTS,
    DARK_COUNTS,
    PROXIMITY_COUNTS,
    draws,
    noise_at,
    sensor_noise,
    white_at,
)
from realitygap.twin.rays import clearance
from realitygap.twin.unit import Unit

__all__ = ["CYCLE_MS", "FULL", "HISTORY_MS", "PHASE_MS", "Sensors", "look_back", "noisy_proximity"]

Array = NDArray[np.float64]

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

    def _counts(self, law: Any, *told: Any) -> list[int]:
        """What a compiled law reads."""
        out = np.empty(SENSORS, np.int64)
        with _wrapping():
            law(self.eyes, *told, out)
        counts: list[int] = out.tolist()
        return counts

    def analog(self, n: int, time_ms: int) -> int:
        """[counts] of an input that nothing is connected to."""
        return int(draws(self._seed, 40 + n, time_ms // CYCLE_MS).integers(0, 5)) if self._noise else 0


@step
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
        poses[k, 2] = one_arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@jit
def _proximity(eyes: Any, noises: Any, noise: float, time_ms: int, history: Any, out: Any) -> None:
    look_back(time_ms, history, eyes.poses)
    reflect(eyes, eyes.poses, eyes.signal)
    for k in range(SENSORS):
        signal = noisy_proximity(noises, noise, k, time_ms, eyes.signal[k])
        out[k] = min(max(np.rint(signal), 0.0), FULL)


@step
def noisy_proximity(noises: Any, noise: float, k: int, time_ms: int, signal: float) -> Any:
    """What a sensor's converter takes for a signal, its noise of this moment on it.

    Args:
        noises, noise: of what is seen and of a sensor that sees nothing, and the scale of both.
        k: which sensor.
        time_ms: now.
        signal: without noise, counts.
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
