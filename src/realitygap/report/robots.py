"""The robot, seen from above and to scale."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Wedge

from realitygap.kernels.params import Robot
from realitygap.report import style
from realitygap.report.rays import light_rays
from realitygap.report.style import SIMULATED, Look, new_figure

__all__ = ["draw_robot", "robot_figure"]

WHEEL_CM = (1.9, 0.45)
"""A wheel as it is drawn: length and width."""


def draw_robot(
    ax: Axes,
    robot: Robot,
    pose: tuple[float, float, float],
    look: Look = SIMULATED,
    *,
    edge: str = style.INK,
    wheels: bool = True,
) -> list[Any]:
    """A robot to scale: body, wheels, and a line to its leading edge; its artists are returned."""
    x, y, heading = pose
    cos, sin = math.cos(heading), math.sin(heading)
    artists: list[Any] = [
        ax.add_patch(
            Circle(
                (x, y),
                robot.radius,
                facecolor=look.body,
                edgecolor=edge,
                linewidth=1.1,
                linestyle=look.line,
                zorder=5,
            )
        )
    ]
    for side in (1, -1) if wheels else ():
        length, width = WHEEL_CM[0] / 2, WHEEL_CM[1] / 2
        middle = side * (robot.track / 2 - width)
        corners = np.array(
            [
                [length, middle - width],
                [length, middle + width],
                [-length, middle + width],
                [-length, middle - width],
            ]
        )
        turned = corners @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
        artists.append(ax.add_patch(Polygon(turned, closed=True, facecolor=edge, linewidth=0, zorder=5.1)))
    tip = (x + robot.radius * cos, y + robot.radius * sin)
    artists += ax.plot([x, tip[0]], [y, tip[1]], color=edge, linewidth=1.3, zorder=5.2, solid_capstyle="butt")
    return artists


def robot_figure(profile: Any) -> Figure:
    """The robot enlarged: its sensors with their numbers and directions, its wheels, a scale."""
    robot = profile.to_kernel()
    figure = new_figure(2.6, 2.7, layout="constrained")
    ax = figure.add_subplot()
    span = robot.radius * 1.75
    draw_robot(ax, robot, (0.0, 0.0, math.pi / 2))
    for place, ray, name in _sensors(robot):
        _draw_sensor(ax, place, ray, name)
    ax.plot([-robot.radius, robot.radius], [-span * 0.93] * 2, color=style.INK, linewidth=0.9, marker="|")
    ax.text(0, -span * 0.98, f"{2 * robot.radius:g} cm", ha="center", va="top", fontsize=7.5)
    ax.set_xlim(-span, span)
    ax.set_ylim(-span * 1.12, span)
    ax.set_aspect("equal")
    ax.axis("off")
    return figure


def _draw_sensor(ax: Axes, place: Any, ray: Any, name: str) -> None:
    """A half disc that faces the sensor's way, an arrow and a number."""
    spot = np.array([-place[1], place[0]])
    facing = math.atan2(*ray[:, : ray.shape[1]].mean(axis=1)[::-1]) + math.pi / 2
    out = np.array([math.cos(facing), math.sin(facing)])
    ax.add_patch(
        Wedge(
            tuple(spot),
            0.34,
            math.degrees(facing) - 90,
            math.degrees(facing) + 90,
            facecolor=style.RAY,
            edgecolor="none",
            zorder=6,
        )
    )
    ax.annotate(
        "",
        tuple(spot + 1.35 * out),
        tuple(spot + 0.34 * out),
        zorder=6,
        arrowprops={"arrowstyle": "-|>", "color": style.RAY, "lw": 0.8, "mutation_scale": 6},
    )
    ax.text(
        spot[0] + 1.75 * out[0], spot[1] + 1.75 * out[1], name, ha="center", va="center", fontsize=8, zorder=7
    )


def _sensors(robot: Robot) -> list[tuple[Any, Any, str]]:
    """Place, rays and number of every sensor; an ambient one where a proximity one stands is it."""
    sensors = [
        (p, r, str(i))
        for i, (p, r) in enumerate(zip(robot.proximity_place, robot.proximity_ray, strict=True))
    ]
    taken = {tuple(np.round(p, 6)) for p, _, _ in sensors}
    for i, (place, ray) in enumerate(zip(robot.ambient_place, light_rays(robot), strict=True)):
        if tuple(np.round(place, 6)) not in taken:
            sensors.append((place, ray, f"a{i}"))
    return sensors
