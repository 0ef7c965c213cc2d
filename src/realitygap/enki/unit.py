"""Enki's robots, and one unit of a population of each: drawn from its number, known to nobody but Enki.

Unit 0 is the published model itself. In the others gains, directions and wheels differ as they do from one
Khepera to the next.
"""

from dataclasses import dataclass

import numpy as np

__all__ = ["MODELS", "Model", "Unit", "draw_unit"]

GAIN_SHARE, TURN_RAD = 0.2, 0.0873
"""Deviations between the eight sensors of one real Khepera: its wall table shows 20 to 25 % and 3° to 11°."""
WHEEL_SHARE, TRACK_SHARE = 0.004, 0.006
MOST = 3.0
"""Deviations, at most: no maker delivers worse."""


@dataclass(frozen=True, kw_only=True)
class Model:
    """What a driver needs to know of one of Enki's robots.

    Attributes:
        words: its name for a person.
        profile: the shipped profile of what is known of it beforehand.
        sensors: how many proximity sensors; full_scale: their highest count.
        unit_cm_s: speed of a wheel at command 1; top: the largest command.
        pulses_per_mm: of its wheels' counters; None: it has none.
        commands: what its commands and speeds are in.
    """

    words: str
    profile: str
    sensors: int
    full_scale: int
    unit_cm_s: float
    top: int
    pulses_per_mm: float | None
    commands: str


MODELS = {
    "khepera": Model(
        words="Enki's Khepera", profile="enki-khepera", sensors=8, full_scale=1023, unit_cm_s=0.8,
        top=127, pulses_per_mm=12.0, commands="Khepera units",
    ),
    "epuck": Model(
        words="Enki's e-puck", profile="enki-epuck", sensors=8, full_scale=4095, unit_cm_s=0.0128,
        top=1000, pulses_per_mm=1000 / 128.0, commands="e-puck units (steps/s)",
    ),
    "thymio2": Model(
        words="Enki's Thymio II", profile="enki-thymio2", sensors=7, full_scale=4505, unit_cm_s=16.6 / 500,
        top=500, pulses_per_mm=None, commands="Thymio units",
    ),
}  # fmt: skip
"""Full scales: the converters' 10 and 12 bits; of the Thymio the most that Enki's model gives. A Khepera's
unit is a pulse each 10 ms (8 mm/s); an e-puck makes 1000 steps a turn of 128 mm; 500 Thymio units are Enki's
top speed of 16.6 cm/s."""


@dataclass(frozen=True, kw_only=True)
class Unit:
    """A unit's shares of what is published, and by how much its sensors are turned (rad)."""

    track: float
    wheels: tuple[float, float]
    gains: tuple[float, ...]
    turns: tuple[float, ...]


def draw_unit(model: str, number: int) -> Unit:
    """The unit with this number of a model, always the same one; 0 is what is published."""
    draws = np.random.default_rng([number, list(MODELS).index(model), 19])
    around = np.clip(draws.standard_normal(3 + 2 * MODELS[model].sensors), -MOST, MOST)
    around *= number > 0
    wheels, sensors = 1.0 + WHEEL_SHARE * around[1:3], around[3:].reshape(2, -1)
    return Unit(
        track=float(1.0 + TRACK_SHARE * around[0]),
        wheels=(float(wheels[0]), float(wheels[1])),
        gains=tuple((1.0 + GAIN_SHARE * sensors[0]).tolist()),
        turns=tuple((TURN_RAD * sensors[1]).tolist()),
    )
