"""The robot in its arena, a millisecond at a time: what the firmware drives and the camera sees."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from realitygap.errors import ConfigError
from realitygap.twin.arena import check_arena
from realitygap.twin.arithmetic import cos_sin
from realitygap.twin.model import BODY_RADIUS, NOMINAL_VOLT, build_xml
from realitygap.twin.noise import CREEP_MS, Creep, check_scale, draws
from realitygap.twin.sensors import CYCLE_MS, PHASE_MS, Sensors
from realitygap.twin.states import States, heading_of
from realitygap.twin.unit import Unit, draw_unit
from realitygap.twin.wheels import FOUND, STATE, Machine, Wheel, run

__all__ = ["TwinBody"]

RECORD_MS = 10
"""A state is kept for the camera this often."""
HISTORY_MS = 21
KEPT = np.isin(np.arange(CYCLE_MS), PHASE_MS)
"""A sensor's reading is at most 20 ms old; the pose is kept when one is refreshed."""
TOUCH = 1e-4
"""A hand sets the robot down this exactly (m)."""


class TwinBody:
    """One unit in one arena. Same unit, seed, arena and calls: the same bits.

    Args:
        arena: size_cm, cylinders, walls, lamps, in cm.
        unit: which robot of the population.
        noise: the twin's noise scale, 1 for the size that real robots have.
        seed: names the noise of this stay in the arena.
        substeps: steps of the physics in a millisecond.
    """

    def __init__(
        self, arena: Mapping[str, Any], *, unit: int, noise: float = 1.0, seed: int = 0, substeps: int = 1
    ) -> None:
        self.arena = check_arena(arena)
        self.unit: Unit = draw_unit(unit)
        self.noise = check_scale(noise)
        self.seed = seed
        self.leds = [0, 0]
        self.time_ms = 0
        name = int(draws(unit, seed, 17).integers(2**62))
        self._sensors = Sensors(self.arena, self.unit, noise=self.noise, seed=name)
        self._creep = Creep(name, self.noise, self.unit.axle_phase)
        self._model = mujoco.MjModel.from_xml_string(
            build_xml(self.arena, self.unit, timestep=0.001 / substeps)
        )
        self._data = mujoco.MjData(self._model)
        self._qpos = self._data.qpos
        self._states: list[tuple[int, NDArray[np.float64]]] = []
        self._turned = np.zeros((3, 2))
        self._history = np.zeros((HISTORY_MS, 7))
        wheels = np.zeros(2, STATE).view(np.recarray)
        self._wheels = Wheel(NOMINAL_VOLT, wheels[0]), Wheel(NOMINAL_VOLT, wheels[1])
        model, data = (self._model._address, self._data._address) if FOUND else (self._model, self._data)
        self._machine = Machine(
            model, data, substeps, self._qpos, self._data.ctrl, wheels, self._turned, self._history, KEPT
        )
        self.place(*self._somewhere(), 0.0)

    # physics

    def advance(self, milliseconds: int) -> None:
        """Let time pass: physics, and the robot's own control of its wheels each millisecond."""
        end = self.time_ms + milliseconds
        while self.time_ms < end:
            into = self.time_ms % CREEP_MS
            if into == 0:
                self._feel_ground()
            part = min(end - self.time_ms, CREEP_MS - into)
            run(self.time_ms + 1, part, self._machine)
            self.time_ms += part
            if self.time_ms % RECORD_MS == 0:
                self._record()

    def _feel_ground(self) -> None:
        x, y = float(self._qpos[0]), float(self._qpos[1])
        w, z = float(self._qpos[3]), float(self._qpos[6])
        half = self.unit.track / 2.0
        dx, dy = -2.0 * w * z * half, (w * w - z * z) * half
        left, right = self._turned[1].tolist()
        self._turned[0] = self._creep.at(0, x + dx, y + dy, left), self._creep.at(1, x - dx, y - dy, right)

    def _record(self) -> None:
        self._states.append((self.time_ms, self._qpos[:7].copy()))

    def _fits(self, x_cm: float, y_cm: float) -> bool:
        w, h = self.arena["size_cm"]
        inside = 0.0 < x_cm < w and 0.0 < y_cm < h
        return inside and self._sensors.clearance(x_cm / 100.0, y_cm / 100.0) >= BODY_RADIUS - TOUCH

    def _somewhere(self) -> tuple[float, float]:
        """The middle of the floor, or the free place nearest to it."""
        w, h = self.arena["size_cm"]
        places = [(w * i / 40, h * j / 40) for i in range(1, 40) for j in range(1, 40)]
        places.sort(key=lambda place: (place[0] - w / 2) ** 2 + (place[1] - h / 2) ** 2)
        for place in places:
            if self._fits(*place):
                return place
        raise ConfigError("arena: nowhere on the floor is room for the robot; leave some free")

    def place(self, x_cm: float, y_cm: float, heading: float) -> None:
        """The experimenter's hand: lift the robot and set it down at rest. Counters keep their values.

        Args:
            x_cm: where its centre goes.
            y_cm: where its centre goes.
            heading: rad, counter-clockwise from +x.

        Raises:
            ConfigError: something else stands there.
        """
        if not self._fits(x_cm, y_cm):
            raise ConfigError(
                f"the robot (radius {BODY_RADIUS * 100:g} cm) finds no room at ({x_cm:g}, {y_cm:g}) cm: "
                "choose a place clear of walls and cylinders"
            )
        data = self._data
        angles = float(data.qpos[7]), float(data.qpos[8])
        mujoco.mj_resetData(self._model, data)
        c, s = cos_sin(heading / 2)
        data.qpos[:7] = (x_cm / 100.0, y_cm / 100.0, 0.0, c, 0, 0, s)
        data.qpos[7:9] = angles
        mujoco.mj_forward(self._model, data)
        self._history[:] = data.qpos[:7]
        self._record()

    # wheels

    def set_speed(self, left: int, right: int) -> None:
        """Hold these speeds (pulses in 10 ms)."""
        self._wheels[0].go(left)
        self._wheels[1].go(right)

    def set_position(self, left: int, right: int) -> None:
        """Drive the counters to these values (pulses)."""
        self._wheels[0].go_to(left)
        self._wheels[1].go_to(right)

    def set_pwm(self, left: int, right: int) -> None:
        """Share of the voltage for each motor, −255 to 255."""
        self._wheels[0].push(left)
        self._wheels[1].push(right)

    def set_speed_gains(self, kp: int, ki: int, kd: int) -> None:
        """Gains of the speed controller."""
        for wheel in self._wheels:
            wheel.set_speed_gains(kp, ki, kd)

    def set_position_gains(self, kp: int, ki: int, kd: int) -> None:
        """Gains of the position controller."""
        for wheel in self._wheels:
            wheel.set_position_gains(kp, ki, kd)

    def set_profile(self, vl: int, al: int, vr: int, ar: int) -> None:
        """Speed and acceleration of the position controller, left and right.

        Args:
            vl, vr: speeds, in the units of command J.
            al, ar: accelerations, in the units of command J.
        """
        self._wheels[0].state.profile, self._wheels[1].state.profile = (vl, al), (vr, ar)

    def pulses(self) -> tuple[int, int]:
        """The position counters."""
        return self._wheels[0].pulses, self._wheels[1].pulses

    def set_pulses(self, left: int, right: int) -> None:
        """Set the position counters."""
        self._wheels[0].pulses, self._wheels[1].pulses = left, right

    def speeds(self) -> tuple[int, int]:
        """Measured speeds, pulses in 10 ms."""
        return self._wheels[0].speed, self._wheels[1].speed

    def on_target(self) -> tuple[bool, bool]:
        """Whether each wheel has what it was asked for."""
        return self._wheels[0].on_target, self._wheels[1].on_target

    # sensors

    def _seen(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """When each sensor was refreshed last, and the poses [8, 3] (x, y in m, heading) of then."""
        refreshed = self._sensors.refreshed(self.time_ms)
        poses = self._history[refreshed % HISTORY_MS]
        return refreshed, np.stack([poses[:, 0], poses[:, 1], heading_of(poses)], axis=1)

    def proximity(self) -> list[int]:
        """Eight counts, 0 to 1023, each as its converter took it 0 to 20 ms ago."""
        return self._sensors.proximity(self.time_ms, *self._seen())

    def ambient(self) -> list[int]:
        """Eight counts, about 480 in the dark and 60 in full light, 0 to 20 ms old."""
        return self._sensors.ambient(self.time_ms, *self._seen())

    def analog(self, n: int) -> int:
        """A free input of the converter: nothing is connected, so it floats near 0."""
        return self._sensors.analog(n, self.time_ms)

    # what only the experimenter and the sealed file know

    def truth(self) -> tuple[float, float, float]:
        """x, y (cm) and heading (rad, −π to π) as they are: for tests and the sealed file only."""
        x, y = self._qpos[:2].tolist()
        return x * 100.0, y * 100.0, float(heading_of(self._qpos))

    def states(self) -> States:
        """Everything recorded so far, a state each 10 ms and at each placing."""
        times = np.array([t for t, _ in self._states], np.int64)
        return States(times, np.array([pose for _, pose in self._states]))
