"""The robot in its arena, a millisecond at a time: what the firmware drives and the camera sees.

First MuJoCo's model of both (SI units), then the body.
"""

import ctypes
import math
import os
from collections.abc import Mapping
from functools import lru_cache
from itertools import count
from typing import Any

try:
    import mujoco
except Exception:  # MUJOCO_GL names what does not work here: that concerns a renderer alone
    _named = os.environ.get("MUJOCO_GL", "")
    os.environ["MUJOCO_GL"] = "disable"
    import mujoco

    os.environ["MUJOCO_GL"] = _named

import numpy as np

from realitygap.errors import ConfigError
from realitygap.twin.noise import SLIP_MS, Slip, check_scale, draws
from realitygap.twin.sensors import CYCLE_MS, HISTORY_MS, PHASE_MS, Sensors
from realitygap.twin.unit import (
    BODY_RADIUS,
    BODY_TOP,
    WALL_HALF,
    WALL_HEIGHT,
    Unit,
    draw_unit,
    plain_arena,
)
from realitygap.twin.wheels import ANGLE, SLIP, Wheels, control

__all__ = ["NOMINAL_VOLT", "TwinBody", "build_xml", "mujoco"]

if mujoco.get_mjcb_time() is None:
    # Its timers, which nobody reads, took a fifteenth of each step: now their clock stands still.
    mujoco.set_mjcb_time(ctypes.CFUNCTYPE(ctypes.c_double)(("PyFloat_GetMin", ctypes.pythonapi)))

BODY_MASS = 0.070  # the same: about 70 g
CLEARANCE = 0.00015
"""Casters end 0.15 mm above the floor (the robot leans 0.4°): at 1.3 mm a prototype leaned by 3.4°."""
CASTER_X = 0.021
CASTER_RADIUS = 0.002
WHEEL_MASS = 0.002
WHEEL_HALF_WIDTH = 0.0015

NOMINAL_VOLT = 5.0
STALL_TORQUE = 0.006  # N·m at the wheel: twice what makes the tyres slip
NO_LOAD_SPEED = 150.0  # rad/s: 1.2 m/s, just above the 127 pulses in 10 ms that can be commanded
ROTOR = 1.0e-6  # kg·m², seen through a gear of 25 to 1
LUGRE = "0.06 0.0004 0.00012 0.00016 1.0"
"""Bearing friction (Canudas de Wit et al. 1995): stiffness, damping, Coulomb, static, Stribeck."""

CONTACT = 'solref="0.002 1" solimp="0.95 0.995 0.00005"'
"""Stiff: a quarter of a millimetre of penetration at 200 mm/s."""


def _arena(arena: Mapping[str, Any]) -> str:
    """Floor, walls, partitions, cylinders and lamps."""
    w, h = (v / 100.0 for v in arena["size_cm"])
    z = WALL_HEIGHT / 2
    number = count()

    def solid(kind: str, rest: str) -> str:
        name = f'name="solid {next(number)}" type="{kind}"'
        return f'<geom {name} material="wall" {rest}/>'

    rows = [
        f'<geom name="floor" type="plane" pos="{w / 2} {h / 2} 0" size="{w / 2 + 0.3} {h / 2 + 0.3} 0.1" '
        f'material="floor"/>'
    ]
    sides = ((w / 2, -0.005, w / 2 + 0.01, 0.005), (w / 2, h + 0.005, w / 2 + 0.01, 0.005),
             (-0.005, h / 2, 0.005, h / 2), (w + 0.005, h / 2, 0.005, h / 2))  # fmt: skip
    rows += [solid("box", f'pos="{x} {y} {z}" size="{a} {b} {z}"') for x, y, a, b in sides]
    for x0, y0, x1, y1 in ([v / 100.0 for v in wall] for wall in arena["walls"]):
        half = math.hypot(x1 - x0, y1 - y0) / 2 + WALL_HALF
        angle = math.atan2(y1 - y0, x1 - x0)
        place = f'pos="{(x0 + x1) / 2} {(y0 + y1) / 2} {z}" euler="0 0 {angle}"'
        rows.append(solid("box", f'{place} size="{half} {WALL_HALF} {z}"'))
    for x, y, r in ([v / 100.0 for v in cylinder] for cylinder in arena["cylinders"]):
        rows.append(solid("cylinder", f'pos="{x} {y} {z}" size="{r} {z}"'))
    for x, y in ([v / 100.0 for v in lamp] for lamp in arena["lamps"]):
        rows.append(f'<geom type="sphere" pos="{x} {y} 0.05" size="0.008" rgba="1 1 0.8 1" group="2"/>')
    return "\n    ".join(rows)


def _wheel(side: str, y: float, unit: Unit, radius: float) -> str:
    return f"""
      <body name="{side}" pos="0 {y} {radius}">
        <joint name="{side}" type="hinge" axis="0 1 0" armature="{ROTOR}"/>
        <geom name="{side}" type="ellipsoid" size="{radius} {WHEEL_HALF_WIDTH} {radius}" mass="{WHEEL_MASS}"
              material="tyre"/>
      </body>"""


def _robot(unit: Unit) -> str:
    bottom = 0.0035
    half = (BODY_TOP - bottom) / 2
    mass = BODY_MASS - 2 * WHEEL_MASS
    left, right = unit.wheel_radius
    caster = f'type="sphere" size="{CASTER_RADIUS}" mass="0" group="1" rgba="0.3 0.3 0.3 1"'
    z = CLEARANCE + CASTER_RADIUS
    inertia = f"{mass * (3 * BODY_RADIUS**2 + 4 * half**2) / 12}"
    return f"""
    <body name="robot" pos="0 0 0">
      <freejoint name="robot"/>
      <inertial pos="0 0 0.012" mass="{mass}" diaginertia="{inertia} {inertia} {mass * BODY_RADIUS**2 / 2}"/>
      <geom name="body" type="cylinder" pos="0 0 {bottom + half}" size="{BODY_RADIUS} {half}" group="1"
            material="body"/>
      <geom name="bumper" type="sphere" pos="0 0 {bottom + half}" size="{BODY_RADIUS}" mass="0" group="3"/>
      <geom {caster} name="front" pos="{CASTER_X} 0 {z}"/>
      <geom {caster} name="back" pos="{-CASTER_X} 0 {z}"/>
      {{disk}}{_wheel("left", unit.track / 2, unit, left)}
      {_wheel("right", -unit.track / 2, unit, right)}
    </body>"""


def _pairs(arena: Mapping[str, Any], unit: Unit) -> str:
    """What can touch, and its friction.

    The body's side is a sphere as wide as it, whose contacts with boxes and cylinders MuJoCo has in closed
    form; where two cylinders touch it throws the robot now and then (4.0.1).
    """
    solids = 4 + len(arena["walls"]) + len(arena["cylinders"])
    touching = [("floor", "front", 0.08), ("floor", "back", 0.08)]
    touching += [(f"solid {k}", "bumper", 0.3) for k in range(solids)]
    touching += [("floor", "left", unit.friction), ("floor", "right", unit.friction)]
    return "\n    ".join(
        f'<pair geom1="{one}" geom2="{other}" friction="{slip} {slip} 0 0 0" {CONTACT}/>'
        for one, other, slip in touching
    )


def build_xml(arena: Mapping[str, Any], unit: Unit, *, timestep: float = 0.001, extra: str = "",
              disk: str = "", visual: str = "") -> str:  # fmt: skip
    """The whole model.

    Args:
        arena, unit: the room in plain numbers, and the robot's sizes.
        timestep: s.
        extra, disk, visual: what goes into the world, onto the robot, and before both.
    """
    motor = (f'nominal="{NOMINAL_VOLT} {STALL_TORQUE} {NO_LOAD_SPEED}" lugre="{LUGRE}" '
             f'ctrllimited="true" ctrlrange="{-NOMINAL_VOLT} {NOMINAL_VOLT}"')  # fmt: skip
    x, y = 9.81 * np.sin(unit.tilt)  # a tilted table is a level one with gravity askew
    return f"""<mujoco model="twin">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{timestep}" integrator="implicitfast" cone="elliptic" impratio="5"
          gravity="{x:.9g} {y:.9g} -9.81">
    <flag island="disable"/>
  </option>
  <visual>{visual or "<quality shadowsize='0'/>"}</visual>
  <asset>
    <material name="floor" rgba="0.78 0.77 0.74 1" specular="0" reflectance="0"/>
    <material name="wall" rgba="0.93 0.92 0.9 1" specular="0"/>
    <material name="body" rgba="0.2 0.22 0.2 1" specular="0"/>
    <material name="tyre" rgba="0.1 0.1 0.1 1" specular="0"/>
  </asset>
  <default>
    <geom contype="0" conaffinity="0"/>
  </default>
  <contact>
    {_pairs(arena, unit)}
  </contact>
  <worldbody>
    {_arena(arena)}
    {extra}{_robot(unit).replace("{disk}", disk)}
  </worldbody>
  <actuator>
    <dcmotor name="left" joint="left" {motor}/>
    <dcmotor name="right" joint="right" {motor}/>
  </actuator>
</mujoco>"""


KEPT = np.isin(np.arange(CYCLE_MS), PHASE_MS).tolist()
"""The pose is kept when a sensor is refreshed."""
SETTLED_MS = 300
"""A robot set down and only told to stand rests then; else it would wander, 6 µm in 3 s at most."""
TOUCH = 1e-4
"""A hand sets the robot down this exactly (m)."""


class TwinBody(Wheels):
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
        super().__init__(NOMINAL_VOLT)
        self.arena = plain_arena(arena)
        self.unit: Unit = draw_unit(unit)
        self.noise = check_scale(noise)
        self.seed = seed
        self.leds = [0, 0]
        self.time_ms = 0
        name = int(draws(unit, seed, 17).integers(2**62))
        self._sensors = Sensors(self.arena, self.unit, noise=self.noise, seed=name)
        self._slip = Slip(name, self.noise, self.unit.axle_phase, self.unit.track / 2.0)
        self._model = _compiled(build_xml(self.arena, self.unit, timestep=0.001 / substeps))
        self._data, self._substeps = mujoco.MjData(self._model), substeps
        self._qpos, self._ctrl = self._data.qpos, self._data.ctrl
        self._history = np.zeros((HISTORY_MS, 7))
        self._stood_ms = 0
        self.place(*self._somewhere(), 0.0)

    # physics

    def advance(self, milliseconds: int) -> None:
        """Let time pass: physics, and the robot's own control of its wheels each millisecond."""
        if not self.at_rest:
            self._stood_ms = -1
        model, data, qpos, ctrl, wheels = self._model, self._data, self._qpos, self._ctrl, self.state
        pose, history, end = qpos[:7], self._history, self.time_ms + milliseconds
        slip, step, substeps, stood = self._slip.update, mujoco.mj_step, self._substeps, self._stood_ms
        angles, slips = wheels[:, ANGLE], wheels[:, SLIP]
        for now in range(self.time_ms + 1, end + 1):
            if stood >= 0:
                if stood == SETTLED_MS:
                    history[:] = pose
                    break
                stood += 1
            if now % SLIP_MS == 1:
                slip(qpos, angles, slips)
            control(wheels, qpos, ctrl)
            step(model, data, substeps)
            if KEPT[now % CYCLE_MS]:
                history[now % HISTORY_MS] = pose
        self._stood_ms = stood
        self.time_ms = end

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
        c, s = math.cos(heading / 2), math.sin(heading / 2)
        data.qpos[:7] = (x_cm / 100.0, y_cm / 100.0, 0.0, c, 0, 0, s)
        data.qpos[7:9] = angles
        mujoco.mj_forward(self._model, data)
        self._history[:] = data.qpos[:7]
        self._stood_ms = 0

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
        x, y, _, a, b, c, d = self._qpos[:7].tolist()
        return x * 100.0, y * 100.0, math.atan2(2.0 * (a * d + b * c), 1.0 - 2.0 * (c * c + d * d))


@lru_cache(maxsize=4)
def _from_the_middle(w: float, h: float) -> list[tuple[float, float]]:
    """Places on a floor, cm, the middle first."""
    places = [(w * i / 40, h * j / 40) for i in range(1, 40) for j in range(1, 40)]
    return sorted(places, key=lambda place: (place[0] - w / 2) ** 2 + (place[1] - h / 2) ** 2)


@lru_cache(maxsize=4)
def _compiled(xml: str) -> Any:
    """MuJoCo's model, which nothing changes: one robot after another of a unit has the same."""
    return mujoco.MjModel.from_xml_string(xml)
