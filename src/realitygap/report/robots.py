"""The robot, seen from above and to scale."""

import math
from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon, Wedge
from numpy.typing import NDArray

from realitygap.kernels.types import Robot
from realitygap.report import style
from realitygap.report.style import SIMULATED, Look, new_figure
from realitygap.world.robot import Profile

__all__ = ["WHEEL_CM", "draw_robot", "front", "robot_figure", "shown_sensors"]

F = NDArray[np.float64]

WHEEL_CM = (1.9, 0.45)
"""Length and width of a drawn wheel."""
DISC_CM = 0.34
"""Radius of a drawn sensor: nearer than this, two are one, as a calibration places them."""


def draw_robot(
    ax: Axes, robot: Robot, pose: tuple[float, float, float], look: Look = SIMULATED, *, edge: str = style.INK
) -> list[Patch | Line2D]:
    """Draw a robot to scale: body, wheels, and a line to its leading edge; returns its artists.

    Args:
        ax: the axes, in cm.
        robot: its body.
        pose: x, y (cm), heading (rad).
        look: colours and lines.
        edge: the outline's colour.
    """
    x, y, heading = pose
    cos, sin = math.cos(heading), math.sin(heading)
    turned = robot.outline[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
    body = Polygon(turned, closed=True) if len(turned) else Circle((x, y), robot.radius)
    body.set(facecolor=look.body, edgecolor=edge, linestyle=look.line, linewidth=1.1, zorder=5)
    length, width = WHEEL_CM[0] / 2, WHEEL_CM[1] / 2
    shapes: list[Patch] = [body]
    for side in (1, -1):
        inner, outer = (side * (robot.wheels.track / 2 - width) + part for part in (-width, width))
        corners = np.array([[length, inner], [length, outer], [-length, outer], [-length, inner]])
        turned = corners @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
        shapes.append(Polygon(turned, closed=True, facecolor=edge, linewidth=0, zorder=5.1))
    for shape in shapes:
        ax.add_artist(shape)  # unlike add_patch it measures nothing: the limits are set
    ahead = front(robot)
    tip = (x + ahead * cos, y + ahead * sin)
    line = ax.plot([x, tip[0]], [y, tip[1]], color=edge, linewidth=1.3, zorder=5.2, solid_capstyle="butt")
    return [*shapes, *line]


def front(robot: Robot) -> float:
    """Distance from the axle's middle to the body's edge ahead, cm."""
    x, y, nx, ny = robot.outline[robot.outline[:, 2] > 0].T
    return float(((nx * x + ny * y) / nx).min(initial=robot.radius))


def robot_figure(profile: Profile) -> Figure:
    """The robot enlarged: its sensors with their numbers and directions, its wheels, a scale."""
    robot = profile.to_kernel()
    figure = new_figure(2.6, 2.7, layout="constrained")
    ax = figure.add_subplot()
    span = robot.radius * 1.75
    draw_robot(ax, robot, (0.0, 0.0, math.pi / 2))
    for place, ahead, name in shown_sensors(robot):
        _draw_sensor(ax, place, ahead, name)
    ax.plot([-robot.radius, robot.radius], [-span * 0.93] * 2, color=style.INK, linewidth=0.9, marker="|")
    ax.text(0, -span * 0.98, f"{2 * robot.radius:.3g} cm", ha="center", va="top", fontsize=7.5)
    ax.set(xlim=(-span, span), ylim=(-span * 1.12, span), aspect="equal")
    ax.axis("off")
    return figure


def _draw_sensor(ax: Axes, place: F, ahead: F, name: str) -> None:
    """A half disc in the sensor's direction, an arrow and a number."""
    spot = np.array([-place[1], place[0]])
    facing = math.atan2(ahead[1], ahead[0]) + math.pi / 2
    out, turn = np.array([math.cos(facing), math.sin(facing)]), math.degrees(facing)
    half = Wedge(tuple(spot), DISC_CM, turn - 90, turn + 90, facecolor=style.RAY, edgecolor="none", zorder=6)
    ax.add_artist(half)
    arrow = {"arrowstyle": "-|>", "color": style.RAY, "lw": 0.8, "mutation_scale": 6}
    ax.annotate("", tuple(spot + 1.35 * out), tuple(spot + DISC_CM * out), zorder=6, arrowprops=arrow)
    x, y = spot + 1.75 * out
    ax.text(x, y, name, ha="center", va="center", fontsize=8, zorder=7)


def shown_sensors(robot: Robot) -> Iterator[tuple[F, F, str]]:
    """Place, direction and number of every sensor, except ambient ones at a proximity sensor's place."""
    for i, (place, ahead) in enumerate(zip(robot.proximity.place, robot.proximity.facing, strict=True)):
        yield place, ahead, str(i)
    for i, (place, ahead) in enumerate(zip(robot.ambient.place, robot.ambient.facing, strict=True)):
        if np.hypot(*(robot.proximity.place - place).T).min(initial=np.inf) > DISC_CM:
            yield place, ahead, f"a{i}"
