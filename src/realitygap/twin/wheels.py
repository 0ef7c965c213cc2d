"""The robot's own control of its wheels, a thousand times a second (K-Team, Khepera user manual).

One `Wheel` counts its encoder's pulses and turns a wanted speed or place into a voltage.
Units are the robot's: pulses, and pulses in 10 ms for speeds.
"""

from __future__ import annotations

import math

__all__ = ["PULSES_PER_TURN", "SPEED_GAINS", "Wheel"]

PULSES_PER_TURN = 600
"""Encoder on the motor's axle, 24 pulses a turn, behind a gear of 25 to 1."""

SPEED_GAINS = (3800, 800, 100)
POSITION_GAINS = (3000, 20, 4000)
PROFILE = (20, 64)
"""The robot's gains and profile (speed, acceleration) as they leave the factory."""

MAX_SPEED = 127
MAX_PWM = 255
WINDOW_MS = 10
"""The speed is measured as the pulses of the last 10 ms."""

SPEED_SCALE = (1 / 60000.0, 1 / 800000.0, 1 / 60000.0)
POSITION_SCALE = (1 / 300000.0, 1 / 30000000.0, 1 / 60000.0)
"""Volt per gain and pulse: ours, for the manual leaves them out; chosen so that the factory's gains
give a quick step without overshoot, as twin.md asks, and never changed since."""
BOUND = 150.0
"""The integral part cannot grow beyond this (pulses): a robot that was held starts without a leap."""
ARRIVED = 3
"""Within 3 pulses (0.25 mm) of its target a wheel is there."""


class Wheel:
    """One wheel's encoder, targets and controller."""

    def __init__(self, nominal_volt: float) -> None:
        self._volt = nominal_volt
        self.speed_gains: tuple[int, int, int] = SPEED_GAINS
        self.position_gains: tuple[int, int, int] = POSITION_GAINS
        self.profile: tuple[int, int] = PROFILE
        self.reset()

    def reset(self) -> None:
        """Stand still, counter at 0."""
        self._mode = "speed"
        self._raw = 0
        self._offset = 0
        self._ring = [0] * WINDOW_MS
        self._slot = 0
        self._wanted = 0.0
        self._error_sum = 0.0
        self._error_last = 0.0
        self._target = 0
        self._reference = 0.0
        self._pace = 0.0
        self._pwm = 0

    @property
    def pulses(self) -> int:
        """The position counter."""
        return self._raw + self._offset

    @pulses.setter
    def pulses(self, value: int) -> None:
        moved = value - self.pulses
        self._offset += moved
        self._target += moved
        self._reference += moved

    @property
    def speed(self) -> int:
        """Pulses in the last 10 ms."""
        return self._raw - self._ring[self._slot]

    @property
    def mode(self) -> str:
        """`speed`, `position` or `pwm`."""
        return self._mode

    @property
    def error(self) -> int:
        """What is missing to the wanted speed or place."""
        if self._mode == "position":
            return self._target - self.pulses
        return round(self._wanted) - self.speed if self._mode == "speed" else 0

    @property
    def on_target(self) -> bool:
        """Whether the wanted place, or the wanted speed within one pulse, is reached."""
        return abs(self.error) <= (ARRIVED if self._mode == "position" else 1)

    def go(self, speed: int) -> None:
        """Hold a speed from now on (cut to what the robot can be asked for)."""
        if self._mode != "speed":
            self._error_sum = 0.0
        self._mode = "speed"
        self._wanted = float(max(-MAX_SPEED, min(MAX_SPEED, speed)))

    def go_to(self, place: int) -> None:
        """Drive to a place and hold it, by the profile's speed and acceleration."""
        if self._mode != "position":
            self._error_sum = 0.0
            self._reference, self._pace = float(self.pulses), float(self.speed)
        self._mode, self._target = "position", place

    def push(self, pwm: int) -> None:
        """Let the motor have a share of the voltage, −255 to 255, uncontrolled."""
        self._mode, self._pwm = "pwm", max(-MAX_PWM, min(MAX_PWM, pwm))

    def voltage(self, angle: float) -> float:
        """One millisecond: count the pulses up to `angle` (rad) and say what the motor gets (V)."""
        self._ring[self._slot] = self._raw
        self._slot = (self._slot + 1) % WINDOW_MS
        self._raw = math.floor(angle * (PULSES_PER_TURN / (2.0 * math.pi)))
        if self._mode == "speed":
            return self._hold_speed()
        if self._mode == "position":
            return self._hold_place()
        return self._volt * self._pwm / MAX_PWM

    def _pid(self, error: float, gains: tuple[int, int, int], scale: tuple[float, float, float]) -> float:
        bounded = max(-BOUND * 10, min(BOUND * 10, self._error_sum + error))
        change, self._error_last = error - self._error_last, error
        volt = gains[0] * scale[0] * error + gains[1] * scale[1] * bounded + gains[2] * scale[2] * change
        if abs(volt) < self._volt:
            self._error_sum = bounded
            return volt
        return math.copysign(self._volt, volt)

    def _hold_speed(self) -> float:
        return self._pid(self._wanted - (self._raw - self._ring[self._slot]), self.speed_gains, SPEED_SCALE)

    def _hold_place(self) -> float:
        fastest, quickest = float(self.profile[0]), self.profile[1] / 256.0
        way = self._target - self._reference
        # speed from which the profile can still stop in time; pulses per 10 ms, a step is 1 ms
        allowed = min(fastest, math.sqrt(2.0 * quickest * 10.0 * abs(way) / 10.0))
        wanted = math.copysign(allowed, way) if abs(way) > 0.05 else 0.0
        self._pace += max(-quickest, min(quickest, wanted - self._pace))
        step = self._pace / 10.0
        self._reference = float(self._target) if abs(way) <= abs(step) else self._reference + step
        return self._pid(self._reference - self.pulses, self.position_gains, POSITION_SCALE)
