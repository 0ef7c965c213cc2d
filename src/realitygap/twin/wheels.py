"""The robot's own control of its wheels, a thousand times a second (K-Team, Khepera user manual).

A wheel counts its encoder's pulses and turns a wanted speed or place into a voltage. Units are the
robot's: pulses, and pulses in 10 ms for speeds. A millisecond of both wheels is compiled.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.compiled import jit, part

__all__ = ["ANGLE", "NUMBERS", "SLIP", "Wheels", "control"]

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


class Wheels:
    """Both wheels' encoders, targets and controllers, by the robot's commands: always left and right.

    Attributes:
        state: [2, NUMBERS]; at_rest: whether both are only told to stand.
    """

    def __init__(self, volt: float) -> None:
        self.state, self.at_rest = np.zeros((2, NUMBERS)), True
        self.set_volt(volt)
        self.set_profile(*PROFILE, *PROFILE)
        self.set_speed_gains(*SPEED_GAINS)
        self.set_position_gains(*POSITION_GAINS)

    def set_volt(self, volt: float) -> None:
        """What their motors get at most."""
        self.state[:, VOLT] = volt

    def set_profile(self, vl: int, al: int, vr: int, ar: int) -> None:
        """How fast the position controller drives: speeds and accelerations, in the units of command J."""
        self.state[:, FASTEST] = vl, vr
        self.state[:, QUICKEST] = al / 256.0, ar / 256.0  # per 10 ms, per 10 ms·ms

    def set_speed_gains(self, kp: int, ki: int, kd: int) -> None:
        """Gains of the speed controller."""
        self.state[:, SPEED_VOLTS : SPEED_VOLTS + 3] = np.multiply((kp, ki, kd), SPEED_SCALE)

    def set_position_gains(self, kp: int, ki: int, kd: int) -> None:
        """Gains of the position controller."""
        self.state[:, POSITION_VOLTS : POSITION_VOLTS + 3] = np.multiply((kp, ki, kd), POSITION_SCALE)

    def set_speed(self, left: int, right: int) -> None:
        """Hold these speeds (pulses in 10 ms), cut to what the robot can be asked for."""
        for wheel, speed in zip(self.state, (left, right), strict=True):
            self._switch(wheel, SPEED)
            wheel[WANTED] = min(max(speed, -MAX_SPEED), MAX_SPEED)
        self.at_rest = left == right == 0

    def set_position(self, left: int, right: int) -> None:
        """Drive the counters to these values (pulses) and hold them, by the profile."""
        self.at_rest = False
        for wheel, target in zip(self.state, (left, right), strict=True):
            if self._switch(wheel, POSITION):
                wheel[REFERENCE], wheel[PACE] = wheel[RAW] + wheel[OFFSET], _speed(wheel)
            wheel[TARGET] = target

    def set_pwm(self, left: int, right: int) -> None:
        """Share of the voltage for each motor, −255 to 255, uncontrolled."""
        self.at_rest = False
        for wheel, share in zip(self.state, (left, right), strict=True):
            wheel[MODE], wheel[PWM_SHARE] = PWM, min(max(share, -MAX_PWM), MAX_PWM)

    def pulses(self) -> tuple[int, int]:
        """The position counters."""
        left, right = (int(wheel[RAW] + wheel[OFFSET]) for wheel in self.state)
        return left, right

    def set_pulses(self, left: int, right: int) -> None:
        """Set the position counters."""
        moved = np.subtract((left, right), self.pulses())
        self.state[:, [OFFSET, TARGET, REFERENCE]] += moved[:, None]

    def speeds(self) -> tuple[int, int]:
        """Measured speeds, pulses in 10 ms."""
        left, right = (int(_speed(wheel)) for wheel in self.state)
        return left, right

    def on_target(self) -> tuple[bool, bool]:
        """Whether each wheel has the wanted place, or the wanted speed within one pulse."""
        left, right = (
            bool(
                abs(wheel[TARGET] - place) <= ARRIVED
                if wheel[MODE] == POSITION
                else wheel[MODE] == PWM or abs(wheel[WANTED] - speed) <= 1
            )
            for wheel, place, speed in zip(self.state, self.pulses(), self.speeds(), strict=True)
        )
        return left, right

    @staticmethod
    def _switch(wheel: Any, mode: int) -> bool:
        """Control a wheel by another law from now on; whether it is another."""
        if wheel[MODE] == mode:
            return False
        wheel[MODE], wheel[ERROR_SUM] = mode, 0.0
        return True


def _speed(wheel: Any) -> Any:
    return wheel[RAW] - wheel[RING + int(wheel[SLOT])]


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
    """One millisecond of both wheels [2, `NUMBERS`]: from MuJoCo's `qpos`, 7 and 8 of which are the axles'
    angles (rad), to the motors' voltages, `ctrl` [2]."""
    for side in range(2):
        wheel, angle = wheels[side], qpos[7 + side]
        wheel[SLIPPED] += wheel[SLIP] * (angle - wheel[ANGLE])
        wheel[ANGLE] = angle
        ctrl[side] = _voltage(wheel, angle + wheel[SLIPPED])
