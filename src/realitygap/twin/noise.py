"""The twin's noise: how large, how shaped, and the noise scale that multiplies all of it.

The sizes were fixed before anything was evolved and are never tuned afterwards:
21 counts (proximity) and 4.5 (ambient) as neighbouring bearings of the real robot's tables differ,
about 6 % of the speed on the wheels, as Michel's Khepera simulator gives them (± 10 %, uniform).

Every draw is named by what it belongs to (seed, purpose, sensor, number of the refreshing), so that
asking twice gives the same answer and not asking changes nothing.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import ConfigError
from realitygap.twin.arithmetic import normals, one_cos_sin, one_normal, step

__all__ = [
    "Creep", "SensorNoise", "check_scale", "creep_at", "creep_of", "draws", "noise_at", "normal_draws",
    "sensor_noise", "white_at",
]  # fmt: skip

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
_FRESH = SLIP_SHARE * math.sqrt(1.0 - SLIP_KEPT**2)
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


@step
def _spread(number: Any) -> Any:
    """Mix the bits of a whole number, or of many (splitmix64, Steele et al. 2014)."""
    z = number + _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * _MIX_A
    z = (z ^ (z >> np.uint64(27))) * _MIX_B
    return z ^ (z >> np.uint64(31))


class SensorNoise(NamedTuple):
    """Noise of deviation 1 for the eight sensors of one kind: a pure function of the time.

    Attributes:
        white, drift: [8] names of what is drawn for each sensor.
    """

    white: NDArray[np.uint64]
    drift: NDArray[np.uint64]


def sensor_noise(*, seed: int, purpose: int) -> SensorNoise:
    """The noise of a seed, for one purpose."""
    spread = getattr(_spread, "py_func", _spread)  # of many at once nothing has to be compiled
    base = spread(spread(np.array([seed & _MASK], np.uint64)) ^ np.uint64(purpose))
    white = spread(base + np.arange(8, dtype=np.uint64))
    return SensorNoise(white, spread(white))


@step
def white_at(noise: Any, sensor: int, refreshed: int) -> Any:
    """What is new at a sensor's refreshing, named by its time (ms): heavier tails than normal (kurtosis
    about 5)."""
    key = noise.white[sensor] ^ np.uint64(refreshed)
    outlier = np.float64(_spread(key ^ _MIX_A)) < OUTLIERS * 2.0**64
    return one_normal(_spread(key)) * (_CORE * OUTLIER_SIZE if outlier else _CORE)


@step
def _drift_at(noise: Any, sensor: int, time_ms: int) -> Any:
    """What changes slowly, deviation 1."""
    knot, rest = time_ms // DRIFT_KNOT_MS, time_ms % DRIFT_KNOT_MS
    here = one_normal(_spread(noise.drift[sensor] ^ np.uint64(knot + 1)))
    there = one_normal(_spread(noise.drift[sensor] ^ np.uint64(knot + 2)))
    share = rest / DRIFT_KNOT_MS
    share = share * share * (3.0 - 2.0 * share)
    size = math.sqrt(share * share + (1.0 - share) * (1.0 - share))
    return (here * (1.0 - share) + there * share) / size


@step
def noise_at(noise: Any, sensor: int, time_ms: int, refreshed: int) -> Any:
    """The whole noise of a sensor, deviation 1.

    Args:
        noise: one channel's.
        sensor: its number.
        time_ms, refreshed: now, and when its reading was last made anew.
    """
    return WHITE * white_at(noise, sensor, refreshed) + DRIFT * _drift_at(noise, sensor, time_ms)


class Creep(NamedTuple):
    """How much further each wheel turns than it carries the robot, as a share of its speed.

    The encoders sit on the motors and see nothing of it: so the robot's own speed control, which is
    nearly noiseless, cannot mend it. Three causes: slip of the tyre, the ground, the wheel on its axle.

    Attributes:
        noise: the scale.
        phases: [2] of the axles (rad), left and right.
        slip: [2] of each wheel now.
        ground: [2, cells, cells] of each place.
        block: [n] normal draws, used from the end on; `left` [1] of them are new.
    """

    noise: float
    phases: NDArray[np.float64]
    slip: NDArray[np.float64]
    ground: NDArray[np.float64]
    block: NDArray[np.float64]
    left: NDArray[np.int64]


def creep_of(seed: int, noise: float, phases: tuple[float, float]) -> tuple[Creep, Callable[[], None]]:
    """The creep of a seed, and what draws its next block when none is left."""
    generator = draws(seed, 31)
    slip = SLIP_SHARE * normal_draws(generator, 2)
    field = GROUND_SHARE * normal_draws(generator, 2, GROUND_CELLS, GROUND_CELLS)
    creep = Creep(noise, np.array(phases), slip, field, np.empty(512), np.zeros(1, np.int64))

    def refill() -> None:
        creep.block[:] = normal_draws(generator, len(creep.block))
        creep.left[0] = len(creep.block)

    return creep, refill


@step
def creep_at(creep: Any, wheel: int, x: float, y: float, angle: float) -> Any:
    """A wheel's creep, to be asked once in `CREEP_MS`, while there are draws.

    Args:
        creep: the wheels'.
        wheel: 0 left, 1 right.
        x, y: where it stands, m.
        angle: by which it has turned, rad.
    """
    if creep.noise == 0.0:
        return 0.0
    creep.left[0] -= 1
    slip = SLIP_KEPT * creep.slip[wheel] + _FRESH * creep.block[creep.left[0]]
    creep.slip[wheel] = slip
    column, row = int(x / GROUND_CELL_M), int(y / GROUND_CELL_M)
    ground = creep.ground[wheel, row % GROUND_CELLS, column % GROUND_CELLS]
    axle = AXLE_SHARE * one_cos_sin(angle + creep.phases[wheel])[0]
    return creep.noise * (slip + ground + axle)


def check_scale(value: Any) -> float:
    """The noise scale: any finite number from 0 on, 1 for the size that real robots have."""
    good = isinstance(value, int | float) and not isinstance(value, bool)
    if not good or not math.isfinite(value) or value < 0:
        raise ConfigError(f"the twin's noise is a number from 0 on, 1 as on real robots; got {value!r}")
    return float(value)
