"""How far a ray goes before it meets something: for pictures only, in plain NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from realitygap.kernels.params import RAYS, Arena, Robot

__all__ = ["cast", "light_rays", "sensor_rays"]

F = NDArray[np.float64]


def cast(arena: Arena, origin: F, direction: F) -> F:
    """Distance in cm from each origin [N, 2] along each unit vector [N, 2] to the nearest thing."""
    width, depth = arena.size
    walls = np.array(
        [[0, 0, width, 0], [width, 0, width, depth], [width, depth, 0, depth], [0, depth, 0, 0]], dtype=float
    )
    distance = np.full(len(origin), np.inf)
    for x0, y0, x1, y1 in np.concatenate([walls, arena.segments.reshape(-1, 4)]):
        along = np.array([x1 - x0, y1 - y0])
        across = direction[:, 0] * along[1] - direction[:, 1] * along[0]
        start = np.array([x0, y0]) - origin
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (start[:, 0] * along[1] - start[:, 1] * along[0]) / across
            place = (start[:, 0] * direction[:, 1] - start[:, 1] * direction[:, 0]) / across
        met = (across != 0) & (reach >= 0) & (place >= 0) & (place <= 1)
        distance = np.where(met & (reach < distance), reach, distance)
    for x, y, radius in arena.cylinders.reshape(-1, 3):
        start = np.array([x, y]) - origin
        middle = (start * direction).sum(axis=1)
        miss = (start**2).sum(axis=1) - middle**2
        half = np.sqrt(np.maximum(radius**2 - miss, 0.0))
        met = (miss < radius**2) & (middle - half >= 0)
        distance = np.where(met & (middle - half < distance), middle - half, distance)
    return distance


def light_rays(robot: Robot) -> F:
    """The rays [S, 2, lanes] about each light sensor's direction; a calibrated one may trace more fans."""
    fans = len(robot.ambient_ray) // max(len(robot.ambient_place), 1)
    return robot.ambient_ray[fans // 2 :: max(fans, 1)]


def sensor_rays(arena: Arena, place: F, ray: F, pose: tuple[float, float, float], reach: F | float) -> F:
    """Where the rays of all sensors start and end, [S · RAYS, 2 ends, 2] in cm.

    `place` [S, 2] and `ray` [S, 2, lanes] are in the robot's frame, `reach` [S] bounds each
    sensor's rays; `pose` is x, y and heading.
    """
    x, y, heading = pose
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    origin = np.repeat(place @ turn.T + (x, y), RAYS, axis=0)
    direction = (ray[:, :, :RAYS].transpose(0, 2, 1) @ turn.T).reshape(-1, 2)
    bound = np.repeat(np.broadcast_to(np.asarray(reach, dtype=float), len(place)), RAYS)
    length = np.minimum(cast(arena, origin, direction), bound)
    return np.stack([origin, origin + length[:, None] * direction], axis=1)
