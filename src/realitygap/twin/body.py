"""The robot in its arena, a millisecond at a time: what the firmware drives and the camera sees."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from realitygap.errors import ConfigError
from realitygap.twin.arena import check_arena
from realitygap.twin.arithmetic import cos_sin
from realitygap.twin.model import BODY_RADIUS, NOMINAL_VOLT, build_xml, mujoco
from realitygap.twin.noise import check_scale, creep_of, draws
from realitygap.twin.sensors import CYCLE_MS, HISTORY_MS, PHASE_MS, Sensors
from realitygap.twin.states import States, heading_of
from realitygap.twin.unit import Unit, draw_unit
from realitygap.twin.wheels import FOUND, RECORD_MS, STATE, Machine, Wheel, note, run

__all__ = ["TwinBody"]

KEPT = np.isin(np.arange(CYCLE_MS), PHASE_MS)
"""The pose is kept when a sensor is refreshed."""
FIRST_STATES = 256
TOUCH = 1e-4
"""A hand sets the robot down this exactly (m)."""


class TwinBody:
    """One unit in one arena. Same unit, seed, arena and calls: the same bits.

    Args:
        arena: size_cm, cylinders, walls, lamps, in cm; maybe reflectance, of the walls and of each cylinder.
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
        creep, self._refill = creep_of(name, self.noise, self.unit.axle_phase)
        self._model = _compiled(build_xml(self.arena, self.unit, timestep=0.001 / substeps))
        self._data = mujoco.MjData(self._model)
        self._qpos = self._data.qpos
        self._history = np.zeros((HISTORY_MS, 7))
        moving = self._qpos, self._data.qvel, self._data.act, self._data.qacc_warmstart
        wheels = np.zeros(2, STATE)
        self._wheels = Wheel(NOMINAL_VOLT, wheels[0]), Wheel(NOMINAL_VOLT, wheels[1])
        self._machine = Machine(
            model=self._model._address if FOUND else self._model,
            data=self._data._address if FOUND else self._data,
            substeps=substeps,
            qpos=self._qpos,
            moving=moving,
            before=tuple(part.copy() for part in moving),
            ctrl=self._data.ctrl,
            wheels=wheels.view(np.recarray),
            stood=np.zeros(1, np.int64),
            turned=np.zeros((3, 2)),
            creep=creep,
            half=self.unit.track / 2.0,
            kept=KEPT,
            history=self._history,
            states=np.empty((FIRST_STATES, 8)),
            recorded=np.zeros(1, np.int64),
        )
        self.place(*self._somewhere(), 0.0)

    # physics

    def advance(self, milliseconds: int) -> None:
        """Let time pass: physics, and the robot's own control of its wheels each millisecond."""
        end = self.time_ms + milliseconds
        self._make_room(milliseconds // RECORD_MS + 1)
        while self.time_ms < end:
            passed = run(self.time_ms + 1, end - self.time_ms, self._machine)
            self.time_ms += passed
            if passed == 0:
                self._refill()

    def _make_room(self, more: int) -> None:
        """For so many states more."""
        kept = self._machine.states
        if self._machine.recorded[0] + more > len(kept):
            grown = np.concatenate([kept, np.empty((max(len(kept), more), 8))])
            self._machine = self._machine._replace(states=grown)

    def _fits(self, x_cm: float, y_cm: float) -> bool:
        w, h = self.arena["size_cm"]
        inside = 0.0 < x_cm < w and 0.0 < y_cm < h
        return inside and self._sensors.clearance(x_cm / 100.0, y_cm / 100.0) >= BODY_RADIUS - TOUCH

    def _somewhere(self) -> tuple[float, float]:
        """The middle of the floor, or the free place nearest to it."""
        for place in _from_the_middle(*self.arena["size_cm"]):
            if self._fits(*place):
                return place
        raise ConfigError("arena: no room for the robot on the floor; leave some free")

    def place(self, x_cm: float, y_cm: float, heading: float) -> None:
        """The experimenter's hand: lift the robot and set it down at rest, its centre at x, y, with a heading
        (rad, counter-clockwise from +x). Counters keep their values.

        Raises:
            ConfigError: something else stands there.
        """
        if not self._fits(x_cm, y_cm):
            raise ConfigError(
                f"the robot (radius {BODY_RADIUS * 100:g} cm) does not fit at ({x_cm:g}, {y_cm:g}) cm: "
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
        self._machine.stood[0] = 0
        self._make_room(1)
        note(self.time_ms, self._machine)

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
        """How fast the position controller drives, in the units of command J.

        Args:
            vl, vr: speeds.
            al, ar: accelerations.
        """
        self._wheels[0].set_profile(vl, al)
        self._wheels[1].set_profile(vr, ar)

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

    def proximity(self) -> list[int]:
        """Eight counts, 0 to 1023, each as its converter took it 0 to 20 ms ago."""
        return self._sensors.proximity(self.time_ms, self._history)

    def ambient(self) -> list[int]:
        """Eight counts, about 480 in the dark and 60 in full light, 0 to 20 ms old."""
        return self._sensors.ambient(self.time_ms, self._history)

    def analog(self, n: int) -> int:
        """A free input of the converter: nothing is connected, so it floats near 0."""
        return self._sensors.analog(n, self.time_ms)

    # what only the experimenter and the sealed file know

    def truth(self) -> tuple[float, float, float]:
        """x, y (cm) and heading (rad, −π to π) as they are: for tests and the sealed file only."""
        x, y = self._qpos[:2].tolist()
        return x * 100.0, y * 100.0, heading_of(self._qpos)

    def states(self) -> States:
        """Everything recorded so far, a state each 10 ms and at each placing."""
        kept = self._machine.states[: self._machine.recorded[0]]
        return States(kept[:, 0].astype(np.int64), kept[:, 1:].copy())


@lru_cache(maxsize=4)
def _from_the_middle(w: float, h: float) -> list[tuple[float, float]]:
    """Places on a floor, cm, the middle first."""
    places = [(w * i / 40, h * j / 40) for i in range(1, 40) for j in range(1, 40)]
    return sorted(places, key=lambda place: (place[0] - w / 2) ** 2 + (place[1] - h / 2) ** 2)


@lru_cache(maxsize=4)
def _compiled(xml: str) -> Any:
    """MuJoCo's model, which nothing changes: one robot after another of a unit has the same."""
    return mujoco.MjModel.from_xml_string(xml)
