"""The stranger: a twin outside the family of laws that a calibration can fit.

The twin's sensor laws lie within reach of the simulation's forms, which makes it kind. The stranger has
besides what robots have and the forms leave out: surfaces that reflect differently, crosstalk between
neighbouring sensors, infrared of the lamp, a lamp with extent, a floor that stays the same over trials, a
hand that places to a millimetre, commands that take effect up to a step late, a battery that sags.
Sizes were fixed before anything was evolved or calibrated on it, and are never tuned afterwards.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import ConfigError
from realitygap.twin.body import NOMINAL_VOLT, TwinBody
from realitygap.twin.compiled import jit
from realitygap.twin.noise import GROUND_CELLS, GROUND_SHARE, draws
from realitygap.twin.sensors import (
    FULL,
    IR_OFFSET,
    LAMP_PROUD,
    Sensors,
    illuminate,
    look_back,
    noisy_proximity,
    reflect,
)
from realitygap.twin.unit import Unit, plain_arena

__all__ = ["StrangerBody"]

WALL_REFLECTANCE, CYLINDER_REFLECTANCE, REFLECTANCE_SPREAD = 1.0, 0.75, 0.08
"""What walls and cylinders reflect, and by how much units and cylinders differ (a share)."""
CROSSTALK = 0.06
"""Share of a neighbour's infrared that a sensor takes in: the emitters' lobes overlap."""
NEIGHBOURS = np.array([[1, 1], [0, 2], [1, 3], [2, 4], [3, 5], [4, 4], [7, 7], [6, 6]])
SENSORS = len(NEIGHBOURS)
"""Of each sensor, in the order of the robot's; at the ends of a row the only one counts twice a half."""
LAMP_INFRARED = 12.0
"""Counts that a lamp 1 m away, straight ahead, adds to the infrared reflected."""
LAMP_RADIUS, LAMP_PARTS = 0.02, 4
"""A lamp is a disk (m), seen as so many points."""
PLACED_M = 0.001
"""Standard deviation of where a hand puts the robot down, in x and in y."""
LATEST_MS = 100
"""A command takes effect up to so long after it was carried out: a step of the paper's."""
CHARGE, SAG_PER_S = (0.9, 1.0), 0.001
"""Share of the battery's voltage when it is switched on, and what is lost in a second."""


class StrangerSensors(Sensors):
    """Sensors of a stranger: its `crosstalk`, and its battery's `charge`, which scales what it emits."""

    def __init__(self, arena: Mapping[str, Any], unit: Unit, *, noise: float, seed: int) -> None:
        super().__init__(
            arena, replace(unit, lamp_power=unit.lamp_power / LAMP_PARTS), noise=noise, seed=seed
        )
        turn = math.tau * (np.arange(LAMP_PARTS) + 0.5) / LAMP_PARTS
        points = self.eyes.lamps[:, None, :] + LAMP_RADIUS * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        size = np.array(arena["size_cm"]) / 100.0
        lamps = np.clip(points.reshape(-1, 2), LAMP_PROUD, size - LAMP_PROUD)
        self.eyes = self.eyes._replace(lamps=lamps)
        self.crosstalk, self.charge = CROSSTALK * float(draws(unit.number, 53).uniform(0.7, 1.3)), 1.0

    def proximity(self, time_ms: int, history: NDArray[np.float64]) -> list[int]:
        """[8] counts: the twin's law, with crosstalk, the lamp's infrared and the battery's charge."""
        scales = self.crosstalk, self.charge, self._unit.lamp_power, LAMP_INFRARED, self._noise
        noises, light = (self._near, self._idle), np.empty(SENSORS)
        return self._counts(_proximity, noises, scales, time_ms, history, light)


@jit
def _proximity(eyes: Any, noises: Any, scales: Any, time_ms: int, history: Any, light: Any, out: Any) -> None:
    crosstalk, charge, power, lamp, noise = scales
    look_back(time_ms, history, eyes.poses)
    illuminate(eyes, power, eyes.poses, light)
    reflect(eyes, eyes.poses, eyes.signal)
    for k in range(out.shape[0]):
        own, first, second = eyes.signal[k], eyes.signal[NEIGHBOURS[k, 0]], eyes.signal[NEIGHBOURS[k, 1]]
        thrown = own + IR_OFFSET + crosstalk * ((first + second) / 2.0 + IR_OFFSET)
        signal = charge * thrown + lamp * light[k] - IR_OFFSET
        out[k] = min(max(np.rint(noisy_proximity(noises, noise, k, time_ms, signal)), 0.0), FULL)


class StrangerBody(TwinBody):
    """A stranger in one arena: arguments as of `TwinBody`, and as there the same bits."""

    def __init__(
        self, arena: Mapping[str, Any], *, unit: int, noise: float = 1.0, seed: int = 0, substeps: int = 1
    ) -> None:
        self._placed: np.random.Generator | None = None
        self._late: deque[tuple[int, int, int]] = deque()
        super().__init__(_room(arena, unit), unit=unit, noise=noise, seed=seed, substeps=substeps)
        name = int(draws(unit, seed, 17).integers(2**62))
        self._sensors: StrangerSensors = StrangerSensors(self.arena, self.unit, noise=noise, seed=name)
        self._slip.ground[:] = GROUND_SHARE * draws(unit, 61).standard_normal((2, GROUND_CELLS, GROUND_CELLS))
        self._full = self._sensors.charge = float(draws(unit, seed, 59).uniform(*CHARGE))
        self._placed, self._delays = draws(unit, seed, 67), draws(unit, seed, 71)

    def advance(self, milliseconds: int) -> None:
        """Let time pass; commands take effect when they are due."""
        end = self.time_ms + milliseconds
        while self._late and self._late[0][0] <= end:
            due, left, right = self._late.popleft()
            self._drain(max(0, due - self.time_ms))
            super().set_speed(left, right)
        self._drain(end - self.time_ms)

    def _drain(self, milliseconds: int) -> None:
        """Let time pass on what the battery still gives."""
        super().advance(milliseconds)
        charge = max(0.0, self._full - SAG_PER_S * self.time_ms / 1000.0)
        self._sensors.charge = charge
        self.set_volt(NOMINAL_VOLT * charge)

    def place(self, x_cm: float, y_cm: float, heading: float) -> None:
        """As the twin's, to a millimetre: where that leaves no room, exactly."""
        if self._placed is not None:
            off = 100.0 * PLACED_M * self._placed.standard_normal(2)
            if self._fits(x_cm, y_cm) and self._fits(x_cm + off[0], y_cm + off[1]):
                x_cm, y_cm = x_cm + float(off[0]), y_cm + float(off[1])
        super().place(x_cm, y_cm, heading)

    def set_speed(self, left: int, right: int) -> None:
        """Hold these speeds, from a moment within the next 100 ms on."""
        due = self.time_ms + int(self._delays.integers(0, LATEST_MS + 1))
        self._late.append((max(due, self._late[-1][0]) if self._late else due, left, right))

    def set_position(self, left: int, right: int) -> None:
        """Drive the counters to these values; what was asked for before is over."""
        self._late.clear()
        super().set_position(left, right)

    def set_pwm(self, left: int, right: int) -> None:
        """Share of the voltage for each motor; what was asked for before is over."""
        self._late.clear()
        super().set_pwm(left, right)


def _room(arena: Mapping[str, Any], unit: int) -> dict[str, Any]:
    """The arena with surfaces of its own, which nobody states.

    Raises:
        ConfigError: somebody does.
    """
    if "reflectance" in arena:
        raise ConfigError(
            "arena: reflectance: expected none for the stranger, whose surfaces are its own secret. "
            "Use the twin, or leave it out."
        )
    room = plain_arena(arena)
    drawn = draws(unit, 73).standard_normal(1 + len(room["cylinders"]))
    white = np.full(len(drawn), CYLINDER_REFLECTANCE)
    white[0] = WALL_REFLECTANCE
    return {**room, "reflectance": (white * (1.0 + REFLECTANCE_SPREAD * drawn.clip(-3.0, 3.0))).tolist()}
