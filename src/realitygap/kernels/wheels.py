"""The wheels under PID control (§3.2.2), and the arc along which they drive the body."""

from typing import NamedTuple

from realitygap.compiled import step
from realitygap.kernels.params import STEP_S
from realitygap.kernels.rng import sin_cos

MEMORY = 5
"""The integral term is the sum of the proportional terms of the last five steps."""

# A row of `work.wheel`: speed U, last change δv, then the last five P, newest first, then the last target,
# and the wheel's distance (cm/s over a step) from the middle of its play.
SPEED, CHANGE, ERRORS, TARGET, PLAY = 0, 1, 2, 7, 8

FASTEST = 12.7
"""A wheel's largest speed over that of its top command: a Khepera counts speeds up to 127 units."""


@step
def turn_wheel(robot, wheel, target, drag, slip):
    """One step of one wheel towards `target` (cm/s); returns its new speed U (cm/s).

    δv = (Kp·P + Ki·I + Kd·D) / 50000. `drag` multiplies the friction threshold, `slip` is the
    relative error of the achieved speed (both carry the noise).
    """
    for i in range(MEMORY - 1, 0, -1):
        wheel[ERRORS + i] = wheel[ERRORS + i - 1]
    speed = wheel[SPEED]
    # Not in the paper: a share of the command acts a step late.
    asked = target + robot.lag * (wheel[TARGET] - target)
    wheel[TARGET] = target
    proportional = (asked - speed) / STEP_S
    wheel[ERRORS] = proportional
    integral = 0.0
    for i in range(MEMORY):
        integral += wheel[ERRORS + i]
    # Static friction: a resting wheel does not move until the integral term passes a threshold.
    if abs(speed) < robot.rest_speed and abs(integral) <= robot.friction * drag:
        wheel[SPEED] = 0.0
        wheel[CHANGE] = 0.0
        return 0.0
    change = (robot.kp * proportional + robot.ki * integral + robot.kd * wheel[CHANGE]) / robot.divisor
    wheel[CHANGE] = change
    speed = speed + change - take_up_play(robot, wheel, target)
    wheel[SPEED] = speed + slip * speed
    return wheel[SPEED]


@step
def bound_wheel(wheel, fastest):
    """Keep a wheel within ±`fastest` (cm/s), since noise proportional to the speed could accelerate it
    without limit."""
    wheel[SPEED] = min(max(wheel[SPEED], -fastest), fastest)
    wheel[CHANGE] = min(max(wheel[CHANGE], -2.0 * fastest), 2.0 * fastest)


@step
def take_up_play(robot, wheel, target):
    """Speed (cm/s) that a wheel loses in this step on reversal; 0 in the paper.

    Friction reverses with the wheel, and the control needs a moment to respond. The effect is that of play
    between motor and wheel: the same distance is lost at each reversal, with or without rest, and takes
    longer the lower the commanded speed.
    """
    half = robot.half_play
    if half <= 0.0 or target == 0.0:
        return 0.0
    side = 1.0 if target > 0.0 else -1.0
    owed = half - side * wheel[PLAY]
    if owed <= 0.0:
        return 0.0
    room = abs(target) * (1.0 - robot.lag)
    lost = owed * (room / (room + owed))
    wheel[PLAY] += side * lost
    return side * lost


class Arc(NamedTuple):
    """Movement of the body in one step: distance (cm), turn (rad), chord over arc, the mean heading."""

    dx: float
    dy: float
    turn: float
    share: float
    cos_mean: float
    sin_mean: float


@step
def drive_arc(track, left, right, c, s, period=STEP_S):
    """Movement of the body in one step.

    Exact differential drive: a chord of length v·dt·sin(h)/h, h half the turn, at mean heading.
    (c, s) = (cos, sin) of the heading before the step.
    """
    half = (right - left) * (0.5 * period) / track
    sin_half, cos_half = sin_cos(half)
    share = sin_half / half if abs(half) > 1e-6 else 1.0 - half * half / 6.0
    cos_mean = c * cos_half - s * sin_half
    sin_mean = s * cos_half + c * sin_half
    chord = 0.5 * (left + right) * period * share
    return Arc(chord * cos_mean, chord * sin_mean, 2.0 * half, share, cos_mean, sin_mean)
