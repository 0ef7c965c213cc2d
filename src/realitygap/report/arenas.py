"""Figures 1 and 2: the arenas to scale, in cm, with a robot, its sensors and their rays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle, Wedge

from realitygap.kernels.params import Arena, Robot
from realitygap.report import style
from realitygap.report.rays import sensor_rays
from realitygap.report.style import PAGE, SIMULATED, Look, new_figure

__all__ = ["arena_figure", "draw_arena", "draw_robot", "draw_start", "robot_figure"]

AMBIENT_RAYS_CM = 15.0
"""Rays of the ambient sensors have no end but the walls: a picture shows so much of them."""
WHEEL_CM = (1.9, 0.45)
"""A wheel as it is drawn: length and width."""


def draw_arena(ax: Axes, arena: Arena, *, labels: bool = True, names: bool = False) -> None:
    """Floor, walls, inner walls, cylinders and lamps of an arena, to scale.

    Args:
        ax: where; its axes become cm.
        arena: as the kernels see it.
        labels: axes with ticks in cm; otherwise nothing but the picture.
        names: write "lamp" at the lamps.
    """
    width, depth = (float(v) for v in arena.size)
    edge = 0.02 * max(width, depth)
    ax.add_patch(Rectangle((0, 0), width, depth, facecolor=style.FLOOR, edgecolor=style.WALL,
                           linewidth=1.6, zorder=0))  # fmt: skip
    for x, y, radius in arena.cylinders.reshape(-1, 3):
        ax.add_patch(Circle((x, y), radius, facecolor=style.CYLINDER, edgecolor=style.WALL,
                            linewidth=0.8, zorder=1))  # fmt: skip
    segments = arena.segments.reshape(-1, 2, 2)
    if len(segments):
        ax.add_collection(LineCollection(list(segments), colors=style.WALL, linewidths=1.6, zorder=1))
    _draw_lamps(ax, arena, names=names)
    ax.set_xlim(-edge, width + edge * (1.6 if len(arena.lamp_centre) else 1.0))
    ax.set_ylim(-edge, depth + edge)
    ax.set_aspect("equal")
    for side in ax.spines.values():
        side.set_visible(False)
    if labels:
        ax.set_xlabel("x (cm)")
        ax.set_ylabel("y (cm)")
        ax.set_xticks(_ticks(width))
        ax.set_yticks(_ticks(depth))
    else:
        ax.set_xticks([])
        ax.set_yticks([])


def _ticks(length: float) -> list[float]:
    """Round places from 0 to `length`, at most seven."""
    gap = next(g for g in (1, 2, 5, 10, 20, 50, 100, 200, 500, math.inf) if length / g <= 6)
    return [k * gap for k in range(int(length / gap) + 1)] if gap < math.inf else [0.0, length]


def _draw_lamps(ax: Axes, arena: Arena, *, names: bool) -> None:
    """Each lamp's points as dots with a half glow about its centre."""
    for points, centre in zip(arena.lamp_points, arena.lamp_centre, strict=True):
        for radius, alpha in ((9.0, 0.12), (6.0, 0.18), (3.2, 0.3)):
            glow = Circle(tuple(centre), radius, facecolor=style.LAMP, edgecolor="none", alpha=alpha, zorder=0.5)
            ax.add_patch(glow)
            glow.set_clip_path(Rectangle((0, 0), *arena.size, transform=ax.transData))
        ax.plot(points[:, 0], points[:, 1], "o", color=style.LAMP, markersize=3.2, zorder=4,
                markeredgecolor=style.WALL, markeredgewidth=0.5, clip_on=False)  # fmt: skip
        if names:
            to_left = centre[0] > arena.size[0] / 2
            ax.annotate("lamp", tuple(centre), xytext=(-10 if to_left else 10, 0),
                        textcoords="offset points", ha="right" if to_left else "left",
                        va="center", fontsize=7.5)  # fmt: skip


def draw_start(ax: Axes, start: np.ndarray) -> None:
    """The disc that starts are drawn from ([5]: x, y, radius, lowest and highest heading), and its name."""
    x, y, radius = (float(v) for v in start[:3])
    if radius > 0:
        ax.add_patch(Circle((x, y), radius, fill=False, edgecolor=style.INK, linewidth=1.0,
                            linestyle=(0, (2, 1.5)), zorder=7))  # fmt: skip
    else:
        ax.plot([x], [y], "+", color=style.INK, markersize=6, markeredgewidth=1.0, zorder=7)
    ax.annotate("start", (x, y - radius), xytext=(0, -32), textcoords="offset points", ha="center",
                va="top", fontsize=7.5, zorder=8,
                arrowprops={"arrowstyle": "-", "color": style.INK, "lw": 0.7, "shrinkA": 1, "shrinkB": 0})  # fmt: skip


def draw_robot(
    ax: Axes, robot: Robot, pose: tuple[float, float, float], look: Look = SIMULATED, *,
    edge: str = style.INK, wheels: bool = True,
) -> list[Any]:  # fmt: skip
    """A robot to scale: body, wheels, and a line to its leading edge; its artists are returned."""
    x, y, heading = pose
    cos, sin = math.cos(heading), math.sin(heading)
    artists: list[Any] = [
        ax.add_patch(Circle((x, y), robot.radius, facecolor=look.body, edgecolor=edge,
                            linewidth=1.1, linestyle=look.line, zorder=5))  # fmt: skip
    ]
    for side in (1, -1) if wheels else ():
        length, width = WHEEL_CM[0] / 2, WHEEL_CM[1] / 2
        middle = side * (robot.track / 2 - width)
        corners = np.array([[length, middle - width], [length, middle + width],
                            [-length, middle + width], [-length, middle - width]])  # fmt: skip
        turned = corners @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
        artists.append(ax.add_patch(Polygon(turned, closed=True, facecolor=edge, linewidth=0, zorder=5.1)))
    tip = (x + robot.radius * cos, y + robot.radius * sin)
    artists += ax.plot([x, tip[0]], [y, tip[1]], color=edge, linewidth=1.3, zorder=5.2,
                       solid_capstyle="butt")  # fmt: skip
    return artists


def _draw_rays(ax: Axes, robot: Robot, arena: Arena, feeds: str, pose: tuple[float, float, float]) -> None:
    """The rays that a task's robot senses with, to what they meet or as far as they matter."""
    if feeds == "proximity":
        place, ray = robot.proximity_place, robot.proximity_ray
        reach = np.where(np.isfinite(robot.proximity_reach), robot.proximity_reach, AMBIENT_RAYS_CM)
    else:
        place, ray, reach = robot.ambient_place, robot.ambient_ray, np.full(len(robot.ambient_place), AMBIENT_RAYS_CM)
    rays = sensor_rays(arena, place, ray, pose, reach)
    ax.add_collection(LineCollection(list(rays), colors=style.RAY, linewidths=0.45, zorder=3))
    x, y, heading = pose
    turn = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
    spots = place @ turn.T + (x, y)
    ax.plot(spots[:, 0], spots[:, 1], "o", color=style.RAY, markersize=1.8, zorder=6)


def _sensing_pose(task: Any, robot: Robot, start: np.ndarray) -> tuple[float, float, float]:
    """Where the robot of figure 1 stands: at its start, or beside an obstacle where starts are a region."""
    x, y, region = (float(v) for v in start[:3])
    heading = float(start[3]) if start[4] - start[3] < 6.28 else 0.0
    radius = float(robot.radius)
    if region <= 0:
        return x, y, heading
    places = [(x + d * math.cos(h), y + d * math.sin(h), h)
              for d in np.arange(region + 1.2 * radius, region + 12 * radius, 0.5)
              for h in np.radians(np.arange(30, 390, 10))]  # fmt: skip
    for px, py, h in places:
        if not task.arena.obstacle_at(px, py, radius + 1.5) and task.arena.obstacle_at(px, py, radius + 3.0):
            return px, py, h
    return x, y, heading


def arena_figure(task: Any, profile: Any) -> Figure:
    """Figure 1 or 2: a task's arena with a robot that senses, to scale."""
    arena, robot = task.arena.to_kernel(), profile.to_kernel()
    start = task.to_kernel(profile).start
    width, depth = (float(v) for v in arena.size)
    wide = min(PAGE, 3.3 * max(width / depth, 0.7) ** 0.75)
    figure = new_figure(wide, (wide - 0.6) * depth / width + 0.55, layout="constrained")
    ax = figure.add_subplot()
    draw_arena(ax, arena, names=True)
    pose = _sensing_pose(task, robot, start)
    _draw_rays(ax, robot, arena, task.feeds, pose)
    draw_robot(ax, robot, pose)
    draw_start(ax, start)
    return figure


def robot_figure(profile: Any) -> Figure:
    """The robot enlarged: its sensors with their numbers and directions, its wheels, a scale."""
    robot = profile.to_kernel()
    figure = new_figure(2.6, 2.7, layout="constrained")
    ax = figure.add_subplot()
    span = robot.radius * 1.75
    draw_robot(ax, robot, (0.0, 0.0, math.pi / 2))
    for place, ray, name in _sensors(robot):
        spot = np.array([-place[1], place[0]])
        facing = math.atan2(*ray[:, : ray.shape[1]].mean(axis=1)[::-1]) + math.pi / 2
        out = np.array([math.cos(facing), math.sin(facing)])
        ax.add_patch(Wedge(tuple(spot), 0.34, math.degrees(facing) - 90, math.degrees(facing) + 90,
                           facecolor=style.RAY, edgecolor="none", zorder=6))  # fmt: skip
        ax.annotate("", spot + 1.35 * out, spot + 0.34 * out, zorder=6,
                    arrowprops={"arrowstyle": "-|>", "color": style.RAY, "lw": 0.8, "mutation_scale": 6})  # fmt: skip
        ax.text(*(spot + 1.75 * out), name, ha="center", va="center", fontsize=8, zorder=7)
    ax.plot([-robot.radius, robot.radius], [-span * 0.93] * 2, color=style.INK, linewidth=0.9, marker="|")
    ax.text(0, -span * 0.98, f"{2 * robot.radius:g} cm", ha="center", va="top", fontsize=7.5)
    ax.set_xlim(-span, span)
    ax.set_ylim(-span * 1.12, span)
    ax.set_aspect("equal")
    ax.axis("off")
    return figure


def _sensors(robot: Robot) -> list[tuple[Any, Any, str]]:
    """Place, rays and number of every sensor; an ambient one where a proximity one stands is it."""
    sensors = [(p, r, str(i)) for i, (p, r) in enumerate(zip(robot.proximity_place, robot.proximity_ray, strict=True))]
    taken = {tuple(np.round(p, 6)) for p, _, _ in sensors}
    for i, (place, ray) in enumerate(zip(robot.ambient_place, robot.ambient_ray, strict=True)):
        if tuple(np.round(place, 6)) not in taken:
            sensors.append((place, ray, f"a{i}"))
    return sensors
