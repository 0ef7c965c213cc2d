"""One robot of a population: its constants, drawn from a seed and known to nobody but the twin.

What the robots have in common stands here with its source; what differs between them is drawn.
Lengths in metres, angles in radians, as everywhere inside the twin.
"""

import math
from dataclasses import dataclass, field, fields
from typing import Any

from realitygap.errors import ConfigError
from realitygap.twin.noise import draws

__all__ = ["SENSORS_MM_DEG", "CameraUnit", "Unit", "draw_unit"]

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
    """How somebody hung the camera: not quite over the middle, not quite straight."""

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
