"""The robot's own control of its wheels, a thousand times a second (K-Team, Khepera user manual).

One `Wheel` counts its encoder's pulses and turns a wanted speed or place into a voltage.
Units are the robot's: pulses, and pulses in 10 ms for speeds.
"""

from __future__ import annotations

import math

__all__ = ["PULSES_PER_TURN", "SPEED_GAINS", "Wheel"]

PULSES_PER_TURN = 600
"""Encoder on the motor's axle, 24 pulses a turn, behind a gear of 25 to 1."""
PULSES_PER_RADIAN = PULSES_PER_TURN / (2.0 * math.pi)

SPEED_GAINS = (3800, 800, 100)
POSITION_GAINS = (3000, 20, 4000)
PROFILE = (20, 64)
"""The robot's gains and profile (speed, acceleration) as they leave the factory."""

MAX_SPEED = 127
MAX_PWM = 255
WINDOW_MS = 10
"""The speed is measured as the pulses of the last 10 ms."""

SPEED_SCALE = (1 / 40000.0, 1 / 500000.0, 1 / 40000.0)
POSITION_SCALE = (1 / 100000.0, 1 / 2000000.0, 1 / 5000.0)
"""Volt per gain and pulse: ours, for the manual leaves them out; chosen so that the factory's gains
give a quick step without overshoot, and never changed since."""
ARRIVED = 3
"""Within 3 pulses (0.25 mm) of its target a wheel is there."""


class Wheel:
    """One wheel's encoder, targets and controller."""

    def __init__(self, nominal_volt: float) -> None:
        self._volt = nominal_volt
        self.set_gains(speed=SPEED_GAINS, position=POSITION_GAINS)
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

    def set_gains(
        self, *, speed: tuple[int, int, int] | None = None, position: tuple[int, int, int] | None = None
    ) -> None:
        """New gains for one controller or both."""
        if speed is not None:
            kp, ki, kd = (g * s for g, s in zip(speed, SPEED_SCALE, strict=True))
            self._speed_volts = (kp, ki, kd)
        if position is not None:
            kp, ki, kd = (g * s for g, s in zip(position, POSITION_SCALE, strict=True))
            self._position_volts = (kp, ki, kd)

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
        ring, slot = self._ring, self._slot
        ring[slot] = self._raw
        self._slot = slot = (slot + 1) % WINDOW_MS
        self._raw = raw = math.floor(angle * PULSES_PER_RADIAN)
        if self._mode == "speed":
            return self._pid(self._wanted - (raw - ring[slot]), self._speed_volts)
        if self._mode == "position":
            return self._pid(self._follow_profile() - self.pulses, self._position_volts)
        return self._volt * self._pwm / MAX_PWM

    def _pid(self, error: float, volts: tuple[float, float, float]) -> float:
        total = self._error_sum + error
        volt = volts[0] * error + volts[1] * total + volts[2] * (error - self._error_last)
        self._error_last = error
        if -self._volt < volt < self._volt:
            self._error_sum = total
            return volt
        return math.copysign(self._volt, volt)  # saturated: the sum waits

    def _follow_profile(self) -> float:
        """Where the wheel should be by now: fast, but never too fast to stop in time."""
        fastest, quickest = float(self.profile[0]), self.profile[1] / 256.0  # per 10 ms, per 10 ms·ms
        way = self._target - self._reference
        wanted = math.copysign(min(fastest, math.sqrt(0.2 * quickest * 10.0 * abs(way))), way)
        self._pace += max(-quickest, min(quickest, wanted - self._pace))
        step = self._pace / 10.0
        if abs(way) <= max(abs(step), 0.5):
            self._reference, self._pace = float(self._target), 0.0
        else:
            self._reference += step
        return self._reference
