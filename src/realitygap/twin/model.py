"""The robot and its arena for MuJoCo: bodies, wheels, motors (SI units)."""

import os
from collections.abc import Mapping
from itertools import count
from typing import Any

try:
    import mujoco
except Exception:  # MUJOCO_GL names what does not work here: that concerns a renderer alone
    _named = os.environ.get("MUJOCO_GL", "")
    os.environ["MUJOCO_GL"] = "disable"
    import mujoco

    os.environ["MUJOCO_GL"] = _named

from realitygap.twin.arena import WALL_HALF
from realitygap.twin.arithmetic import arctan2, cos_sin, hypot
from realitygap.twin.unit import Unit

__all__ = ["BODY_RADIUS", "BODY_TOP", "CLEARANCE", "NOMINAL_VOLT", "WALL_HEIGHT", "build_xml", "mujoco"]

BODY_RADIUS = 0.0275  # K-Team, Khepera user manual: diameter 55 mm
BODY_TOP = 0.030  # the same: height 30 mm
BODY_MASS = 0.070  # the same: about 70 g
CLEARANCE = 0.00015
"""Casters end 0.15 mm above the floor (the robot leans 0.4°): at 1.3 mm a prototype leaned by 3.4°."""
CASTER_X = 0.021
CASTER_RADIUS = 0.002
WHEEL_MASS = 0.002
WHEEL_HALF_WIDTH = 0.0015
WALL_HEIGHT = 0.04
"""Just above the robot and its disk, which a camera overhead must not lose behind a cylinder."""

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
        half = hypot(x1 - x0, y1 - y0) / 2 + WALL_HALF
        angle = float(arctan2(y1 - y0, x1 - x0))
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
      <geom {caster} name="front" pos="{CASTER_X} 0 {z}"/>
      <geom {caster} name="back" pos="{-CASTER_X} 0 {z}"/>
      {{disk}}{_wheel("left", unit.track / 2, unit, left)}
      {_wheel("right", -unit.track / 2, unit, right)}
    </body>"""


def _pairs(arena: Mapping[str, Any], unit: Unit) -> str:
    """What can touch, and its friction: MuJoCo need not search for it. The order is that of its search,
    because the last bits depend on it."""
    solids = 4 + len(arena["walls"]) + len(arena["cylinders"])
    touching = [("floor", "front", 0.08), ("floor", "back", 0.08)]
    touching += [(f"solid {k}", "body", 0.3) for k in range(solids)]
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
    x, y = 9.81 * cos_sin(unit.tilt)[1]  # a tilted table is a level one with gravity askew
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
