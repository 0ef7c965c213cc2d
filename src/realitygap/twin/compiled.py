"""The body's millisecond loop, compiled: for a twin that drives many trials.

`realitygap.twin.body` and `realitygap.twin.wheels` have the same loop in Python and are its judge: the
same arithmetic in the same order gives the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import llvmlite.binding
import mujoco
import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from realitygap.twin.arithmetic import jit
from realitygap.twin.body import REFRESHED_MS, TwinBody
from realitygap.twin.model import NOMINAL_VOLT
from realitygap.twin.sensors import CYCLE_MS
from realitygap.twin.wheels import MAX_PWM, PULSES_PER_RADIAN, WINDOW_MS, Wheel

__all__ = ["CompiledBody", "body_for_many"]

MODES = ("speed", "position", "pwm")
SPEED, POSITION = 0, 1

MODE, RAW, OFFSET, SLOT, TARGET, PWM, FASTEST, QUICKEST, FULL_PWM, RING = range(10)
"""Where a wheel's whole numbers are; the ring of counts takes the rest."""
WANTED, ERROR_SUM, ERROR_LAST, REFERENCE, PACE, VOLT, PULSES, SPEED_VOLTS = range(8)
"""Where its other numbers are; the gains are three each."""
POSITION_VOLTS = SPEED_VOLTS + 3
REALS = POSITION_VOLTS + 3


_step = types.ExternalFunction("mj_step", types.void(types.uintp, types.uintp))


@jit
def _pid(real: Any, gains: int, error: float) -> Any:
    """`Wheel._pid`."""
    total = real[ERROR_SUM] + error
    volt = real[gains] * error + real[gains + 1] * total + real[gains + 2] * (error - real[ERROR_LAST])
    real[ERROR_LAST] = error
    if -real[VOLT] < volt < real[VOLT]:
        real[ERROR_SUM] = total
        return volt
    return math.copysign(real[VOLT], volt)


@jit
def _follow_profile(whole: Any, real: Any) -> Any:
    """`Wheel._follow_profile`."""
    fastest, quickest = float(whole[FASTEST]), whole[QUICKEST] / 256.0
    way = whole[TARGET] - real[REFERENCE]
    wanted = math.copysign(min(fastest, math.sqrt(0.2 * quickest * 10.0 * abs(way))), way)
    real[PACE] += max(-quickest, min(quickest, wanted - real[PACE]))
    step = real[PACE] / 10.0
    if abs(way) <= max(abs(step), 0.5):
        real[REFERENCE], real[PACE] = float(whole[TARGET]), 0.0
    else:
        real[REFERENCE] += step
    return real[REFERENCE]


@jit
def _voltage(whole: Any, real: Any, angle: float) -> Any:
    """`Wheel.voltage`."""
    slot = whole[SLOT]
    whole[RING + slot] = whole[RAW]
    whole[SLOT] = slot = (slot + 1) % (whole.shape[0] - RING)
    whole[RAW] = raw = math.floor(angle * real[PULSES])
    if whole[MODE] == SPEED:
        return _pid(real, SPEED_VOLTS, real[WANTED] - (raw - whole[RING + slot]))
    if whole[MODE] == POSITION:
        return _pid(real, POSITION_VOLTS, _follow_profile(whole, real) - (raw + whole[OFFSET]))
    return real[VOLT] * whole[PWM] / whole[FULL_PWM]


@jit
def _run(
    first: int, count: int, model: int, data: int, substeps: int, qpos: Any, ctrl: Any, whole: Any,
    real: Any, turned: Any, history: Any, kept: Any,
) -> None:  # fmt: skip
    """`TwinBody._run` for `count` milliseconds from `first` on."""
    for now in range(first, first + count):
        for side in range(2):
            angle = qpos[7 + side]
            turned[2, side] += turned[0, side] * (angle - turned[1, side])
            turned[1, side] = angle
            ctrl[side] = _voltage(whole[side], real[side], angle + turned[2, side])
        for _ in range(substeps):
            _step(model, data)
        if kept[now % kept.shape[0]]:
            history[now % history.shape[0]] = qpos[:7]


def _cell(name: str, place: int, kind: type) -> property:
    """An attribute that is kept in one of a wheel's arrays."""

    def get(self: CompiledWheel) -> Any:
        return kind(getattr(self, name)[place])

    def put(self: CompiledWheel, value: Any) -> None:
        getattr(self, name)[place] = value

    return property(get, put)


def _cells(name: str, first: int, count: int) -> property:
    """Several of them."""

    def get(self: CompiledWheel) -> Any:
        return getattr(self, name).data[first : first + count]

    def put(self: CompiledWheel, values: Any) -> None:
        getattr(self, name)[first : first + count] = values

    return property(get, put)


class CompiledWheel(Wheel):
    """A wheel whose numbers are where compiled code finds them."""

    def __init__(self, nominal_volt: float, whole: NDArray[np.int64], real: NDArray[np.float64]) -> None:
        self.whole, self.real = whole, real
        super().__init__(nominal_volt)
        self.whole[FULL_PWM], self.real[PULSES] = MAX_PWM, PULSES_PER_RADIAN

    @property
    def _mode(self) -> str:
        return MODES[self.whole[MODE]]

    @_mode.setter
    def _mode(self, mode: str) -> None:
        self.whole[MODE] = MODES.index(mode)

    _raw, _offset, _slot = (_cell("whole", k, int) for k in (RAW, OFFSET, SLOT))
    _target, _pwm = _cell("whole", TARGET, int), _cell("whole", PWM, int)
    profile, _ring = _cells("whole", FASTEST, 2), _cells("whole", RING, WINDOW_MS)
    _wanted, _reference, _pace = (_cell("real", k, float) for k in (WANTED, REFERENCE, PACE))
    _error_sum, _error_last = _cell("real", ERROR_SUM, float), _cell("real", ERROR_LAST, float)
    _volt = _cell("real", VOLT, float)
    _speed_volts, _position_volts = _cells("real", SPEED_VOLTS, 3), _cells("real", POSITION_VOLTS, 3)


class CompiledBody(TwinBody):
    """`TwinBody` to the last bit; it needs `body_for_many`, which looks whether it can work."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self._kept = np.isin(np.arange(CYCLE_MS), list(REFRESHED_MS))
        self._parts = (
            self._model._address, self._data._address, self._substeps, self._qpos, self._ctrl, self._whole,
            self._real, self._turned, self._history, self._kept,
        )  # fmt: skip

    def _two_wheels(self) -> tuple[Wheel, Wheel]:
        self._whole, self._real = np.zeros((2, RING + WINDOW_MS), np.int64), np.zeros((2, REALS))
        left, right = (
            CompiledWheel(NOMINAL_VOLT, *rows) for rows in zip(self._whole, self._real, strict=True)
        )
        return left, right

    def _run(self, milliseconds: int) -> None:
        _run(self.time_ms + 1, milliseconds, *self._parts)
        self.time_ms += milliseconds


def body_for_many(arena: Mapping[str, Any], **settings: Any) -> TwinBody:
    """A body as `TwinBody` makes it: the compiled one, or the plain one where nothing can be compiled."""
    return (CompiledBody if _step_is_found() else TwinBody)(arena, **settings)


def _step_is_found() -> bool:
    """Let compiled code find MuJoCo's own `mj_step`."""
    if numba.config.DISABLE_JIT:
        return False
    for library in Path(mujoco.__file__).parent.glob("libmujoco*"):
        with suppress(RuntimeError):
            llvmlite.binding.load_library_permanently(str(library))
    return llvmlite.binding.address_of_symbol("mj_step") is not None
