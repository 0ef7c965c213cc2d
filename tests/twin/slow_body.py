"""The twin in plain Python, all of MuJoCo's stages on: the judge of the compiled one."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from realitygap.twin.body import TwinBody
from realitygap.twin.model import NOMINAL_VOLT
from realitygap.twin.noise import CREEP_MS, draws
from realitygap.twin.sensors import CYCLE_MS, HISTORY_MS, PHASE_MS
from realitygap.twin.states import heading_of
from realitygap.twin.wheels import (
    AGAIN,
    ARRIVED,
    ASIDE_M,
    MAX_PWM,
    MAX_SPEED,
    POSITION_GAINS,
    POSITION_SCALE,
    PROFILE,
    PULSES_PER_RADIAN,
    SETTLED_MS,
    SPEED_GAINS,
    SPEED_SCALE,
    THROWN,
    WINDOW_MS,
    note,
)
from tests.twin.slow_sensors import SlowCreep, SlowSensors


class SlowBody(TwinBody):
    """A `TwinBody` with slow wheels, creep and sensors, in which MuJoCo is stepped from Python."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self._substeps = settings.get("substeps", 1)
        self._wheels = SlowWheel(NOMINAL_VOLT), SlowWheel(NOMINAL_VOLT)  # type: ignore[assignment]
        self._model.opt.disableflags = 0
        name = int(draws(self.unit.number, self.seed, 17).integers(2**62))
        self._creep = SlowCreep(name, self.noise, self.unit.axle_phase)
        self._eyes = SlowSensors(self.arena, self.unit, noise=self.noise, seed=name)

    def place(self, x_cm: float, y_cm: float, heading: float) -> None:
        super().place(x_cm, y_cm, heading)
        self._set_down: int | None = self.time_ms  # None: it has been told to turn since

    def advance(self, milliseconds: int) -> None:
        self._make_room(milliseconds)
        for now in range(self.time_ms + 1, self.time_ms + milliseconds + 1):
            if self.time_ms % CREEP_MS == 0:
                self._feel_ground()
            creeps, last, slipped = self._machine.turned
            for side, wheel in enumerate(self._wheels):
                angle = float(self._qpos[7 + side])
                slipped[side] += creeps[side] * (angle - last[side])
                last[side] = angle
                self._data.ctrl[side] = wheel.voltage(float(angle + slipped[side]))  # type: ignore[attr-defined]
            if not all(wheel.told_to_stand for wheel in self._wheels):  # type: ignore[attr-defined]
                self._set_down = None
            if self._set_down is None or now <= self._set_down + SETTLED_MS:
                self._move()
            self.time_ms = now
            if now % CYCLE_MS in PHASE_MS:
                self._history[now % HISTORY_MS] = self._qpos[:7]
            if now % 10 == 0:
                note(now, self._machine)

    def _move(self) -> None:
        data = self._data
        parts = data.qpos, data.qvel, data.act, data.qacc_warmstart
        before = [part.copy() for part in parts]
        for aside in (0.0, *(ASIDE_M * 10.0**k for k in range(AGAIN))):
            for part, was in zip(parts, before, strict=True):
                part[:] = was
            data.qpos[0] += aside
            mujoco.mj_step(self._model, data, self._substeps)
            if math.hypot(*data.qvel[:3]) < THROWN:
                return
        raise AssertionError("thrown from wherever it begins")

    def _feel_ground(self) -> None:
        (x, y), (w, z) = self._qpos[:2].tolist(), self._qpos[[3, 6]].tolist()
        half = self.unit.track / 2.0
        dx, dy = -2.0 * w * z * half, (w * w - z * z) * half
        turned = self._machine.turned
        left, right = turned[1].tolist()
        turned[0] = self._creep.at(0, x + dx, y + dy, left), self._creep.at(1, x - dx, y - dy, right)

    def _seen(self) -> tuple[Any, Any]:
        """When each sensor was refreshed last, and the poses [8, 3] (x, y in m, heading) of then."""
        refreshed = self._eyes.refreshed(self.time_ms)
        poses = self._history[refreshed % HISTORY_MS]
        return refreshed, np.stack([poses[:, 0], poses[:, 1], [heading_of(pose) for pose in poses]], axis=1)

    def proximity(self) -> list[int]:
        return self._eyes.proximity(self.time_ms, *self._seen())

    def ambient(self) -> list[int]:
        return self._eyes.ambient(self.time_ms, *self._seen())


class SlowWheel:
    """`realitygap.twin.wheels` in plain Python."""

    def __init__(self, nominal_volt: float) -> None:
        self._volt = nominal_volt
        self.set_speed_gains(*SPEED_GAINS)
        self.set_position_gains(*POSITION_GAINS)
        self.set_profile(*PROFILE)
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

    def set_profile(self, *profile: int) -> None:
        self.profile = profile

    def set_speed_gains(self, *gains: int) -> None:
        self._speed_volts = tuple(g * s for g, s in zip(gains, SPEED_SCALE, strict=True))

    def set_position_gains(self, *gains: int) -> None:
        self._position_volts = tuple(g * s for g, s in zip(gains, POSITION_SCALE, strict=True))

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
    def told_to_stand(self) -> bool:
        """Whether it holds the speed 0."""
        return self._mode == "speed" and self._wanted == 0

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

    def _pid(self, error: float, volts: tuple[float, ...]) -> float:
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
