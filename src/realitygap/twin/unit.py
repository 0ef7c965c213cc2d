"""One robot of a population, and the arena that it stands in.

A robot's constants are drawn from its number and known to nobody but the twin. What the robots have in common
stands here with its source. Lengths in metres, angles in radians, as everywhere inside the twin; an arena
comes in plain numbers, in cm.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import ConfigError
from realitygap.twin.noise import draws

__all__ = [
    "BODY_RADIUS",
    "BODY_TOP",
    "SENSORS_MM_DEG",
    "WALL_HALF",
    "WALL_HEIGHT",
    "Unit",
    "draw_unit",
    "faces_of",
    "plain_arena",
]  # fmt: skip

BODY_RADIUS = 0.0275  # K-Team, Khepera user manual: diameter 55 mm
BODY_TOP = 0.030  # the same: height 30 mm
WALL_HEIGHT = 0.04
"""Just above the robot and its disk, which a camera overhead must not lose behind a cylinder."""
WALL_HALF = 0.003
"""A partition is a board of 6 mm (m, half of it)."""

SENSORS_MM_DEG = (
    (10, 24, 90), (19, 17, 45), (25, 6, 0), (25, -6, 0),
    (19, -17, -45), (10, -24, -90), (-24, -10, 180), (-24, 10, 180),
)  # fmt: skip
"""x forward, y left (mm), direction (degrees): the Player driver's default geometry
(playerproject/player, server/drivers/mixed/khepera/khepera.cc, `ir.poses`)."""

WHEEL_RADIUS = 0.050 / (2 * math.pi)
"""600 pulses a turn at 12 pulses a millimetre (Player's encoder_res 1/12): a way of 50 mm a turn."""
TRACK = 0.053
"""Between the wheels: 53 mm (KiKS, KIKS_ROBOT_DISTANCE_BETWEEN_WHEELS)."""


def _drawn(mean: float, deviation: float, count: int = 1) -> Any:
    """A constant that differs from unit to unit: numbers of this law, drawn in the fields' order."""
    return field(metadata={"law": (mean, deviation, count)})


@dataclass(frozen=True, kw_only=True)
class CameraUnit:
    """The camera's mounting error: not quite over the middle, not quite straight."""

    offset_share: tuple[float, float] = _drawn(0.0, 0.005, 2)
    height_share: float = _drawn(1.0, 0.007)
    tilt: tuple[float, float] = _drawn(0.0, math.radians(0.7), 2)
    roll: float = _drawn(0.0, math.radians(0.5))
    k1: float = _drawn(-0.12, 0.025)
    k2: float = _drawn(0.03, 0.01)
    gain: float = _drawn(1.0, 0.04)


@dataclass(frozen=True, kw_only=True)
class Unit:
    """The constants of one robot and of the room it stands in."""

    number: int
    proximity_gain: tuple[float, ...] = _drawn(1.0, 0.2, 8)  # wall.sam: eight sensors, sd 20 to 25 %
    ambient_gain: tuple[float, ...] = _drawn(1.0, 0.2, 8)
    direction: tuple[float, ...] = _drawn(0.0, math.radians(5.0), 8)  # wall.sam: fitted ones err by 3° to 11°
    dark: tuple[float, ...] = _drawn(482.0, 4.0, 8)  # light.sam: 480 to 490
    floor: tuple[float, ...] = _drawn(60.0, 4.0, 8)  # light.sam: 50 to 65
    wheel_radius: tuple[float, float] = _drawn(WHEEL_RADIUS, 0.004 * WHEEL_RADIUS, 2)
    track: float = _drawn(TRACK, 0.0003)
    axle_phase: tuple[float, float] = _drawn(math.pi, 1.8, 2)
    friction: float = _drawn(0.8, 0.06)  # rubber on painted board
    tilt: tuple[float, float] = _drawn(0.0, math.radians(0.1), 2)  # a table, levelled by eye
    lamp_power: float = _drawn(1.0, 0.06)
    lamp_height: float = _drawn(0.05, 0.004)
    camera: CameraUnit


def draw_unit(number: int) -> Unit:
    """The robot with this number, always the same one.

    Raises:
        ConfigError: the number is not a whole number from 0 on.
    """
    if not isinstance(number, int) or isinstance(number, bool) or number < 0:
        raise ConfigError(f"a unit is named by a whole number from 0 on, got {number!r}")
    # NumPy's normal draws: those within three deviations are the same on every processor
    generator = draws(number, 7)

    def around(mean: float, deviation: float, count: int) -> Any:
        """Normal, held within three deviations: no maker delivers worse."""
        drawn = [max(-3.0, min(3.0, float(generator.standard_normal()))) for _ in range(count)]
        return tuple(mean + deviation * one for one in drawn) if count > 1 else mean + deviation * drawn[0]

    def drawn(kind: type[Any]) -> dict[str, Any]:
        return {one.name: around(*one.metadata["law"]) for one in fields(kind) if one.metadata}

    constants = drawn(Unit)
    return Unit(number=number, camera=CameraUnit(**drawn(CameraUnit)), **constants)


def plain_arena(arena: Mapping[str, Any]) -> dict[str, Any]:
    """The same arena with every key there and every number a float."""
    out: dict[str, Any] = {"size_cm": list(map(float, arena["size_cm"]))}
    for key in ("cylinders", "walls", "lamps"):
        out[key] = [list(map(float, row)) for row in arena.get(key, ())]
    if "reflectance" in arena:
        out["reflectance"] = list(map(float, arena["reflectance"]))
    return out


def faces_of(arena: Mapping[str, Any]) -> NDArray[np.float64]:
    """[n, 4] x0, y0, x1, y1 (m): the faces that light and infrared meet, round the floor and partitions."""
    w, h = (v / 100.0 for v in arena["size_cm"])
    faces = [(0, 0, w, 0), (w, 0, w, h), (w, h, 0, h), (0, h, 0, 0)]
    for x0, y0, x1, y1 in (np.array(wall) / 100.0 for wall in arena["walls"]):
        length = math.hypot(x1 - x0, y1 - y0)
        ux, uy = (x1 - x0) / length * WALL_HALF, (y1 - y0) / length * WALL_HALF
        a, b = (x0 - ux + uy, y0 - uy - ux), (x1 + ux + uy, y1 + uy - ux)
        c, d = (x1 + ux - uy, y1 + uy + ux), (x0 - ux - uy, y0 - uy + ux)
        faces += [(*a, *b), (*b, *c), (*c, *d), (*d, *a)]
    return np.array(faces, dtype=np.float64)
