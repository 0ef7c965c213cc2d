"""The twin's noise: how large, how shaped, and the noise scale that multiplies all of it.

The sizes were fixed before anything was evolved and are never tuned afterwards:
21 counts (proximity) and 4.5 (ambient) as neighbouring bearings of the real robot's tables differ,
about 6 % of the speed on the wheels, as Michel's Khepera simulator gives them (± 10 %, uniform).

Every draw is named by what it belongs to (seed, purpose, sensor, number of the refreshing), so that
asking twice gives the same answer and not asking changes nothing.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import ConfigError
from realitygap.twin.arithmetic import cos, normals

__all__ = ["Creep", "SensorNoise", "check_scale", "draws", "normal_draws"]

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
"""Slip of the tyre: deviation of the creep, and what is left of it after `CREEP_MS`: exp(−5/40), for it is
forgotten in 40 ms."""
GROUND_SHARE, GROUND_CELL_M, GROUND_CELLS = 0.042, 0.006, 64
"""The ground: creep that belongs to a place (dust, seams), in cells of 6 mm."""
AXLE_SHARE = 0.025
"""A wheel that sits off its axle: amplitude, once a turn."""
CREEP_MS = 5
"""The creep is brought up to date this often: 1 mm of way at most."""

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_A = np.uint64(0xBF58476D1CE4E5B9)
_MIX_B = np.uint64(0x94D049BB133111EB)
_MASK = (1 << 64) - 1


def draws(*name: int) -> np.random.Generator:
    """A generator that belongs to a name: same name, same draws."""
    return np.random.Generator(np.random.PCG64([n & _MASK for n in name]))


def normal_draws(generator: np.random.Generator, *shape: int) -> NDArray[np.float64]:
    """Normal draws of a generator: NumPy's own take a logarithm of the C library, this one of the twin's."""
    bits: NDArray[np.uint64] = generator.bit_generator.random_raw(math.prod(shape))
    return normals(bits.reshape(shape))


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


class SensorNoise:
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


class Creep:
    """How much further each wheel turns than it carries the robot, as a share of its speed.

    The encoders sit on the motors and see nothing of it: so the robot's own speed control, which is
    nearly noiseless, cannot mend it. Three causes: slip of the tyre, the ground, the wheel on its axle.
    """

    def __init__(self, seed: int, noise: float, phases: tuple[float, float]) -> None:
        generator = draws(seed, 31)
        self._noise = noise
        self._phases = phases
        self._generator = generator
        self._slip: list[float] = (SLIP_SHARE * normal_draws(generator, 2)).tolist()
        field = normal_draws(generator, 2, GROUND_CELLS, GROUND_CELLS)
        self._ground: list[list[list[float]]] = (GROUND_SHARE * field).tolist()
        self._fresh = SLIP_SHARE * math.sqrt(1.0 - SLIP_KEPT**2)
        self._block: list[float] = []

    def _normal(self) -> float:
        if not self._block:
            self._block = normal_draws(self._generator, 512).tolist()
        return self._block.pop()

    def at(self, wheel: int, x: float, y: float, angle: float) -> float:
        """Creep of a wheel (0 left, 1 right) that stands at x, y (m) and has turned by `angle` (rad).

        To be asked once in `CREEP_MS`.

        Args:
            wheel: 0 left, 1 right.
            x, y: where it stands, m.
            angle: by which it has turned, rad.
        """
        if self._noise == 0.0:
            return 0.0
        self._slip[wheel] = SLIP_KEPT * self._slip[wheel] + self._fresh * self._normal()
        column, row = int(x / GROUND_CELL_M), int(y / GROUND_CELL_M)
        ground = self._ground[wheel][row % GROUND_CELLS][column % GROUND_CELLS]
        axle = AXLE_SHARE * cos(angle + self._phases[wheel])
        return self._noise * (self._slip[wheel] + ground + axle)


def check_scale(value: Any) -> float:
    """The noise scale: any finite number from 0 on, 1 for the size that real robots have."""
    good = isinstance(value, int | float) and not isinstance(value, bool)
    if not good or not math.isfinite(value) or value < 0:
        raise ConfigError(f"the twin's noise is a number from 0 on, 1 as on real robots; got {value!r}")
    return float(value)
