"""The twin's noise: how large, how shaped, and the noise scale that multiplies all of it.

The sizes were fixed before anything was evolved and are never tuned afterwards:
21 counts (proximity) and 4.5 (ambient) as neighbouring bearings of the real robot's tables differ,
about 6 % of the speed on the wheels, as Michel's Khepera simulator gives them (± 10 %, uniform).

Every draw is named by what it belongs to (seed, purpose, sensor, number of the refreshing), so that
asking twice gives the same answer and not asking changes nothing.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import ConfigError
from realitygap.twin.compiled import jit, part

__all__ = ["Slip", "check_scale", "draws", "noise_at", "sensor_noise", "white_at"]

Array = NDArray[np.float64]

PROXIMITY_COUNTS = 21.0
AMBIENT_COUNTS = 4.5
DARK_COUNTS = 3.3
"""A proximity sensor that sees nothing still jitters: 0 to 12 counts in the real tables."""

WHITE, DRIFT = 0.95, 0.3122
"""Shares of a sensor's deviation: new at each refreshing, and slow; their squares add to 1."""
DRIFT_KNOT_MS = 4000
"""The slow share wanders from one random value to the next in this time."""

OUTLIERS, OUTLIER_SIZE = 0.1, 2.2
"""Heavier tails than normal: one draw in ten has 2.2 times the others' deviation."""
_CORE = 1.0 / math.sqrt(1.0 - OUTLIERS + OUTLIERS * OUTLIER_SIZE**2)

SLIP_SHARE, SLIP_KEPT = 0.064, 0.8824969025845955
"""Slip of the tyre: its deviation, and what is left of it after `SLIP_MS`: exp(−5/40), for it is
forgotten in 40 ms."""
_FRESH = SLIP_SHARE * math.sqrt(1.0 - SLIP_KEPT**2)
GROUND_SHARE, GROUND_CELL_M, GROUND_CELLS = 0.042, 0.006, 64
"""The ground: slip that belongs to a place (dust, seams), in cells of 6 mm."""
AXLE_SHARE = 0.025
"""A wheel that sits off its axle: amplitude, once a turn."""
SLIP_MS = 5
"""The slip is brought up to date this often: 1 mm of way at most."""

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_A = np.uint64(0xBF58476D1CE4E5B9)
_MIX_B = np.uint64(0x94D049BB133111EB)
_MASK = (1 << 64) - 1


def draws(*name: int) -> np.random.Generator:
    """A generator that belongs to a name: same name, same draws."""
    return np.random.Generator(np.random.PCG64([n & _MASK for n in name]))


@part
def _spread(number: Any) -> Any:
    """Mix the bits of a whole number, or of many (splitmix64, Steele et al. 2014)."""
    z = number + _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * _MIX_A
    z = (z ^ (z >> np.uint64(27))) * _MIX_B
    return z ^ (z >> np.uint64(31))


@part
def _normal(bits: Any) -> Any:
    """A draw of deviation 1 from 64 random bits (Box and Muller 1958)."""
    first = (np.float64(bits >> np.uint64(32)) + 0.5) * 2.3283064365386963e-10
    second = np.float64(bits & np.uint64(0xFFFFFFFF)) * 2.3283064365386963e-10
    return math.sqrt(-2.0 * math.log(first)) * math.cos(2.0 * math.pi * second)


class SensorNoise(NamedTuple):
    """Noise of deviation 1 for the eight sensors of one kind, a pure function of the time: [8] names of what
    is drawn for each sensor."""

    white: NDArray[np.uint64]
    drift: NDArray[np.uint64]


def sensor_noise(*, seed: int, purpose: int) -> SensorNoise:
    """The noise of a seed, for one purpose."""
    spread = getattr(_spread, "py_func", _spread)  # of many at once nothing has to be compiled
    base = spread(spread(np.array([seed & _MASK], np.uint64)) ^ np.uint64(purpose))
    white = spread(base + np.arange(8, dtype=np.uint64))
    return SensorNoise(white, spread(white))


@part
def white_at(noise: Any, sensor: int, refreshed: int) -> Any:
    """What is new at a sensor's refreshing, named by its time (ms): heavier tails than normal (kurtosis
    about 5)."""
    key = noise.white[sensor] ^ np.uint64(refreshed)
    outlier = np.float64(_spread(key ^ _MIX_A)) < OUTLIERS * 2.0**64
    return _normal(_spread(key)) * (_CORE * OUTLIER_SIZE if outlier else _CORE)


@part
def _drift_at(noise: Any, sensor: int, time_ms: int) -> Any:
    """What changes slowly, deviation 1."""
    knot, rest = time_ms // DRIFT_KNOT_MS, time_ms % DRIFT_KNOT_MS
    here = _normal(_spread(noise.drift[sensor] ^ np.uint64(knot + 1)))
    there = _normal(_spread(noise.drift[sensor] ^ np.uint64(knot + 2)))
    share = rest / DRIFT_KNOT_MS
    share = share * share * (3.0 - 2.0 * share)
    size = math.sqrt(share * share + (1.0 - share) * (1.0 - share))
    return (here * (1.0 - share) + there * share) / size


@part
def noise_at(noise: Any, sensor: int, time_ms: int, refreshed: int) -> Any:
    """The whole noise of a sensor, deviation 1, now; `refreshed` is when it was last read anew (ms)."""
    return WHITE * white_at(noise, sensor, refreshed) + DRIFT * _drift_at(noise, sensor, time_ms)


class Slip:
    """How much further each wheel turns than it carries the robot, as a share of its speed.

    The encoders sit on the motors and see nothing of it: so the robot's own speed control, which is
    nearly noiseless, cannot mend it. Three causes: slip of the tyre, the ground, the wheel on its axle.

    Args:
        seed: names the draws.
        noise: the scale.
        phases: [2] of the axles (rad), left and right.
        half: of the track, m.

    Attributes:
        ground: [2, cells, cells] slip of each place.
    """

    def __init__(self, seed: int, noise: float, phases: tuple[float, float], half: float) -> None:
        self._generator = draws(seed, 31)
        self._tyre = SLIP_SHARE * self._generator.standard_normal(2)
        self.ground = GROUND_SHARE * self._generator.standard_normal((2, GROUND_CELLS, GROUND_CELLS))
        self._noise, self._phases, self._half = noise, np.array(phases), half
        self._fresh, self._used = np.empty((0, 2)), 0

    def update(self, qpos: Array, angles: Array, slip: Array) -> None:
        """Bring both wheels' `slip` [2] up to date, once in `SLIP_MS`; `angles` [2] are the axles' (rad)."""
        if self._noise == 0.0:
            return
        if self._used == len(self._fresh):
            self._fresh, self._used = self._generator.standard_normal((512, 2)), 0
        fresh, self._used = self._fresh[self._used], self._used + 1
        _update(self._tyre, fresh, self.ground, self._phases, self._half, self._noise, qpos, angles, slip)


@jit
def _update(
    tyre: Any,
    fresh: Any,
    ground: Any,
    phases: Any,
    half: float,
    noise: float,
    qpos: Any,
    angles: Any,
    slip: Any,
) -> None:
    x, y, w, z = qpos[0], qpos[1], qpos[3], qpos[6]
    dx, dy = -2.0 * w * z * half, (w * w - z * z) * half
    for side in range(2):
        tyre[side] = SLIP_KEPT * tyre[side] + _FRESH * fresh[side]
        column, row = int((x + dx) / GROUND_CELL_M), int((y + dy) / GROUND_CELL_M)
        place = ground[side, row % GROUND_CELLS, column % GROUND_CELLS]
        axle = AXLE_SHARE * math.cos(angles[side] + phases[side])
        slip[side] = noise * (tyre[side] + place + axle)
        dx, dy = -dx, -dy


def check_scale(value: Any) -> float:
    """The noise scale: any finite number from 0 on, 1 for the size that real robots have."""
    good = isinstance(value, int | float) and not isinstance(value, bool)
    if not good or not math.isfinite(value) or value < 0:
        raise ConfigError(f"the twin's noise is a number from 0 on, 1 as on real robots; got {value!r}")
    return float(value)
