"""One robot of a population: its constants, drawn from a seed and known to nobody but the twin.

What the robots have in common stands here with its source; what differs between them is drawn.
Lengths in metres, angles in radians, as everywhere inside the twin.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
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

_EIGHT = 8


@dataclass(frozen=True, kw_only=True)
class CameraUnit:
    """How somebody hung the camera: not quite over the middle, not quite straight."""

    offset_share: tuple[float, float]
    height_share: float
    tilt: tuple[float, float]
    roll: float
    k1: float
    k2: float
    gain: float


@dataclass(frozen=True, kw_only=True)
class Unit:
    """The constants of one robot and of the room it stands in."""

    number: int
    proximity_gain: tuple[float, ...]
    ambient_gain: tuple[float, ...]
    direction: tuple[float, ...]
    dark: tuple[float, ...]
    floor: tuple[float, ...]
    wheel_radius: tuple[float, float]
    track: float
    axle_phase: tuple[float, float]
    friction: float
    tilt: tuple[float, float]
    lamp_power: float
    lamp_height: float
    camera: CameraUnit

    def to_dict(self) -> dict[str, Any]:
        """Every constant, JSON-ready: for the sealed file, not for a score."""
        return asdict(self)


def draw_unit(number: int) -> Unit:
    """The robot with this number, always the same one.

    Raises:
        ConfigError: the number is not a whole number from 0 on.
    """
    if not isinstance(number, int) or isinstance(number, bool) or number < 0:
        raise ConfigError(f"a unit is named by a whole number from 0 on, got {number!r}")
    # NumPy's normal draws: those within three deviations are the same on every processor
    generator = draws(number, 7)

    def around(mean: float, deviation: float) -> float:
        """Normal, held within three deviations: no maker delivers worse."""
        return mean + deviation * max(-3.0, min(3.0, float(generator.standard_normal())))

    def several(mean: float, deviation: float, n: int = _EIGHT) -> tuple[float, ...]:
        return tuple(around(mean, deviation) for _ in range(n))

    def two(mean: float, deviation: float) -> tuple[float, float]:
        return around(mean, deviation), around(mean, deviation)

    return Unit(
        number=number,
        proximity_gain=several(1.0, 0.2),  # wall.sam: the eight sensors of one robot, sd 20 to 25 %
        ambient_gain=several(1.0, 0.2),
        direction=several(0.0, math.radians(5.0)),  # wall.sam: fitted directions err by 3° to 11°
        dark=several(482.0, 4.0),  # light.sam: 480 to 490
        floor=several(60.0, 4.0),  # light.sam: 50 to 65
        wheel_radius=two(WHEEL_RADIUS, 0.004 * WHEEL_RADIUS),
        track=around(TRACK, 0.0003),
        axle_phase=two(math.pi, 1.8),
        friction=around(0.8, 0.06),  # rubber on painted board
        tilt=two(0.0, math.radians(0.1)),  # a table, levelled by eye
        lamp_power=around(1.0, 0.06),
        lamp_height=around(0.05, 0.004),
        camera=CameraUnit(
            offset_share=two(0.0, 0.005),
            height_share=around(1.0, 0.007),
            tilt=two(0.0, math.radians(0.7)),
            roll=around(0.0, math.radians(0.5)),
            k1=around(-0.12, 0.025),
            k2=around(0.03, 0.01),
            gain=around(1.0, 0.04),
        ),
    )
