"""What the twin's sensors see: infrared thrown back to each, and the lamp's light, direct and off the walls.

The laws are the twin's own, taken from what the real tables show, not from the paper's equations.
Everything stands upright, so light is followed in the plane. Lamps hang higher than the robot is tall:
what of their light passes over it, it does not shade.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.arena import edges
from realitygap.twin.arithmetic import cos_sin, jit, one_arctan2, one_cos_sin, one_power, power, step
from realitygap.twin.model import BODY_RADIUS, BODY_TOP, WALL_HEIGHT
from realitygap.twin.rays import Scene, is_clear, meet, near, scene_of
from realitygap.twin.unit import SENSORS_MM_DEG, Unit

__all__ = ["IR_OFFSET", "LAMP_COUNTS", "LAMP_PROUD", "SENSORS", "Eyes", "eyes_of", "illuminate", "reflect"]

Array = NDArray[np.float64]

SENSORS = len(SENSORS_MM_DEG)

RAYS = 45
FAN = (np.arange(RAYS) + 0.5) * math.pi / RAYS - math.pi / 2

# Infrared: fitted to wall.sam with this very law (RMSE 28 counts over the eight sensors)
IR_EXPONENT = 2.6  # cos^2.6: lamp's and eye's own narrowness together
IR_DEPTH = 0.0016  # m: lamp and eye lie a little behind their window
IR_GAIN = 0.0550  # counts·m² a ray of the fan, as many as there are
IR_OFFSET = 500.0  # counts: what must be thrown back before the converter shows anything
IR_REACH = 0.12  # m: further away nothing reaches the offset

# Ambient light
EYE_EXPONENT = 1.4  # light.sam at 25 cm: three quarters of the light at 33° off, a third at 65°
EYE_HEIGHT = 0.012  # m
WALL_WHITE = 0.3  # share of the light that walls and cylinders (grey paint) throw back, evenly
EYE_MIDDLE = 1.47  # rad: the eye's response over all elevations, summed
LAMP_COUNTS = 6000.0
"""How far a lamp 1 m away, straight ahead, would pull a reading down: a desk lamp, bright enough to
saturate a sensor that looks at it from the far end of the room (paper, 3.3: lit sensors say where the
lamp is, hardly how far)."""
LAMP_PROUD = 0.006  # m: the lamp hangs this far in front of a wall it is fixed to


class Eyes(NamedTuple):
    """What the sensors are: places on the robot (m), directions (rad) and gains, [8] each; cosines and sines
    of a fan's rays, and their weights, [RAYS] each; and what there is to be seen.

    `reach` is how far away (m) something may throw infrared back; `low` is the share of the way from a wall,
    at their height, up to a lamp that lies below the body's top; `square` the square of the lamps' height
    above them. There is room for poses [8, 3], signals [8] and rays [RAYS, 5].
    """

    x: Array
    y: Array
    direction: Array
    gain: Array
    across: Array
    along: Array
    infrared: Array
    light: Array
    scene: Scene
    reach: float
    lamps: Array
    square: float
    low: float
    poses: Array
    signal: Array
    rays: Array


def eyes_of(arena: Mapping[str, Any], unit: Unit) -> Eyes:
    """Of a unit in an arena, a room in plain numbers."""
    place = np.array(SENSORS_MM_DEG, dtype=np.float64)
    white = np.array(arena["reflectance"]) if "reflectance" in arena else None
    scene = scene_of(edges(arena), np.array(arena["cylinders"]).reshape(-1, 3) / 100.0, white)
    lamps, size = np.array(arena["lamps"]).reshape(-1, 2) / 100.0, np.array(arena["size_cm"]) / 100.0
    rise = unit.lamp_height - EYE_HEIGHT
    fan = cos_sin(FAN)
    seen = power(fan[0], EYE_EXPONENT)
    return Eyes(
        x=place[:, 0] / 1000.0,
        y=place[:, 1] / 1000.0,
        direction=np.radians(place[:, 2]) + np.array(unit.direction),
        gain=np.array(unit.proximity_gain),
        across=fan[0],
        along=fan[1],
        infrared=power(fan[0], IR_EXPONENT) * IR_GAIN,
        light=seen / math.fsum(seen),
        scene=scene,
        reach=IR_REACH * math.sqrt(max(1.0, *scene.white)),
        lamps=np.clip(lamps, LAMP_PROUD, size - LAMP_PROUD),
        square=rise**2,
        low=(BODY_TOP - EYE_HEIGHT) / max(rise, BODY_TOP - EYE_HEIGHT),
        poses=np.empty((SENSORS, 3)),
        signal=np.empty(SENSORS),
        rays=np.empty((RAYS, 5)),
    )


@step
def _stand(eyes: Any, poses: Any, k: int) -> Any:
    """Where a sensor is, and cosine and sine of where it looks."""
    c, s = one_cos_sin(poses[k, 2])
    x = poses[k, 0] + c * eyes.x[k] - s * eyes.y[k]
    y = poses[k, 1] + s * eyes.x[k] + c * eyes.y[k]
    c, s = one_cos_sin(poses[k, 2] + eyes.direction[k])
    return x, y, c, s


@jit
def reflect(eyes: Any, poses: Any, out: Any) -> None:
    """Infrared thrown back to each sensor, counts less the offset, without noise, into [8].

    Each ray: emitted and taken in by cos^2.6 of its angle, thrown back by Lambert's law (cosine of
    the incidence) and the surface's reflectance, weakened by the square of the distance. `poses` [8, 3]: x, y
    (m) and heading of the robot when each sensor was refreshed.
    """
    counts = near(eyes.scene, poses[0, 0], poses[0, 1], eyes.reach + BODY_RADIUS)
    for k in range(SENSORS):
        out[k] = -IR_OFFSET
        if counts[0] == 0 and counts[1] == 0:
            continue
        x, y, c, s = _stand(eyes, poses, k)
        total = 0.0
        for j in range(RAYS):
            dx, dy = c * eyes.across[j] - s * eyes.along[j], s * eyes.across[j] + c * eyes.along[j]
            distance, incidence, _, _, _, _, white = meet(eyes.scene, counts, x, y, dx, dy)
            deep = distance + IR_DEPTH
            total += white * incidence / (deep * deep) * eyes.infrared[j]
        out[k] = total * eyes.gain[k] - IR_OFFSET


@jit
def illuminate(eyes: Any, power: float, poses: Any, out: Any) -> None:
    """Light on each sensor, into [8]; 1 is a lamp 1 m away, straight ahead. `poses` as of `reflect`.

    Direct light, and what walls and cylinders throw back evenly after one bounce.
    """
    lamps, rays = eyes.lamps, eyes.rays
    counts = near(eyes.scene, poses[0, 0], poses[0, 1], np.inf)
    centre_x, centre_y = 0.0, 0.0
    for k in range(SENSORS):
        out[k] = 0.0
        centre_x, centre_y = centre_x + poses[k, 0], centre_y + poses[k, 1]
    centre = centre_x / SENSORS, centre_y / SENSORS
    for k in range(SENSORS if lamps.shape[0] else 0):
        x, y, c, s = _stand(eyes, poses, k)
        for j in range(RAYS):
            dx, dy = c * eyes.across[j] - s * eyes.along[j], s * eyes.across[j] + c * eyes.along[j]
            distance, _, px, py, nx, ny, white = meet(eyes.scene, counts, x, y, dx, dy)
            tall = one_arctan2(WALL_HEIGHT - EYE_HEIGHT, distance) + one_arctan2(EYE_HEIGHT, distance)
            # share of a sensor's view, up and down, that a wall fills
            tall = tall / EYE_MIDDLE * white
            rays[j, 0], rays[j, 1], rays[j, 2], rays[j, 3], rays[j, 4] = px, py, nx, ny, tall
        for n in range(lamps.shape[0]):
            lamp, thrown = (lamps[n, 0], lamps[n, 1]), 0.0
            for j in range(RAYS):
                lit = on_wall(eyes, lamp, (rays[j, 0], rays[j, 1]), (rays[j, 2], rays[j, 3]), centre)
                thrown += lit * rays[j, 4] * eyes.light[j]
            out[k] = out[k] + _direct(eyes, lamp, x, y, c, s) + WALL_WHITE * thrown
        out[k] *= power


@step
def _direct(eyes: Any, lamp: Any, x: float, y: float, c: float, s: float) -> Any:
    """Light of a lamp on a sensor at x, y that looks along c, s."""
    ax, ay = lamp[0] - x, lamp[1] - y
    square = ax * ax + ay * ay + eyes.square
    facing = (ax * c + ay * s) / math.sqrt(square)
    return one_power(facing, EYE_EXPONENT) / square if is_clear(eyes.scene, x, y, ax, ay) else 0.0


@step
def on_wall(eyes: Any, lamp: Any, point: Any, normal: Any, centre: Any) -> Any:
    """Light of a lamp on a point of a wall whose normal points to the robot: each x, y (m).

    The body, about its centre, shades it where light comes nearer than its radius before it has risen above
    its top.
    """
    (px, py), (nx, ny) = point, normal
    ax, ay = lamp[0] - px, lamp[1] - py
    flat = ax * ax + ay * ay
    square = flat + eyes.square
    # a hair off the surface, so that a wall does not shade itself
    if not is_clear(eyes.scene, px + 1e-6 * nx, py + 1e-6 * ny, ax, ay):
        return 0.0
    along = ((centre[0] - px) * ax + (centre[1] - py) * ay) / max(flat, 1e-12)
    along = min(max(along, 0.0), eyes.low)
    dx, dy = px + along * ax - centre[0], py + along * ay - centre[1]
    if math.sqrt(dx * dx + dy * dy) <= BODY_RADIUS:
        return 0.0
    return max(ax * nx + ay * ny, 0.0) / math.sqrt(square) / square
