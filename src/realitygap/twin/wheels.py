"""The robot's own control of its wheels, a thousand times a second (K-Team, Khepera user manual).

A wheel counts its encoder's pulses and turns a wanted speed or place into a voltage. Units are the
robot's: pulses, and pulses in 10 ms for speeds. The millisecond's loop, with MuJoCo's step in it, is
compiled where MuJoCo's library is found, and runs as it stands here, with the same bits, where it is not.
"""

import ctypes
import math
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding
import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from realitygap.twin.arithmetic import jit
from realitygap.twin.model import mujoco
from realitygap.twin.noise import CREEP_MS, Creep, creep_at

__all__ = ["FOUND", "RECORD_MS", "STATE", "Machine", "Wheel", "note", "run"]

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
RECORD_MS = 10
"""A state is kept for the camera this often."""
SETTLED_MS = 300
"""A robot set down and only told to stand rests then; else it would wander, 6 µm in 3 s at most."""
THROWN, AGAIN, ASIDE_M = 1.5, 5, 1e-9
"""The speed (m/s) of none but a thrown robot; tries of such a millisecond, and how far aside the first is."""
ARRIVED = 3
"""Within 3 pulses (0.25 mm) of its target a wheel is there."""

SPEED, POSITION, PWM = 0, 1, 2
STATE = np.dtype(
    [(name, np.int64) for name in ("mode", "raw", "offset", "slot", "target", "pwm")]
    + [("ring", np.int64, WINDOW_MS), ("profile", np.int64, 2), ("speed_volts", float, 3)]
    + [("position_volts", float, 3)]
    + [(name, float) for name in ("volt", "wanted", "error_sum", "error_last", "reference", "pace")]
)
"""A wheel's numbers, where compiled code finds them."""


class Wheel:
    """One wheel's encoder, targets and controller: `state` is one of an array of `STATE`, zeros at first."""

    def __init__(self, volt: float, state: Any) -> None:
        self._state = state
        self.set_volt(volt)
        self.set_profile(*PROFILE)
        self.set_speed_gains(*SPEED_GAINS)
        self.set_position_gains(*POSITION_GAINS)

    def set_volt(self, volt: float) -> None:
        """What its motor gets at most."""
        self._state["volt"] = volt

    def set_profile(self, speed: int, acceleration: int) -> None:
        """How fast the position controller drives."""
        self._state["profile"] = speed, acceleration

    def set_speed_gains(self, *gains: int) -> None:
        """Kp, Ki and Kd."""
        self._state["speed_volts"] = np.multiply(gains, SPEED_SCALE)

    def set_position_gains(self, *gains: int) -> None:
        """Kp, Ki and Kd."""
        self._state["position_volts"] = np.multiply(gains, POSITION_SCALE)

    @property
    def pulses(self) -> int:
        """The position counter."""
        return int(self._state["raw"] + self._state["offset"])

    @pulses.setter
    def pulses(self, value: int) -> None:
        moved = value - self.pulses
        for name in ("offset", "target", "reference"):
            self._state[name] += moved

    @property
    def speed(self) -> int:
        """Pulses in the last 10 ms."""
        return int(self._state["raw"] - self._state["ring"][self._state["slot"]])

    @property
    def error(self) -> int:
        """What is missing to the wanted speed or place."""
        if self._state["mode"] == POSITION:
            return int(self._state["target"]) - self.pulses
        return round(float(self._state["wanted"])) - self.speed if self._state["mode"] == SPEED else 0

    @property
    def on_target(self) -> bool:
        """Whether the wanted place, or the wanted speed within one pulse, is reached."""
        return abs(self.error) <= (ARRIVED if self._state["mode"] == POSITION else 1)

    def go(self, speed: int) -> None:
        """Hold a speed from now on (cut to what the robot can be asked for)."""
        if self._state["mode"] != SPEED:
            self._state["error_sum"] = 0.0
        self._state["mode"] = SPEED
        self._state["wanted"] = max(-MAX_SPEED, min(MAX_SPEED, speed))

    def go_to(self, place: int) -> None:
        """Drive to a place and hold it, by the profile's speed and acceleration."""
        if self._state["mode"] != POSITION:
            self._state["error_sum"] = 0.0
            self._state["reference"], self._state["pace"] = self.pulses, self.speed
        self._state["mode"], self._state["target"] = POSITION, place

    def push(self, pwm: int) -> None:
        """Let the motor have a share of the voltage, −255 to 255, uncontrolled."""
        self._state["mode"], self._state["pwm"] = PWM, max(-MAX_PWM, min(MAX_PWM, pwm))


@jit
def _pid(wheel: Any, volts: Any, error: float) -> Any:
    total = wheel.error_sum + error
    volt = volts[0] * error + volts[1] * total + volts[2] * (error - wheel.error_last)
    wheel.error_last = error
    if -wheel.volt < volt < wheel.volt:
        wheel.error_sum = total
        return volt
    return math.copysign(wheel.volt, volt)  # saturated: the sum waits


@jit
def _follow_profile(wheel: Any) -> Any:
    """Where the wheel should be by now: fast, but never too fast to stop in time."""
    fastest, quickest = float(wheel.profile[0]), wheel.profile[1] / 256.0  # per 10 ms, per 10 ms·ms
    way = wheel.target - wheel.reference
    wanted = math.copysign(min(fastest, math.sqrt(0.2 * quickest * 10.0 * abs(way))), way)
    wheel.pace += max(-quickest, min(quickest, wanted - wheel.pace))
    step = wheel.pace / 10.0
    if abs(way) <= max(abs(step), 0.5):
        wheel.reference, wheel.pace = float(wheel.target), 0.0
    else:
        wheel.reference += step
    return wheel.reference


@jit
def _voltage(wheel: Any, angle: float) -> Any:
    """One millisecond: count the pulses up to `angle` (rad) and say what the motor gets (V)."""
    wheel.ring[wheel.slot] = wheel.raw
    wheel.slot = (wheel.slot + 1) % WINDOW_MS
    wheel.raw = math.floor(angle * PULSES_PER_RADIAN)
    if wheel.mode == SPEED:
        return _pid(wheel, wheel.speed_volts, wheel.wanted - (wheel.raw - wheel.ring[wheel.slot]))
    if wheel.mode == POSITION:
        return _pid(wheel, wheel.position_volts, _follow_profile(wheel) - (wheel.raw + wheel.offset))
    return wheel.volt * wheel.pwm / MAX_PWM


class Machine(NamedTuple):
    """What a millisecond needs: MuJoCo's model and data (their addresses where `FOUND`) and views of it.

    moving: qpos, qvel, act and qacc_warmstart, and `before` as they were; wheels [2] records; stood [1]: ms
    since the robot was set down, as long as it is only told to stand, else −1; turned [3, 2] creep, last
    angle, slip; half: of the track (m); history: the poses kept of each `kept` millisecond; states [n, 8]:
    time and pose, `recorded` [1] of them so far.
    """

    model: Any
    data: Any
    substeps: int
    qpos: NDArray[np.float64]
    moving: tuple[NDArray[np.float64], ...]
    before: tuple[NDArray[np.float64], ...]
    ctrl: NDArray[np.float64]
    wheels: Any
    stood: NDArray[np.int64]
    turned: NDArray[np.float64]
    creep: Creep
    half: float
    kept: NDArray[np.bool_]
    history: NDArray[np.float64]
    states: NDArray[np.float64]
    recorded: NDArray[np.int64]


def _step_is_found() -> bool:
    """Let compiled code find MuJoCo's own `mj_step`, which then takes no time of its parts."""
    if numba.config.DISABLE_JIT:
        return False
    for library in Path(mujoco.__file__).parent.glob("libmujoco*"):
        with suppress(RuntimeError):
            llvmlite.binding.load_library_permanently(str(library))
    if timer := llvmlite.binding.address_of_symbol("mjcb_time"):
        ctypes.c_void_p.from_address(timer).value = None  # a tenth of a step's time
    return llvmlite.binding.address_of_symbol("mj_step") is not None


FOUND = _step_is_found()
_step: Any = types.ExternalFunction("mj_step", types.void(types.uintp, types.uintp))


@jit
def _feel_ground(machine: Any) -> None:
    """Bring both wheels' creep up to date, where they stand."""
    x, y, w, z = machine.qpos[0], machine.qpos[1], machine.qpos[3], machine.qpos[6]
    dx, dy = -2.0 * w * z * machine.half, (w * w - z * z) * machine.half
    for side in range(2):
        angle = machine.turned[1, side]
        machine.turned[0, side] = creep_at(machine.creep, side, x + dx, y + dy, angle)
        dx, dy = -dx, -dy


@jit
def note(now: int, machine: Any) -> None:
    """Keep where the robot is, for the camera."""
    row = machine.recorded[0]
    machine.states[row, 0] = now
    for k in range(7):
        machine.states[row, 1 + k] = machine.qpos[k]
    machine.recorded[0] = row + 1


@jit
def _stands(machine: Any) -> Any:
    """Count a millisecond's standing; whether the robot has come to rest, so that its physics may wait."""
    for side in range(2):
        if machine.wheels[side].mode != SPEED or machine.wheels[side].wanted != 0.0:
            machine.stood[0] = -1
    machine.stood[0] += machine.stood[0] >= 0
    return machine.stood[0] > SETTLED_MS


@jit
def _copy(parts: Any, into: Any) -> None:
    for part, other in zip(parts, into):  # noqa: B905 (Numba's has no `strict`)
        for k in range(part.shape[0]):
            other[k] = part[k]


@jit
def _move(machine: Any) -> None:
    """Let MuJoCo step; again from a little aside if that threw the robot: it finds now and then that one of
    two cylinders that touch is centimetres deep in the other (4.0.1; in two of 72 drives of 12 s)."""
    _copy(machine.moving, machine.before)
    for k in range(1 + AGAIN):
        for _ in range(machine.substeps):
            _step(machine.model, machine.data)
        speed = machine.moving[1]
        if speed[0] * speed[0] + speed[1] * speed[1] + speed[2] * speed[2] < THROWN * THROWN:
            break
        _copy(machine.before, machine.moving)
        machine.qpos[0] += ASIDE_M * 10.0**k


def _run(first: int, count: int, machine: Machine) -> int:
    """Let `count` milliseconds pass, the first of them this one.

    Returns:
        How many have passed: fewer if the creep needs new draws.
    """
    for now in range(first, first + count):
        if (now - 1) % CREEP_MS == 0:
            if machine.creep.left[0] == 0 and machine.creep.noise:
                return now - first
            _feel_ground(machine)
        for side in range(2):
            angle = machine.qpos[7 + side]
            machine.turned[2, side] += machine.turned[0, side] * (angle - machine.turned[1, side])
            machine.turned[1, side] = angle
            machine.ctrl[side] = _voltage(machine.wheels[side], angle + machine.turned[2, side])
        if not _stands(machine):
            _move(machine)
        if machine.kept[now % machine.kept.shape[0]]:
            for k in range(7):
                machine.history[now % machine.history.shape[0], k] = machine.qpos[k]
        if now % RECORD_MS == 0:
            note(now, machine)
    return count


if FOUND:
    run = jit(_run)
else:
    run, _step = _run, mujoco.mj_step
