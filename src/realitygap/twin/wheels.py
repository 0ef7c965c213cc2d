"""The robot's own control of its wheels, a thousand times a second (K-Team, Khepera user manual).

A wheel counts its encoder's pulses and turns a wanted speed or place into a voltage. Units are the
robot's: pulses, and pulses in 10 ms for speeds. A millisecond of both wheels is compiled.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.compiled import jit, part

__all__ = ["ANGLE", "NUMBERS", "SLIP", "Wheel", "control"]

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

SPEED, POSITION, PWM = 0, 1, 2
(
    MODE, RAW, OFFSET, SLOT, TARGET, PWM_SHARE, VOLT, WANTED, ERROR_SUM, ERROR_LAST, REFERENCE, PACE,
    FASTEST, QUICKEST, ANGLE, SLIP, SLIPPED,
) = range(17)  # fmt: skip
SPEED_VOLTS, POSITION_VOLTS, RING = 17, 20, 23
NUMBERS = RING + WINDOW_MS
"""Where the numbers of a wheel are in a row: its controller's, its axle's last angle (rad), its slip now and
the angle by which it has slipped in all; each controller's three gains in volts a pulse; the pulses
of the last 10 ms."""


class Wheel:
    """One wheel's encoder, targets and controller: `state` is a row of NUMBERS, zeros at first."""

    def __init__(self, volt: float, state: Any) -> None:
        self._state = state
        self.set_volt(volt)
        self.set_profile(*PROFILE)
        self.set_speed_gains(*SPEED_GAINS)
        self.set_position_gains(*POSITION_GAINS)

    def set_volt(self, volt: float) -> None:
        """What its motor gets at most."""
        self._state[VOLT] = volt

    def set_profile(self, speed: int, acceleration: int) -> None:
        """How fast the position controller drives."""
        self._state[FASTEST], self._state[QUICKEST] = speed, acceleration / 256.0  # per 10 ms, per 10 ms·ms

    def set_speed_gains(self, *gains: int) -> None:
        """Kp, Ki and Kd."""
        self._state[SPEED_VOLTS : SPEED_VOLTS + 3] = np.multiply(gains, SPEED_SCALE)

    def set_position_gains(self, *gains: int) -> None:
        """Kp, Ki and Kd."""
        self._state[POSITION_VOLTS : POSITION_VOLTS + 3] = np.multiply(gains, POSITION_SCALE)

    @property
    def pulses(self) -> int:
        """The position counter."""
        return int(self._state[RAW] + self._state[OFFSET])

    @pulses.setter
    def pulses(self, value: int) -> None:
        moved = value - self.pulses
        self._state[[OFFSET, TARGET, REFERENCE]] += moved

    @property
    def speed(self) -> int:
        """Pulses in the last 10 ms."""
        return int(self._state[RAW] - self._state[RING + int(self._state[SLOT])])

    @property
    def stands(self) -> bool:
        """Whether it is only told to stand."""
        return bool(self._state[MODE] == SPEED and self._state[WANTED] == 0.0)

    @property
    def error(self) -> int:
        """What is missing to the wanted speed or place."""
        if self._state[MODE] == POSITION:
            return int(self._state[TARGET]) - self.pulses
        return round(float(self._state[WANTED])) - self.speed if self._state[MODE] == SPEED else 0

    @property
    def on_target(self) -> bool:
        """Whether the wanted place, or the wanted speed within one pulse, is reached."""
        return abs(self.error) <= (ARRIVED if self._state[MODE] == POSITION else 1)

    def go(self, speed: int) -> None:
        """Hold a speed from now on (cut to what the robot can be asked for)."""
        if self._state[MODE] != SPEED:
            self._state[ERROR_SUM] = 0.0
        self._state[MODE] = SPEED
        self._state[WANTED] = max(-MAX_SPEED, min(MAX_SPEED, speed))

    def go_to(self, place: int) -> None:
        """Drive to a place and hold it, by the profile's speed and acceleration."""
        if self._state[MODE] != POSITION:
            self._state[ERROR_SUM] = 0.0
            self._state[REFERENCE], self._state[PACE] = self.pulses, self.speed
        self._state[MODE], self._state[TARGET] = POSITION, place

    def push(self, pwm: int) -> None:
        """Let the motor have a share of the voltage, −255 to 255, uncontrolled."""
        self._state[MODE], self._state[PWM_SHARE] = PWM, max(-MAX_PWM, min(MAX_PWM, pwm))


@part
def _pid(wheel: Any, first: int, error: float) -> Any:
    total = wheel[ERROR_SUM] + error
    volt = wheel[first] * error + wheel[first + 1] * total + wheel[first + 2] * (error - wheel[ERROR_LAST])
    wheel[ERROR_LAST] = error
    if -wheel[VOLT] < volt < wheel[VOLT]:
        wheel[ERROR_SUM] = total
        return volt
    return math.copysign(wheel[VOLT], volt)  # saturated: the sum waits


@part
def _follow_profile(wheel: Any) -> Any:
    """Where the wheel should be by now: fast, but never too fast to stop in time."""
    fastest, quickest = wheel[FASTEST], wheel[QUICKEST]
    way = wheel[TARGET] - wheel[REFERENCE]
    wanted = math.copysign(min(fastest, math.sqrt(0.2 * quickest * 10.0 * abs(way))), way)
    wheel[PACE] += max(-quickest, min(quickest, wanted - wheel[PACE]))
    step = wheel[PACE] / 10.0
    if abs(way) <= max(abs(step), 0.5):
        wheel[REFERENCE], wheel[PACE] = wheel[TARGET], 0.0
    else:
        wheel[REFERENCE] += step
    return wheel[REFERENCE]


@part
def _voltage(wheel: Any, angle: float) -> Any:
    """One millisecond: count the pulses up to `angle` (rad) and say what the motor gets (V)."""
    slot = int(wheel[SLOT])
    wheel[RING + slot] = wheel[RAW]
    slot = (slot + 1) % WINDOW_MS
    wheel[SLOT], wheel[RAW] = slot, math.floor(angle * PULSES_PER_RADIAN)
    if wheel[MODE] == SPEED:
        return _pid(wheel, SPEED_VOLTS, wheel[WANTED] - (wheel[RAW] - wheel[RING + slot]))
    if wheel[MODE] == POSITION:
        return _pid(wheel, POSITION_VOLTS, _follow_profile(wheel) - (wheel[RAW] + wheel[OFFSET]))
    return wheel[VOLT] * wheel[PWM_SHARE] / MAX_PWM


@jit
def control(wheels: Any, qpos: Any, ctrl: NDArray[np.float64]) -> None:
    """One millisecond of both wheels' control.

    Args:
        wheels: [2, `NUMBERS`], left and right.
        qpos: MuJoCo's places; 7 and 8 are the axles' angles (rad).
        ctrl: [2] into which the motors' voltages go.
    """
    for side in range(2):
        wheel, angle = wheels[side], qpos[7 + side]
        wheel[SLIPPED] += wheel[SLIP] * (angle - wheel[ANGLE])
        wheel[ANGLE] = angle
        ctrl[side] = _voltage(wheel, angle + wheel[SLIPPED])
